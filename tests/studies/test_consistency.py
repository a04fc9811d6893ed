"""The consistency study: its parts against other computations, its results on disk, and the slopes that it finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import scp_planner as sp
from scp_planner.errors import StudyError
from scp_planner.studies.consistency import (
    OTHER_WAY,
    RESULTS,
    ConsistencyResult,
    Fit,
    ResultFile,
    run_consistency,
)
from scp_planner.studies.field import (
    FIELD,
    METRICS,
    BorderPoint,
    ConsistencySettings,
    Record,
    Replication,
    Study,
    ZoneKind,
    border,
)
from scp_planner.studies.figures import plot_border, plot_consistency
from scp_planner.threat_zones.batch import ZoneBatch

TINY = ConsistencySettings(sizes=(100, 1000), noises=(0.02,), repetitions=2, points=16)


@pytest.fixture(scope="module")
def study() -> Study:
    return Study(TINY)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> ConsistencyResult:
    """The study's quick mode, which CI runs."""
    return run_consistency(ConsistencySettings.quick(), folder=tmp_path_factory.mktemp("quick"))


# the claims


@pytest.mark.parametrize("metric", ["sup_difference", "offsets", "accelerations", "path", "motion", "travel_time"])
@pytest.mark.slow
def test_with_estimated_centres_everything_falls_like_the_root_of_n(metric: str, quick: ConsistencyResult) -> None:
    slope = next(s for s in quick.slopes if (s.kind, s.metric) == ("estimate", metric))
    assert slope.slope == pytest.approx(-0.5, abs=0.1)
    assert slope.lower < slope.slope < slope.upper


@pytest.mark.slow
def test_with_estimated_centres_the_excess_falls_like_n(quick: ConsistencyResult) -> None:
    slope = next(s for s in quick.slopes if (s.kind, s.metric) == ("estimate", "excess"))
    assert slope.slope == pytest.approx(-1.0, abs=0.25)


@pytest.mark.slow
def test_confidence_regions_shrink_to_the_true_zones_at_the_same_rate(quick: ConsistencyResult) -> None:
    noise, metrics = quick.settings.noises[0], {metric.name: metric for metric in METRICS}
    for name, allowed in (("sup_difference", 0.1), ("motion", 0.15)):
        slope = quick.settled_slope(ZoneKind.REGION, noise, metrics[name])
        assert slope is not None
        assert slope.slope == pytest.approx(-0.5, abs=allowed)


@pytest.mark.slow
def test_minimisers_exist_inside_the_domain_and_nothing_is_lower(quick: ConsistencyResult) -> None:
    assert all(record.values["lower_points"] == 0.0 for record in quick.records)
    assert all(record.values["least_speed"] > 0.5 for record in quick.records)


@pytest.mark.slow
def test_minimisers_of_the_true_objective_have_the_lowest_true_value(quick: ConsistencyResult) -> None:
    assert all(record.values["excess"] >= -1e-9 for record in quick.records)


def test_at_the_border_of_the_domain_the_slope_is_infinite_and_from_rest_the_travel_time_too() -> None:
    points = border((1.0, 0.0))
    outside = [point for point in points if point.distance < 0.0]
    assert [point.value for point in outside] == [np.inf, np.inf]
    moving = [point for point in points if point.start_speed == 1.0 and 0.0 < point.distance < 1e-5]
    assert moving[-1].travel_time == pytest.approx(2.0 * 20.0 / 1.0, rel=1e-3)
    assert moving[-1].final_speed == pytest.approx(0.0, abs=1e-3)
    assert _exponent(moving, "slope") == pytest.approx(-0.5, abs=0.01)
    resting = [point for point in points if point.start_speed == 0.0 and point.distance > 0.0]
    # tau = sqrt(2 L / a) from rest
    assert [point.travel_time for point in resting] == pytest.approx(
        [float(np.sqrt(2.0 * 20.0 / point.distance)) for point in resting]
    )
    assert _exponent(resting, "travel_time") == pytest.approx(-0.5, abs=1e-6)


def _exponent(points: Sequence[BorderPoint], name: str) -> float:
    x = np.log([point.distance for point in points])
    return float(np.polyfit(x, np.log([abs(getattr(point, name)) for point in points]), 1)[0])


# its parts


def test_the_minimiser_is_stationary_but_at_the_limits_of_acceleration(study: Study) -> None:
    gradient, free = study.truth.gradient(study.minimiser), study.truth.path_size
    limits, beta = study.problem.limits, study.minimiser[free:]
    assert gradient[:free] == pytest.approx(np.zeros(free), abs=1e-5)
    inside = (beta < limits.acceleration) & (beta > -limits.deceleration)
    assert gradient[free:][inside] == pytest.approx(np.zeros(inside.sum()), abs=1e-5)
    assert np.abs(study.minimiser[:free]).max() < FIELD.largest_offset


