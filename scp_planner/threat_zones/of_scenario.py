"""Threat zones: where an obstacle may be, over time, with the level of confidence that was asked for."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import atan2, hypot
from typing import TYPE_CHECKING, cast, overload

import numpy as np

from scp_planner.arrays import Index
from scp_planner.mathematics import corridor, planar
from scp_planner.mathematics.convex_pieces import convex_pieces
from scp_planner.mathematics.courses import course_covariances, course_pointing, course_polynomials
from scp_planner.mathematics.headings import course_heading
from scp_planner.mathematics.outlines import Outline
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.mathematics.tolerances import STRAIGHT
from scp_planner.pauses import GoOn, with_pauses
from scp_planner.scenario.models import Confidence, Goal, Model, Obstacle, Passage, Scenario
from scp_planner.scenario.motions import Course, Future, Futures, GivenMotion, KnownMotion, Motion, is_uncertain
from scp_planner.scenario.shapes import Disc, Ellipse, Rectangle, Shape
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.threat_zones.reach import NO_BOUNDS, VELOCITY_SHARE, Reach, followed, within_reach
from scp_planner.threat_zones.sorted_zones import KnownDiscs, SortedZones
from scp_planner.threat_zones.tolerances import FLATTEST
from scp_planner.threat_zones.zone import ThreatZone, by_obstacle
from scp_planner.tracking.motion_estimate import HORIZON

if TYPE_CHECKING:
    from scp_planner.threat_zones.widening import Widening
    from scp_planner.tracking.motion_estimate import MotionEstimate, MotionPolynomials
    from scp_planner.tracking.standing import Stand

logger = logging.getLogger(__name__)


def zones(scenario: Scenario) -> tuple[ThreatZone, ...]:
    """Return the threat zones of all obstacles of a scenario, in order, and of what is outside its corridor.

    An obstacle has one, or one for each of the several futures that it may have, the most probable one first.

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
    return zones_of(scenario)


def zones_of(scenario: Scenario, go_on: GoOn | None = None) -> tuple[ThreatZone, ...]:
    """Return the threat zones of a scenario; of many it is asked now and then whether to go on."""
    units = NaturalUnits.of(scenario)
    made = tuple(zone.outside(units) for zone in ZonesOf(units.scenario(scenario, go_on), go_on))
    tell_of_discs(scenario.obstacles, by_obstacle(made))
    return made


def tell_of_discs(obstacles: Sequence[Obstacle], several: Mapping[str, Sequence[ThreatZone]]) -> None:
    """Log which shapes are taken for the discs that cover them; for the parameters see `taken_for_discs`."""
    for told in taken_for_discs(obstacles, several):
        logger.info(told)


def taken_for_discs(obstacles: Sequence[Obstacle], several: Mapping[str, Sequence[ThreatZone]]) -> Iterator[str]:
    """Say which shapes are taken for the discs that cover them."""
    for obstacle in obstacles:
        # most are discs, whose zones need not be made for this
        shape = obstacle.shape
        if obstacle.id in several and is_taken_for_a_disc(shape, several[obstacle.id]):
            kind, radius = type(shape).__name__.lower(), covering_radius(shape)
            yield f"{obstacle.id}: taken for a disc of {radius:.3g} m, the heading of its {kind} is not known"


class ZonesOf(SortedZones):
    """The zones of a scenario in its natural units, each made when it is asked for."""

    def __init__(self, scenario: Scenario, go_on: GoOn | None = None) -> None:
        scenario = _without_whom_it_meets(scenario)
        found, others = _sorted_out(scenario.obstacles)
        self._obstacles = scenario.obstacles
        self._confidence = scenario.confidence
        uncertain = sum(is_uncertain(scenario.obstacles[k].motion) for k in others)
        estimates = _estimates(scenario, others, go_on)
        made = {
            k: _zones(scenario.obstacles[k], estimates.get(k), scenario, uncertain, go_on)
            for k in with_pauses(others, go_on)
        }
        first = _first_of_each(len(scenario.obstacles), made)
        self.discs, self._disc_of = replace(found, index=first[found.index]), found.index
        self._made = {int(first[k]) + part: zone for k, several in made.items() for part, zone in enumerate(several)}
        self.others = tuple(sorted(self._made))
        walls = corridor_zones(scenario)
        for number, wall in enumerate(walls, start=int(first[-1])):
            self._made[number] = wall
            self.others = (*self.others, number)
        self._size = int(first[-1]) + len(walls)

    @property
    def of_others(self) -> dict[str, list[ThreatZone]]:
        return by_obstacle(self._made[number] for number in self.others)

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
            obstacle = self._obstacles[self._disc_of[int(np.searchsorted(self.discs.index, index))]]
            assert obstacle.motion is not None
            (self._made[index],) = given_zones(
                obstacle.id, obstacle.shape, obstacle.margin, obstacle.motion, self._confidence
            )
        return self._made[index]


