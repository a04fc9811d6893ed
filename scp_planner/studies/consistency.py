"""The published convergence claims, measured: Q_n to Q, and the minimisers of Q_n to those of Q."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scp_planner.arrays import Array
from scp_planner.batch.local import LocalExecutor
from scp_planner.errors import StudyError
from scp_planner.files import regular_target, text_table, write_rows
from scp_planner.studies.field import (
    METRICS,
    BorderPoint,
    ConsistencySettings,
    Metric,
    Record,
    Replication,
    Study,
    ZoneKind,
    border,
)

RESULTS, SUMMARY, SLOPES, BORDER = "results.jsonl", "summary.csv", "slopes.csv", "border.csv"
OTHER_WAY = "other_way"


@dataclass(frozen=True)
class FitParameters:
    """Confidence bands, and data that a fit needs."""

    band: float = 0.95  # Of the confidence bands of means and slopes
    resamples: int = 1000
    fewest_sizes: int = 2  # Of n, that a slope is fitted to
    fewest_repetitions: int = 5  # On the same way, that a mean is taken of


FITS = FitParameters()


class Fit(StrEnum):
    """Data that a slope is fitted to."""

    ALL = "all"
    """All repetitions, from ``fit_from`` on."""
    SETTLED = "settled"
    """All repetitions, from where no minimiser is on another way than the true one."""
    SAME_WAY = "same_way"
    """From ``fit_from`` on, at each n the repetitions whose minimiser is on the same way as the true one."""


@lru_cache(maxsize=1)
def prepared(settings: ConsistencySettings) -> Study:
    """Return the study of these settings; each process prepares it once."""
    return Study(settings)


def _measure(settings: ConsistencySettings, task: Replication) -> list[Record]:
    # Which repetitions are done does not change what one of them does: prepare once for all.
    return prepared(replace(settings, sizes=(), noises=(), repetitions=0)).measure(task)


def run_consistency(
    settings: ConsistencySettings | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    workers: int = 1,
    progress: bool = False,
) -> ConsistencyResult:
    """Do the study, or what is left of it."""
    settings = settings or ConsistencySettings()
    done: dict[Replication, list[Record]] = {}
    file = None
    if folder is not None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        file = ResultFile(Path(folder) / RESULTS, settings.fingerprint)
        done = file.load()
    tasks = _tasks(settings)
    missing = [task for task in tasks if task not in done]
    with _bar(len(tasks), len(tasks) - len(missing), progress) as advance:
        for records in _results(settings, missing, workers):
            if file is not None:
                file.append(records)
            done[records[0].task] = records
            advance()
    return ConsistencyResult(settings, tuple(record for task in tasks for record in done[task]))


def _tasks(settings: ConsistencySettings) -> list[Replication]:
    return [
        Replication(noise, size, repetition)
        for repetition in range(settings.repetitions)
        for noise in settings.noises
        for size in settings.sizes
    ]


def _results(settings: ConsistencySettings, tasks: Sequence[Replication], workers: int) -> Iterator[list[Record]]:
    """Results as they come; an interrupt or error ends the workers at once."""
    if workers <= 1:
        for task in tasks:
            yield _measure(settings, task)
        return
    with closing(LocalExecutor(workers).run(partial(_measure, settings), tasks)) as answers:
        for answer in answers:
            if answer.result is None:
                raise StudyError(f"{answer.item}: {answer.reason}")
            yield answer.result


@contextmanager
def _bar(total: int, done: int, wanted: bool) -> Iterator[Callable[[], None]]:
    if not wanted:
        yield lambda: None
        return
    from tqdm import tqdm

    with tqdm(total=total, initial=done, unit="repetition", disable=None) as bar:

        def advance() -> None:
            bar.update()

        yield advance


class ResultFile:
    """Results of repetitions on disk, one line of JSON each: an interrupted study goes on from them."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = regular_target(path)
        self.fingerprint = fingerprint

    def load(self) -> dict[Replication, list[Record]]:
        """Return the results that are there; a last line that was cut short is taken away."""
        if not self.path.exists():
            return {}
        text = self.path.read_bytes()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            with open(self.path, "r+b") as file:
                file.truncate(whole)
        found: dict[Replication, list[Record]] = {}
        for number, line in enumerate(text[:whole].decode("utf-8").splitlines(), start=1):
            try:
                data = json.loads(line)
                task = Replication(data["noise"], data["size"], data["repetition"])
                records = [Record(task, ZoneKind(kind), values) for kind, values in data["kinds"].items()]
            except (ValueError, KeyError, TypeError, AttributeError):
                raise StudyError(f"{self.path}: line {number} is no result of this study") from None
            if data.get("study") == self.fingerprint:
                found[task] = records
        return found

    def append(self, records: Sequence[Record]) -> None:
        """Add the records of one repetition: one write to the end of the file, which is there whole or not at all."""
        task = records[0].task
        data = {
            "study": self.fingerprint,
            "noise": task.noise,
            "size": task.size,
            "repetition": task.repetition,
            "kinds": {record.kind.value: record.values for record in records},
        }
        line = json.dumps(data, allow_nan=False) + "\n"
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            os.write(descriptor, line.encode("utf-8"))
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@dataclass(frozen=True)
class Mean:
    """The mean of one metric over the repetitions, with its confidence band."""

    kind: str
    noise: float
    metric: str
    size: int  # n
    mean: float  # In the metric's unit
    lower: float  # In the metric's unit
    upper: float  # In the metric's unit


