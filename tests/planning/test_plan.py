"""The plan: callable, consistent with itself by finite differences, saved and loaded exactly."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from scp_planner.certificate.verdict import Clearance
from scp_planner.planning.plan import PlanStatus
from scp_planner.trips.trajectory import Trajectory
from scp_planner.trips.trip import Trip

pytestmark = pytest.mark.numerics


@pytest.fixture(scope="module")
def plan() -> sp.Plan:
    return sp.plan(scene(*CROSSERS, start={"time": 5.0, "position": [2.0, -1.0]}))


def test_the_functions_of_time_fit_each_other(plan: sp.Plan) -> None:
    t = np.random.default_rng(0).uniform(plan.start_time + 0.01, plan.arrival_time - 0.01, 300)
    h = 1e-5
    velocity = (plan.position(t + h) - plan.position(t - h)) / (2 * h)
    np.testing.assert_allclose(plan.velocity(t), velocity, atol=2e-3)
    np.testing.assert_allclose(plan.speed(t), np.hypot(*velocity.T), atol=2e-3)
    np.testing.assert_allclose(np.tan(plan.heading(t)), velocity[:, 1] / velocity[:, 0], atol=2e-3)
    inside = np.abs(t[:, None] - plan.knot_times).min(axis=1) > 2 * h
    acceleration = (plan.speed(t + h) - plan.speed(t - h)) / (2 * h)
    np.testing.assert_allclose(plan.acceleration(t)[inside], acceleration[inside], atol=1e-6)
    turn = (plan.heading(t + h) - plan.heading(t - h)) / (2 * h)
    np.testing.assert_allclose(plan.curvature(t) * plan.speed(t), turn, atol=3e-3)


def test_times_may_have_any_shape_and_are_clamped(plan: sp.Plan) -> None:
    assert plan.position(plan.start_time).shape == (2,)
    assert plan.speed(plan.start_time).shape == ()
    assert plan.position(np.zeros((2, 3))).shape == (2, 3, 2)
    assert plan.position([]).shape == (0, 2)
    np.testing.assert_allclose(plan.position(-100.0), [2.0, -1.0], atol=1e-12)
    # The planning frame's lengths are rounded to 0.1 um, so that a scene that is turned or moved gives the same plan.
    np.testing.assert_allclose(plan.position(plan.arrival_time + 9.0), [20.0, 0.0], rtol=0.0, atol=1e-7)


def test_the_relative_gap_is_that_to_the_bound_among_the_obstacles(tmp_path: Path) -> None:
    """A wall that fills the workspace goes ahead slowly: without it the trip would take half as long."""
    square = {"polygon": [[-0.5, -2.0], [0.5, -2.0], [0.5, 2.0], [-0.5, 2.0]]}
    wall = {"id": "wall", "shape": square, "motion": {"position": (2.0, 0.0), "velocity": (1.0, 0.0)}}
    ahead = {"min": [-0.5, -0.6], "max": [9.0, 0.6]}
    made = sp.plan(scene(wall, bounds=ahead, goal={"position": [8.0, 0.0]}, start={"speed": 0.0}))
    assert made.certified and made.relative_gap < 0.1 * made.gap
    bounded = made.bounded()
    assert 1.5 * made.lower_bound < bounded.lower_bound <= made.travel_time
    assert bounded.gap == bounded.relative_gap == made.relative_gap
    bounded.save(tmp_path / "plan.json", samples=2)
    assert sp.Plan.load(tmp_path / "plan.json").relative_gap == made.relative_gap
    bad = replace(made, status=PlanStatus.FEASIBLE, reason="not looked at")
    assert bad.relative_gap == bad.gap == made.gap


def test_a_saved_plan_is_loaded_to_the_bit(plan: sp.Plan, tmp_path: Path) -> None:
    plan.save(tmp_path / "plan.json", samples=50)
    again = sp.Plan.load(tmp_path / "plan.json")
    t = np.linspace(plan.start_time, plan.arrival_time, 501)
    for name in ("position", "velocity", "speed", "acceleration", "heading", "curvature"):
        assert getattr(again, name)(t).tobytes() == getattr(plan, name)(t).tobytes(), name
    assert again.status is PlanStatus.UNVERIFIED and not again.certified
    assert again.stated_status is plan.status
    for name in ("reason", "travel_time", "method", "solver", "iterations", "clearance", "limits"):
        assert getattr(again, name) == getattr(plan, name), name
    data = json.loads((tmp_path / "plan.json").read_text())
    assert data["schema"] == 1
    assert data["arrival_time"] == plan.arrival_time
    assert len(data["samples"]["time"]) == 50
    again.save(tmp_path / "again.json", samples=50)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "plan.json").read_bytes()


def test_a_plan_without_obstacles_has_no_least_clearance(tmp_path: Path) -> None:
    plan = sp.plan(scene())
    assert plan.clearance.minimum == np.inf
    plan.save(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["clearance"]["minimum"] is None
    assert sp.Plan.load(tmp_path / "plan.json").clearance.minimum == np.inf


def test_a_plan_that_was_not_checked_is_none_without_obstacles(tmp_path: Path) -> None:
    plan = replace(sp.plan(scene()), clearance=Clearance(-np.inf))
    plan.save(tmp_path / "plan.json")
    assert sp.Plan.load(tmp_path / "plan.json").clearance == plan.clearance
    assert str(plan.clearance) == "clearance not known"


def _set(*keys: str | int, value: Any) -> Any:
    def change(data: Any) -> None:
        for key in keys[:-1]:
            data = data[key]
        if value is KeyError:
            del data[keys[-1]]
        else:
            data[keys[-1]] = value

    return change


def _both(*changes: Any) -> Any:
    def change(data: dict[str, Any]) -> None:
        for each in changes:
            each(data)

    return change


HUGE = 10**400

BAD = {
    "schema": (_set("schema", value=2), "schema = 2"),
    "no path": (_set("path", value=KeyError), "path"),
    "path is a list": (_set("path", value=[1]), "path"),
    "degree": (_set("path", "degree", value=9), "path.degree = 9"),
    "a path with corners": (_set("path", "degree", value=1), "path.degree = 1: must be at least 3"),
    "a path whose curvature jumps": (_set("path", "degree", value=2), "path.degree = 2: must be at least 3"),
    "degree of the acceleration": (_set("acceleration", "degree", value=3), "acceleration.degree = 3"),
    "a knot twice": (_set("path", "knots", 5, value=0.0), "path.knots"),
    "status that only a plan that was read has": (_set("status", value="unverified"), "status = 'unverified'"),
    "samples": (_set("samples", value=[]), "samples"),
    "samples without times": (_set("samples", "time", value=KeyError), "samples.time"),
    "samples backwards": (_set("samples", "time", value=[1.0, 0.0]), "samples.time"),
    "samples before the start": (_set("samples", "time", 0, value=-1.0), "samples.time"),
    "samples of fewer positions": (_set("samples", "position", value=[[0.0, 0.0]]), "samples.position"),
    "samples elsewhere": (_set("samples", "position", 1, 1, value=3e-5), "samples.position[1]"),
    "samples that are faster": (_set("samples", "velocity", 0, 0, value=1.1), "samples.velocity[0] = [1.1,"),
    "samples that turn": (_set("samples", "heading", 1, value=0.1), "samples.heading[1] = 0.1"),
    "samples of another speed": (_set("samples", "speed", 0, value=1.1), "samples.speed[0] = 1.1"),
    "samples that brake": (_set("samples", "acceleration", 0, value=-1.0), "samples.acceleration[0] = -1.0"),
    "samples that bend": (_set("samples", "curvature", 0, value=0.5), "samples.curvature[0] = 0.5"),
    "degree as text": (_set("path", "degree", value="3"), "path.degree"),
    "knots": (_set("path", "knots", value=[0.0, 1.0]), "path.knots"),
    "knots of nothing": (_set("path", "knots", value=None), "path.knots"),
    "offsets": (_set("path", "offsets", value=[0.0]), "path.offsets"),
    "offset is text": (_set("path", "offsets", value=["x"]), "path.offsets"),
    "guide": (_set("path", "guide", "kind", value="loop"), "path.guide"),
    "a key that there is not": (_set("note", value="x"), "note = 'x': unknown key"),
    "a curved guide of few headings": (
        _both(_set("path", "guide", "kind", value="curved"), _set("path", "guide", "headings", value=[0.0, 1.0])),
        "path.guide.headings",
    ),
    "a curved guide without headings": (_set("path", "guide", "kind", value="curved"), "path.guide.headings = null"),
    "a guide without length": (_set("path", "guide", "length", value=0.0), "path.guide.length = 0.0"),
    "several faults": (_both(_set("reason", value=3), _set("wall_time", value="x")), "wall_time = 'x'"),
    "guide's length": (_set("path", "guide", "length", value=3.0), "path.knots"),
    "guide's origin": (_set("path", "guide", "origin", value=[1.0]), "path.guide.origin"),
    "acceleration knots": (_set("acceleration", "knots", value=[0.0, 0.5]), "acceleration.knots"),
    "coefficients": (_set("acceleration", "coefficients", value=[1.0]), "acceleration.coefficients"),
    "start speed": (_set("acceleration", "start_speed", value=-1.0), "acceleration.start_speed = -1.0"),
    "travel time": (_set("travel_time", value=1.0), "travel_time = 1.0"),
    "travel time is text": (_set("travel_time", value="7"), "travel_time"),
    "status": (_set("status", value="fine"), "status"),
    "iterations": (_set("iterations", value=-1), "iterations = -1"),
    "wall time": (_set("wall_time", value=True), "wall_time"),
    "clearance": (_set("clearance", value=None), "clearance"),
    "start time of too many digits": (_set("start_time", value=HUGE), "start_time = 1000"),
    "travel time of too many digits": (_set("travel_time", value=HUGE), "travel_time = 1000"),
    "wall time of too many digits": (_set("wall_time", value=HUGE), "wall_time = 1000"),
    "lower bound of too many digits": (_set("lower_bound", value=HUGE), "lower_bound = 1000"),
    "lower bound as text": (_set("lower_bound", value="x"), "lower_bound"),
    "origin of too many digits": (_set("path", "guide", "origin", value=[0, HUGE]), "path.guide.origin"),
    "length of too many digits": (_set("path", "guide", "length", value=HUGE), "path.guide"),
    "offset of too many digits": (_set("path", "offsets", 3, value=HUGE), "path.offsets"),
    "knot of too many digits": (_set("path", "knots", 3, value=HUGE), "path.knots"),
    "coefficient of too many digits": (_set("acceleration", "coefficients", 3, value=-HUGE), "acceleration.coeff"),
    "offset out of this world": (_set("path", "offsets", 3, value=1e300), "path.offsets"),
    "coefficient out of this world": (
        _set("acceleration", "coefficients", 3, value=1e200),
        "acceleration.coefficients",
    ),
    "start time out of this world": (_set("start_time", value=1e300), "start_time = 1e+300"),
    "origin out of this world": (_set("path", "guide", "origin", value=[1e200, 0.0]), "path.guide.origin"),
    "start speed out of this world": (_set("acceleration", "start_speed", value=1e300), "acceleration.start_speed"),
    "stops as text": (_set("stops", value="no"), "stops"),
    "a stop that takes no time": (_both(_set("stops", value=True), _set("travel_time", value=0.0)), "travel_time = 0"),
    "a stop before it begins": (_both(_set("stops", value=True), _set("travel_time", value=-7.0)), "travel_time = -7"),
    "a stop that never comes": (_both(_set("stops", value=True), _set("travel_time", value=1e300)), "travel_time = 1e"),
    "a trip that never arrives": (
        _both(
            _set("acceleration", "coefficients", value=[-2.0] * 21),
            _set("acceleration", "knots", value=[k / 21 for k in range(22)]),
        ),
        "travel_time",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_faulty_plan_file_is_refused_by_name(plan: sp.Plan, tmp_path: Path, name: str) -> None:
    change, expected = BAD[name]
    data = plan.to_dict(samples=2)
    change(data)
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(data))
    with pytest.raises(sp.PlanError) as caught:
        sp.Plan.load(file)
    assert str(file) in str(caught.value)
    assert expected in str(caught.value)


def test_all_faults_of_a_plan_file_are_listed(plan: sp.Plan, tmp_path: Path) -> None:
    text = json.dumps(plan.to_dict(samples=2) | {"reason": 3, "iterations": 0.5})
    file = tmp_path / "bad.json"
    file.write_text(text[:-1] + ', "solver": "again"}')
    with pytest.raises(sp.PlanError, match="2 faults") as caught:
        sp.Plan.from_dict(json.loads(text), str(file))
    assert [fault.path for fault in caught.value.faults] == ["reason", "iterations"]
    with pytest.raises(sp.PlanError, match=r"solver = 'again': must be given only once"):
        sp.Plan.load(file)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", '{"schema": NaN}', '{"schema": ' + 5000 * "1" + "}", 9999 * "["])
def test_what_is_no_plan_at_all_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "bad.json"
    file.write_text(text)
    with pytest.raises(sp.PlanError, match=r"bad\.json"):
        sp.Plan.load(file)


@pytest.mark.parametrize("travel_time", [np.inf, np.nan, -1.0])
def test_there_is_no_trip_that_never_arrives(plan: sp.Plan, travel_time: float) -> None:
    trajectory = plan.trip.trajectory
    with pytest.raises(ValueError, match="never arrives"):
        Trip(plan.trip.frame, Trajectory(trajectory.path, trajectory.beta, travel_time))


def test_samples_of_seven_digits_are_read(plan: sp.Plan) -> None:
    data = plan.to_dict(samples=201)
    samples = {name: np.array(values) for name, values in data["samples"].items()}
    data["samples"] = {
        name: np.vectorize(lambda value: float(f"{value:.7g}"))(values).tolist() for name, values in samples.items()
    }
    data["samples"]["time"] = np.clip(data["samples"]["time"], plan.start_time, plan.arrival_time).tolist()
    assert sp.Plan.from_dict(data, "rounded").travel_time == plan.travel_time
    del data["samples"]
    assert sp.Plan.from_dict(data, "none").travel_time == plan.travel_time


@pytest.mark.parametrize("clock", [0.0, 1.7e9])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("vehicle", [{}, {"max_jerk": 2.0}])
def test_plans_of_all_sizes_are_read_with_their_samples(size: float, clock: float, vehicle: dict[str, float]) -> None:
    sizes = {"radius": 0.3 * size, "max_speed": 3.0 * size, "max_acceleration": 1.5 * size}
    sizes |= {"max_deceleration": 2.0 * size} | {name: value * size for name, value in vehicle.items()}
    made = sp.plan(
        sp.Scenario(
            vehicle=sizes,
            start={"time": clock, "position": [7.0 * size, 0.0], "heading": 0.0, "speed": size},
            goal={"position": [27.0 * size, 3.0 * size]},
        )
    )
    assert made.certified
    assert sp.Plan.from_dict(made.to_dict(500), "plan.json").travel_time == made.travel_time


def test_what_a_plan_file_states_is_not_believed(tmp_path: Path) -> None:
    scenario = scene(disc("o", (10.0, 0.0)))
    made = sp.plan(scenario)
    made.save(tmp_path / "plan.json")
    loaded = sp.Plan.load(tmp_path / "plan.json")
    again = loaded.verified(scenario)
    assert again.certified and again.reason is None and again.stated_status is None
    assert again.clearance == sp.certify(scenario, made).clearance
    nearer = scene(disc("o", (10.0, 0.0), radius=1.0))
    worse = loaded.verified(nearer)
    assert worse.status is PlanStatus.INFEASIBLE and not worse.certified
    assert worse.reason is not None and "clearance to o" in worse.reason
    assert worse.clearance.minimum < 0.0
