"""Closed loops: what sensors see, how the vehicle follows, what others do, what is written down."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_type_hints

import command
import numpy as np
import pytest
from scenes import CROSSERS, disc, scene

import scp_planner as sp
from benchmarks.online_faults import KINDS, injected_run
from scp_planner import builtin
from scp_planner.scenario.process_model import ProcessModel, RandomWalkVelocity
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.online import OnlineSettings
from scp_planner.simulation.loop import simulate
from scp_planner.simulation.run import Run
from scp_planner.simulation.sensors import LEAST_NOISE, Sensor
from scp_planner.simulation.setup import Follower, SimulationChoices, SimulationSettings, world_of
from scp_planner.simulation.worlds import Script, SocialForces, VehicleState, World
from scp_planner.tracking.tracks import Track

SHORT = {"goal": {"position": (8.0, 0.0)}}


@pytest.fixture(scope="module")
def run() -> Run:
    return simulate(scene(*CROSSERS), seed=3)


def observations(run: Run) -> list[Any]:
    return [seen for record in run.records for seen in record.observations]


def reloaded(run: Run, folder: Path) -> Run:
    run.save(folder / "run.json")
    return Run.load(folder / "run.json")


def test_choices_are_keywords_or_a_setup() -> None:
    """Both say the same, and keywords go before the setup."""
    assert get_type_hints(SimulationChoices) == get_type_hints(SimulationSettings)
    one = simulate(scene(**SHORT), setup=SimulationSettings(sensors=[Sensor(rate=4.0)], time_limit=9.0), time_limit=0.5)
    assert one == simulate(scene(**SHORT), sensors=[Sensor(rate=4.0)], time_limit=0.5)
    assert not one.arrived
    with pytest.raises(TypeError, match="colour"):
        simulate(scene(), colour=3)  # type: ignore[call-arg]


def test_a_limit_of_the_jerk_is_kept_from_plan_to_plan() -> None:
    """With a vehicle that takes up each plan late, and is off it: by differences of the speeds that are recorded."""
    scenario = scene(**SHORT, vehicle={"max_jerk": 4.0})
    run = simulate(scenario, seed=1, follower=Follower(tracking_error=0.05, reaction_time=0.05))
    assert run.arrived and all(cycle.safe for cycle in run.records)
    step = np.diff(run.time)
    acceleration = np.diff(run.speed) / step
    jerk = np.diff(acceleration) / (0.5 * (step[1:] + step[:-1]))
    assert np.abs(jerk).max() <= 4.0 * (1.0 + 1e-6)
    assert np.abs(jerk).max() > 2.0


# the record


def test_vehicle_arrives_among_accelerating_obstacles(run: Run) -> None:
    assert run.arrived and not run.contact and not run.contact_standing
    assert run.position[-1] == pytest.approx((20.0, 0.0), abs=1e-3)
    assert run.travel_time == pytest.approx(run.time[-1]) and run.travel_time < 1.1 * 7.18
    assert sum(run.outcomes.values()) == len(run.records) == len(run.plans) == math.ceil(run.travel_time * 10.0 - 1e-6)
    assert all(record.reason for record in run.records)


@pytest.mark.parametrize("rate", [10.0, 7.0, 3.0])
@pytest.mark.parametrize("speed", [0.0, None])
def test_vehicle_drives_on_within_the_radius_of_its_goal(speed: float | None, rate: float) -> None:
    """It comes to rest as planned, and not at once where the goal's radius begins."""
    run = simulate(scene(goal={"position": (5.0, 0.0), "radius": 0.4, "speed": speed}), rate=rate, time_limit=10.0)
    assert run.arrived and run.travel_time < 6.0
    assert math.dist(run.position[-1], (5.0, 0.0)) <= 0.4 + 1e-6
    speeds = np.array(run.speed)
    assert np.all(np.diff(speeds) >= -2.0 * np.diff(run.time) - 1e-3)  # the vehicle's deceleration
    if speed == 0.0:
        assert speeds[-1] == pytest.approx(0.0, abs=2e-3)