def whom_it_touches(scenario: Scenario) -> frozenset[str]:
    """Ids of obstacles that are targets, where the vehicle is to come as near as to touch them."""
    goals: list[Goal | Passage] = [scenario.goal, *scenario.goals]
    met = [(one.target.obstacle, one) for one in goals if one.target is not None]
    return frozenset(
        one.id
        for one in (scenario.obstacles if met else ())
        if any(name == one.id and is_touched(scenario, one.shape, one.margin, goal) for name, goal in met)
    )


def _without_whom_it_meets(scenario: Scenario) -> Scenario:
    met = whom_it_touches(scenario)
    if not met:
        return scenario
    return changed(scenario, obstacles=tuple(one for one in scenario.obstacles if one.id not in met))


def is_touched(scenario: Scenario, shape: Shape, margin: float = 0.0, goal: Goal | Passage | None = None) -> bool:
    """True if the vehicle is to come as near to a target of a shape as to touch it."""
    goal = goal or scenario.goal
    radius = goal.within(scenario.vehicle) if isinstance(goal, Passage) else goal.radius
    reach = scenario.vehicle.radius + radius + margin + covering_radius(shape)
    return hypot(*goal.offset) <= reach


def _first_of_each(obstacles: int, made: Mapping[int, Sequence[ThreatZone]]) -> Index:
    """Index of each obstacle's first zone, and how many there are in all: one each, but for some."""
    counts = np.ones(obstacles + 1, dtype=np.intp)
    for number, several in made.items():
        counts[number] = len(several)
    return np.cumsum(counts) - counts


def _sorted_out(obstacles: Sequence[Obstacle]) -> tuple[KnownDiscs, list[int]]:
    """Discs whose motion is a polynomial, and the indices of all other obstacles."""
    found, rows, others = [], [], []
    for number, obstacle in enumerate(obstacles):
        motion, shape = obstacle.motion, obstacle.shape
        if type(motion) is Motion and type(shape) is Disc:
            found.append(number)
            rows.append((*_powers(motion), shape.disc + obstacle.margin))
        else:
            others.append(number)
    table = np.array(rows).reshape(len(rows), 7)
    coefficients = table[:, :6].reshape(-1, 3, 2)
    ids = [obstacles[k].id for k in found]
    return KnownDiscs(np.array(found, dtype=np.intp), ids, table[:, 6], coefficients), others


def corridor_zones(scenario: Scenario) -> tuple[ThreatZone, ...]:
    """Return corridor and walls of a scenario as the zones of obstacles that stand: what lies outside, and walls."""
    start = scenario.start.position
    return (*_beside_corridor(start, scenario.corridor), *_walls(start, scenario.walls))


@lru_cache(maxsize=16)
def _beside_corridor(start: planar.Point, polygons: tuple[corridor.Polygon, ...] | None) -> tuple[ThreatZone, ...]:
    return () if polygons is None else _standing(start, corridor.NAME, corridor.known_outlines(polygons, start))


@lru_cache(maxsize=16)
def _walls(start: planar.Point, walls: tuple[corridor.Polygon, ...]) -> tuple[ThreatZone, ...]:
    return _standing(start, corridor.WALLS, corridor.outlines_from(start, walls))


def _standing(start: planar.Point, name: str, outlines: tuple[Outline, ...]) -> tuple[ThreatZone, ...]:
    """Outlines seen from a place as the zone of one obstacle that stands; none without any."""
    still = PiecewisePolynomials.single(0.0, np.array(start)[None])
    return (ThreatZone(name, 0.0, still, None, outlines),) if outlines else ()


def _estimates(scenario: Scenario, some: Iterable[int], go_on: GoOn | None) -> dict[int, MotionEstimate]:
    """Estimate the motions of those of some obstacles that are not given, by their place in the scenario."""
    unknown = [k for k in some if scenario.obstacles[k].motion is None]
    if not unknown:
        return {}
    from scp_planner.tracking.estimate import estimate_obstacles

    found = estimate_obstacles([scenario.obstacles[k] for k in unknown], go_on)
    return dict(zip(unknown, found, strict=True))


