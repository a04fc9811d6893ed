"""Any answer against its promises, by the dense check, in the units of its scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
import shapely.affinity

import scp_planner as sp
from benchmarks.hostile.features import Data
from benchmarks.hostile.scaling import scaled
from scp_planner.scenario.models import Obstacle
from scp_planner.scenario.motions import Course, Futures, is_uncertain
from scp_planner.threat_zones.of_scenario import given_zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.tracking.confidence import alpha_of_one, marginal_scale
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.motion_estimate import region_scale
from verification.dense_check import SAMPLES, check_trip
from verification.differences import ACCELERATION_WINDOW, CHORD_LENGTH, SPEED_WINDOW, Array
from verification.findings import Tolerances

ROUNDING = 8.0 * np.finfo(float).eps
UNITS = 20.0
"""Units of length of a trip: tolerances follow from its length."""
SECONDS = 3.0 / UNITS
"""Unit of time of a trip, of its duration, at most."""
USERS = 1e-5
"""Of the trip's length, by which a user's constraint may be missed."""
GOAL_SPEED_SHARE = 1e-3 / 3.0
"""Of the highest speed, by which the goal's may be missed: the page of the certificate says so."""


@dataclass(frozen=True)
class Drive:
    """A plan in the units of its scene.

    Attributes
    ----------
    plan : Plan
    length, time : float
        m and s.
    turn : float
        rad, by which the vehicle heads elsewhere than the plan says: pi of a plan that is driven backwards.
    """

    plan: sp.Plan
    length: float = 1.0
    time: float = 1.0
    turn: float = 0.0

    @property
    def begin(self) -> float:
        """Time of the start."""
        return self.plan.start_time / self.time

    @property
    def end(self) -> float:
        """Time of the arrival."""
        return self.plan.arrival_time / self.time

    def position(self, times: Any) -> Array:
        """Positions (n, 2) at times (n,)."""
        return self.plan.position(np.asarray(times) * self.time) / self.length

    def heading(self, times: Any) -> Array:
        """Headings (n,) at times (n,), rad."""
        return self.plan.heading(np.asarray(times) * self.time) + self.turn

    def speed(self, when: float) -> float:
        """Signed speed at a time."""
        moment = when * self.time
        pace = float(self.plan.speed(moment)) * self.time / self.length
        return -pace if self.turn or bool(self.plan.backward(moment)) else pace


def goal_speed_missed(data: Mapping[str, Any]) -> float:
    """How far off the speed at the goal may be in a scenario, as a dict, m/s."""
    return Tolerances().boundary_speed + GOAL_SPEED_SHARE * float(data["vehicle"]["max_speed"])


def tolerances(data: Mapping[str, Any], places: Array, times: Array) -> Tolerances:
    """How far off a trip through places (n, 2), m, at times (n,), s, may be: by its units, and by rounding."""
    usual = Tolerances()
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    unit = max(1.0, length / UNITS)
    top = float(data["vehicle"]["max_speed"])
    off = ROUNDING * (float(np.abs(places).max()) + top * float(np.abs(times).max()))
    rough = 4.0 * off / (SPEED_WINDOW * ACCELERATION_WINDOW)
    bent = 8.0 * off / CHORD_LENGTH**2
    return replace(
        usual,
        start_time=usual.start_time + 1e-6 * SECONDS * float(np.ptp(times)),
        position=2.0 * usual.position * unit + off,
        clearance=usual.clearance + 1e-6 * unit + off,
        speed=usual.speed + 2.0 * off / SPEED_WINDOW,
        boundary_speed=usual.boundary_speed + 10.0 * off / 1e-4,
        acceleration=usual.acceleration + rough,
        jerk=usual.jerk + 40.0 * rough,
        curvature=usual.curvature + bent,
        curvature_rate=usual.curvature_rate + 40.0 * bent,
        lateral_acceleration=usual.lateral_acceleration + bent * top**2,
        heading=usual.heading + 4.0 * off / 1e-4,
        goal_speed=goal_speed_missed(data),
    )


def contents(scenario: sp.Scenario, scene: Data) -> Data:
    """Give a scenario as a dict in the units of its scene, but for its map, which need be in no file."""
    data = scenario.model_copy(update={"ground": None}).to_dict()
    return dict(scaled(data, 1.0 / scene["length"], 1.0 / scene["time"]))


def occupied_ground(ground: Data | None) -> Any:
    """Make a shapely geometry of the occupied cells of a map, and of what lies beyond it."""
    if ground is None:
        return None
    cells, edge = np.array(ground["cells"], dtype=bool), ground["resolution"]
    rows, columns = np.nonzero(cells)
    parts = [*shapely.box(columns * edge, rows * edge, (columns + 1) * edge, (rows + 1) * edge)]
    height, width = cells.shape
    if ground["beyond"]:
        frame, far = shapely.box(0.0, 0.0, width * edge, height * edge), 1e3 * (width + height) * edge
        parts.append(frame.buffer(far, join_style="mitre").difference(frame))
    turned = shapely.affinity.rotate(shapely.union_all(parts), ground["yaw"], origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, *ground["origin"])