def test_clearance_is_that_of_the_course(run: Run) -> None:
    """Against the true motions, sampled more finely than the run is recorded."""
    motions: dict[str, Any] = {obstacle.id: obstacle.motion for obstacle in run.scenario.obstacles}
    radii = {obstacle.id: obstacle.shape.disc for obstacle in run.scenario.obstacles}  # type: ignore[union-attr]
    least = math.inf
    for record, plan in zip(run.records, run.plans, strict=True):
        times = np.linspace(record.time, min(record.time + 0.1, run.time[-1]), 100)
        for name, motion in motions.items():
            centers = (
                np.array(motion.position)
                + times[:, None] * motion.velocity
                + 0.5 * times[:, None] ** 2 * np.array(motion.acceleration)
            )
            gaps = np.linalg.norm(plan.position(times) - centers, axis=1) - radii[name] - 0.3
            least = min(least, float(gaps.min()))
    assert run.least_clearance == pytest.approx(least, abs=2e-3)
    assert run.least_clearance == pytest.approx(min(record.clearance for record in run.records), abs=1e-9)


def test_same_seed_same_run_and_the_file_holds_all_of_it(run: Run, tmp_path: Path) -> None:
    one, again, other = (simulate(scene(*CROSSERS), seed=seed, time_limit=0.8) for seed in (3, 3, 4))
    assert again == one and np.array_equal(again.position, one.position)
    assert other != one and not np.array_equal(other.position, one.position)
    assert np.array_equal(run.position[: len(one.position)], one.position)
    assert reloaded(run, tmp_path) == run


def test_same_seed_same_run_with_everything_that_is_random() -> None:
    def drive() -> Run:
        crowd = SocialForces([(4.0, 2.0), (6.0, -2.0)], [(4.0, -6.0), (6.0, 6.0)], [1.0, 1.2])
        sensors = (Sensor(rate=10.0, noise=0.1, dropout=0.3), Sensor(rate=4.0, noise=0.02, latency=0.2, range=6.0))
        follower = Follower(tracking_error=0.05, reaction_time=0.02)
        return simulate(scene(**SHORT), seed=5, world=crowd, sensors=sensors, follower=follower, time_limit=1.5)

    assert drive() == drive()


# sensors


def test_noise_is_that_of_the_sensor(run: Run) -> None:
    motions = {obstacle.id: obstacle.motion for obstacle in run.scenario.obstacles}
    errors = []
    for seen in observations(run):
        motion: Any = motions[seen.obstacle]
        place = np.array(motion.position) + seen.time * np.array(motion.velocity)
        errors.append(np.array(seen.position) - place - 0.5 * seen.time**2 * np.array(motion.acceleration))
        assert seen.deviation == 0.1 and seen.arrival == seen.time
    size = 2 * len(errors)
    # The standard deviation of so many has one of 0.1 / sqrt(2 n).
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(0.1, abs=4.0 * 0.1 / math.sqrt(2 * size))
    assert np.abs(np.mean(errors, axis=0)).max() < 4.0 * 0.1 / math.sqrt(len(errors))


def test_sensor_looks_at_its_rate() -> None:
    run = simulate(scene(disc("d", (4.0, 6.0)), **SHORT), sensors=[Sensor(rate=4.0)], rate=10.0)
    times = [seen.time for seen in observations(run)]
    assert times == pytest.approx([0.25 * k for k in range(1, len(times) + 1)], abs=1e-9)
    assert len(times) == math.floor(4.0 * run.records[-1].time + 1e-9)


def test_noise_of_nothing_is_exact() -> None:
    run = simulate(scene(disc("d", (4.0, 6.0), (0.1, 0.0)), **SHORT), noise=0.0, rate=5.0)
    for seen in observations(run):
        assert seen.position == pytest.approx((4.0 + 0.1 * seen.time, 6.0), abs=1e-9)
        assert seen.deviation == LEAST_NOISE * NaturalUnits.of(run.scenario).length