def test_the_second_derivative_at_the_minimiser_is_positive_definite(study: Study) -> None:
    """This is what makes minimisers converge like the root of n."""
    step, size = 1e-5, study.truth.size
    hessian = np.array(
        [
            (study.truth.gradient(study.minimiser + step * unit) - study.truth.gradient(study.minimiser - step * unit))
            / (2.0 * step)
            for unit in np.eye(size)
        ]
    )
    assert np.linalg.eigvalsh(0.5 * (hessian + hessian.T)).min() > 1e-3


def test_other_local_minima_are_clearly_higher(study: Study) -> None:
    values = [study.truth.value(omega) for omega in study.minima]
    assert values == sorted(values)
    assert values[1] > values[0] + 0.05


def test_the_compact_set_lies_in_the_box_and_the_domain(study: Study) -> None:
    points, free = study.compact_set, study.truth.path_size
    assert len(points) == TINY.points
    assert np.abs(points[:, :free]).max() <= FIELD.largest_offset
    assert points[:, free:].max() <= study.problem.limits.acceleration
    assert points[:, free:].min() >= -study.problem.limits.deceleration
    for omega in points:
        trajectory = study.truth.trajectory(omega)
        assert trajectory.travel_time <= FIELD.max_travel_time
        assert trajectory.speed_control_points().min() >= 0.0


def test_values_over_the_set_are_those_of_the_objective(study: Study) -> None:
    assert study.true_values == pytest.approx([study.truth.value(omega) for omega in study.compact_set], rel=1e-12)
    observed = sp.zones(study.observed(Replication(0.1, 50, 0)))
    batch = ZoneBatch.of(observed, study.problem.frame, study.problem.zones.radius[0] - 0.7)
    problem = study.problem.among(batch)
    expected = [study.objective(problem).value(omega) for omega in study.compact_set]
    assert study.set_values(problem.zones) == pytest.approx(expected, rel=1e-9)


def test_observations_are_n_in_the_window_and_scatter_as_they_should(study: Study) -> None:
    observed = study.observed(Replication(0.1, 4000, 3))
    for obstacle, true in zip(observed.obstacles, study.scenario.obstacles, strict=True):
        assert obstacle.observations is not None
        assert isinstance(true.motion, sp.Motion)
        time, seen = np.array(obstacle.observations.time), np.array(obstacle.observations.position)
        assert (len(time), time[0], time[-1]) == (4000, -TINY.window, 0.0)
        truth = (
            np.array(true.motion.position)
            + np.outer(time, true.motion.velocity)
            + 0.5 * np.outer(time**2, true.motion.acceleration)
        )
        assert np.cov((seen - truth).T) == pytest.approx(np.diag([0.01, 0.01]), abs=1e-3)
        assert np.abs((seen - truth).mean(axis=0)).max() < 0.01


def test_repetitions_differ_and_are_repeatable(study: Study) -> None:
    def first(task: Replication) -> object:
        observations = study.observed(task).obstacles[0].observations
        assert observations is not None
        return observations.position

    assert first(Replication(0.1, 10, 0)) == first(Replication(0.1, 10, 0))
    assert first(Replication(0.1, 10, 0)) != first(Replication(0.1, 10, 1))
    assert first(Replication(0.1, 10, 0)) != first(Replication(0.05, 10, 0))


# means and slopes


def synthetic(
    exponent: float, repetitions: int = 50, elsewhere: tuple[int, ...] = (), seed: int = 4
) -> ConsistencyResult:
    """Results that follow a power of n, times noise; at some sizes one minimiser lies in another basin."""
    settings = ConsistencySettings(repetitions=repetitions, noises=(0.1,))
    random = np.random.default_rng(seed)
    records = [
        Record(
            Replication(0.1, size, repetition),
            kind,
            {metric.name: float(3.0 * size**exponent * random.gamma(4.0, 0.25)) for metric in METRICS}
            | {OTHER_WAY: float(size in elsewhere and repetition == 0)},
        )
        for kind in ZoneKind
        for size in settings.sizes
        for repetition in range(repetitions)
    ]
    return ConsistencyResult(settings, tuple(records))


