"""Everyday loops: their scenes, the contact check, the baselines' limits, the table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from shapely import Point, Polygon

from benchmarks.everyday import scenes
from benchmarks.everyday.__main__ import main
from benchmarks.everyday.bodies import gap, ground_gap, least_gap, polygon_distance
from benchmarks.everyday.controllers.product import CONFIGURATIONS, Product
from benchmarks.everyday.loop import Motion, drive
from benchmarks.everyday.motions import Array, Robot, constant_velocity
from benchmarks.everyday.runs import BASELINES
from benchmarks.everyday.scene import CAR, ROBOT, Agent, Scene, person, stop_at
from benchmarks.everyday.truth import known_trip

PLAIN = (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", scenes.NAMES)
def test_scenes_begin_clear_and_are_reproducible(name: str) -> None:
    first, again = scenes.make(name, 1), scenes.make(name, 1)
    first.scenario()
    robot = Robot(np.array(first.start[:2]), first.start[2], first.start[3])
    assert ground_gap(first.walls, first.bounds, first.vehicle, robot.position, robot.heading) > 0.0
    for one, two in zip(first.agents, again.agents, strict=True):
        place = one.motion(0.0, robot)
        assert gap(first.vehicle, robot.position, robot.heading, one.shape, (place, one.heading)) > 0.1
        assert np.array_equal(one.motion(3.0, robot), two.motion(3.0, robot)) or np.any(place != two.motion(0.0, robot))
        assert np.array_equal(one.motion(4.0, robot), two.motion(4.0, robot))


def test_polygon_distances_are_those_of_shapely() -> None:
    rng = np.random.default_rng(0)
    corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)]
    points, shape = rng.uniform(-1.0, 5.0, (200, 2)), Polygon(corners)
    expected = [
        (-1.0 if shape.contains(Point(point)) else 1.0) * shape.boundary.distance(Point(point)) for point in points
    ]
    assert polygon_distance(points, corners) == pytest.approx(np.array(expected), abs=1e-12)


@pytest.mark.parametrize("shape", [{"disc": 0.4}, {"rectangle": [2.0, 0.8]}])
@pytest.mark.parametrize("vehicle", [ROBOT, CAR], ids=["disc", "discs"])
def test_contacts_between_samples_are_those_of_dense_sampling(
    shape: dict[str, object], vehicle: dict[str, object]
) -> None:
    rng = np.random.default_rng(1)
    for _ in range(8):
        p, q = rng.normal(0.0, 3.0, (2, 2)), rng.normal(0.0, 3.0, (2, 2))
        h, g = rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.5, 0.5, 2)
        shares = np.linspace(0.0, 1.0, 2001)
        dense = min(
            gap(
                vehicle,
                p[0] + s * (p[1] - p[0]),
                h[0] + s * (h[1] - h[0]),
                shape,
                (q[0] + s * (q[1] - q[0]), g[0] + s * (g[1] - g[0])),
            )
            for s in shares
        )
        found = least_gap(vehicle, shape, ((p[0], h[0]), (p[1], h[1])), ((q[0], g[0]), (q[1], g[1])))
        assert dense - 2e-3 <= found <= dense + 1e-3 + 1e-9


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_arrive_within_the_limits_of_the_vehicle(name: str) -> None:
    walker = person("walker", constant_velocity((6.0, -5.0), (0.0, 1.2)))
    scene = Scene(ROBOT, PLAIN, [stop_at(8.0, 1.0)], [walker], 30.0)
    found = drive(scene, BASELINES[name](scene), seed=2)
    assert found.arrived
    assert not found.contacts
    assert found.excess < 0.01
    assert math.dist(found.path[-1][1].position, (8.0, 1.0)) <= 0.15
    assert found.time < 1.5 * known_trip(scene, found).travel_time


class _Straight:
    """Drives ahead whatever comes."""

    unsafe = 0

    def __init__(self) -> None:
        self.times: list[float] = []

    def step(self, time: float, robot: Robot) -> Motion:
        return lambda at: (np.array([at, 0.0]), np.array([0.0, 1.0]))

    def has_arrived(self, robot: Robot) -> bool:
        return False

    def explains(self, time: float, agent: Agent, place: Array) -> str:
        return f"asked for {time:.2f}"

    def observe(self, *facts: object) -> None: ...
    def set_goal(self, *facts: object) -> None: ...
    def set_walls(self, *facts: object) -> None: ...


def test_a_contact_is_found_with_its_time_depth_and_kind() -> None:
    """Head-on at 1 m/s each from 5 m, radii 0.3 m: touched after (5 - 0.6) / 2 s."""
    walker = person("walker", constant_velocity((5.0, 0.0), (-1.0, 0.0)))
    scene = Scene(ROBOT, (0.0, 0.0, 0.0, 1.0), [stop_at(8.0, 0.0)], [walker], 3.0)
    found = drive(scene, _Straight())
    (contact,) = found.contacts
    assert contact.time == pytest.approx(2.2, abs=0.011)
    assert contact.driving
    assert contact.closing == pytest.approx(1.0)
    assert contact.depth == pytest.approx(0.6, abs=1e-3)
    assert contact.before == f"asked for {contact.time - 1.0:.2f}"
    assert found.gap == pytest.approx(-0.6, abs=2e-3)


@pytest.mark.parametrize("name", ["A", "D", "F"])
def test_the_planner_drives_through_an_empty_hall(name: str) -> None:
    scene, configuration = Scene(ROBOT, PLAIN, [stop_at(4.0, 0.0)], [], 8.0), CONFIGURATIONS[name]
    controller = Product(scene, configuration)
    found = drive(scene, controller, 0, configuration.exact, configuration.follower)
    assert found.path[-1][1].position[0] > 3.0
    assert controller.unsafe == 0


def test_the_command_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["--scenes", "drone_pad", "--controllers", "orca", "--output", str(tmp_path)]
    assert main(asked) == 0
    written = (tmp_path / "everyday.csv").read_text()
    assert main(asked) == 0  # goes on from the file
    assert (tmp_path / "everyday.csv").read_text() == written
    assert "| drone_pad | orca" in capsys.readouterr().out
    assert main(["--list"]) == 0
    assert "lobby" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--scenes", "nowhere"])
