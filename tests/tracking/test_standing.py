from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scp_planner.online.planner import Planner
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.ready_made import ready_made
from scp_planner.threat_zones.of_scenario import zones
from scp_planner.tracking.estimators import ProcessTrack
from scp_planner.tracking.standing import Stand
from scp_planner.tracking.tracks import Tracks

PERSON = ready_made("pedestrian")
SWAY = 0.06
ALPHA = 0.05


def stands(times: np.ndarray, positions: np.ndarray, noise: float) -> list[Stand]:
    """Regions that a person stands in, after each observation."""
    filtered, last, found = ProcessTrack(PERSON), None, []
    for time, position in zip(times.tolist(), positions.tolist(), strict=True):
        filtered.update(time, (position[0], position[1]), noise**2 * np.eye(2))
        estimate = filtered.estimate(None)
        last = Stand.after(last, estimate.reference_time, estimate.mean[0], estimate.state_covariance, SWAY)
        found.append(last)
    return found


def is_outside(stand: Stand, positions: np.ndarray, noise: float) -> np.ndarray:
    xx, xy, yy = stand.region
    region = np.array([[xx, xy], [xy, yy]]) + 9.0 * noise**2 * np.eye(2)
    offsets = positions - stand.place
    return np.einsum("ni,ij,nj->n", offsets, np.linalg.inv(region), offsets) > 1.0


class TestStand:
    @pytest.mark.parametrize(
        ("file", "times"), [("eth", 50), ("hotel", 400), pytest.param("univ", 3000, marks=pytest.mark.slow)]
    )
    def test_recorded_people_set_out_no_more_often_than_allowed_for(
        self, recorded_data: Path, file: str, times: int
    ) -> None:
        tried = left = 0
        for track in Tracks.load(recorded_data / "pedestrians" / f"{file}_obsmat.txt"):
            for stand in stands(track.times, track.positions, PERSON.noise_deviation):
                later = (track.times > stand.seen) & (track.times <= stand.until(ALPHA))
                if later.any():
                    tried += 1
                    left += int(is_outside(stand, track.positions[later], PERSON.noise_deviation).any())
        assert tried > times
        assert left <= ALPHA * tried

    def test_one_that_stands_is_within_its_region(self) -> None:
        times = 0.1 * np.arange(400)
        for seed in range(20):
            rng = np.random.default_rng(seed)
            place = rng.normal(0.0, 100.0, 2)
            found = stands(times, place + rng.normal(0.0, 0.05, (len(times), 2)), 0.05)
            assert not is_outside(found[-1], place[None], 0.0).any()
            assert np.sqrt(found[-1].region[0]) < 0.2

    def test_most_are_seen_to_stand_for_as_long_as_they_do(self) -> None:
        times, rng = 0.1 * np.arange(400), np.random.default_rng(5)
        long = [stands(times, rng.normal(0.0, 0.05, (len(times), 2)), 0.05)[-1] for _ in range(20)]
        assert np.median([one.seen - one.since for one in long]) == pytest.approx(times[-1])

    @pytest.mark.parametrize("speed", [0.05, 0.3, 1.2])
    def test_one_that_walks_slowly_does_not_stand_for_long(self, speed: float) -> None:
        times, rng = 0.1 * np.arange(300), np.random.default_rng(1)
        seen = np.outer(times, [speed, 0.0]) + rng.normal(0.0, 0.05, (len(times), 2))
        assert max(one.seen - one.since for one in stands(times, seen, 0.05)[50:]) < 0.5 / speed + 2.0

    def test_the_rule_of_succession(self) -> None:
        # the share of times, drawn at random from one of a length drawn at random, of which the rest is short
        rng = np.random.default_rng(0)
        length = 10.0 ** rng.uniform(-4.0, 8.0, 100_000)
        past = length * rng.uniform(size=length.shape)
        middle = (past > 1.0) & (past < 100.0)
        stood, rest = past[middle], (length - past)[middle]
        stand = Stand(0.0, 1.0, 2, np.zeros(2), np.ones(3))
        allowed = (stand.until(0.1) - 1.0) * stood
        assert (rest <= allowed).mean() == pytest.approx(0.1, abs=0.02)


class TestBesideOneWhoStands:
    def planner(self) -> Planner:
        vehicle = {"radius": 0.3, "max_speed": 1.5, "max_acceleration": 1.0, "max_deceleration": 1.5}
        scene = Scenario.model_validate(
            {
                "vehicle": vehicle,
                "start": {"time": 0.0, "position": (0.0, 0.0), "heading": 0.0, "speed": 0.0},
                "goal": {"position": (3.0, 0.0), "speed": 0.0},
                "confidence": {"level": "joint", "probability": 0.95},
            }
        )
        planner = Planner(scene)
        planner.add_obstacle("person", {"disc": 0.3}, model="pedestrian", covariance=0.05**2 * np.eye(2))
        return planner

    def test_the_vehicle_arrives(self) -> None:
        planner, rng = self.planner(), np.random.default_rng(0)
        place, time, position, heading, speed = np.array([3.4, 0.7]), 0.0, np.zeros(2), 0.0, 0.0
        least = np.inf
        while time < 60.0:
            planner.observe("person", time, place + rng.normal(0.0, 0.05, 2))
            time += 0.1
            if time > 35.0:
                plan = planner.replan(time, position, heading, speed)
                if plan.arrived:
                    break
                position, heading = plan.position(time + 0.1), float(plan.heading(time + 0.1))
                speed = float(plan.speed(time + 0.1))
                least = min(least, float(np.hypot(*(place - position))) - 0.6)
        assert plan.arrived
        assert least > 0.1

    def test_the_scenario_has_the_zones_that_were_planned_with(self) -> None:
        planner, rng = self.planner(), np.random.default_rng(0)
        for step in range(300):
            planner.observe("person", 0.1 * step, np.array([3.4, 0.7]) + rng.normal(0.0, 0.05, 2))
        planner.replan(29.9, (0.0, 0.0), 0.0, 0.0)
        (zone,), (told,) = planner.zones, zones(planner.scenario)
        times = 29.9 + np.linspace(0.0, 4.0, 4001)
        ratio = told.covariance(times)[:, 0, 0] / zone.covariance(times)[:, 0, 0]
        assert np.hypot(*(told.center(times) - zone.center(times)).T).max() < 1e-3
        assert (ratio > 1.001).sum() <= 2  # where the zone jumps
        radii = np.sqrt(zone.covariance(times)[:, 0, 0])
        assert radii[0] == radii[500] < 0.2 < 0.4 < radii[1500]