def test_nothing_is_seen_out_of_range_or_view() -> None:
    posts = [disc("ahead", (6.0, 2.0)), disc("far", (40.0, 0.5)), disc("behind", (-2.0, 0.5))]
    sensors = [Sensor(range=10.0, field_of_view=math.pi)]
    run = simulate(scene(*posts, start={"position": (0.0, 0.0)}, **SHORT), sensors=sensors)
    seen = {one.obstacle for one in observations(run)}
    assert seen == {"ahead"}
    places = dict(zip(np.round(run.time, 9).tolist(), run.position, strict=True))
    for one in observations(run):
        vehicle = places[round(one.time, 9)]
        assert np.linalg.norm(np.array([6.0, 2.0]) - vehicle) <= 10.0
    # Once the vehicle has passed it, it is not in view any more.
    passed = run.time[run.position[:, 0] > 6.5][0]
    assert max(one.time for one in observations(run)) < passed
    assert {zone.id for zone in run.records[0].zones} == {"ahead"}


def test_latency_delays_what_is_heard() -> None:
    run = simulate(scene(disc("d", (4.0, 6.0)), **SHORT), sensors=[Sensor(latency=0.25)], time_limit=1.5)
    assert len(run.records) >= 15
    for record in run.records:
        for seen in record.observations:
            assert seen.arrival == pytest.approx(seen.time + 0.25)
            assert record.time - 0.1 - 1e-9 <= seen.arrival - 1e-9 <= record.time
    assert {seen.time for seen in observations(run)} >= {-0.1, 0.0}  # seen before the start, heard of after it


