"""Threat zones: where an obstacle may be, over time, with the level of confidence that was asked for.

A zone at time t is the obstacle's estimated centre + the ellipse {z : z' C(t)^-1 z <= 1} + its shape. C(t) is the
covariance of the estimate scaled by the quantile of the level (confidence.py), zero for a motion that is known.
Centres and covariances are piecewise polynomials in time. A shape is a disc, or one convex outline, or several (a
concave polygon). Rectangles and ellipses without a heading of their own turn with the direction of the velocity.

:class:`ThreatZone` is one zone in world coordinates, to look at. :class:`ZoneBatch` holds all zones of a plan, in the
planning frame, for evaluation of many at once; inflated by the vehicle's radius its distances are those of the
vehicle's reference point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import atan2, hypot
from typing import overload

import numpy as np

from scp_planner.mathematics import corridor
from scp_planner.mathematics.courses import course_covariances, course_pointing, course_polynomials
from scp_planner.mathematics.outlines import Outline, convex_pieces
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.scenario.models import Confidence, Course, KnownMotion, Model, Motion, Obstacle, Scenario
from scp_planner.scenario.shapes import Disc, Ellipse, Rectangle, Shape
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.batch import KnownDiscs, SortedZones
from scp_planner.threat_zones.zone import ThreatZone

STRAIGHT = 1e-12  # relative: velocities and accelerations that differ less in direction are in line
SLOWEST_HEADING = 0.1  # units of speed; shapes on courses that are anywhere slower are covered by discs
SLOWNESS_LOOKS = 17  # at each piece of a course
HORIZON = 120.0  # units of time; longest trip that estimated zones are made for


def zones(scenario: Scenario) -> tuple[ThreatZone, ...]:
    """Return the threat zone of every obstacle of a scenario, in order, and of what is outside its corridor.

    Parameters
    ----------
    scenario : Scenario
        Its ``confidence`` names the level that the zones of estimated obstacles hold from ``start.time`` on.

    Returns
    -------
    tuple of ThreatZone

    Raises
    ------
    ScenarioError
        If an obstacle's motion cannot be estimated, or its shape is not supported.
    """
    units = NaturalUnits.of(scenario)
    return tuple(zone.outside(units) for zone in ZonesOf(units.scenario(scenario)))


class ZonesOf(SortedZones):
    """The zones of a scenario in its natural units, each made when it is asked for.

    Most of a thousand obstacles are far away, and their zones are never asked for: a batch takes discs whose motion is
    a polynomial as the numbers that they are.

    Parameters
    ----------
    scenario : Scenario

    Raises
    ------
    ScenarioError
        As in :func:`zones`.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.discs, others = _sorted_out(scenario.obstacles)
        self._obstacles = scenario.obstacles
        self._confidence = scenario.confidence
        uncertain = sum(is_uncertain(scenario.obstacles[k]) for k in others)
        self._made = {k: _zone(scenario.obstacles[k], scenario, uncertain) for k in others}
        self.others = tuple(sorted(self._made))
        walls = corridor_zones(scenario)
        for number, wall in enumerate(walls, start=len(scenario.obstacles)):
            self._made[number] = wall
            self.others = (*self.others, number)
        self._size = len(scenario.obstacles) + len(walls)

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, index: int) -> ThreatZone: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[ThreatZone, ...]: ...

    def __getitem__(self, index: int | slice) -> ThreatZone | tuple[ThreatZone, ...]:
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(self._size)))
        if not -self._size <= index < self._size:
            raise IndexError(f"there are {self._size} zones, and none has the index {index}")
        index %= self._size
        if index not in self._made:
            obstacle = self._obstacles[index]
            assert obstacle.motion is not None
            self._made[index] = known_zone(
                obstacle.id, obstacle.shape, obstacle.margin, obstacle.motion, self._confidence
            )
        return self._made[index]


