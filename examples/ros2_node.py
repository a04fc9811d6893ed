"""A ROS 2 node that plans: odometry and tracked objects in, speed and turning rate out.

python examples/ros2_node.py --goal 12 0 [--objects /perception/objects]

All that is not ROS is in `Loop`, which takes and gives messages of any make.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from typing import Any

import scp_planner as sp
from scp_planner.formats.tracked_objects import seconds, yaw_of
from scp_planner.simulation.replay import TrackFeed

VEHICLE = sp.Vehicle(radius=0.4, max_speed=1.5, max_acceleration=1.0, max_deceleration=1.5, steering="on_the_spot")
PERIOD, DEADLINE = 0.05, 0.02  # s


class Loop:
    """Planning while driving, from odometry to odometry."""

    def __init__(
        self, goal: tuple[float, float], vehicle: sp.Vehicle = VEHICLE, deadline: float | None = DEADLINE
    ) -> None:
        self.goal, self.vehicle, self.deadline = goal, vehicle, deadline
        self.planner: sp.Planner | None = None
        self.feed: TrackFeed | None = None
        self.odometry: Any = None
        self.planned = -math.inf

    def take_odometry(self, message: Any) -> None:
        """Keep the newest state; the first one begins the trip."""
        self.odometry = message
        if self.planner is None:
            time, place, heading, speed = self.state()
            scenario = sp.Scenario(
                name="drive",
                vehicle=self.vehicle,
                start=sp.Start(time=time, position=place, heading=heading, speed=min(speed, self.vehicle.max_speed)),
                goal=sp.Goal(position=self.goal, speed=0.0),
            )
            self.planner = sp.Planner(scenario, online=sp.OnlineSettings(period=PERIOD, tracking_error=0.05))
            self.feed = TrackFeed(self.planner)

    def take_objects(self, message: Any) -> None:
        """Tell the planner of tracked objects, in the frame of the odometry; those before the first state are lost."""
        if self.feed is not None:
            self.feed.take(message)

    def state(self) -> tuple[float, tuple[float, float], float, float]:
        pose, twist = self.odometry.pose.pose, self.odometry.twist.twist.linear
        heading = yaw_of(pose.orientation)
        return (
            seconds(self.odometry.header.stamp),
            (float(pose.position.x), float(pose.position.y)),
            heading,
            math.hypot(twist.x, twist.y),
        )

    def replan(self) -> sp.OnlinePlan | None:
        """Plan from the newest state; None before there is one, or if it is that of the last plan."""
        if self.planner is None:
            return None
        time, place, heading, speed = self.state()
        if time <= self.planned:
            return None
        self.planned = time
        return self.planner.replan(time, place, heading, speed, deadline=self.deadline)


def command(plan: sp.OnlinePlan, time: float, ahead: float = 0.1) -> tuple[float, float]:
    """Speed, m/s, and turning rate, rad/s, of a plan soon after a time, for a robot that takes no trajectories."""
    speed = float(plan.speed(time + ahead))
    return speed, speed * float(plan.curvature(time + ahead))


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--goal", type=float, nargs=2, default=(12.0, 0.0), metavar=("X", "Y"), help="m")
    parser.add_argument("--objects", default="/perception/object_recognition/objects", help="topic of tracked objects")
    options = parser.parse_args(argv)
    try:
        import rclpy
        from autoware_perception_msgs.msg import PredictedObjects
        from geometry_msgs.msg import Twist
        from nav_msgs.msg import Odometry
        from rclpy.node import Node
    except ImportError as missing:
        print(f"{missing}: source a workspace of ROS 2 with nav_msgs and autoware_perception_msgs", file=sys.stderr)
        return 2

    rclpy.init()
    node, loop = Node("scp_planner"), Loop((options.goal[0], options.goal[1]))
    node.create_subscription(Odometry, "/odom", loop.take_odometry, 10)
    node.create_subscription(PredictedObjects, options.objects, loop.take_objects, 10)
    drive = node.create_publisher(Twist, "/cmd_vel", 1)

    def tick() -> None:
        plan = loop.replan()
        if plan is None:
            return
        message = Twist()
        message.linear.x, message.angular.z = command(plan, loop.state()[0])
        drive.publish(message)
        if not plan.safe:
            node.get_logger().warning(f"{plan.outcome}: {plan.reason}")

    node.create_timer(PERIOD, tick)
    try:
        rclpy.spin(node)
    finally:
        drive.publish(Twist())  # stand
        node.destroy_node()
        rclpy.shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