def test_dropouts_are_as_many_as_said() -> None:
    posts = [disc(f"d{k}", (10.0, 6.0 + 2.0 * k)) for k in range(8)]
    run = simulate(scene(*posts), sensors=[Sensor(dropout=0.4)], online=OnlineSettings())
    looks = 8 * (len(run.records) - 1)
    missed = 1.0 - len(observations(run)) / looks
    assert missed == pytest.approx(0.4, abs=4.0 * math.sqrt(0.24 / looks))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rate": 0.0}, "rate 0.0 must be finite and greater than 0"),
        ({"noise": -0.1}, "noise -0.1 must be finite and at least 0"),
        ({"range": 0.0}, "range 0.0 must be greater than 0"),
        ({"field_of_view": 0.0}, r"field_of_view 0.0 must be in \(0, 2 pi\]"),
        ({"latency": math.inf}, "latency inf must be finite and at least 0"),
        ({"dropout": 1.0}, r"dropout 1.0 must be in \[0, 1\)"),
    ],
)
def test_sensors_are_checked(values: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Sensor(**values)


# the vehicle


def test_vehicle_drifts_within_its_tracking_error() -> None:
    run = simulate(scene(*CROSSERS[:1], **SHORT), follower=Follower(tracking_error=0.06), seed=1)
    assert run.arrived and not run.contact
    off = []
    for record, plan in zip(run.records, run.plans, strict=True):
        # Each plan begins where the vehicle is; within a cycle it drifts from there.
        inside = (run.time > record.time + 1e-9) & (run.time <= record.time + 0.1 + 1e-9)
        off += np.linalg.norm(run.position[inside] - plan.position(run.time[inside]), axis=1).tolist()
    assert 0.01 < max(off) <= 0.06 + 1e-9


def test_new_plans_are_followed_after_the_reaction_time() -> None:
    run = simulate(scene(*CROSSERS[:1], **SHORT), follower=Follower(reaction_time=0.06), rate=10.0, seed=1)
    assert run.arrived
    for number in range(1, len(run.records) - 1):
        before, plan, time = run.plans[number - 1], run.plans[number], run.records[number].time
        for after, followed in ((0.02, before), (0.04, before), (0.1, plan)):
            (k,) = np.flatnonzero(np.abs(run.time - (time + after)) < 1e-6)
            assert np.linalg.norm(run.position[k] - followed.position(time + after)) < 0.05
        (k,) = np.flatnonzero(np.abs(run.time - (time + 0.02)) < 1e-6)
        assert run.speed[k] == pytest.approx(float(before.speed(time + 0.02)), abs=1e-9)


def test_margin_is_that_of_the_follower() -> None:
    run = simulate(scene(disc("d", (4.0, 3.0)), **SHORT), follower=Follower(0.05, 0.02), time_limit=0.1)
    assert run.records[0].zones[0].radius == pytest.approx(0.5 + 0.05 + 0.02 * 3.0)


@pytest.mark.parametrize("side", [1.0, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_curved_guides_are_driven(side: float) -> None:
    """The guide says on which side of a post to pass, to the end."""
    guide = [[0.0, 0.0], [4.0, 3.0 * side], [12.0, 3.0 * side], [16.0, 0.0]]
    post = disc("post", (8.0, 0.0), radius=0.8)
    run = simulate(scene(post, goal={"position": (16.0, 0.0)}, guide=guide), rate=5.0)
    assert run.arrived and not run.contact
    assert run.travel_time < 6.6
    assert side * np.interp(8.0, run.position[:, 0], run.position[:, 1]) > 1.1


# what others do


def test_contact_is_seen_by_the_simulation_where_the_planner_is_blind() -> None:
    blind = [Sensor(range=0.05)]
    run = simulate(scene(disc("post", (4.0, 0.1)), **SHORT), sensors=blind)
    assert run.arrived and run.contact and run.least_clearance == pytest.approx(0.1 - 0.5 - 0.3, abs=0.02)


def test_contact_of_a_standing_vehicle_counts_apart() -> None:
    """A post stops the vehicle in a corridor; then something that it never sees runs into it, and leaves."""
    corridor = {"min": (-2.0, -1.0), "max": (21.0, 1.0)}
    rammer = (np.array([0.0, 4.0, 6.3, 9.0]), np.array([[-20.0, 0.0], [-20.0, 0.0], [3.5, 0.0], [-20.0, 0.0]]))
    world = {"post": lambda t: np.tile([6.0, 0.0], (len(t), 1)), "rammer": rammer}
    blind = [Sensor(range=7.0, field_of_view=1.0)]
    scenario = scene(disc("post", (6.0, 0.0), radius=0.8), bounds=corridor)
    shapes = {"rammer": sp.Disc(disc=1.2)}
    run = simulate(
        scenario, world=world, sensors=blind, online=OnlineSettings(), shapes=shapes, time_limit=8.0, rate=4.0
    )
    assert not run.arrived and not run.contact and run.contact_standing
    assert run.outcomes["braking"] > 10 and run.least_clearance > 0.0


class Pacer:
    """Somebody who walks beside the vehicle, far enough for it to drive on, and remembers what it was told."""

    def __init__(self) -> None:
        self.told: list[tuple[float, VehicleState]] = []

    def step(self, dt: float, vehicle: VehicleState) -> Mapping[str, Any]:
        self.told.append((dt, vehicle))
        return {"pacer": vehicle.position + np.array([0.0, 3.5])}


def test_world_is_told_of_the_vehicle() -> None:
    pacer = Pacer()
    assert isinstance(pacer, World)
    run = simulate(scene(**SHORT), world=pacer, history=1.0, shapes={"pacer": sp.Disc(disc=0.4)}, rate=5.0)
    assert run.arrived and not run.contact
    assert sum(dt for dt, _ in pacer.told) == pytest.approx(run.travel_time + 1.0, abs=1e-6)
    states = [state for _, state in pacer.told]
    assert [state.time for state in states] == sorted(state.time for state in states)
    assert states[-1].radius == 0.3 and np.linalg.norm(states[-1].velocity) > 1.0
    assert run.records[5].zones[0].radius == pytest.approx(0.4)


def test_crowd_that_reacts_is_driven_through() -> None:
    """People change their minds: they are estimated with process noise."""
    process = ProcessModel(process=RandomWalkVelocity(diffusion=0.3), velocity_deviation=1.0, noise_deviation=0.1)
    rng = np.random.default_rng(2)
    positions = np.column_stack([rng.uniform(3.0, 8.0, 5), rng.uniform(-5.0, 5.0, 5)])
    crowd = SocialForces(positions, positions * [1.0, -1.0], np.full(5, 0.8))
    scenario = scene(
        goal={"position": (10.0, 0.0)},
        vehicle={"max_speed": 1.5},
        start={"speed": 0.0},
        confidence={"probability": 0.95, "level": "per_time"},
    )
    model = sp.Model(order=1, process=process)
    run = simulate(scenario, world=crowd, seed=4, history=3.0, time_limit=30.0, model=model, rate=4.0)
    assert run.arrived and not run.contact
    assert {name for name in run.obstacles} == {f"p{k}" for k in range(5)}


def test_worlds_are_functions_tracks_or_arrays() -> None:
    times, place = np.array([-10.0, 60.0]), np.array([[4.0, 3.0], [4.0, 3.0]])
    still = scene(disc("d", (4.0, 3.0)), **SHORT)
    runs = [
        simulate(still, seed=2, world={"d": given}, time_limit=0.5)
        for given in ((times, place), Track("d", times, place), lambda t: np.tile([4.0, 3.0], (len(t), 1)))
    ]
    assert runs[0] == runs[1] == runs[2] == simulate(still, seed=2, time_limit=0.5)


def test_obstacle_that_leaves_is_forgotten() -> None:
    leaves = (np.array([-5.0, 1.0]), np.array([[4.0, 3.0], [4.0, 3.0]]))
    run = simulate(scene(**SHORT, start={"speed": 0.0}), world={"d": leaves}, rate=5.0)
    known = [bool(record.zones) for record in run.records]
    assert known[0] and not known[-1]
    assert np.isnan(run.obstacles["d"][-1]).all()


def test_truth_of_observed_obstacles_is_drawn_from_what_is_open() -> None:
    """The zones of the scenario, per time at 50 %, hold the true centre about as often as they say."""
    scenario = builtin.load("radar")
    scenario = scenario.model_copy(update={"confidence": sp.Confidence(probability=0.5, level="per_time")})
    zones, now = sp.zones(scenario), np.zeros(1)
    truths = [world.at(now) for seed in range(100) if isinstance(world := world_of(scenario, None, seed), Script)]
    inside = sum(
        bool(zone.signed_distance(0.0, truth[zone.id][0]) <= -zone.radius) for truth in truths for zone in zones
    )
    count = 100 * len(zones)
    assert inside / count == pytest.approx(0.5, abs=4.0 * math.sqrt(0.25 / count))
    quick = sp.Settings(max_runs=1, path_span=4.0, samples=40)  # how it drives does not matter
    run = simulate(scenario, settings=quick, seed=3, time_limit=0.1)
    for name, places in run.obstacles.items():
        assert places[0] == pytest.approx(truths[3][name][0], abs=1e-12)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"noise": -1.0}, "noise: -1.0 must be finite and at least 0"),
        ({"rate": 0.0}, "rate: 0.0 must be finite and greater than 0"),
        ({"history": math.nan}, "history: nan must be finite"),
        ({"seed": -1}, "seed: -1 must be a whole number of at least 0"),
        ({"world": 3}, "world: 3 is neither a mapping nor an object with a step"),
        ({"solver": "magic"}, "solver = 'magic': must be one of daqp"),
    ],
)
def test_misuse_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate(scene(), **values)


