"""Dead ends: how far a vehicle that only drives ahead can go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.arrays import Array, Mask
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.dead_ends import FAR, STEPS, way_on
from scp_planner.online.dodge_outlooks import _is_clear, _within_box
from scp_planner.online.planner import Planner
from scp_planner.scenario.limits import Box
from scp_planner.settings.online import OnlineSettings
from scp_planner.threat_zones.batch import ZoneBatch

PERIOD = 0.1


def between(wall: float) -> Callable[[Array], Mask]:
    """Clear up to walls so far away on either side, m."""

    def clear(place: Array) -> Mask:
        return np.asarray(np.abs(place[..., 1]) < wall)

    return clear


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_who_heads_for_a_wall_can_go_on_if_there_is_room_to_turn(radius: float) -> None:
    """Between walls: to drive along them takes radius (1 - cos angle) to the side, from geometry."""
    rng = np.random.default_rng(2)
    heading, aside = rng.uniform(-1.4, 1.4, 200), rng.uniform(0.0, 1.0, 200) * radius
    place = np.stack([rng.uniform(-5.0, 5.0, 200), 0.0 * aside], axis=1)
    places = zip(place, heading, aside.tolist(), strict=True)
    found = np.array([way_on(at[None], np.array([angle]), radius, between(wall))[0] for at, angle, wall in places])
    needed = radius * (1.0 - np.cos(heading))
    # turns are some of all that there are, and a wall may be a little farther away than where it is looked at
    free, stuck = needed < 0.6 * aside - 0.05 * radius, needed > 1.05 * aside
    assert free.sum() > 30 and stuck.sum() > 30
    assert np.all(found[free] > 0.6 * FAR * radius)
    assert np.all(found[stuck] < 0.5 * FAR * radius)


def test_way_on_ends_where_it_is_blocked() -> None:
    found = way_on(np.zeros((1, 2)), np.zeros(1), 1.0, lambda at: at[..., 0] ** 2 + at[..., 1] ** 2 < 1.5**2)
    left = 2.0 * np.arcsin(0.5 * 1.5)  # the chord of the tightest turn is as long as that
    assert left - FAR / STEPS < found[0] <= left


def test_in_a_narrow_room_no_dodge_ends_where_no_trip_leads_on() -> None:
    """Something blocks the room for a while. The vehicle cannot turn round there: turned to a wall it would stay."""
    planner = Planner(scene(bounds={"min": (-2.0, -1.1), "max": (21.0, 1.1)}), online=OnlineSettings(iterations=6))
    plan = planner.replan(0.0, (0.0, 0.0), 0.0, 1.0)
    for k in range(20, 75):
        time = k * PERIOD
        place = plan.position(time)
        if k == 21:
            planner.add_obstacle(disc("post", (float(plan.position(2.0)[0]) + 5.0, 0.0), radius=1.2))
        if k == 62:
            planner.remove_obstacle("post")
            stood = place
        plan = planner.replan(time, place, float(plan.heading(time)), max(float(plan.speed(time)), 0.0))
    assert float(plan.position(7.4)[0]) > stood[0] + 0.2
    assert plan.arrival_time < 20.0


def test_walls_that_are_nowhere_near_are_left_out() -> None:
    """Those that are left decide of all places as all of them do."""
    rng = np.random.default_rng(5)
    places = rng.uniform([-40.0, -9.0], [60.0, 9.0], (120, 2)).tolist()
    crates = [disc(f"disc {k}", (x, y)) for k, (x, y) in enumerate(places[:60])]
    for k, (x, y) in enumerate(places[60:]):
        shape = {"rectangle": rng.uniform(0.2, 6.0, 2).tolist(), "heading": float(rng.uniform(0.0, 3.0))}
        crates.append({"id": f"wall {k}", "shape": shape, "motion": {"position": [x, y]}})
    found = sp.zones(scene(*crates, start={"position": [0.0, 40.0]}))
    standing = ZoneBatch.of(found, PlanningFrame((0.0, 0.0), 0.0, 0.0), 0.3)
    local = rng.uniform([3.0, -4.0], [9.0, 4.0], (7, 11, 2))
    counts, blocked = list[int](), 0
    for moved in np.linspace(-60.0, 60.0, 13):
        place = local + np.array([moved, 0.0])
        points = place.reshape(-1, 2)
        every = standing.distances(np.zeros(len(points)), points, 0.0).min(axis=1) >= 0.0
        clear = _is_clear(Box(np.zeros((0, 2)), np.zeros(0)), standing, place)
        assert np.array_equal(clear.ravel(), every)
        counts.append(len(_within_box(standing, points)))
        blocked += int((~every).sum())
    assert 0 < max(counts) < standing.size / 4
    assert blocked > 50
