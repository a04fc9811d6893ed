"""What is seen of dodges before they are certified."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import disc, scene

from scp_planner.online.dodge_outlooks import UNREST, Driven, Outlook, until_over
from scp_planner.online.dodge_worth import GAIN, NEARNESS, nearness
from scp_planner.online.evasion import Evasion
from scp_planner.online.means import Replan
from scp_planner.online.planner import Planner
from scp_planner.online.remaining import State


def test_end_of_a_dodge_is_looked_at_between_samples() -> None:
    """Somebody comes nearer by 1 m/s: when the dodges end, at 1.4 s and at 2 s, clearances are what is left then."""
    times = np.array([0.0, 1.0, 2.0, 3.0])
    driven = Driven(times, np.zeros((2, 4, 2)), np.zeros((2, 4)), np.array([1.4, 2.0]))
    found = until_over(np.tile(1.5 - times, (2, 1)), driven)
    assert found[0] == pytest.approx([1.5, 0.5, 0.1, np.inf]) and found[1] == pytest.approx([1.5, 0.5, -0.5, -0.5])


def seen_after(*velocities: tuple[float, float]) -> tuple[Outlook, float, np.ndarray, np.ndarray]:
    """What is seen of dodges, and of a trip of 20 m, after walkers had these velocities, a tenth of a second each."""
    planner = Planner(scene(disc("walker", (1.0, 1.5), velocities[0]), start={"speed": 0.0}))
    evasion = Evasion(planner._means)
    for look, velocity in enumerate(velocities):
        state, now = State(0.1 * look, (0.0, 0.0), None, 0.0), 0.1 * (len(velocities) - 1)
        place = (1.0 - now * velocity[0], 1.5 - now * velocity[1])  # in the end they all are at the same place
        planner.update_motion("walker", {"position": place, "velocity": velocity})
        moment = planner._means.moment(state)
        view = evasion._looked(Replan(moment, 0.0, math.inf, None, look))
    trip = Planner(scene(start={"speed": 0.0})).replan(state.time, (0.0, 0.0), None, 0.0).trip
    dodges = view.dodges
    return view.seen, evasion.outlooks.worth_of(moment, trip, dodges.times), dodges.times, dodges.position


def nearer_by(change: np.ndarray, times: np.ndarray, place: np.ndarray, course: np.ndarray) -> np.ndarray:
    """By how much nearer somebody comes at places and times, who changes the velocity so much once more, (C, J) m."""
    offset = place - course
    away = offset / np.linalg.norm(offset, axis=-1, keepdims=True)
    return UNREST * np.maximum(away @ change, 0.0) * np.minimum(times, 0.8 * GAIN)


@pytest.mark.parametrize("before", [(0.0, -1.0), (0.6, -1.0), (0.3, -0.7)])
def test_who_has_just_changed_the_velocity_is_taken_to_go_on_with_that(before: tuple[float, float]) -> None:
    """By the change, for as long as way is gained, in moments of 0.8 s; against the nearness of one who has not."""
    now = (0.3, -1.0)
    steady, _, times, places = seen_after(now, now, now)
    turned, _, _, _ = seen_after(before, before, now)
    assert np.array_equal(turned.room.each, steady.room.each)
    clearance = steady.room.each[0]
    change = np.array(now) - before
    nearer = clearance - nearer_by(change, times, places, np.array([1.0, 1.5]) + np.outer(times, now))
    more = nearness(times / 0.8, nearer / 0.6) - nearness(times / 0.8, clearance / 0.6)
    assert steady.worth - turned.worth == pytest.approx(NEARNESS * 0.6 * more, abs=1e-6)
    assert more.max() > 0.02


def test_a_trip_is_worth_less_only_if_who_turns_turns_towards_it() -> None:
    """Somebody on the left of the way, who comes across."""
    now = (0.0, -1.0)
    on_trip = {x: seen_after((x, -1.0), (x, -1.0), now)[1] for x in (-0.6, 0.0, 0.6)}
    assert on_trip[0.6] < on_trip[0.0] - 1e-3, "turns back to where the vehicle sets out from"


def test_nobody_turns_where_there_is_nobody_but_a_border() -> None:
    planner = Planner(scene(start={"speed": 0.0}, bounds={"min": (-5.0, -5.0), "max": (30.0, 5.0)}))
    view = Evasion(planner._means)._looked(
        Replan(planner._means.moment(State(0.0, (0.0, 0.0), None, 0.0)), 0.0, math.inf, None, 0)
    )
    assert np.isfinite(view.seen.worth).all() and view.seen.room.each.shape[0] == 1
