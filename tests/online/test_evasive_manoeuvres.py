from __future__ import annotations

import numpy as np
import pytest
from scenes import scene

from scp_planner.online.evasive_manoeuvres import EvasiveManoeuvres
from scp_planner.online.manoeuvre_courses import PROMPT, Profiles
from scp_planner.scenario.limits import Limits


def manoeuvres(heading: float | None) -> EvasiveManoeuvres:
    scenario = scene(vehicle={"max_speed": 1.5, "max_curvature": 2.0})
    limits, radius = Limits.of(scenario), scenario.vehicle.radius
    profiles = Profiles.of(0.4, limits, 2.0 * radius, 1.0)
    return EvasiveManoeuvres.of(heading, profiles, limits, radius, 1.0, False, PROMPT)


class TestBest:
    @pytest.mark.parametrize("heading", [None, 0.3])
    @pytest.mark.parametrize("most", [1, 24, 50, 10_000])
    def test_is_the_courses_of_most_worth_and_the_first_one(self, heading: float | None, most: int) -> None:
        every, rng = manoeuvres(heading), np.random.default_rng(most)
        worth = rng.normal(size=len(every.position))
        few, numbers = every.best(most, worth)
        assert few.position == pytest.approx(every.position[numbers], abs=1e-12)
        assert np.array_equal(few.until, every.until[numbers])
        assert numbers[0] == 0
        first = every.families[0].length.shape[1]
        assert len(numbers) <= max(most, first)
        if most >= 24:
            assert worth.argmax() in numbers
        if most >= len(worth):
            assert np.array_equal(numbers, np.arange(len(worth)))