# films


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_run_is_animated(suffix: str, tmp_path: Path) -> None:
    import shutil

    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        pytest.skip("needs ffmpeg, which is not installed")
    path = tmp_path / f"run{suffix}"
    file = tmp_path / "scene.yaml"
    scene(disc("d", (3.0, 1.0)), goal={"position": (5.0, 0.0)}).save(file)
    result = command.run("simulate", file, "--rate", "5", "--animate", path, "--quiet")
    assert result.exit_code == 0, result.stderr
    data = path.read_bytes()
    assert data[:6] == b"GIF89a" if suffix == ".gif" else data[4:8] == b"ftyp"
    assert len(data) > 5000


# faults


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=pytest.mark.slow if seed % 2 else ()) for seed in range(len(KINDS))]
)
def test_faults_never_make_the_planner_raise_or_lie(seed: int) -> None:
    """Each kind of fault with another one; and twice, where there is time."""
    run = injected_run(seed, (KINDS[seed], KINDS[seed - 1]), longest=2.2, check_every=4)
    assert not run.error, run.error
    assert not run.refused, run.refused
    assert not run.unsaid
    assert run.cycles >= 20 and sum(run.outcomes.values()) == run.cycles


@pytest.mark.slow
def test_500_runs_with_faults() -> None:
    for seed in range(500):
        run = injected_run(seed)
        assert run.faultless, f"seed {seed}: {run.error or run.refused or run.unsaid}"
