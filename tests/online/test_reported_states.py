"""States and covariances that a tracker reports while driving."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import scene
from tracked_states import ACCELERATION, POSITION, VELOCITY, covariance, obstacle

import scp_planner as sp

pytestmark = pytest.mark.numerics


class TestOnline:
    def planner(self, *others: dict[str, Any]) -> sp.Planner:
        return sp.Planner(scene(*others, confidence=sp.Confidence(level="per_obstacle")))

    def test_an_update_is_the_estimate_of_a_file(self) -> None:
        """Zones of an obstacle that is told about while driving, and of one that is in the scenario."""
        (from_file, updated) = (self.planner(obstacle(3, model="car")), self.planner())
        updated.add_obstacle("one", {"disc": 0.3}, model="car")
        updated.update_obstacle("one", 0.0, POSITION, VELOCITY, ACCELERATION, covariance=covariance(3))
        for each in (from_file, updated):
            each.replan(0.0, (0.0, 0.0), 0.0, 1.0)
        (a,), (b,) = from_file.zones, updated.zones
        at = np.linspace(0.0, 5.0, 6)
        np.testing.assert_array_equal(a.center(at), b.center(at))
        np.testing.assert_array_equal(a.covariance(at), b.covariance(at))

    def test_its_zone_is_that_of_the_scenario_that_it_says_it_planned_for(self) -> None:
        for model in ({"order": 2}, "pedestrian"):
            planner = self.planner(obstacle(2, model=model))
            planner.update_obstacle("one", 0.2, (5.9, 4.8), VELOCITY, covariance=covariance(2))
            plan = planner.replan(0.2, (0.2, 0.0), 0.0, 1.0)
            (zone,), (again,) = planner.zones, sp.zones(planner.scenario)
            at = np.linspace(0.2, 5.0, 7)
            np.testing.assert_allclose(again.center(at), zone.center(at), atol=1e-9)
            # the horizon that zones hold for is one of the scene's own times, and the scene has become shorter
            np.testing.assert_allclose(again.covariance(at), zone.covariance(at), rtol=1e-3)
            assert plan.safe
            assert sp.certify(planner.scenario, plan).holds is plan.certified

    def test_the_newest_counts_and_what_is_older_is_left_out(self) -> None:
        planner = self.planner(obstacle(2))
        planner.update_obstacle("one", 0.5, (7.0, 7.0), (0.0, 0.0), covariance=covariance(2))
        planner.update_obstacle("one", 0.4, (1.0, 1.0), (0.0, 0.0), covariance=covariance(2))
        planner.replan(0.5, (0.5, 0.0), 0.0, 1.0)
        np.testing.assert_allclose(planner.zones[0].center(0.5), [7.0, 7.0])
        (note,) = planner.notes
        assert note == "one at t = 0.400 s: it came too late, after a newer estimate"

    def test_an_observation_after_it_is_a_newcomers(self) -> None:
        planner = self.planner(obstacle(2))
        planner.update_obstacle("one", 0.1, POSITION, VELOCITY, covariance=1e-6 * np.eye(4))
        planner.observe("one", 0.2, (6.5, 5.5), 0.01 * np.eye(2))
        planner.replan(0.2, (0.2, 0.0), 0.0, 1.0)
        zone = planner.zones[0]
        np.testing.assert_allclose(zone.center(0.2), [6.5, 5.5], atol=1e-6)
        assert zone.covariance(1.2)[0, 0] > 0.1  # nothing is believed of its velocity

    def test_bad_updates_are_refused(self) -> None:
        planner = self.planner(obstacle(2))
        with pytest.raises(ValueError, match="4 rows of 4"):
            planner.update_obstacle("one", 0.1, POSITION, VELOCITY, covariance=np.eye(2))
        with pytest.raises(ValueError, match="velocity"):
            planner.update_obstacle("one", 0.1, POSITION, (np.nan, 0.0), covariance=covariance(2))
