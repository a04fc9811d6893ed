"""The certificate against trips evaluated by scipy: it refuses what is wrong by little, between any samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference_trips import (
    BREAKS,
    FRAME,
    GOAL,
    RADIUS,
    SEEDS,
    Reference,
    broken,
    elliptic_zone,
    least,
    passing,
    random_trip,
    the_scene,
    vehicle_limits,
    verdict,
)
from scenes import disc, scene

import scp_planner as sp
from scp_planner.certificate.check import certify_trip
from scp_planner.certificate.checked_trip import Scope
from scp_planner.certificate.remembered import Motions
from scp_planner.errors import EstimationError
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polynomials import PiecewisePolynomials
from scp_planner.scenario.units import NaturalUnits
from scp_planner.threat_zones.error_tube import TrackingTube
from scp_planner.threat_zones.of_scenario import corridor_zones
from scp_planner.threat_zones.zone import ThreatZone
from scp_planner.trips.guide import CurvedGuide, StraightGuide
from scp_planner.trips.path import Path
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


@pytest.mark.parametrize("speed", [0.5, 3.0, 30.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_cut_of_a_millimetre_into_a_zone_is_refused_and_a_miss_of_one_is_not(seed: int, speed: float) -> None:
    trip = random_trip(seed, acceleration_degree=seed % 3)
    reference = Reference(trip)
    near = passing(reference, seed, speed)

    for depth in (1e-3, 1e-6):
        cut = verdict(the_scene(near.obstacle(depth)), trip)
        assert broken(cut) == {"clearance"}
        (violation,) = cut.violations
        assert violation.obstacle == "passing"
        assert -depth - 1e-8 <= violation.value < 0.0
        assert violation.time == pytest.approx(near.time + FRAME.time, abs=0.1)
        assert cut.clearance.minimum == violation.value

    for depth in (-1e-3, -1e-6):
        missed = verdict(the_scene(near.obstacle(depth)), trip)
        assert broken(missed) == set()
        assert 0.0 <= missed.clearance.minimum <= -depth + 1e-8
        assert missed.clearance.obstacle == "passing"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cut_into_the_growing_ellipse_of_an_estimate_is_refused(seed: int) -> None:
    trip = random_trip(seed)
    reference = Reference(trip)
    zone, distance = elliptic_zone(reference, seed)
    assert distance > RADIUS
    scenario = the_scene()

    cut = verdict(scenario, trip, (replace(zone, radius=distance - RADIUS + 1e-3),))
    assert broken(cut) == {"clearance"}
    assert cut.violations[0].obstacle == "seen"
    assert -1e-3 - 1e-5 <= cut.violations[0].value < 0.0

    missed = verdict(scenario, trip, (replace(zone, radius=distance - RADIUS - 1e-3),))
    assert broken(missed) == set()
    assert 0.0 <= missed.clearance.minimum <= 1e-3 + 1e-5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_zone_that_darts_in_and_out_between_samples_is_seen(seed: int) -> None:
    """Pieces of an obstacle's motion may begin and end anywhere, also within one interval of the certificate."""
    trip = random_trip(seed)
    reference = Reference(trip)
    rng = np.random.default_rng(seed)
    begin = FRAME.time + rng.uniform(0.3, 0.7) * reference.tau
    here = reference.position(np.array([begin - FRAME.time]))[0]
    # Stands 2 m aside, comes and goes at constant acceleration in four parts of a millisecond, stands again
    aside, step = here + np.array([2.0, 0.0]), 1e-3
    push = -1.9 / step**2 / 2.0 * np.array([1.0, 0.0])  # half the acceleration
    half_way = aside + push * step**2
    in_place = half_way + 2.0 * push * step**2 - push * step**2
    fast = 2.0 * push * step
    pieces = np.array(
        [
            [aside, [0, 0], [0, 0]],
            [aside, [0, 0], push],
            [half_way, fast, -push],
            [in_place, [0, 0], -push],
            [half_way, -fast, push],
            [aside, [0, 0], [0, 0]],
        ]
    )
    edges = np.concatenate([[FRAME.time], begin + step * np.arange(5), [np.inf]])
    zone = ThreatZone("darting", 0.5, PiecewisePolynomials(edges[None], pieces[None]))
    times = np.linspace(begin, begin + 4 * step, 401)
    assert zone.signed_distance(times, reference.position(times - FRAME.time)).min() < -0.3
    assert broken(verdict(the_scene(), trip, (zone,))) == {"clearance"}