def _sorted_out(obstacles: Sequence[Obstacle]) -> tuple[KnownDiscs, list[int]]:
    """Discs whose motion is a polynomial, and the indices of all other obstacles."""
    found, rows, others = [], [], []
    for number, obstacle in enumerate(obstacles):
        motion, shape = obstacle.motion, obstacle.shape
        if type(motion) is Motion and type(shape) is Disc:
            found.append(number)
            rows.append((*motion.position, *motion.velocity, *motion.acceleration, shape.disc + obstacle.margin))
        else:
            others.append(number)
    table = np.array(rows).reshape(len(rows), 7)
    coefficients = table[:, :6].reshape(-1, 3, 2)
    coefficients[:, 2] *= 0.5
    ids = [obstacles[k].id for k in found]
    return KnownDiscs(np.array(found, dtype=np.intp), ids, table[:, 6], coefficients), others


def corridor_zones(scenario: Scenario) -> tuple[ThreatZone, ...]:
    """Return corridor and walls of a scenario as the zones of obstacles that stand: what lies outside, and walls."""
    outside = () if scenario.corridor is None else _walls(scenario.corridor)
    return (*_standing(scenario, corridor.NAME, outside), *_standing(scenario, corridor.WALLS, scenario.walls))


def _standing(scenario: Scenario, name: str, polygons: Sequence[corridor.Polygon]) -> tuple[ThreatZone, ...]:
    """Convex polygons as the zone of one obstacle that stands; none without any."""
    if not polygons:
        return ()
    middle = np.array(scenario.start.position)
    still = PiecewisePolynomials.single(0.0, middle[None])
    outlines = tuple(Outline.polygon(np.array(polygon) - middle) for polygon in polygons)
    return (ThreatZone(name, 0.0, still, None, outlines),)


@lru_cache(maxsize=16)
def _walls(polygons: Sequence[corridor.Polygon]) -> list[corridor.Polygon]:
    return corridor.outside(polygons)


def _zone(obstacle: Obstacle, scenario: Scenario, estimated: int) -> ThreatZone:
    if obstacle.motion is not None:
        confidence = scenario.confidence
        return known_zone(obstacle.id, obstacle.shape, obstacle.margin, obstacle.motion, confidence, estimated)
    body = estimated_body(obstacle.shape, obstacle.model)
    from scp_planner.estimation.confidence import region_scale
    from scp_planner.estimation.estimate import estimate_obstacle

    estimate = estimate_obstacle(obstacle)
    start = max(scenario.start.time, estimate.reference_time)  # which may be later by rounding
    scale = region_scale(
        str(scenario.confidence.level),
        scenario.confidence.probability,
        estimate,
        obstacles=estimated,
        start=start,
        stop=start + HORIZON,
    )
    pieces = estimate.polynomials(start, start + HORIZON)
    return ThreatZone(
        obstacle.id,
        body.radius + obstacle.margin + pieces.center_error,
        PiecewisePolynomials(pieces.breakpoints[None], pieces.center[None]),
        PiecewisePolynomials(pieces.breakpoints[None], scale * pieces.covariance[None]),
        body.outlines,
    )


@dataclass(frozen=True)
class Body:
    """A shape as zones take it: the sum of a disc, m, and convex outlines, or of a disc alone."""

    radius: float
    outlines: tuple[Outline, ...] = ()


def is_uncertain(obstacle: Obstacle) -> bool:
    """Whether where an obstacle is is not known exactly: it has been observed, or foretold with a covariance."""
    motion = obstacle.motion
    return motion is None or (isinstance(motion, Course) and motion.covariance is not None)


def known_zone(
    name: str, shape: Shape, margin: float, motion: KnownMotion, confidence: Confidence, uncertain: int = 1
) -> ThreatZone:
    """Return the zone of an obstacle whose motion is given, with an extra margin in m.

    Parameters
    ----------
    name, shape, margin, motion
        Of the obstacle.
    confidence : Confidence
        Of a course with a covariance.
    uncertain : int
        How many obstacles are not known exactly.

    Returns
    -------
    ThreatZone
    """
    centers = motion_polynomials(motion)
    if isinstance(motion, Course) and motion.covariance is not None:
        from scp_planner.estimation.confidence import marginal_scale

        scale = marginal_scale(str(confidence.level), confidence.probability, len(motion.time), uncertain)
        given = np.broadcast_to(np.array(motion.covariance), (len(motion.time), 2, 2))
        body = estimated_body(shape, Model())
        covariances = course_covariances(motion.time, scale * given)
        return ThreatZone(name, body.radius + margin, centers, covariances, body.outlines)
    if isinstance(shape, Disc):
        return ThreatZone(name, shape.disc + margin, centers)
    if isinstance(motion, Course) and motion.heading is not None:
        outlines = shape_outlines(shape, None)
        pointing = course_pointing(motion.time, motion.heading) if any(one.turning for one in outlines) else None
        return ThreatZone(name, margin, centers, None, outlines, pointing)
    outlines = shape_outlines(shape, _fixed_heading(centers))
    if isinstance(motion, Course) and any(outline.turning for outline in outlines) and _turns_on_the_spot(centers):
        return ThreatZone(name, covering_radius(shape) + margin, centers)
    return ThreatZone(name, margin, centers, None, outlines)


