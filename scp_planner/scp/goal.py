"""Early ends of a run: its limits of work, and the trips that it is measured against."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.verdict import off_a_step
from scp_planner.scp.evaluation import Evaluation
from scp_planner.scp.parameters import LoopParameters


def to_beat(travel_time: float, step: float | None) -> float:
    """Return what another trip has to be faster than, to be the better one where arrivals count in steps of time."""
    return travel_time if step is None else (_step_after(travel_time, step) - 1) * step + off_a_step(step)


def _step_after(travel_time: float, step: float) -> int:
    return ceil((travel_time - off_a_step(step)) / step)


@dataclass(frozen=True)
class ArrivalSteps:
    """Steps of time that a trip has to arrive on."""

    step: float  # s
    latest: float  # travel time that is still in time, s

    def after(self, travel_time: float) -> float:
        """Return the travel time to the next step, s."""
        return _step_after(travel_time, self.step) * self.step

    def as_good(self, trip: Evaluation, sooner: float, parameters: LoopParameters) -> bool:
        """True if a trip, but for what slowing down to its step mends, can hardly arrive on an earlier one."""
        time = trip.trajectory.travel_time
        if trip.worst_violation > parameters.grave or self.after(time) > self.latest:
            return False
        return time - parameters.hope * max(sooner, 0.0) > to_beat(time, self.step)


@dataclass(frozen=True)
class RunLimits:
    """Limits of the work of one run."""

    max_iterations: int
    deadline: float  # value of :func:`time.perf_counter` at which the run ends, s
    # after so many iterations a trip without grave violations is good enough, though not the fastest
    enough: int | None
    hopeless_after: int  # a run that is still far from feasible after so many iterations ends
    tolerance: float  # gains of the travel time or the merit below this are none, s


@dataclass(frozen=True)
class Cutoff:
    """A run is given up when it can hardly become faster than this time, s, or comes to go the way of a rival."""

    time: float
    rival: Evaluation | None
    samples: Array  # (n,) normalised times at which trips are compared with the rival
    parameters: LoopParameters
    steps: ArrivalSteps | None = None

    def on_time(self, trip: Evaluation, sooner: float) -> bool:
        """True if a trip will do for the step of time that it arrives on, and can hardly arrive on an earlier one."""
        soon = trip.trajectory.travel_time < self.time
        return soon and self.steps is not None and self.steps.as_good(trip, sooner, self.parameters)

    def slower(self, trip: Evaluation, sooner: float) -> bool:
        """True if a trip can hardly become fast enough, if the next step makes it sooner by so many s."""
        # What is still violated can only take more time.
        return trip.trajectory.travel_time - self.parameters.hope * max(sooner, 0.0) > self.time

    def will_be_slower(self, trip: Evaluation, sooner: float) -> bool:
        """True if that will be said of the trip after the next step, which makes it sooner by so many s."""
        return self.slower(trip, sooner * (1.0 + 1.0 / self.parameters.hope))

    def same_way(self, trip: Evaluation) -> bool:
        """True if a trip has come so near to the rival that it would end as that did."""
        if self.rival is None or trip.worst_violation > self.parameters.watch:
            return False
        apart = trip.points.path.position - self._rival_places
        return bool(np.abs(apart).max() < self.parameters.same_way)

    @cached_property
    def _rival_places(self) -> Array:
        """Places of the rival at the samples, (n, 2): it may be a trip of other splines, with other samples."""
        assert self.rival is not None
        rival = self.rival.trajectory
        return rival.at(rival.space.time_table(self.samples)).path.position
