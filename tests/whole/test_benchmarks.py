"""The benchmarks' own parts: generators, starts, the arcs and gradients that peers rest on, files, tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import scp_planner
from benchmarks import common, families, online, online_answers, online_crowds, online_regions
from benchmarks.peers import __main__ as peers
from benchmarks.peers.base import JUDGE, Attempt, judge
from benchmarks.peers.casadi_ipopt import ArcTrip
from benchmarks.peers.starts import TEN_STARTS, Start, first_guess
from benchmarks.report.__main__ import main as write_page
from verification.dense_check import check_trip

ALL_FAMILIES = (*families.FAMILIES, "far70")


@pytest.mark.parametrize("family", ALL_FAMILIES)
def test_random_scenarios_are_valid_and_reproducible(family: str) -> None:
    first = families.random_scenario(family, np.random.default_rng(5), "one")
    again = families.random_scenario(family, np.random.default_rng(5), "one")
    other = families.random_scenario(family, np.random.default_rng(6), "one")
    assert first == again
    assert first != other
    scenario = families.as_scenario(first)
    assert isinstance(scenario, scp_planner.Scenario)
    assert len(scenario.obstacles) == len(first["obstacles"])


@pytest.mark.parametrize("start", TEN_STARTS, ids=str)
def test_starts_obey_the_ends_and_the_speed_limits(start: Start) -> None:
    """A start is free to turn too sharply for its speed, and knows no obstacle; all else must hold."""
    data = families.crossing(np.random.default_rng(0), 0)
    data["vehicle"] |= {"max_lateral_acceleration": None, "max_curvature": None}
    guess = first_guess(data, start)
    assert guess.states[0, :2] == pytest.approx(data["start"]["position"])
    assert guess.states[:, 3].max() <= 3.0 + 1e-12
    # Driven at its own speeds and accelerations it gets where it says, when it says.
    steps = np.diff(guess.times)
    driven = steps * (guess.states[1:, 3] + guess.states[:-1, 3]) / 2.0
    lengths = np.linalg.norm(np.diff(guess.states[:, :2], axis=0), axis=1)
    # The trapezium is exact but where the ramp ends inside a step: there it is short by at most rate * step^2 / 8.
    assert np.all(np.abs(driven - lengths) <= 2.0 * steps**2 / 8.0 + 1e-12)
    assert np.count_nonzero(np.abs(driven - lengths) > 1e-12) <= 1
    driven_at = make_interp_spline(guess.times, guess.states[:, :2], k=5)
    report = check_trip(data, driven_at, guess.times[0], guess.times[-1], tolerances=JUDGE)
    assert {finding.name for finding in report.violations} <= {"acceleration", "deceleration"}, str(report)
    middle = np.argmin(np.abs(guess.states[:, 0] - 10.0))
    assert guess.states[middle, 1] == pytest.approx(start.bow, abs=1e-3)


def test_arc_trips_drive_exact_arcs() -> None:
    """Judged by the dense check: half a second of full acceleration on a left arc, then braking on a right one."""
    controls = np.array([[1.5, 0.5], [-2.0, -0.4]])
    trip = ArcTrip(3.0, np.array([0.0, 0.0, 0.0, 1.0]), controls, 1.0)
    goal = trip(np.array([4.0]))[0]
    data = families.crossing(np.random.default_rng(0), 0)
    data["start"]["time"] = 3.0
    data["goal"] = {"position": goal.tolist(), "heading": None, "speed": 0.75}
    report = check_trip(data, trip, 3.0, 4.0)
    assert report.ok, str(report)
    assert report["acceleration"].value == pytest.approx(1.5, abs=1e-4)
    assert report["deceleration"].value == pytest.approx(2.0, abs=1e-4)
    assert report["curvature"].value == pytest.approx(0.5, abs=1e-4)
    attempt = Attempt(True, trip, 3.0, 4.0, 1, "")
    verdict = judge(data, attempt)
    assert verdict is not None
    assert verdict.ok


def test_peers_run_on_random_scenarios_and_the_page_says_what_they_did(tmp_path: Path) -> None:
    """Two quick methods, two starts: the files, and the page that is made from them."""
    results, page = tmp_path / "results", tmp_path / "docs" / "benchmarks.md"
    methods = ["scp_planner.plan", "scp_planner one run"]
    options = ["--random", "2", "--families", "crossing3", "--starts", "2", "--output", str(results)]
    assert peers.main([*options, "--methods", *methods]) == 0
    rows = common.read_csv(results / "peers-random.csv")
    assert [(row["method"], row["start_set"]) for row in rows[:3]] == [
        ("scp_planner.plan", "plan"),
        ("scp_planner one run", "one"),
        ("scp_planner one run", "first 2"),
    ]
    assert len({row["scenario"] for row in rows}) == 2
    assert write_page(["--results", str(results), "--page", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    anchors = {heading.lower().replace(",", "").replace(" ", "-") for heading in re.findall(r"^#+ (.+)$", text, re.M)}
    links = re.findall(r"\]\(#([^)]+)\)", text)
    assert links
    assert set(links) <= anchors
    plan_row = next(line for line in text.splitlines() if line.startswith("| scp_planner.plan"))
    assert [cell.strip() for cell in plan_row.strip("|").split("|")][2:4] == ["2/2", "2/2"]


def test_the_page_tells_what_closed_loops_came_to(tmp_path: Path) -> None:
    results, page = tmp_path / "results", tmp_path / "benchmarks.md"
    loop = {"family": "crossing5", "noise": 0.1, "arrived": 1, "contact": 0, "contact_standing": 0, "truth_time": 8.0}
    loop |= {"cycles": 80, "braking": 4, "unsafe": 0}
    common.write_csv(
        results / "online-loops.csv",
        [
            {**loop, "seed": 0, "level": 0.5, "contact": 1, "travel_time": 8.2},
            {**loop, "seed": 0, "level": 0.99, "travel_time": 8.4},
            {**loop, "seed": 1, "level": 0.99, "travel_time": 8.8},
        ],
    )
    replan = {"wall_ms": 2.0, "processor_ms": 1.9, **{f"{stage}_ms": 0.5 for stage in online.STAGES}}
    common.write_csv(results / "online-replan.csv", [replan, {**replan, "wall_ms": 4.0}])
    assert write_page(["--results", str(results), "--page", str(page)]) == 0
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.read_text().splitlines()]
    assert ["all", "2", "0.0", "0.0", "100.0", "1.075", "5.00", "0.00"] in cells, "both seeds at the usual level"
    assert ["0.5", "1", "100.0", "0.0", "100.0", "1.025", "5.00", "0.00"] in cells
    assert ["0.99", "1", "0.0", "0.0", "100.0", "1.050", "5.00", "0.00"] in cells, "of the seed that other levels have"
    assert ["all", "3.00", "3.80", "3.98", "4.00"] in cells


def test_online_fault_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert online.main(["faults", "--count", "1", "--check-every", "10", "--output", str(tmp_path)]) == 0
    *_, last = capsys.readouterr().out.splitlines()
    cells = [cell.strip() for cell in last.strip("|").split("|")]
    assert cells[:2] == ["all", "1"] and cells[4:7] == ["0", "0", "0"]
    assert len(common.read_csv(tmp_path / "online-faults.csv")) == 1


def test_closed_loop_benchmark_row() -> None:
    row = online.loop({"family": "crossing5", "seed": 0, "level": 0.99})
    assert row["arrived"] == 1 and row["contact"] == 0
    assert 1.0 <= row["travel_time"] / row["truth_time"] < 1.2
    outcomes = ("improved", "kept", "repaired", "evading", "braking")
    assert row["cycles"] == sum(row[outcome] for outcome in outcomes)


def test_crowd_tasks_are_drawn_where_there_is_room(recorded_data: Path) -> None:
    tracks = online_crowds.recordings(recorded_data)["eth"]
    drawn = online_crowds.task("eth", tracks, 3)
    again = online_crowds.task("eth", tracks, 3)
    assert (drawn.time, drawn.start, drawn.goal) == (again.time, again.start, again.goal)
    places = drawn.places(drawn.time)
    assert len(places) >= online_crowds.FEWEST
    assert np.linalg.norm(places - drawn.start, axis=1).min() > online_crowds.ROOM
    row = online_crowds.drive({"eth": tracks}["eth"], {"place": "eth", "number": 3, "way": "waiting"})
    length = float(np.linalg.norm(np.subtract(drawn.goal, drawn.start)))
    assert row["arrived"] == 1 and row["travel_time"] > (length - 0.4) / online_crowds.VEHICLE.max_speed


def test_no_test_answers_sooner_than_the_one_that_is_told_everything() -> None:
    rng, looks, false = np.random.default_rng(3), 8, 0.02
    signal = 0.5 * online_answers.CHANGE * (0.1 * np.arange(1, looks + 1)) ** 2
    # The logarithm of the ratio of likelihoods, up to a factor and a constant, of looks with and without the change.
    without = (0.1 * rng.standard_normal((200_000, looks))) @ signal
    changed = (signal + 0.1 * rng.standard_normal((200_000, looks))) @ signal
    power = float((changed > np.quantile(without, 1.0 - false)).mean())
    assert abs(power - online_answers.best_power(looks, false)) < 0.01
    third, _, _, tenth, *_, last = online_answers.answers(range(2))
    assert third.best < 0.02 and third.answered < 0.1  # nothing can be known after three looks
    assert tenth.answered < tenth.best and last.answered > 0.9


def test_bounds_of_a_share_are_those_of_how_much_obstacles_differ() -> None:
    rng, inside, runs = np.random.default_rng(8), 0, 2_000
    whose = np.repeat(np.arange(60), 10)
    for _ in range(runs):
        likely = rng.beta(9.0, 1.0, 60)[whose]  # 0.9 in the mean, and alike for all that is of one obstacle
        low, high = online_regions.between(rng.random(600) < likely, whose)
        inside += low <= 0.9 <= high
    assert 0.92 < inside / runs < 0.98
    low, high = online_regions.between(np.ones(240, dtype=bool), np.repeat(np.arange(24), 10))
    assert high == 1.0 and 0.84 < low < 0.88  # as of 24 that are independent