def test_ends_that_differ_from_the_scenario_are_refused() -> None:
    trip = random_trip(1)
    reference = Reference(trip)
    final = float(reference.speed(np.array([reference.tau]))[0])
    headings = [FRAME.heading + float(np.arctan(reference.offset(s, nu=1))) for s in (0.0, 20.0)]
    frame, tiny = trip.frame, 1e-3

    right = the_scene(start={"heading": headings[0]}, goal={"heading": headings[1], "speed": final})
    assert broken(verdict(right, trip)) == set()
    turned = the_scene(start={"heading": headings[0] + 2.0 * np.pi}, goal={"heading": headings[1] - 2.0 * np.pi})
    assert broken(verdict(turned, trip)) == set()

    for scenario, what in (
        (the_scene(start={"heading": headings[0] + tiny}), "start heading"),
        (the_scene(goal={"heading": headings[1] - tiny}), "goal heading"),
        (the_scene(start={"heading": headings[0] + np.pi}), "start heading"),
        (the_scene(start={"speed": 1.0 + tiny}), "start speed"),
        (the_scene(goal={"speed": final + 2.0 * tiny}), "goal speed error"),
        (the_scene(start={"time": FRAME.time + tiny}), "start time"),
        (the_scene(start={"position": [3.0 + tiny, -2.0]}), "distance from the start"),
        (the_scene(goal={"position": [GOAL[0], GOAL[1] - tiny]}), "distance from the goal"),
        (the_scene(goal={"position": [GOAL[0], GOAL[1] - 0.2], "radius": 0.199}), "distance from the goal"),
    ):
        assert broken(verdict(scenario, trip)) == {what}
    inside = the_scene(goal={"position": [GOAL[0], GOAL[1] - 0.2], "radius": 0.201})
    assert broken(verdict(inside, trip)) == set()

    moved = replace(frame, origin=(frame.origin[0], frame.origin[1] + tiny))
    assert broken(verdict(the_scene(), Trip(moved, trip.trajectory))) == {
        "distance from the start",
        "distance from the goal",
    }


@pytest.mark.parametrize("factor", [0.999, 1.001])
def test_a_travel_time_that_does_not_fit_path_and_speed_is_refused(factor: float) -> None:
    """Longer, and the vehicle would stand still at the goal while its speed says that it moves."""
    whole = random_trip(1).trajectory
    trip = Trip(FRAME, Trajectory(whole.path, whole.beta, factor * whole.travel_time))
    assert not verdict(the_scene(), trip).holds


def test_what_is_not_a_number_is_refused() -> None:
    whole = random_trip(1).trajectory
    for theta_spoilt, beta_spoilt in ((4, None), (None, 3)):
        theta, beta = whole.theta.copy(), whole.beta.copy()
        if theta_spoilt is not None:
            theta[theta_spoilt] = np.nan
        if beta_spoilt is not None:
            beta[beta_spoilt] = np.nan
        with np.errstate(invalid="ignore"):
            trip = Trip(FRAME, Trajectory(Path(whole.space, theta), beta, whole.travel_time))
            assert not verdict(the_scene(), trip).holds


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["low", "high"])
@pytest.mark.parametrize("axis", [0, 1], ids=["x", "y"])
def test_leaving_the_workspace_between_samples_is_refused(axis: int, sign: float) -> None:
    frame = PlanningFrame((3.0, -2.0), (0.5 * np.pi, 0.0)[axis], 5.0)
    trip = random_trip(4, frame=frame)
    reference = Reference(trip)
    goal = {"position": frame.to_world(np.array([20.0, 0.0])).tolist()}
    where, extreme = least(lambda t: sign * reference.position(t)[:, axis], 0.0, reference.tau)
    assert 0.5 < where < reference.tau - 0.5
    for slip, expected in ((1e-5, {"workspace bounds"}), (-1e-5, set())):
        walls = {"min": [-50.0, -50.0], "max": [50.0, 50.0]}
        walls["min" if sign > 0.0 else "max"][axis] = sign * (extreme - RADIUS + slip)
        assert broken(verdict(the_scene(bounds=walls, goal=goal), trip)) == expected


def test_a_gap_exactly_as_wide_as_the_vehicle_is_refused_at_once() -> None:
    walls = [
        {
            "id": name,
            "shape": {"rectangle": [6.0, 3.0], "heading": 0.0},
            "motion": {"position": [10.0, side * (1.8 - 1e-11)]},
        }
        for name, side in (("upper", 1.0), ("lower", -1.0))
    ]
    # Halving the intervals along the walls, where the distance is nothing but rounding, would take all memory.
    certificate = sp.certify(scene(*walls), sp.plan(scene()))
    (violation,) = certificate.violations
    assert (violation.what, violation.obstacle in ("upper", "lower")) == ("clearance", True)
    assert abs(violation.value) < 1e-9