def _zones(
    obstacle: Obstacle, estimate: MotionEstimate | None, scenario: Scenario, estimated: int, go_on: GoOn | None
) -> tuple[ThreatZone, ...]:
    """Zones of an obstacle, with an estimate of its motion if that is not given."""
    name, shape, margin, confidence = obstacle.id, obstacle.shape, obstacle.margin, scenario.confidence
    if estimate is None:
        assert obstacle.motion is not None, "otherwise it is estimated"
        return given_zones(name, shape, margin, obstacle.motion, confidence, estimated, go_on)
    start = max(scenario.start.time, estimate.reference_time)  # which may be later by rounding
    body = Embodied(name, shape, estimated_body(shape, obstacle.model), margin, obstacle.model.bounds)
    return (estimated_region(body, estimate, confidence, estimated, start).zone(),)


@dataclass(frozen=True)
class Embodied:
    """An obstacle whose motion is estimated."""

    id: str
    shape: Shape
    body: Body
    margin: float  # Extra clearance, m
    bounds: tuple[float, float] = NO_BOUNDS  # Largest speed, m/s, and acceleration, m/s^2


@dataclass(frozen=True)
class EstimatedRegion:
    """Zone of an estimated motion before it is cut to what can be reached, and widened by an uncertain heading."""

    motion: MotionPolynomials
    uncut: ThreatZone
    reach: Reach | None = None
    widening: Widening | None = None
    stands: tuple[Stand, float] | None = None  # The stand, and the absolute time up to which it goes on, s

    def resized(self, uncut: ThreatZone) -> EstimatedRegion:
        """Return the region with covariances of another size: what can be reached begins in one as much larger."""
        if uncut is self.uncut or self.reach is None:
            return replace(self, uncut=uncut)
        new, old = (
            float(one.covariances.coefficients[0, 0, 0, [0, 2]].sum())
            for one in (uncut, self.uncut)
            if one.covariances is not None
        )
        return replace(self, uncut=uncut, reach=replace(self.reach, region=max(new / old, 1.0) * self.reach.region))

    def zone(self) -> ThreatZone:
        """Return the zone."""
        found = self.uncut if self.reach is None else within_reach(self.uncut, self.reach)
        if self.stands is not None:
            return _standing_first(found, *self.stands)
        if self.widening is None or found.covariances is None:
            return found
        from scp_planner.threat_zones.widening import widened

        return replace(found, covariances=widened(found.covariances, self.widening))


def _standing_first(zone: ThreatZone, stand: Stand, until: float) -> ThreatZone:
    """The region that an obstacle stands in up to a time, s, and then its zone, which begins about that place."""
    assert zone.covariances is not None, "its motion is estimated"
    span = zone.centers.breakpoints[:, [0, -1]]
    place, region = (PiecewisePolynomials(span, each[None, None, None]) for each in (stand.place, stand.region))
    shift = stand.place - zone.center(until)
    # E(C) + ball(R) is in E((1 + R / s) C + (R^2 + s R) I) with any s
    off, size = float(np.hypot(*shift)), float(np.sqrt(np.linalg.eigvalsh(zone.covariance(until))[-1]))
    grown = (1.0 + off / size) * zone.covariances.coefficients
    grown[:, :, 0, [0, 2]] += off * (off + size)
    covariances = replace(zone.covariances, coefficients=grown)
    return replace(
        zone,
        centers=followed(place, zone.centers.plus(shift), until),
        covariances=followed(region, covariances, until),
        expected=None if zone.expected is None else followed(place, zone.expected.plus(shift), until),
    )