def estimated_body(shape: Shape, model: Model) -> Body:
    """Return the body of an obstacle whose motion is estimated."""
    if isinstance(shape, Disc):
        return Body(shape.disc)
    standing = model.order == 0 and model.process is None
    outlines = shape_outlines(shape, 0.0 if standing else None)
    if any(outline.turning for outline in outlines):
        # The direction of an estimated velocity may be wrong by any angle: all of them are covered.
        return Body(covering_radius(shape))
    return Body(0.0, outlines)


def motion_polynomials(motion: KnownMotion) -> PiecewisePolynomials:
    """The centre of a motion that is known, of absolute time."""
    if isinstance(motion, Course):
        return course_polynomials(motion.time, motion.position)
    half = (0.5 * motion.acceleration[0], 0.5 * motion.acceleration[1])
    return PiecewisePolynomials.single(0.0, np.array([motion.position, motion.velocity, half]))


def shape_outlines(shape: Shape, heading: float | None) -> tuple[Outline, ...]:
    """Convex outlines of a shape about its centre; none for a disc.

    Parameters
    ----------
    shape : Shape
    heading : float or None
        Of the motion, rad; None where it changes: then a shape along it turns.

    Returns
    -------
    tuple of Outline
    """
    if isinstance(shape, Disc):
        return ()
    if isinstance(shape, Rectangle):
        own = shape.heading if shape.heading is not None else heading
        return (Outline.rectangle(*shape.rectangle, own),)
    if isinstance(shape, Ellipse):
        own = shape.heading if shape.heading is not None else heading
        return (Outline.ellipse(*shape.ellipse, own),)
    return convex_pieces(shape.polygon)


def _fixed_heading(centers: PiecewisePolynomials) -> float | None:
    """Direction, rad, of a motion on a straight line, up to its sign; 0 standing; None if it changes."""
    vectors = centers.coefficients[:, :, 1:].reshape(-1, 2)
    largest = vectors[int(np.argmax(np.hypot(vectors[:, 0], vectors[:, 1])))] if len(vectors) else np.zeros(2)
    size = float(np.hypot(*largest))
    if size == 0.0:
        return 0.0
    across = np.abs(vectors[:, 0] * largest[1] - vectors[:, 1] * largest[0]) / size
    return atan2(largest[1], largest[0]) if np.all(across <= STRAIGHT * np.hypot(*vectors.T)) else None


def _turns_on_the_spot(centers: PiecewisePolynomials) -> bool:
    """Whether a course is anywhere so slow that its direction says nothing of its heading."""
    breaks = centers.breakpoints[0]
    ends = np.where(np.isfinite(breaks[1:]), breaks[1:], breaks[:-1] + 1.0)
    times = (breaks[:-1] + np.linspace(0.0, 1.0, SLOWNESS_LOOKS)[:, None] * (ends - breaks[:-1])).ravel()
    velocity = centers.derivative.at(np.zeros(len(times), dtype=np.intp), times)
    return bool(np.hypot(velocity[:, 0], velocity[:, 1]).min() < SLOWEST_HEADING)


def covering_radius(shape: Shape) -> float:
    """Radius of the disc around an obstacle's centre that covers its shape, m."""
    if isinstance(shape, Disc):
        return shape.disc
    if isinstance(shape, Rectangle):
        return 0.5 * hypot(*shape.rectangle)
    if isinstance(shape, Ellipse):
        return max(shape.ellipse)
    return max(hypot(*vertex) for vertex in shape.polygon)
