"""Replanning along a recording of a robot: tracked objects and odometry in, plans out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scp_planner.errors import MISSING, Fault, ScenarioError
from scp_planner.formats.message_types import KINDS, typestore
from scp_planner.formats.tracked_objects import Unknowns, seconds, tracked_objects, yaw_of
from scp_planner.mathematics.polylines import points_at
from scp_planner.online.planner import Planner
from scp_planner.scenario.models import Goal, Scenario, Start, Vehicle
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.recorder import Recorder
from scp_planner.simulation.run import Run

ODOMETRY = "nav_msgs/msg/Odometry"


@dataclass
class TrackFeed:
    """Tell a planner of the tracked objects in messages; one that has not been in them for a while is removed.

    Attributes
    ----------
    planner : Planner
    unknowns : Unknowns
        Sizes, m, and standard deviations, m and m/s, where messages have none.
    keep : float
        How long an object stays that messages no longer hold, s.
    """

    planner: Planner
    unknowns: Unknowns = field(default_factory=Unknowns)
    keep: float = 1.0
    _last: dict[str, float] = field(default_factory=dict)

    def take(self, message: Any) -> tuple[str, ...]:
        """Take in a message, see `scp_planner.formats.tracked_objects`; return the ids of its objects.

        Parameters
        ----------
        message
            Of any kind that `tracked_objects` reads.

        Returns
        -------
        tuple of str
        """
        found, planner = tracked_objects(message, self.unknowns), self.planner
        for each in found:
            if each.id not in self._last:
                planner.add_obstacle(each.id, each.shape, model=each.model or {"order": 1})
            if each.futures is not None:
                planner.update_motion(each.id, each.futures)
            elif each.velocity is not None:
                planner.update_obstacle(each.id, each.time, each.position, each.velocity, covariance=each.covariance)
            else:
                planner.observe(each.id, each.time, each.position, each.covariance[:2, :2])
            self._last[each.id] = each.time
        now = seconds(message.header.stamp)
        for name, time in self._last.items():
            if now - self.keep > time > -math.inf:
                planner.remove_obstacle(name)
                self._last[name] = -math.inf  # known, and gone until it comes back
        return tuple(each.id for each in found)


def replay(
    bag: str | PathLike[str],
    goal: tuple[float, float],
    scenario: Scenario | None = None,
    *,
    period: float = 0.1,
    deadline: float | None = None,
    online: OnlineSettings | None = None,
) -> Run:
    """Replan along a recording, each time from where the robot was, among the objects that it tracked.

    Parameters
    ----------
    bag : path
        Folder of a bag of ROS 2, or its MCAP file: odometry and messages of tracked objects in the same frame.
    goal : (2,)
        m.
    scenario : Scenario, optional
        Its vehicle, walls, bounds and confidence are those of the plans. None: a disc of 0.3 m that is as fast as the
        robot was, or 1 m/s, accelerates by 1 m/s2 and brakes by 2 m/s2.
    period : float
        Between two replans, s.
    deadline : float, optional
        Wall time of a replan, s.
    online : OnlineSettings, optional

    Returns
    -------
    Run
        What was driven, and a plan a replan.

    Raises
    ------
    ImportError
        If `rosbags` is not installed.
    ScenarioError
        If the recording has no odometry, or no tracked objects.
    """
    driven, seen = _read(Path(bag))
    position = np.array([pose for _, pose, _, _ in driven])
    planner = Planner(_scenario(scenario, goal, driven), online=online)
    feed, waiting = TrackFeed(planner), iter(seen)
    time = np.array([stamp for stamp, *_ in driven])
    following = next(waiting, None)
    with Recorder(planner) as recorder:
        for now in np.arange(time[0], time[-1], period).tolist():
            while following is not None and seconds(following.header.stamp) <= now:
                feed.take(following)
                following = next(waiting, None)
            index = int(np.searchsorted(time, now, "right")) - 1
            _, _, heading, speed = driven[index]
            speed = speed if planner.backs_up else abs(speed)
            planner.replan(now, points_at(now, time, position), heading, speed, deadline=deadline)
    return recorder.run()


Odometry = tuple[float, tuple[float, float], float, float]


def _read(bag: Path) -> tuple[list[Odometry], list[Any]]:
    """Odometry as time, position, heading and speed, and messages of tracked objects, by their stamps."""
    store = typestore()
    from rosbags.highlevel import AnyReader

    driven: list[Odometry] = []
    seen: list[Any] = []
    with AnyReader([bag], default_typestore=store) as reader:
        wanted = [each for each in reader.connections if each.msgtype in (*KINDS, ODOMETRY)]
        for connection, _, raw in reader.messages(connections=wanted) if wanted else ():
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.msgtype == ODOMETRY:
                driven.append(_odometry(message))
            else:
                seen.append(message)
    for kind, found in ((ODOMETRY, driven), (" or ".join(KINDS), seen)):
        if not found:
            raise ScenarioError(str(bag), [Fault("", MISSING, f"the recording has no message of {kind}")])
    return sorted(driven), sorted(seen, key=lambda each: seconds(each.header.stamp))


def _odometry(message: Any) -> Odometry:
    pose, twist = message.pose.pose, message.twist.twist.linear
    heading = yaw_of(pose.orientation)
    speed = math.copysign(math.hypot(twist.x, twist.y), twist.x)
    return seconds(message.header.stamp), (float(pose.position.x), float(pose.position.y)), heading, speed


def _scenario(given: Scenario | None, goal: tuple[float, float], driven: list[Odometry]) -> Scenario:
    time, position, heading, speed = driven[0]
    fastest = max(abs(speed) for *_, speed in driven)
    start = Start(time=time, position=position, heading=heading, speed=abs(speed))
    if given is not None:
        start = start.model_copy(update={"speed": min(speed, given.vehicle.max_speed)})
        changes = {"start": start, "goal": Goal(position=goal), "guide": None, "obstacles": ()}
        return given.model_copy(update=changes)
    vehicle = Vehicle(radius=0.3, max_speed=max(fastest, 1.0), max_acceleration=1.0, max_deceleration=2.0)
    return Scenario(name="replay", vehicle=vehicle, start=start, goal=Goal(position=goal))