def estimated_region(
    obstacle: Embodied,
    estimate: MotionEstimate,
    confidence: Confidence,
    estimated: int,
    start: float,
    stand: Stand | None = None,
) -> EstimatedRegion:
    """Return what the zone of an obstacle is made of whose motion is estimated."""
    from scp_planner.threat_zones.widening import HEADINGS, Split, widening_of
    from scp_planner.tracking.motion_estimate import region_scale
    from scp_planner.tracking.standing import STANDING

    body, widening = obstacle.body, None
    level, probability, sharing = str(confidence.level), confidence.probability, estimated
    begin, stop, spent, bounded = start, start + HORIZON, 0.0, obstacle.bounds != NO_BOUNDS
    split = Split.of(confidence, estimated)
    if body.turning is not None:
        widening = widening_of(body.turning, estimate, split.spending(HEADINGS.heading_share), start, HORIZON)
        if widening is not None:
            spent += HEADINGS.heading_share
            body = Body(0.0, shape_outlines(obstacle.shape, widening.heading))
    stands = None
    if stand is not None and body.turning is None:
        until = min(stand.until(STANDING.share * split.alpha), start + 0.5 * HORIZON)
        if until - start >= STANDING.least:
            spent, stands = spent + STANDING.share, (stand, until)
    if bounded:
        spent, begin = spent + VELOCITY_SHARE, min(start, estimate.reference_time)
    if spent > 0.0:
        level, probability, sharing = split.level, split.spending(1.0 - spent), 1
    scale = region_scale(level, probability, estimate, obstacles=sharing, start=begin, stop=stop)
    pieces = estimate.polynomials(start, stop)
    zone = ThreatZone(
        obstacle.id,
        body.radius + obstacle.margin + pieces.center_error,
        PiecewisePolynomials(pieces.breakpoints[None], pieces.center[None]),
        PiecewisePolynomials(pieces.breakpoints[None], scale * pieces.covariance[None]),
        body.outlines,
        until=start + HORIZON,
    )
    reach = None
    if bounded:
        reach = Reach.of(estimate, begin, scale, split.spending(VELOCITY_SHARE), obstacle.bounds)
    return EstimatedRegion(pieces, zone, reach, widening, stands)


@dataclass(frozen=True)
class Body:
    """A shape as zones take it: the sum of a disc, m, and convex outlines, or of a disc alone."""

    radius: float
    outlines: tuple[Outline, ...] = ()
    turning: Outline | None = None


def given_zones(
    name: str,
    shape: Shape,
    margin: float,
    motion: GivenMotion,
    confidence: Confidence,
    uncertain: int = 1,
    go_on: GoOn | None = None,
) -> tuple[ThreatZone, ...]:
    """Return the zones of an obstacle whose motion is given, with an extra margin in m."""
    if not is_uncertain(motion):
        futures = motion.futures if isinstance(motion, Futures) else ()
        kept = [one.motion for one in _by_weight(futures) if one.weight > 0.0] or [cast(KnownMotion, motion)]
        return tuple(_known_zone(name, shape, margin, one) for one in with_pauses(kept, go_on))
    from scp_planner.tracking.confidence import alpha_of_one

    level = str(confidence.level)
    alpha = alpha_of_one(level, confidence.probability, uncertain)
    if isinstance(motion, Futures) and len(motion.futures) > 1:
        from scp_planner.tracking.confidence import alpha_of_mixture

        of_one = alpha_of_mixture(level, alpha, uncertain)
        return tuple(with_pauses(_future_zones(name, shape, margin, motion, level, of_one), go_on))
    single = motion.futures[0].motion if isinstance(motion, Futures) else motion
    assert isinstance(single, Course)
    return (_course_zone(name, shape, margin, single, level, alpha),)


def _by_weight(futures: Sequence[Future]) -> list[Future]:
    """Futures, the most probable one first."""
    return sorted(futures, key=lambda future: -future.weight)


def _future_zones(
    name: str, shape: Shape, margin: float, motion: Futures, level: str, alpha: float
) -> Iterator[ThreatZone]:
    """Yield the zones of several futures, which all together miss the obstacle with at most a probability of alpha."""
    from scp_planner.tracking.confidence import course_scale, shared_risk, sizes_of

    futures = _by_weight(motion.futures)
    weights = np.array([one.weight for one in futures])
    counts = [len(one.motion.time) if isinstance(one.motion, Course) else 1 for one in futures]
    scales = np.array([course_scale(level, alpha, count) for count in counts])
    sizes = sizes_of(np.array([_spread(one.motion) for one in futures]), scales, covering_radius(shape) + margin)
    for one, risk in zip(futures, shared_risk(weights / weights.sum(), sizes, alpha).tolist(), strict=True):
        if risk >= 1.0:
            continue  # improbable enough
        if isinstance(one.motion, Course) and one.motion.covariance is not None:
            yield _course_zone(name, shape, margin, one.motion, level, risk)
        else:
            yield _known_zone(name, shape, margin, one.motion)