@pytest.mark.parametrize("exponent", [-0.5, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_the_fit_finds_the_exponent_and_its_band_covers_it(exponent: float) -> None:
    slopes = [slope for seed in range(6) for slope in synthetic(exponent, seed=seed).slopes if slope.fit == Fit.ALL]
    assert len(slopes) == 6 * len(ZoneKind) * len(METRICS)
    assert [slope.slope for slope in slopes] == pytest.approx([exponent] * len(slopes), abs=0.1)
    covered = [slope.lower <= exponent <= slope.upper for slope in slopes]
    assert 0.86 < np.mean(covered) <= 1.0
    assert all(slope.expected == metric.exponent for slope, metric in zip(slopes, 12 * METRICS, strict=True))


def test_slopes_of_minimisers_are_fitted_again_where_all_are_in_the_true_basin() -> None:
    result = synthetic(-0.5, elsewhere=(10, 300))
    for kind in ZoneKind:
        assert result.settled_from(kind, 0.1) == 1000
    starts = {slope.from_size for slope in result.slopes if slope.metric == "motion"}
    assert starts == {30, 1000}
    fits = [slope.fit for slope in result.slopes if (slope.kind, slope.metric) == ("region", "motion")]
    assert fits == [Fit.ALL, Fit.SETTLED, Fit.SAME_WAY]
    assert {slope.from_size for slope in result.slopes if slope.metric == "sup_difference"} == {30}
    shares = [mean.mean for mean in result.means if (mean.kind, mean.metric) == ("region", OTHER_WAY)]
    assert shares == pytest.approx([0.02, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0])


def test_jumps_to_another_way_make_slopes_steep_and_those_on_the_same_way_do_not() -> None:
    """A fifth of the minimisers at n = 30 and 100 is far away; the others follow the power of n as they did."""
    plain = synthetic(-0.5)
    jumped = tuple(
        replace(record, values={name: 10.0 for name in record.values} | {OTHER_WAY: 1.0})
        if record.task.size in (30, 100) and record.task.repetition < 10
        else record
        for record in plain.records
    )
    result = replace(plain, records=jumped)
    for metric in METRICS[1:]:
        slopes = {slope.fit: slope for slope in result.slopes if (slope.kind, slope.metric) == ("region", metric.name)}
        assert slopes[Fit.ALL].slope < -0.7
        assert slopes[Fit.SAME_WAY].slope == pytest.approx(-0.5, abs=0.1)
        assert slopes[Fit.SAME_WAY].lower < slopes[Fit.SAME_WAY].slope < slopes[Fit.SAME_WAY].upper
        assert slopes[Fit.SAME_WAY].from_size == 30
        same = result.same_way_means(ZoneKind.REGION, 0.1, metric)
        kept = plain.values(ZoneKind.REGION, 0.1, metric.name)[1, 10:]
        assert same[30] == pytest.approx(kept.mean())
    assert "20%" in result.table()


def test_where_minimisers_never_settle_there_is_no_asymptotic_slope() -> None:
    result = synthetic(-0.5, elsewhere=(10_000,))
    assert result.settled_from(ZoneKind.REGION, 0.1) is None
    assert result.settled_slope(ZoneKind.REGION, 0.1, METRICS[1]) is None
    assert result.settled_slope(ZoneKind.REGION, 0.1, METRICS[0]) is not None
    assert " - " in result.table()


# results on disk


def test_results_are_kept_and_an_interrupted_study_goes_on(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The power goes off in the middle of the second line."""
    settings = replace(TINY, sizes=(100,), points=8)
    whole = run_consistency(settings, folder=tmp_path, progress=True)
    assert capfd.readouterr().err == "", "no bar without a terminal"
    file = tmp_path / RESULTS
    first, second = file.read_text().splitlines()
    file.write_text(first + "\n" + second[:11])
    assert run_consistency(settings, folder=tmp_path) == whole
    assert sorted(file.read_text().splitlines()) == sorted([first, second])


@pytest.mark.slow
def test_results_do_not_depend_on_the_number_of_processes(tmp_path: Path) -> None:
    settings = replace(TINY, sizes=(100,), points=8)
    assert run_consistency(settings, folder=tmp_path, workers=2) == run_consistency(settings)


def test_results_of_other_settings_are_left_alone(tmp_path: Path) -> None:
    task, values = Replication(0.02, 100, 0), {metric.name: 1.0 for metric in METRICS}
    records = [Record(task, kind, values) for kind in ZoneKind]
    mine, other = (ResultFile(tmp_path / RESULTS, name) for name in ("mine", "other"))
    mine.append(records)
    assert mine.load() == {task: records}
    assert other.load() == {}
    assert TINY.fingerprint == replace(TINY, repetitions=9, noises=(0.3,)).fingerprint
    assert TINY.fingerprint != replace(TINY, seed=1).fingerprint


@pytest.mark.parametrize("text", ["nonsense\n", "[]\n", '{"noise": 1}\n', "1\n"])
def test_a_file_of_something_else_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / RESULTS).write_text(text)
    with pytest.raises(StudyError, match=r"results.jsonl: line 1 is no result of this study"):
        run_consistency(TINY, folder=tmp_path)
    assert (tmp_path / RESULTS).read_text() == text


# what is written


@pytest.mark.slow
def test_tables_and_figures_are_written(quick: ConsistencyResult, tmp_path: Path) -> None:
    names = [path.name for path in quick.save(tmp_path)]
    assert names == ["summary.csv", "slopes.csv", "border.csv"]
    slopes = (tmp_path / "slopes.csv").read_text().splitlines()
    assert slopes[0] == "kind,noise,metric,fit,from_size,slope,lower,upper,expected"
    assert len(slopes) == 1 + len(quick.slopes)
    plot_consistency(quick, tmp_path / "consistency.png")
    plot_border(border(), tmp_path / "border.svg")
    assert (tmp_path / "consistency.png").stat().st_size > 20_000
    assert "<svg" in (tmp_path / "border.svg").read_text()
    table = quick.table().splitlines()
    assert table[1].split()[:2] == ["zones", "noise"]
    assert len(table) == 15
    assert table[12].split()[:3] == ["zones", "noise", "offsets"]
