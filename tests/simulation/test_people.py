"""People who give way, and the episodes that others measure their robots in."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.settings.online import Regions
from scp_planner.simulation.crowds import (
    CROWDS,
    Episode,
    among_people,
    circle_crossing,
    restless_arena,
    square_crossing,
)
from scp_planner.simulation.people import Manner, OrcaPeople, Restlessness, RestlessPeople
from scp_planner.simulation.worlds import VehicleState, World

FAR = VehicleState(0.0, np.array([100.0, 0.0]), np.zeros(2), 0.3)
Array = np.ndarray


def gaps(people: OrcaPeople) -> Array:
    """Free distances between all pairs of people, m."""
    apart = np.linalg.norm(people.positions[:, None] - people.positions[None], axis=2)
    one, two = np.triu_indices(len(apart), 1)
    return np.asarray(apart[one, two] - people.radii[one] - people.radii[two])


@pytest.mark.parametrize("make", [circle_crossing, square_crossing])
@pytest.mark.parametrize("seed", range(4))
def test_people_cross_without_touching(make: Callable[..., Episode], seed: int) -> None:
    people = make(seed, 8).people
    assert isinstance(people, World)
    least = math.inf
    for _ in range(120):
        before = people.positions
        people.step(0.25, FAR)
        least = min(least, float(gaps(people).min()))
        assert (np.linalg.norm(people.positions - before, axis=1) <= 0.25 * people.speeds + 1e-9).all()
    assert least > 0.0
    assert np.linalg.norm(people.positions - people.goals, axis=1).max() < 0.3


def test_people_without_anybody_near_walk_straight_at_their_speed() -> None:
    people = OrcaPeople([[0.0, 0.0]], [[6.0, 8.0]], 0.5)
    people.step(2.0, FAR)
    assert people.positions[0] == pytest.approx((0.6, 0.8))


def test_time_may_pass_in_any_parts() -> None:
    """Decisions are made every 0.25 s, whenever the world is asked."""
    whole, parts = circle_crossing(3).people, circle_crossing(3).people
    for _ in range(8):
        whole.step(0.25, FAR)
    for dt in (0.0, 0.1, 0.3, 0.05, 0.05, 0.7, 0.8):
        parts.step(dt, FAR)
    assert parts.positions == pytest.approx(whole.positions, abs=1e-9)


def test_people_give_way_to_a_vehicle_only_if_they_see_it() -> None:
    vehicle = VehicleState(0.0, np.array([3.0, 0.0]), np.zeros(2), 0.4)
    blind, seeing = (OrcaPeople([[0.0, 0.1]], [[8.0, 0.1]], sees_vehicle=sees) for sees in (False, True))
    nearest = {False: math.inf, True: math.inf}
    for _ in range(40):
        for sees, people in ((False, blind), (True, seeing)):
            people.step(0.25, vehicle)
            nearest[sees] = min(nearest[sees], float(np.linalg.norm(people.positions[0] - vehicle.position)))
    assert nearest[False] < 0.4
    # What they leave to a vehicle that stands is its half; they come near, and stay out.
    assert nearest[True] > 0.69


def test_restless_people_change_their_goals_and_never_stay() -> None:
    people = RestlessPeople([[0.0, 0.0], [3.0, 0.0]], [[0.5, 0.0], [9.0, 0.0]], restlessness=Restlessness(5.0), seed=2)
    first = people.goals.copy()
    for _ in range(19):
        people.step(0.25, FAR)
    assert (people.goals[1] == first[1]).all() and (people.goals[0] != first[0]).all()
    assert abs(np.hypot(*people.goals[0]) - 5.0) <= math.sqrt(0.5)
    changes = 0
    for _ in range(400):
        before = people.goals.copy()
        people.step(0.25, FAR)
        changes += int((people.goals != before).any())
    assert changes > 10


@pytest.mark.parametrize("seed", range(6))
def test_episodes_are_those_of_the_protocols(seed: int) -> None:
    circle, square, arena = circle_crossing(seed), square_crossing(seed, 10), restless_arena(seed)
    assert [len(each.people.positions) for each in (circle, square, arena)] == [5, 10, 20]
    assert (np.abs(np.linalg.norm(circle.people.positions, axis=1) - CROWDS.circle) <= math.sqrt(0.5)).all()
    assert (circle.people.goals == -circle.people.positions).all()
    assert (square.people.positions[:, 0] * square.people.goals[:, 0] <= 0.0).all()
    assert (np.abs(square.people.positions) <= 0.5 * CROWDS.square).all()
    assert ((arena.people.radii >= CROWDS.arena_radii[0]) & (arena.people.radii <= CROWDS.arena_radii[1])).all()
    assert ((arena.people.speeds >= CROWDS.arena_speeds[0]) & (arena.people.speeds <= CROWDS.arena_speeds[1])).all()
    for each in (circle, square, arena):
        start, goal = np.array(each.scenario.start.position), np.array(each.scenario.goal.position)
        free = np.linalg.norm(each.people.positions - start, axis=1) - each.people.radii - CROWDS.robot_radius
        assert free.min() >= CROWDS.gap and gaps(each.people).min() >= CROWDS.gap - 1e-9
        assert np.hypot(*(goal - start)) >= CROWDS.arena_trip - 1e-9 and (np.abs([start, goal]) <= CROWDS.arena).all()
        assert each.scenario.goal.radius == CROWDS.robot_radius and not each.people.sees_vehicle
        assert {name: shape.model_dump() for name, shape in each.shapes.items()} == {
            name: {"disc": radius} for name, radius in zip(each.people.names, each.people.radii, strict=True)
        }


def test_episodes_are_the_same_for_the_same_seed() -> None:
    for make in (circle_crossing, square_crossing, restless_arena):
        one, two, other = make(5), make(5), make(6)
        assert one.scenario == two.scenario
        for _ in range(30):
            one.people.step(0.25, FAR)
            two.people.step(0.25, FAR)
        assert (one.people.positions == two.people.positions).all()
        assert (one.people.positions != other.people.positions).any()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: OrcaPeople([[0.0, 0.0]], [[1.0, 0.0], [2.0, 0.0]]), "goals: there are 2 of them for 1 people"),
        (lambda: OrcaPeople([[0.0, 0.0]], [[1.0, 0.0]], speeds=0.0), "speeds: .* must be finite and greater than 0"),
        (lambda: OrcaPeople([[0.0, 0.0]], [[1.0, 0.0]], radii=math.nan), "radii: .* must be finite"),
        (lambda: Manner(step=0.0), "manner: step 0.0 must be finite and greater than 0"),
        (lambda: Manner(neighbours=-1), "manner: neighbours -1 must be at least 0"),
        pytest.param(lambda: circle_crossing(0, 60), "people: there is no room for 60", marks=pytest.mark.slow),
    ],
)
def test_misuse_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_nobody_is_a_crowd_too() -> None:
    assert OrcaPeople(np.zeros((0, 2)), np.zeros((0, 2))).step(1.0, FAR) == {}


# Settings among people


def test_a_stop_stays_clear_for_as_long_as_it_takes_to_get_under_way() -> None:
    """Half a width at top speed, 0.3 s, for who has its speed at once; two thirds of 1.5 s for who needs that long."""
    quick = sp.Vehicle(radius=0.3, max_speed=1.0, max_acceleration=4.0, max_deceleration=4.0)
    slow = sp.Vehicle(radius=0.3, max_speed=1.5, max_acceleration=1.0, max_deceleration=1.0)
    assert among_people(quick, 0.25).stay_clear == pytest.approx(0.3)
    assert among_people(slow, 0.1).stay_clear == pytest.approx(1.0)


def test_zones_among_people_are_those_of_the_model() -> None:
    """Zones that follow what came of them fill a crowd."""
    walker = sp.Vehicle(radius=0.3, max_speed=1.0, max_acceleration=4.0, max_deceleration=4.0)
    assert among_people(walker, 0.25).regions is Regions.MODEL