def test_all_that_is_wrong_is_named_at_once() -> None:
    trip = random_trip(1)
    reference = Reference(trip)
    worst = vehicle_limits(reference)
    scenario = the_scene(
        passing(reference, 1, 3.0).obstacle(0.2),
        vehicle={name: 0.9 * value for name, value in worst.items()},
        start={"speed": 1.1},
    )
    certificate = verdict(scenario, trip)
    assert broken(certificate) == {
        "start speed",
        "speed",
        "acceleration",
        "curvature",
        "lateral_acceleration",
        "clearance",
    }
    assert "clearance to passing -0." in str(certificate.violations[-1])


def test_a_clearance_that_is_no_number_is_none() -> None:
    trip = random_trip(0)
    zone, _ = elliptic_zone(Reference(trip), 0)
    certificate = verdict(the_scene(), trip, (replace(zone, radius=np.nan),))
    assert broken(certificate) == {"clearance"}


def test_a_path_with_a_cusp_is_refused() -> None:
    bend = CurvedGuide(20.0, np.linspace(0.0, 4.0, 21))  # a radius of 5 m, round which a path at 5 m turns on the spot
    space = TripSpace(bend, 1.0, 3, 4, 0, BREAKS)
    theta = np.full(space.path_size, 0.0)
    theta[2:5] = 5.0
    trip = Trip(FRAME, Trajectory.of(space, theta, np.zeros(space.acceleration_size)))
    found = verdict(the_scene(), trip)
    assert not found.holds
    assert [violation.what for violation in found.violations] == ["error of the positions"]


@pytest.mark.parametrize("side", [1.0, 30.0, -30.0])
def test_what_has_left_the_corridor_beyond_its_walls_is_not_in_it(side: float) -> None:
    """Its outside is covered up to some lengths: what drives on there, far from it, touches none of that."""
    trip = random_trip(1)
    origin, along = np.array(FRAME.origin), np.array([np.cos(FRAME.heading), np.sin(FRAME.heading)])
    across = np.array([-along[1], along[0]])
    corners = ((-5.0, -4.0), (25.0, -4.0), (25.0, 4.0), (-5.0, 4.0))
    corridor = tuple(tuple((origin + x * along + (y + side - 1.0) * across).tolist()) for x, y in corners)
    scenario = the_scene().model_copy(update={"corridor": (corridor,)})
    zones = corridor_zones(scenario)
    for scope in (Scope(), Scope(FRAME.time + 1.0)):
        motions = Motions()
        for _ in range(2):
            found = certify_trip(scenario, trip, zones, scope, motions=motions)
            assert found.holds == (side == 1.0)
            assert {one.obstacle for one in found.violations} == (set() if side == 1.0 else {"corridor"})
    disc_ahead = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"discs": (0.0, 30.0)})})
    assert not certify_trip(disc_ahead, trip, zones).holds


# The certificate's bounds of what limits are used, against fine searches