def _spread(motion: KnownMotion) -> float:
    """Standard deviation of a motion, m, the mean over its times and directions; 0 where it is known exactly."""
    if not isinstance(motion, Course) or motion.covariance is None:
        return 0.0
    given = np.array(motion.covariance)
    # Of one that is nearly singular, rounding may leave a determinant of nothing or less.
    least = (FLATTEST * np.trace(given, axis1=-2, axis2=-1)) ** 2
    return float(np.sqrt(np.mean(np.sqrt(np.maximum(np.linalg.det(given), least)))))


def _course_zone(name: str, shape: Shape, margin: float, course: Course, level: str, alpha: float) -> ThreatZone:
    """Zone of a course with a covariance that misses it with a probability of at most alpha."""
    from scp_planner.tracking.confidence import course_scale

    scale = course_scale(level, alpha, len(course.time))
    given = np.broadcast_to(np.array(course.covariance), (len(course.time), 2, 2))
    body = estimated_body(shape, Model())
    covariances = course_covariances(course.time, scale * given)
    return ThreatZone(name, body.radius + margin, motion_polynomials(course), covariances, body.outlines)


def _known_zone(name: str, shape: Shape, margin: float, motion: KnownMotion) -> ThreatZone:
    """Zone of a motion that is known exactly."""
    centers = motion_polynomials(motion)
    if isinstance(shape, Disc):
        return ThreatZone(name, shape.disc + margin, centers)
    if isinstance(motion, Course) and motion.heading is not None:
        outlines = shape_outlines(shape, None)
        pointing = course_pointing(motion.time, motion.heading) if any(one.turning for one in outlines) else None
        return ThreatZone(name, margin, centers, None, outlines, pointing)
    outlines = shape_outlines(shape, _fixed_heading(centers))
    pointing = None
    if isinstance(motion, Course) and any(outline.turning for outline in outlines):
        pointing = course_heading(centers, 2.0 * covering_radius(shape))
        if pointing is None:
            return ThreatZone(name, covering_radius(shape) + margin, centers)
    return ThreatZone(name, margin, centers, None, outlines, None if pointing is centers else pointing)


def estimated_body(shape: Shape, model: Model) -> Body:
    """Return the body of an obstacle whose motion is estimated."""
    if isinstance(shape, Disc):
        return Body(shape.disc)
    standing = model.order == 0 and model.process is None
    outlines = shape_outlines(shape, 0.0 if standing else None)
    if any(outline.turning for outline in outlines):
        # The direction of an estimated velocity may be wrong by any angle, as long as nobody bounds it.
        return Body(covering_radius(shape), (), outlines[0])
    return Body(0.0, outlines)


def motion_polynomials(motion: KnownMotion) -> PiecewisePolynomials:
    """The centre of a motion that is known, of absolute time."""
    if isinstance(motion, Course):
        return course_polynomials(motion.time, motion.position)
    return PiecewisePolynomials.single(0.0, np.array(_powers(motion)).reshape(3, 2))


def _powers(motion: Motion) -> tuple[float, ...]:
    """Coefficients of 1, t and t^2 of a motion, x and y in turn; t is absolute time, and not counted from its own."""
    since, (x, y), (u, v), (a, b) = motion.reference_time, motion.position, motion.velocity, motion.acceleration
    place = x - since * (u - 0.5 * since * a), y - since * (v - 0.5 * since * b)
    return *place, u - since * a, v - since * b, 0.5 * a, 0.5 * b


def shape_outlines(shape: Shape, heading: float | None) -> tuple[Outline, ...]:
    """Convex outlines of a shape about its centre; none for a disc."""
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


def is_taken_for_a_disc(shape: Shape, several: Sequence[ThreatZone]) -> bool:
    """True if any zone of an obstacle is that of a disc that covers its shape, for want of a heading."""
    return isinstance(shape, Rectangle | Ellipse) and not all(zone.outlines for zone in several)


def covering_radius(shape: Shape) -> float:
    """Radius of the disc around an obstacle's centre that covers its shape, m."""
    if isinstance(shape, Disc):
        return shape.disc
    if isinstance(shape, Rectangle):
        return 0.5 * hypot(*shape.rectangle)
    if isinstance(shape, Ellipse):
        return max(shape.ellipse)
    return max(hypot(*vertex) for vertex in shape.polygon)