def refused(
    scene: Data,
    scenario: sp.Scenario,
    drive: Drive,
    *,
    data: Mapping[str, Any] | None = None,
    begin: float | None = None,
    end: float | None = None,
    samples: int = SAMPLES,
    lowered: bool = False,
    speed_met: float = 0.0,
) -> str:
    """Say what a drive that is said to be certified breaks of its scenario; nothing if nothing.

    Parameters
    ----------
    scene : dict
        With the map, and the least time that a user's constraint asks for.
    scenario : Scenario
        With the obstacles of which the regions are to be known.
    drive : Drive
    data : mapping, optional
        What is promised, if it is not the scenario.
    begin, end : float, optional
        Times from which and to which it is promised; None: all of the drive.
    samples : int
    lowered : bool
        As for `check_trip`.
    speed_met : float
        By how much more than usual the speed at the end may be off.
    """
    data = contents(scenario, scene) if data is None else data
    begin, end = drive.begin if begin is None else begin, drive.end if end is None else end
    least = scene.get("least_time")
    if not (math.isfinite(begin) and math.isfinite(end)):
        return f"from {begin} to {end}"
    if not end > begin:
        return ""
    times = np.linspace(begin, end, 200)
    places = drive.position(times)
    allowed = tolerances(data, places, times)
    allowed = replace(allowed, goal_speed=allowed.goal_speed + speed_met)
    report = check_trip(
        data,
        lambda t: drive.position(np.clip(t, begin, end)),
        begin,
        end,
        heading=lambda t: drive.heading(np.clip(t, begin, end)),
        ground=occupied_ground(scene["map"]),
        regions=regions(scenario, end * drive.time),
        tolerances=allowed,
        samples=samples,
        lowered=lowered,
    )
    missed = [] if report.ok else [str(report)]
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    if least is not None and drive.end - drive.begin < least - USERS * max(length, 1.0):
        missed.append(f"travel_time {drive.end - drive.begin:.9g} against {least:.9g} of the user's constraint")
    return "; ".join(missed)


def regions(scenario: sp.Scenario, until: float) -> dict[str, float]:
    """Size of each confidence region up to a time, s; the level is the planner's business, not the check's."""
    level, probability = str(scenario.confidence.level), scenario.confidence.probability
    start = scenario.start.time
    uncertain = [each for each in scenario.obstacles if is_uncertain(each.motion)]
    found: dict[str, float] = {}
    for each in uncertain:
        if each.motion is None:
            estimate = estimate_obstacle(each)
            found[each.id] = region_scale(
                level, probability, estimate, obstacles=len(uncertain), start=start, stop=max(until, start)
            )
        elif isinstance(each.motion, Futures):
            found |= _of_futures(each, each.motion, scenario, len(uncertain))
        else:
            assert isinstance(each.motion, Course)
            found[each.id] = marginal_scale(level, probability, len(each.motion.time), len(uncertain))
    return found


def _of_futures(obstacle: Obstacle, motion: Futures, scenario: sp.Scenario, uncertain: int) -> dict[str, float]:
    """Size of the region of each future, read off its zone; of one that is improbable enough there is none.

    Raises
    ------
    AssertionError
        If all together miss the obstacle with more than the probability that is left to it.
    """
    confidence, found, missed = scenario.confidence, {}, 0.0
    zones = given_zones(obstacle.id, obstacle.shape, obstacle.margin, motion, confidence, uncertain)
    level = str(confidence.level)
    for k, future in enumerate(motion.futures):
        course = future.motion
        if not isinstance(course, Course) or course.covariance is None:
            continue  # known exactly, and kept clear of
        times = np.array(course.time)
        given = np.broadcast_to(np.array(course.covariance), (len(times), 2, 2))
        own = [each for each in zones if _is_about(each, course)]
        if not own:
            missed += future.weight
            continue
        assert own[0].covariances is not None
        scaled = own[0].covariances.grid(times[:1]).ravel()
        scale = float(scaled[0] / given[0, 0, 0])
        found[f"{obstacle.id}[{k}]"] = scale
        once = math.exp(-0.5 * scale)
        missed += future.weight * (once if level == "per_time" else -math.expm1(len(times) * math.log1p(-once)))
    alpha = alpha_of_one(level, confidence.probability, uncertain)
    assert missed <= alpha * (1.0 + 1e-6), f"{obstacle.id}: missed with {missed}, {alpha} allowed"
    return found


def _is_about(zone: ThreatZone, course: Course) -> bool:
    place = zone.centers.grid(np.array(course.time[:1])).ravel()
    return zone.covariances is not None and math.dist(place, course.position[0]) < 1e-6 * (1.0 + math.hypot(*place))
