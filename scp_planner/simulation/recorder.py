"""Recorder of a loop of one's own: each replan is a line of a file as soon as it is made."""

from __future__ import annotations

import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TextIO

import numpy as np

from scp_planner.errors import MISSING, Fault, PlanError
from scp_planner.files import SyntaxFault, parse_json, read_text
from scp_planner.outputs import output_named
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.units import changed
from scp_planner.scenario.validation import Part, part_of_file
from scp_planner.simulation.cycle import Cycle, State
from scp_planner.simulation.run import RECORDING_SUFFIX, Run
from scp_planner.simulation.run_file import ChangeLine, FirstLine, ReplanLine, ShapeLine
from scp_planner.simulation.sensors import Observation

if TYPE_CHECKING:
    from scp_planner.online.plan import OnlinePlan
    from scp_planner.online.planner import Planner
    from scp_planner.threat_zones.zone import ThreatZone


class Recorder:
    """Write what a planner is told and answers, line by line, so that a crash costs at most the last lines.

    Another thread writes: a replan waits for nothing.

    Parameters
    ----------
    planner : Planner
    path : path, optional
        .jsonl; `Run.load` reads it. None: the lines are kept in memory alone.
    live : bool
        Serve each replan to Foxglove, too.

    Raises
    ------
    ValueError
        If the suffix is another one.
    ImportError
        If it shall be live, and `foxglove-sdk` is not installed.
    """

    def __init__(self, planner: Planner, path: str | PathLike[str] | None = None, live: bool = False) -> None:
        if path is not None and Path(path).suffix.lower() != RECORDING_SUFFIX:
            raise ValueError(f"{path}: must end in {RECORDING_SUFFIX}")
        self._planner, self._path, self._serves = planner, path, live
        self._scenario: Scenario  # as it is now
        self._opened = ExitStack()
        self._file: TextIO | None = None
        self._live: Any = None
        self._seen: list[Observation] = []
        self._writer = ThreadPoolExecutor(max_workers=1)
        self._error: OSError | None = None
        self.lines: list[dict[str, Any]] = []
        """The lines so far of a recording that has no file."""

    def __enter__(self) -> Self:
        """Begin with the scenario."""
        with ExitStack() as opened:
            if self._serves:
                self._live = opened.enter_context(closing(output_named("live scene")()))
            if self._path is not None:
                self._file = opened.enter_context(open(self._path, "w", encoding="utf-8", newline="\n"))
            self._opened = opened.pop_all()
        self._scenario = self._planner.scenario
        self._writer.submit(self._write, {"schema": 1, "scenario": self._scenario.to_dict()})
        self._planner.listeners.append(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the recording; the planner goes on without it. What could not be written is told now."""
        self._planner.listeners.remove(self)
        self._writer.shutdown()
        self._opened.close()
        if self._error is not None and error is None:
            raise self._error

    def added(self, obstacle: str, shape: Any) -> None:
        """Note an obstacle that the planner is told of."""
        self._writer.submit(self._write, {"obstacle": obstacle, "shape": shape.model_dump(mode="json")})

    def changed(self, asked: Scenario) -> None:
        """Note another goal, ground or limits that the planner is given; the start is where it drives then."""
        self._scenario = asked
        if asked.ground is not None and asked.ground.map.source is None:
            asked = changed(asked, ground=None)  # which could not be read again
        self._writer.submit(self._write, {"changed": asked.to_dict()})

    def observed(self, obstacle: str, time: float, position: tuple[float, float], covariance: Any) -> None:
        """Note a position, m, that was observed or reported at a time, s; it is written with the next replan."""
        deviation = 0.0 if covariance is None else float(np.sqrt(np.trace(np.asarray(covariance)[:2, :2]) / 2.0))
        self._seen.append(Observation(obstacle, float(time), float(time), position, deviation))

    def replanned(
        self, time: float, position: tuple[float, float], heading: float | None, speed: float, wall_time: float
    ) -> None:
        """Write a replan in a state, in s, m, rad and m/s: what was observed before, the zones, the plan."""
        plan, seen = self._planner.plan, tuple(self._seen)
        assert plan is not None
        del self._seen[: len(seen)]
        direction = float(plan.heading(time) if heading is None else heading)
        state = State(float(time), position, direction, float(speed), wall_time)
        self._writer.submit(self._write_replan, state, seen, plan, self._planner.zones, self._scenario)

    def _write_replan(
        self,
        state: State,
        seen: tuple[Observation, ...],
        plan: OnlinePlan,
        zones: tuple[ThreatZone, ...],
        scenario: Scenario,
    ) -> None:
        cycle = Cycle.of(state, plan, seen, zones)
        line = ReplanLine.model_construct(
            cycle=cycle, plan=plan, arrived=plan.arrived, wall_time=state.wall_time, timings=plan.timings
        )
        self._write(line.model_dump(mode="json", exclude={"cycle": {"wall_time"}}))
        if self._live is not None:
            self._live.replan(cycle, plan, scenario)

    def run(self) -> Run:
        """Give what was recorded in memory as a run."""
        return run_of(self.lines, "recording")

    def _write(self, line: dict[str, Any]) -> None:
        if self._file is None:
            self.lines.append(line)
            return
        try:
            self._file.write(json.dumps(line, allow_nan=False) + "\n")
            self._file.flush()
        except OSError as error:
            self._error = error


def load_recording(path: str | PathLike[str]) -> Run:
    """Read a recording as a run; a last line without its end, as a crash leaves it, is left out."""
    *whole, _ = read_text(path, PlanError).split("\n")
    return run_of((_parsed(line, number, str(path)) for number, line in enumerate(whole, 1)), str(path))


def _parsed(line: str, number: int, name: str) -> Any:
    try:
        data, faults = parse_json(line)
    except SyntaxFault as error:
        faults = [replace(error.fault, path="")]
    if faults:
        raise PlanError(name, [fault.below(f"line {number}") for fault in faults])
    return data


def run_of(lines: Iterable[Any], name: str) -> Run:
    """Make a run of the lines of a recording: what was driven is known at the replans, true obstacles are not."""
    nothing = PlanError(name, [Fault("", MISSING, "not a recording, or one without any replan")])
    first, *rest = [*lines] or [None]
    if first is None:
        raise nothing
    begin = part_of_file(FirstLine, name, first, PlanError, place="line 1")
    replans: list[ReplanLine] = []
    shapes: dict[str, Shape] = {}
    changes: list[Scenario] = []
    for number, data in enumerate(rest, 2):
        kind = next((kind for key, kind in _LINES.items() if isinstance(data, dict) and key in data), ReplanLine)
        line = part_of_file(kind, name, data, PlanError, place=f"line {number}")
        if isinstance(line, ShapeLine):
            shapes[line.obstacle] = line.shape
        elif isinstance(line, ChangeLine):
            changes.append(line.changed)
        else:
            assert isinstance(line, ReplanLine)
            if replans and line.cycle.time < replans[-1].cycle.time:
                text = "must not be before that of the replan before"
                raise PlanError(name, [Fault(f"line {number}.cycle.time", line.cycle.time, text)])
            replans.append(line)
    if not replans:
        raise nothing
    cycles = tuple(replace(line.cycle, wall_time=line.wall_time) for line in replans)
    time = np.array([cycle.time for cycle in cycles])
    return Run(
        scenario=begin.scenario,
        seed=0,
        arrived=replans[-1].arrived,
        contact=False,
        contact_standing=False,
        travel_time=float(time[-1] - time[0]),
        least_clearance=np.inf,
        records=cycles,
        time=time,
        position=np.array([cycle.position for cycle in cycles]),
        heading=np.array([cycle.heading for cycle in cycles]),
        speed=np.abs([cycle.speed for cycle in cycles]),
        obstacles={},
        plans=tuple(line.plan for line in replans),
        shapes=shapes,
        changes=tuple(changes),
    )


_LINES: dict[str, type[Part]] = {"shape": ShapeLine, "changed": ChangeLine}
"""Kinds of lines besides replans, by the key that each has."""
