"""Tracked objects in messages of other programs: states, futures and shapes as planners take them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.scenario.motions import Course, Future, Futures
from scp_planner.scenario.shapes import Disc, PolygonShape, Rectangle, Shape

_MODELS_OF_AUTOWARE = {1: "car", 2: "car", 3: "car", 4: "car", 5: "car", 6: "cyclist", 7: "pedestrian"}
_MODELS_OF_DERIVED = {4: "pedestrian", 5: "cyclist", 6: "car", 7: "car", 8: "car", 9: "car"}
_BOX, _SPHERE, _CYLINDER = 1, 2, 3  # of shape_msgs/SolidPrimitive
_CYLINDER_OF_AUTOWARE, _POLYGON_OF_AUTOWARE = 1, 2


@dataclass(frozen=True)
class Unknowns:
    """Sizes and errors of what messages leave open.

    Attributes
    ----------
    radius : float
        Of an object without a size, m.
    position, velocity : float
        Standard deviations of each coordinate where a covariance is missing, m and m/s.
    """

    radius: float = 0.4
    position: float = 0.1
    velocity: float = 0.3


@dataclass(frozen=True, eq=False)
class TrackedObject:
    """An object as a message tells of it, in the frame of the message.

    Attributes
    ----------
    id : str
    time : float
        Stamp, s.
    position : (2,) array
        m.
    velocity : (2,) array or None
        m/s; None: the message has none.
    covariance : (4, 4) array
        Of x, y, vx, vy, in m and s.
    shape : Shape
    model : str or None
        Ready-made model of its motion, by its classification.
    futures : Futures or None
        Predicted courses and their weights.
    """

    id: str
    time: float
    position: Array
    velocity: Array | None
    covariance: Array
    shape: Shape
    model: str | None = None
    futures: Futures | None = None


Reader = Callable[[Any, float, Unknowns], TrackedObject]


def tracked_objects(message: Any, unknowns: Unknowns | None = None) -> list[TrackedObject]:
    """Read the objects of a message, whichever package made its class: only its attributes are looked at.

    Parameters
    ----------
    message
        ``PredictedObjects`` or ``TrackedObjects`` of autoware_perception_msgs, ``ObjectArray`` of derived_object_msgs,
        ``Detection3DArray`` of vision_msgs (positions; a tracker's ids), ``ObstacleArray`` of nav2_dynamic_msgs, or
        ``ObstacleArrayMsg`` of costmap_converter_msgs.
    unknowns : Unknowns, optional
        Sizes, m, and standard deviations, m and m/s, where the message has none.

    Returns
    -------
    list of TrackedObject

    Raises
    ------
    ValueError
        If the message is of none of these kinds.
    """
    for field, readers in _READERS.items():
        if hasattr(message, field):
            time, left_open = seconds(message.header.stamp), unknowns or Unknowns()
            found = [_reader(each, readers)(each, time, left_open) for each in getattr(message, field)]
            return [each for each in found if np.isfinite(each.position).all()]
    raise ValueError(f"message: {type(message).__name__} holds no tracked objects")


def _reader(each: Any, readers: Mapping[str, Reader]) -> Reader:
    found = next((reader for field, reader in readers.items() if hasattr(each, field)), None)
    if found is None:
        raise ValueError(f"message: {type(each).__name__} is no tracked object of a known kind")
    return found


def seconds(stamp: Any) -> float:
    """Seconds of a stamp or a duration of ROS, s."""
    return float(getattr(stamp, "sec", 0)) + 1e-9 * float(getattr(stamp, "nanosec", 0))


def yaw_of(quaternion: Any) -> float:
    """Heading of an orientation, rad."""
    x, y, z, w = (float(getattr(quaternion, axis)) for axis in "xyzw")
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _autoware(each: Any, time: float, unknowns: Unknowns) -> TrackedObject:
    kinematics, prefix = each.kinematics, "initial_" if hasattr(each.kinematics, "predicted_paths") else ""
    pose = getattr(kinematics, prefix + "pose_with_covariance")
    twist = getattr(kinematics, prefix + "twist_with_covariance")
    heading = yaw_of(pose.pose.orientation)
    turn = _turn(heading)  # the twist is in the frame of the object
    label = max(each.classification, key=lambda one: one.probability, default=None)
    spread = _block(pose.covariance, 6, unknowns.position)
    return TrackedObject(
        id=bytes(bytearray(each.object_id.uuid)).hex(),
        time=time,
        position=_xy(pose.pose.position),
        velocity=turn @ _xy(twist.twist.linear),
        covariance=_joint(spread, turn @ _block(twist.covariance, 6, unknowns.velocity) @ turn.T),
        shape=_shape_of_autoware(each.shape, heading, _xy(twist.twist.linear), unknowns),
        model=None if label is None else _MODELS_OF_AUTOWARE.get(int(label.label)),
        futures=_futures(getattr(kinematics, "predicted_paths", ()), time, spread),
    )


def _shape_of_autoware(shape: Any, heading: float, velocity: Array, unknowns: Unknowns) -> Shape:
    length, width = float(shape.dimensions.x), float(shape.dimensions.y)
    if shape.type == _POLYGON_OF_AUTOWARE:
        return _polygon(np.array([_xy(point) for point in shape.footprint.points]) @ _turn(heading).T, unknowns)
    if shape.type == _CYLINDER_OF_AUTOWARE:
        return Disc(disc=0.5 * length if length > 0.0 else unknowns.radius)
    return _box(length, width, heading, velocity, unknowns)


def _futures(paths: Any, time: float, covariance: Array) -> Futures | None:
    """Weighted courses of predicted paths, whose poses have errors like that of the present one."""
    weights = [max(float(path.confidence), 0.0) for path in paths if len(path.path) > 1]
    usable = [path for path in paths if len(path.path) > 1 and seconds(path.time_step) > 0.0]
    if not usable or len(usable) != len(weights):
        return None
    total = sum(weights)
    shares = [weight / total if total > 0.0 else 1.0 / len(weights) for weight in weights]
    courses = [
        Course(
            time=time + seconds(path.time_step) * np.arange(len(path.path)),
            position=np.array([_xy(pose.position) for pose in path.path]),
            covariance=covariance,
        )
        for path in usable
    ]
    return Futures(futures=[Future(weight=share, motion=one) for share, one in zip(shares, courses, strict=True)])


def _derived(each: Any, time: float, unknowns: Unknowns) -> TrackedObject:
    heading, velocity, sizes = yaw_of(each.pose.orientation), _xy(each.twist.linear), list(each.shape.dimensions)
    kind = int(each.shape.type)
    if kind == _BOX and len(sizes) > 1:
        shape = _box(float(sizes[0]), float(sizes[1]), heading, velocity, unknowns)
    else:
        radius = {_SPHERE: sizes[:1], _CYLINDER: sizes[1:2]}.get(kind, [])
        shape = Disc(disc=float(radius[0]) if radius and radius[0] > 0.0 else unknowns.radius)
    spread = _joint(unknowns.position**2 * np.eye(2), unknowns.velocity**2 * np.eye(2))
    model = _MODELS_OF_DERIVED.get(int(each.classification)) if each.object_classified else None
    tracked = int(each.detection_level) > 0  # else there is no twist
    return TrackedObject(
        str(each.id), time, _xy(each.pose.position), velocity if tracked else None, spread, shape, model
    )


def _detection(each: Any, time: float, unknowns: Unknowns) -> TrackedObject:
    result = max(each.results, key=lambda one: one.hypothesis.score, default=None)
    pose, size = each.bbox.center, each.bbox.size
    spread = _block([] if result is None else result.pose.covariance, 6, unknowns.position)
    still = np.zeros(2)
    shape = _box(float(size.x), float(size.y), yaw_of(pose.orientation), still, unknowns)
    # Nobody knows in which direction it will be seen next: no rectangle that turns.
    around = Disc(disc=0.5 * math.hypot(*shape.rectangle)) if isinstance(shape, Rectangle) else shape
    joint = _joint(spread, unknowns.velocity**2 * np.eye(2))
    model = None if result is None else {"person": "pedestrian"}.get(result.hypothesis.class_id, None)
    return TrackedObject(str(each.id), time, _xy(pose.position), None, joint, around, model)


def _nav2(each: Any, time: float, unknowns: Unknowns) -> TrackedObject:
    """Sizes come without a heading: a disc covers them."""
    half = 0.5 * math.hypot(float(each.size.x), float(each.size.y))
    spread = _joint(
        _block(getattr(each, "position_covariance", []), 3, unknowns.position),
        _block(getattr(each, "velocity_covariance", []), 3, unknowns.velocity),
    )
    shape = Disc(disc=half if half > 0.0 else unknowns.radius)
    identity = bytes(bytearray(each.uuid.uuid)).hex()
    return TrackedObject(identity, time, _xy(each.position), _xy(each.velocity), spread, shape)


def _teb(each: Any, time: float, unknowns: Unknowns) -> TrackedObject:
    corners = np.array([_xy(point) for point in each.polygon.points]).reshape(-1, 2)
    center = corners.mean(axis=0) if len(corners) else np.full(2, np.nan)
    shape = _polygon(corners - center, replace(unknowns, radius=float(each.radius) or unknowns.radius))
    spread = _joint(unknowns.position**2 * np.eye(2), _block(each.velocities.covariance, 6, unknowns.velocity))
    return TrackedObject(str(each.id), time, center, _xy(each.velocities.twist.linear), spread, shape)


_READERS: dict[str, dict[str, Reader]] = {
    "objects": {"kinematics": _autoware, "detection_level": _derived},
    "detections": {"bbox": _detection},
    "obstacles": {"uuid": _nav2, "velocities": _teb},
}


def _xy(point: Any) -> Array:
    return np.array([float(point.x), float(point.y)])


def _turn(heading: float) -> Array:
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([[cos, -sin], [sin, cos]])


def _block(covariance: Any, size: int, deviation: float) -> Array:
    """Part of x and y of a covariance, row by row; a circle where it is missing, as its zeros say, or none at all."""
    values = np.asarray(covariance, dtype=float)
    if values.size == size * size:
        part = values.reshape(size, size)[:2, :2]
        if np.isfinite(part).all() and np.linalg.eigvalsh(0.5 * (part + part.T))[0] > 0.0:
            return 0.5 * (part + part.T)
    return deviation**2 * np.eye(2)


def _joint(position: Array, velocity: Array) -> Array:
    return np.block([[position, np.zeros((2, 2))], [np.zeros((2, 2)), velocity]])


def _box(length: float, width: float, heading: float, velocity: Array, unknowns: Unknowns) -> Shape:
    """Rectangle along the motion, or where it is if it stands."""
    if not (length > 0.0 and width > 0.0):
        return Disc(disc=unknowns.radius)
    stands = math.hypot(*velocity) < unknowns.velocity
    return Rectangle(rectangle=(length, width), heading=heading if stands else None)


def _polygon(corners: Array, unknowns: Unknowns) -> Shape:
    """Convex hull of corners (n, 2) m about the centre, or the disc that covers what is no polygon."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return PolygonShape(polygon=corners[ConvexHull(corners).vertices])
    except (QhullError, ValueError):
        reach = float(np.linalg.norm(corners, axis=1).max(initial=0.0))
        return Disc(disc=reach + unknowns.radius)
