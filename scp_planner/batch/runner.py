"""A batch: which scenarios there are, which of them are done, and what becomes of the rest."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields
from pathlib import Path, PurePath

from scp_planner.batch.executor import Answer, Executor, Fate
from scp_planner.batch.jobs import (
    BAD_INPUT,
    Job,
    JobResult,
    Options,
    TableRow,
    carry_out,
    cell_of,
    digest_of,
    digest_of_bytes,
)
from scp_planner.batch.table import Table, TableError, opened, read
from scp_planner.errors import ScenarioError
from scp_planner.files import JSON_SUFFIX, YAML_SUFFIXES, check_extent, regular_target, write_text
from scp_planner.planning.plan import PlanStatus
from scp_planner.scenario.models import Scenario

SCENARIO_SUFFIXES = (*YAML_SUFFIXES, JSON_SUFFIX)
PLAN_SUFFIX = ".plan.json"
NOTHING_CAME = (Fate.ERROR.value, Fate.LOST.value)
"""Statuses of work that came to nothing, for no fault of the scenario."""


@dataclass(frozen=True)
class BatchResult:
    rows: tuple[dict[str, str], ...]  # The cells of each scenario's row, in order of their files
    done_before: int  # Rows that were there already

    @property
    def counts(self) -> dict[str, int]:
        """Number of scenarios with each status, the most frequent first."""
        return dict(Counter(row["status"] for row in self.rows).most_common())


def scenario_files(folder: Path, pattern: str | None = None, leave_out: Sequence[Path] = ()) -> dict[str, Path]:
    """Find the scenarios of a folder."""
    if pattern and not _is_within(pattern):
        raise ValueError(f"pattern {pattern!r}: must be of paths within the folder, '**' a whole part of it")
    if pattern and "**" in pattern:
        try:
            check_extent(folder)
        except ValueError as error:
            raise ValueError(f"pattern {pattern!r}: {folder} {error}") from None
    found = folder.glob(pattern or "*")
    others = [path.resolve() for path in leave_out]
    files = {
        path.relative_to(folder).as_posix(): path
        for path in found
        if path.suffix.lower() in SCENARIO_SUFFIXES
        and path.is_file()
        and not path.name.startswith(".")
        and not any(path.resolve().is_relative_to(other) for other in others)
    }
    return dict(sorted(files.items()))


def _is_within(pattern: str) -> bool:
    path = PurePath(pattern)
    plain = all(part != ".." and (part == "**" or "**" not in part) for part in path.parts)
    return bool(path.parts) and not path.anchor and plain


def run_batch(
    files: Mapping[str, Path],
    table: Path,
    executor: Executor,
    options: Options | None = None,
    *,
    plans: Path | None = None,
    timings: bool = False,
    retry: bool = False,
    progress: Callable[[int, str], None] | None = None,
) -> BatchResult:
    """Plan many scenarios; the rows that are in the table already are not done again."""
    options = options or Options()
    if plans is not None:
        for file in files:
            regular_target(_plan_file(plans, file))
    with opened(table, _columns(timings)) as rows:
        _check_options(rows, options)
        batch = _Batch(files, rows, options, plans, retry, progress)
        with closing(executor.run(carry_out, batch.jobs())) as answers:
            for answer in answers:
                batch.take(answer)
    return BatchResult(tuple(rows.rows[cell_of(file)] for file in files), batch.done_before)


def rows_done(files: Mapping[str, Path], table: Path, *, timings: bool = False) -> int:
    """Count the scenarios that have a row in a table."""
    return len({cell_of(file) for file in files} & read(table, _columns(timings)).keys())


def _columns(timings: bool) -> list[str]:
    return [each.name for each in fields(TableRow) if timings or each.name != "wall_time"]


@dataclass
class _Batch:
    """The state of one batch."""

    files: Mapping[str, Path]
    table: Table
    options: Options
    plans: Path | None
    retry: bool
    progress: Callable[[int, str], None] | None
    done: int = 0
    done_before: int = 0

    def jobs(self) -> Iterator[Job]:
        """Give what is to be planned, and settle what needs no planning on the way."""
        for file, path in self.files.items():
            try:
                scenario = Scenario.load(path)
            except (ScenarioError, OSError) as error:
                digest, options = digest_of_bytes(path), str(self.options)
                if not self._is_done(file, digest):
                    self._add(TableRow(file, "", BAD_INPUT, _in_a_line(error), options=options, digest=digest))
            else:
                digest = digest_of(scenario)
                if not self._is_done(file, digest):
                    yield Job(file, scenario, digest, self.options, self.plans is not None)

    def take(self, answer: Answer[Job, JobResult]) -> None:
        """Take what came of a job: its plan first, so that where there is a row there is a plan."""
        job, result = answer.item, answer.result
        if result is None:
            told = answer.fate.value, answer.reason
            row = TableRow(job.file, job.scenario.name, *told, options=str(self.options), digest=job.digest)
        else:
            row = result.row
            if self.plans is not None and result.plan is not None:
                target = _plan_file(self.plans, job.file)
                target.parent.mkdir(parents=True, exist_ok=True)
                write_text(target, result.plan)
        self._add(row)

    def _add(self, row: TableRow) -> None:
        self.table.add(row.texts())
        self._advance(row.status)

    def _advance(self, status: str) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, status)

    def _is_done(self, file: str, digest: str) -> bool:
        """True if a scenario's row is there; if so it counts."""
        row = self.table.rows.get(cell_of(file))
        if row is None or row["digest"] != digest or (self.retry and row["status"] in NOTHING_CAME):
            return False
        if self.plans is not None and row["status"] in list(PlanStatus) and not _plan_file(self.plans, file).exists():
            return False
        self.done_before += 1
        self._advance(row["status"])
        return True


def _plan_file(folder: Path, file: str) -> Path:
    return folder / (file + PLAN_SUFFIX)


def _in_a_line(error: ScenarioError | OSError) -> str:
    if isinstance(error, ScenarioError):
        shown = [str(fault) for fault in error.faults[:5]]
        more = len(error.faults) - len(shown)
        return "; ".join([*shown, *([f"and {more} more faults"] if more else [])])
    return error.strerror or str(error)


def _check_options(table: Table, options: Options) -> None:
    others = {row["options"] for row in table.rows.values()} - {str(options)}
    if others:
        raise TableError(
            f"{table.path}: its rows were made with other options: {', '.join(sorted(others))}, "
            f"not {options}; write to another file"
        )
