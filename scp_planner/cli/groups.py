"""Options in groups: a command takes one object for what belongs together, the parser sees an option for each field."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar, get_type_hints

from scp_planner.batch.jobs import Options, PlanningMethod
from scp_planner.cli.options import (
    Assignments,
    Json,
    MethodName,
    Prove,
    Quiet,
    Samples,
    Seed,
    SolverName,
    TimeLimit,
    Verbose,
    check_number,
    check_solver,
    check_time_limit,
    keyword_settings,
)
from scp_planner.settings.planning import Settings

R = TypeVar("R")


@dataclass(frozen=True)
class Printing:
    as_json: Json = False
    quiet: Quiet = False
    verbose: Verbose = False


@dataclass(frozen=True)
class PlanOptions:
    method: MethodName = PlanningMethod.SCP
    solver: SolverName = None
    assignments: Assignments = None
    seed: Seed = 0  # there is nothing to draw
    time_limit: TimeLimit = None
    samples: Samples = 200
    prove: Prove = None

    def check(self) -> None:
        """Refuse a solver that is not there, and a limit in which nothing can be done."""
        check_solver(self.solver, self.method)
        check_number("--prove", self.prove, 0.0)
        check_time_limit(self.time_limit)

    @property
    def options(self) -> Options:
        """Options of the planner."""
        return Options(self.method, replace(Settings(), **self.values), self.time_limit, self.samples, self.prove)

    @property
    def values(self) -> dict[str, Any]:
        """Settings by ``--set`` and ``--solver``."""
        return keyword_settings(self.assignments, self.solver)


def ungrouped(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command a parameter for each field of its groups."""
    signature = inspect.signature(command, eval_str=True)
    parameters = signature.parameters.values()
    groups: dict[str, Any] = {each.name: each.annotation for each in parameters if is_dataclass(each.annotation)}
    plain: list[inspect.Parameter] = []
    for each in parameters:
        plain += _parameters(groups[each.name]) if each.name in groups else [each.replace(kind=each.KEYWORD_ONLY)]

    @functools.wraps(command)
    def run(**given: Any) -> R:
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        return command(**given)

    run.__annotations__ = {each.name: each.annotation for each in plain}
    run.__signature__ = signature.replace(parameters=plain)  # type: ignore[attr-defined]
    return run


def _parameters(group: Any) -> list[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    kind = inspect.Parameter.KEYWORD_ONLY
    return [
        inspect.Parameter(each.name, kind, default=each.default, annotation=hints[each.name]) for each in fields(group)
    ]
