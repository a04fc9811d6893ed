"""Messages of tracked objects, and bags of them, for tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from scp_planner.formats.message_types import AUTOWARE, DERIVED, NAV2, TEB, VISION, typestore

Point = tuple[float, float]
types = cache(typestore)


def make(kind: str, **fields: Any) -> Any:
    return types().types[kind](**fields)


def stamp(time: float, kind: str = "Time") -> Any:
    whole = math.floor(time)
    return make(f"builtin_interfaces/msg/{kind}", sec=whole, nanosec=round(1e9 * (time - whole)))


def header(time: float) -> Any:
    return make("std_msgs/msg/Header", stamp=stamp(time), frame_id="map")


def vector(x: float, y: float, kind: str = "Vector3") -> Any:
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=0.0)


def pose(at: Point, heading: float = 0.0) -> Any:
    turn = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))
    return make("geometry_msgs/msg/Pose", position=vector(*at, "Point"), orientation=turn)


def twist(velocity: Point, kind: str = "Twist") -> Any:
    return make(f"geometry_msgs/msg/{kind}", linear=vector(*velocity), angular=vector(0.0, 0.0))


def with_covariance(kind: str, variances: Point = (0.0, 0.0), **field: Any) -> Any:
    covariance = np.zeros(36)
    covariance[0], covariance[7] = variances
    return make(f"geometry_msgs/msg/{kind}WithCovariance", **field, covariance=covariance)


def polygon(corners: Sequence[Point]) -> Any:
    points = [make("geometry_msgs/msg/Point32", x=x, y=y, z=0.0) for x, y in corners]
    return make("geometry_msgs/msg/Polygon", points=points)


def uuid(number: int) -> Any:
    return make("unique_identifier_msgs/msg/UUID", uuid=np.full(16, number, dtype=np.uint8))


def autoware(
    time: float,
    at: Point,
    velocity: Point,
    *,
    heading: float | None = None,
    label: int = 7,
    kind: int = 0,
    footprint: Sequence[Point] = (),
    predicted: bool = True,
) -> Any:
    """One object, with two predicted paths: on at its velocity, and a stand."""
    direction = math.atan2(velocity[1], velocity[0]) if heading is None else heading
    prefix, name = ("initial_", "Predicted") if predicted else ("", "Tracked")
    kinematics = {
        prefix + "pose_with_covariance": with_covariance("Pose", (0.04, 0.09), pose=pose(at, direction)),
        prefix + "twist_with_covariance": with_covariance(
            "Twist", (0.25, 0.01), twist=twist((math.hypot(*velocity), 0.0))
        ),
        prefix + "acceleration_with_covariance": with_covariance("Accel", accel=twist((0.0, 0.0), "Accel")),
    }
    if predicted:
        paths = [
            make(
                AUTOWARE + "PredictedPath",
                path=[
                    pose((at[0] + 0.5 * k * share * velocity[0], at[1] + 0.5 * k * share * velocity[1]))
                    for k in range(3)
                ],
                time_step=stamp(0.5, "Duration"),
                confidence=confidence,
            )
            for share, confidence in ((1.0, 0.6), (1.0, 0.2))
        ]
        kinematics["predicted_paths"] = paths
    else:
        kinematics.update(orientation_availability=2, is_stationary=False)
    one = make(
        f"{AUTOWARE}{name}Object",
        object_id=uuid(7),
        existence_probability=0.9,
        classification=[make(AUTOWARE + "ObjectClassification", label=label, probability=0.8)],
        kinematics=make(f"{AUTOWARE}{name}ObjectKinematics", **kinematics),
        shape=make(AUTOWARE + "Shape", type=kind, footprint=polygon(footprint), dimensions=vector(0.8, 0.6)),
    )
    return make(f"{AUTOWARE}{name}Objects", header=header(time), objects=[one])


def derived(time: float, at: Point, velocity: Point) -> Any:
    """A car, a ball, and something that was only detected."""
    sizes: Any = (([4.0, 1.8, 1.5], 1, 1, True, 6), ([0.5], 2, 1, False, 6), ([], 0, 0, False, 0))
    objects = [
        make(
            DERIVED + "Object",
            header=header(time),
            id=number,
            detection_level=level,
            object_classified=classified,
            pose=pose(at, math.atan2(velocity[1], velocity[0])),
            twist=twist(velocity),
            accel=twist((0.0, 0.0), "Accel"),
            polygon=polygon([]),
            shape=make(
                "shape_msgs/msg/SolidPrimitive", type=kind, dimensions=np.array(dimensions), polygon=polygon([])
            ),
            classification=label,
            classification_certainty=200,
            classification_age=3,
        )
        for number, (dimensions, kind, level, classified, label) in enumerate(sizes, 1)
    ]
    return make(DERIVED + "ObjectArray", header=header(time), objects=objects)


def detections(time: float, at: Point) -> Any:
    result = make(
        VISION + "ObjectHypothesisWithPose",
        hypothesis=make(VISION + "ObjectHypothesis", class_id="person", score=0.9),
        pose=with_covariance("Pose", (0.01, 0.01), pose=pose(at)),
    )
    box = make(VISION + "BoundingBox3D", center=pose(at), size=vector(0.8, 0.6))
    one = make(VISION + "Detection3D", header=header(time), results=[result], bbox=box, id="track-4")
    return make(VISION + "Detection3DArray", header=header(time), detections=[one])


def nav2(time: float, at: Point, velocity: Point) -> Any:
    one = make(
        NAV2 + "Obstacle",
        uuid=uuid(3),
        score=0.7,
        position=vector(*at, "Point"),
        velocity=vector(*velocity),
        size=vector(0.3, 0.4),
        position_covariance=np.diag([0.01, 0.01, 0.01]).ravel(),
        velocity_covariance=np.diag([0.04, 0.04, 0.04]).ravel(),
    )
    return make(NAV2 + "ObstacleArray", header=header(time), obstacles=[one])


def teb(time: float, at: Point, velocity: Point) -> Any:
    """A disc that moves, and a square."""
    square = [(4.5, 0.5), (5.5, 0.5), (5.5, 1.5), (4.5, 1.5)]
    obstacles = [
        make(
            TEB + "ObstacleMsg",
            header=header(time),
            polygon=polygon(corners),
            radius=radius,
            id=number,
            orientation=pose((0.0, 0.0)).orientation,
            velocities=with_covariance("Twist", twist=twist(speed)),
        )
        for number, (corners, radius, speed) in enumerate((([at], 0.3, velocity), (square, 0.0, (0.0, 0.0))))
    ]
    return make(TEB + "ObstacleArrayMsg", header=header(time), obstacles=obstacles)


def odometry(time: float, at: Point, heading: float, speed: float) -> Any:
    return make(
        "nav_msgs/msg/Odometry",
        header=header(time),
        child_frame_id="base_link",
        pose=with_covariance("Pose", pose=pose(at, heading)),
        twist=with_covariance("Twist", twist=twist((speed, 0.0))),
    )


def write_bag(folder: Path, messages: Sequence[Any]) -> Path:
    """Write a bag of ROS 2, a topic for each kind of message."""
    from rosbags.rosbag2 import Writer

    with Writer(folder, version=8) as writer:
        kinds = {message.__msgtype__ for message in messages}
        topics = {kind: writer.add_connection("/" + kind.split("/")[-1], kind, typestore=types()) for kind in kinds}
        for message in messages:
            kind, at = message.__msgtype__, message.header.stamp
            writer.write(topics[kind], at.sec * 10**9 + at.nanosec, types().serialize_cdr(message, kind))
    return folder