@pytest.mark.parametrize(
    ("limit", "name", "share"),
    [
        ("max_speed", "speed", 2e-6),  # control points of smooth profiles lie farther beyond it than that
        ("max_acceleration", "acceleration", 2e-6),
        ("max_deceleration", "acceleration", 2e-6),
        ("max_curvature", "curvature", 1e-3),
        ("max_lateral_acceleration", "lateral_acceleration", 1e-3),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_limit_broken_by_a_share_of_it_is_refused(seed: int, limit: str, name: str, share: float) -> None:
    trip = random_trip(seed, path_degree=3 + seed % 3, acceleration_degree=seed // 3 % 3)
    worst = vehicle_limits(Reference(trip))[limit]
    assert worst > 0.0

    refused = verdict(the_scene(vehicle={limit: worst / (1.0 + share)}), trip)
    assert broken(refused) == {name}
    (violation,) = refused.violations
    assert abs(violation.value) == pytest.approx(worst, rel=share)
    assert abs(violation.allowed) == pytest.approx(worst / (1.0 + share))

    kept = verdict(the_scene(vehicle={limit: worst * (1.0 + 1e-6)}), trip)
    assert broken(kept) == set()
    assert abs(kept.limits[name].worst) == pytest.approx(worst, rel=2e-3)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_peak_of_curvature_between_knots_is_found(seed: int) -> None:
    trip = random_trip(seed, path_degree=5, arc=1.2)
    reference = Reference(trip)
    where, value = least(lambda s: -np.abs(reference.curvature_at(s)), 0.0, 20.0, 200001)
    assert np.abs(reference.station_knots - where).min() > 0.05
    assert broken(verdict(the_scene(vehicle={"max_curvature": -value * (1.0 - 1e-6)}), trip)) == {"curvature"}
    assert broken(verdict(the_scene(vehicle={"max_curvature": -value * (1.0 + 1e-6)}), trip)) == set()


def test_driving_backwards_is_refused() -> None:
    space = TripSpace(StraightGuide(20.0), 1.0, 3, 9, 0, (0.0, 0.3, 0.6, 1.0))
    beta = np.array([-0.5, 0.5, 0.6])
    trip = Trip(FRAME, Trajectory.of(space, np.zeros(space.path_size), beta))
    assert Reference(trip).speed(np.array([0.3 * trip.trajectory.travel_time]))[0] < 0.0
    assert broken(verdict(the_scene(), trip)) == {"speed"}


# The certificate of a vehicle that stays in a tube round its trip, against dense samples of speed and curvature

TUBE = TrackingTube(0.01, 0.02, 0.04, max_speed=4.0, max_lateral=3.0, probability=0.95, records=40)
POST, CROSSER = (9.0, 0.1), (14.0, -6.0)
SIZE, ROOM = 0.5, 0.3
STEPS = 40_000


def among(radius: float) -> sp.Scenario:
    return scene(
        disc("post", POST, radius=radius),
        disc("crosser", CROSSER, (0.0, 1.0), radius=radius),
        vehicle={"discs": [0.0, 0.4]},
    )


@pytest.fixture(scope="module")
def planned() -> tuple[sp.Scenario, sp.Plan]:
    """A scene, and a plan that has room in it: one among larger obstacles."""
    return among(SIZE), sp.plan(among(SIZE + ROOM))


def densely(scenario: sp.Scenario, plan: sp.Plan, tube: TrackingTube) -> float:
    """Least distance of the vehicle's discs to both obstacles, less the tube, at many times."""
    t = np.linspace(scenario.start.time, plan.arrival_time, STEPS)
    speed, curvature, heading = plan.speed(t), plan.curvature(t), plan.heading(t)
    off = tube.standing + tube.per_speed * speed + tube.per_lateral * speed**2 * np.abs(curvature)
    least = np.inf
    for offset in scenario.vehicle.discs:
        place = plan.position(t) + offset * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        for center in (np.array(POST), np.array(CROSSER) + (t - scenario.start.time)[:, None] * [0.0, 1.0]):
            apart = np.hypot(*(place - center).T) - SIZE - scenario.vehicle.radius - off
            least = min(least, float(apart.min()))
    return least


def scaled(factor: float) -> TrackingTube:
    sizes = {name: factor * getattr(TUBE, name) for name in ("standing", "per_speed", "per_lateral")}
    return replace(TUBE, **sizes)


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.0])
def test_each_piece_of_a_trip_has_the_room_that_it_needs(planned: tuple[sp.Scenario, sp.Plan], factor: float) -> None:
    scenario, plan = planned
    found, dense = sp.certify(scenario, plan, tube=scaled(factor)), densely(scenario, plan, scaled(factor))
    assert found.holds and dense > 0.0
    precision = 1e-3 * NaturalUnits.of(scenario).length
    assert dense - precision - 1e-6 <= found.clearance.minimum <= dense + 1e-9


def test_what_the_tube_touches_is_refused(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    assert densely(scenario, plan, scaled(3.0)) < 0.0
    found = sp.certify(scenario, plan, tube=scaled(3.0))
    assert not found.holds and {one.what for one in found.violations} == {"clearance"}


def test_tube_by_piece_asks_for_less_than_its_bound(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    whole = sp.certify(scenario, plan).clearance.minimum - TUBE.bound(scenario.vehicle)
    assert sp.certify(scenario, plan, tube=TUBE).clearance.minimum > whole + 0.05 * TUBE.bound(scenario.vehicle)


def test_tube_leaves_the_workspace_before_the_vehicle_does(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    t = np.linspace(scenario.start.time, plan.arrival_time, STEPS)
    tip = plan.position(t) + 0.4 * np.stack([np.cos(plan.heading(t)), np.sin(plan.heading(t))], axis=1)
    y = np.concatenate([plan.position(t)[:, 1], tip[:, 1]])
    off = np.tile(TUBE.radius(plan.speed(t), plan.speed(t) ** 2 * np.abs(plan.curvature(t))), 2)
    for room, holds in ((1.01, True), (0.99, False)):
        low = float((y - room * off).min()) - scenario.vehicle.radius
        box = sp.Bounds(min=(-5.0, low), max=(25.0, 10.0))
        assert sp.certify(scenario.model_copy(update={"bounds": box}), plan, tube=TUBE).holds is holds


def test_tube_that_was_recorded_for_less_is_refused(planned: tuple[sp.Scenario, sp.Plan]) -> None:
    scenario, plan = planned
    with pytest.raises(EstimationError, match="speed"):
        sp.certify(scenario, plan, tube=replace(TUBE, max_speed=1.0))
