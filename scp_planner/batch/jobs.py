"""One scenario of a batch: what a worker is given, what it does, and the row that comes of it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from time import perf_counter
from typing import TYPE_CHECKING

from scp_planner.settings.knobs import word_of
from scp_planner.settings.planning import Settings

if TYPE_CHECKING:
    from pathlib import Path

    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario

BAD_INPUT = "bad_input"
"""Status of a scenario that is refused; others are those of plans, and the fates of work that came to nothing."""


class PlanningMethod(StrEnum):
    SCP = "scp"
    PENALTY_DESCENT = "penalty-descent"


@dataclass(frozen=True)
class Options:
    """Choices of how to plan."""

    method: PlanningMethod = PlanningMethod.SCP
    settings: Settings = field(default_factory=Settings)
    time_limit: float | None = None  # Wall time for one scenario, s
    samples: int = 200
    prove: float | None = None  # Relative gap to prove

    def __post_init__(self) -> None:
        object.__setattr__(self, "method", word_of(PlanningMethod, self.method, "method"))

    def __str__(self) -> str:
        """Say what the results depend on and is not the default."""
        usual = Settings()
        changed = {
            each.name: value
            for each in fields(Settings)
            if (value := getattr(self.settings, each.name)) != getattr(usual, each.name)
        }
        own = {"method": self.method, "time_limit": self.time_limit, "prove": self.prove}
        return " ".join(f"{name}={value}" for name, value in {**own, **changed}.items() if value is not None)


@dataclass(frozen=True)
class Job:
    """A scenario to plan."""

    file: str
    scenario: Scenario
    digest: str
    options: Options
    wants_plan: bool


@dataclass(frozen=True)
class TableRow:
    """One line of the table."""

    file: str  # Path of the scenario within the folder; its cell is that of `cell_of`
    name: str = ""
    status: str = ""
    reason: str = ""  # Why there is no certificate
    travel_time: float | None = None  # s
    arrival_time: float | None = None  # s
    lower_bound: float | None = None  # s
    least_clearance: float | None = None  # m
    nearest_obstacle: str = ""
    iterations: int | None = None
    options: str = ""
    digest: str = ""
    wall_time: float | None = None

    def texts(self) -> dict[str, str]:
        """Give the cells: a number so that every bit is kept, all text on one line and writable as UTF-8."""
        cells = {name: "" if value is None else " ".join(str(value).split()) for name, value in asdict(self).items()}
        written = {name: cell.encode("utf-8", "backslashreplace").decode("utf-8") for name, cell in cells.items()}
        return {**written, "file": cell_of(self.file)}


def cell_of(file: str) -> str:
    """Give the cell that names a file: each name has its own, on one line, whatever the file system allows."""
    return "".join(
        letter if letter.isprintable() and letter != "\\" else letter.encode("unicode_escape").decode("ascii")
        for letter in file
    )


@dataclass(frozen=True)
class JobResult:
    """Result that a worker sends back."""

    row: TableRow
    plan: str | None = None  # Contents of the plan file


def carry_out(job: Job) -> JobResult:
    """Plan a scenario; this runs in a worker."""
    began = perf_counter()
    plan = planned(job.scenario, job.options)
    wall_time = perf_counter() - began
    row = TableRow(
        file=job.file,
        name=job.scenario.name,
        status=plan.status.value,
        reason=plan.reason or "",
        travel_time=plan.travel_time,
        arrival_time=plan.arrival_time,
        lower_bound=plan.lower_bound,
        least_clearance=plan.clearance.minimum,
        nearest_obstacle=plan.clearance.obstacle or "",
        iterations=plan.iterations,
        options=str(job.options),
        digest=job.digest,
        wall_time=wall_time,
    )
    if not job.wants_plan:
        return JobResult(row)
    return JobResult(row, json.dumps(plan.to_dict(job.options.samples), allow_nan=False) + "\n")


def planned(scenario: Scenario, options: Options) -> Plan:
    """Plan a scenario by the method that is asked for."""
    if options.method is PlanningMethod.PENALTY_DESCENT:
        from scp_planner.baseline.penalty_descent import penalty_descent

        return penalty_descent(scenario, options.settings, time_limit=options.time_limit)
    from scp_planner.planning import plan_search

    return plan_search.plan(scenario, options.settings, time_limit=options.time_limit, prove=options.prove)


def digest_of(scenario: Scenario) -> str:
    """Give a short name of a scenario's contents: equal ones have the same, however their files are written."""
    return _digest(json.dumps(scenario.to_dict(), sort_keys=True).encode())


def digest_of_bytes(path: Path) -> str:
    """Give a short name of what a file holds that is no scenario."""
    try:
        return _digest(path.read_bytes())
    except OSError:
        return ""


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