@dataclass(frozen=True)
class Slope:
    """The exponent of n that a metric falls with, fitted on log-log axes, with its confidence band."""

    kind: str
    noise: float
    metric: str
    fit: str
    from_size: int  # Least n of the fit
    slope: float
    lower: float
    upper: float
    expected: float  # By the theory


@dataclass(frozen=True)
class ConsistencyResult:
    settings: ConsistencySettings
    records: tuple[Record, ...]

    def values(self, kind: ZoneKind, noise: float, metric: str) -> Array:
        """Values of a metric, (sizes, repetitions)."""
        return np.array(
            [
                [self._found[kind, Replication(noise, size, repetition)][metric] for repetition in self._repetitions]
                for size in self.settings.sizes
            ]
        )

    @cached_property
    def _found(self) -> dict[tuple[ZoneKind, Replication], dict[str, float]]:
        return {(record.kind, record.task): record.values for record in self.records}

    @property
    def _repetitions(self) -> range:
        return range(self.settings.repetitions)

    def settled_from(self, kind: ZoneKind, noise: float) -> int | None:
        """Give the least n, of those to fit, from which on all minimisers lie in the basin of the true one."""
        elsewhere = self.values(kind, noise, OTHER_WAY).max(axis=1)
        settled = None
        for size, other in sorted(zip(self.settings.sizes, elsewhere, strict=True), reverse=True):
            if other > 0.0 or size < self.settings.fit_from:
                break
            settled = size
        return settled

    @cached_property
    def means(self) -> tuple[Mean, ...]:
        """Means of all metrics, and of the share of minimisers in other basins."""
        rows = []
        for kind, noise in self._groups():
            for name in (*(metric.name for metric in METRICS), OTHER_WAY):
                values, resampled = self._resampled(kind, noise, name)
                lower, upper = _band(resampled)
                rows += [
                    Mean(kind.value, noise, name, size, float(values[i].mean()), float(lower[i]), float(upper[i]))
                    for i, size in enumerate(self.settings.sizes)
                ]
        return tuple(rows)

    @cached_property
    def slopes(self) -> tuple[Slope, ...]:
        """Slopes of all metrics, and of those of minimisers all three fits, where there are sizes enough for them."""
        rows = []
        for kind, noise in self._groups():
            settled = self.settled_from(kind, noise)
            for metric in METRICS:
                first = self._slope(kind, noise, metric, self.settings.fit_from)
                rows.append(first)
                if metric.of_minimiser:
                    if settled is not None and first is not None and settled > first.from_size:
                        rows.append(self._slope(kind, noise, metric, settled, Fit.SETTLED))
                    rows.append(self.same_way_slope(kind, noise, metric))
        return tuple(row for row in rows if row is not None)

    def settled_slope(self, kind: ZoneKind, noise: float, metric: Metric) -> Slope | None:
        """Give the slope of a metric where the theory applies; None if that is at fewer than two sizes."""
        first: int | None = self.settings.fit_from
        if metric.of_minimiser:
            first = self.settled_from(kind, noise)
        return None if first is None else self._slope(kind, noise, metric, first)

    def same_way_slope(self, kind: ZoneKind, noise: float, metric: Metric) -> Slope | None:
        """Give the slope of the repetitions that are on the same way, from ``fit_from`` on."""
        found = {
            size: (mean, resampled)
            for size, mean, resampled in self._same_way(kind, noise, metric)
            if size >= self.settings.fit_from
        }
        if len(found) < FITS.fewest_sizes:
            return None
        means, resampled = zip(*found.values(), strict=True)
        return _slope_of(
            kind, noise, metric, Fit.SAME_WAY, np.array(list(found)), np.array(means), np.array(resampled).T
        )

    def same_way_means(self, kind: ZoneKind, noise: float, metric: Metric) -> dict[int, float]:
        """Means of a metric over the repetitions on the same way, by n, where there are enough of them."""
        return {size: mean for size, mean, _ in self._same_way(kind, noise, metric)}

    def _same_way(self, kind: ZoneKind, noise: float, metric: Metric) -> Iterator[tuple[int, float, Array]]:
        """Sizes, means, and means of resampled repetitions, (resamples,)."""
        same = self.values(kind, noise, OTHER_WAY) == 0.0
        random = np.random.default_rng(self.settings.seed)
        for size, values, mine in zip(self.settings.sizes, self.values(kind, noise, metric.name), same, strict=True):
            count = int(mine.sum())
            if count >= FITS.fewest_repetitions:
                chosen = random.integers(count, size=(FITS.resamples, count))
                yield size, float(values[mine].mean()), values[mine][chosen].mean(axis=1)

    def _slope(self, kind: ZoneKind, noise: float, metric: Metric, first: int, fit: Fit = Fit.ALL) -> Slope | None:
        sizes = np.array(self.settings.sizes)
        fitted = sizes >= first
        if fitted.sum() < FITS.fewest_sizes:
            return None
        values, resampled = self._resampled(kind, noise, metric.name)
        return _slope_of(kind, noise, metric, fit, sizes[fitted], values.mean(axis=1)[fitted], resampled[:, fitted])

    def _groups(self) -> Iterator[tuple[ZoneKind, float]]:
        yield from ((kind, noise) for kind in ZoneKind for noise in self.settings.noises)

    def _resampled(self, kind: ZoneKind, noise: float, metric: str) -> tuple[Array, Array]:
        """Values (sizes, repetitions), and the means of resampled repetitions (resamples, sizes)."""
        values, count = self.values(kind, noise, metric), self.settings.repetitions
        random = np.random.default_rng(self.settings.seed)
        chosen = random.integers(count, size=(FITS.resamples, len(values), count))
        return values, np.take_along_axis(values[None], chosen, axis=2).mean(axis=2)

    def save(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write means, slopes and the border of the domain as CSV; return the files."""
        written = [Path(folder) / name for name in (SUMMARY, SLOPES, BORDER)]
        tables: tuple[Sequence[Any], ...] = (self.means, self.slopes, border())
        for path, kind, rows in zip(written, (Mean, Slope, BorderPoint), tables, strict=True):
            write_rows(path, kind, rows)
        return written

    def table(self) -> str:
        """Write for a terminal the slopes where the theory applies, how often it does not, and what then."""
        heads = ["zones", "noise", "settled from n", *(metric.name for metric in METRICS)]
        rows = [["theory", "", "", *(f"{metric.exponent:g}" for metric in METRICS)]]
        for kind, noise in self._groups():
            slopes = [self.settled_slope(kind, noise, metric) for metric in METRICS]
            cells = ("-" if s is None else f"{s.slope:.2f} [{s.lower:.2f}, {s.upper:.2f}]" for s in slopes)
            rows.append([kind.value, f"{noise:g} m", str(self.settled_from(kind, noise) or "-"), *cells])
        return "\n".join(
            [
                "Slopes over n, from where all minimisers are on the same way:",
                text_table([heads, *rows], "<"),
                "",
                "Minimisers on another way:",
                text_table(self._shares(), "<"),
                "",
                f"Slopes over n >= {self.settings.fit_from}, of all minimisers | of those on the same way:",
                text_table(self._both_slopes(), "<"),
            ]
        )

    def _shares(self) -> list[list[str]]:
        """Share of minimisers on another way."""
        heads = ["zones", "noise", *(f"n = {size}" for size in self.settings.sizes)]
        shares = (
            (kind, noise, self.values(kind, noise, OTHER_WAY).mean(axis=1).tolist()) for kind, noise in self._groups()
        )
        return [
            heads,
            *([kind.value, f"{noise:g} m", *(f"{share:.0%}" for share in row)] for kind, noise, row in shares),
        ]

    def _both_slopes(self) -> list[list[str]]:
        """Slopes with the jumps between ways, and without."""
        metrics = [metric for metric in METRICS if metric.of_minimiser]
        rows = [["zones", "noise", *(metric.name for metric in metrics)]]
        for kind, noise in self._groups():
            cells = []
            for metric in metrics:
                pair = (
                    self._slope(kind, noise, metric, self.settings.fit_from),
                    self.same_way_slope(kind, noise, metric),
                )
                cells.append(" | ".join("-" if slope is None else f"{slope.slope:.2f}" for slope in pair))
            rows.append([kind.value, f"{noise:g} m", *cells])
        return rows


def _band(resampled: Array) -> tuple[Array, Array]:
    tail = 0.5 * (1.0 - FITS.band)
    lower, upper = np.quantile(resampled, [tail, 1.0 - tail], axis=0)
    return lower, upper


def _slope_of(
    kind: ZoneKind, noise: float, metric: Metric, fit: Fit, sizes: NDArray[Any], means: Array, resampled: Array
) -> Slope:
    """Fit means (sizes,), with a band from those of resampled repetitions (resamples, sizes)."""
    x = np.log10(sizes)
    lower, upper = _band(_fit(x, resampled))
    least, slope = int(sizes.min()), float(_fit(x, means))
    return Slope(kind.value, noise, metric.name, fit.value, least, slope, float(lower), float(upper), metric.exponent)


def _fit(x: Array, means: Array) -> Array:
    """Least-squares slopes of log10 of (..., sizes) means against x."""
    y = np.log10(np.maximum(means, 1e-300))
    centered = x - x.mean()
    slopes: Array = y @ centered / float(centered @ centered)
    return slopes
