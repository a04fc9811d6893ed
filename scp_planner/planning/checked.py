"""Runs of any method with their certificates, and the problems that they solve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from scp_planner.certificate.lower_bound import kinematic_bound
from scp_planner.certificate.verdict import Certificate
from scp_planner.problem.near_zones import LONGEST_TRIP, without_far_zones
from scp_planner.problem.problem import Problem
from scp_planner.scp.evaluation import Evaluation
from scp_planner.trips.trajectory import Trajectory


@dataclass(frozen=True)
class RunQuality:
    """Runs that hardly fail, and trips that are fast enough."""

    hardly: float = 0.15  # largest violation of a run that hardly fails: another one may mend it
    good_enough: float = 1e-3  # relative distance to the lower bound at which the search ends


QUALITY = RunQuality()


class MethodRun(Protocol):
    """A run of any method."""

    @property
    def evaluation(self) -> Evaluation:
        """The trip that it ended with, evaluated."""
        ...


RunT = TypeVar("RunT", bound=MethodRun)


@dataclass(frozen=True)
class CheckedRun(Generic[RunT]):
    """A run and its certificate; None if the run was cut off."""

    run: RunT
    certificate: Certificate | None

    @property
    def trajectory(self) -> Trajectory:
        """The trip that the run ended with."""
        return self.run.evaluation.trajectory

    @property
    def travel_time(self) -> float:
        """Travel time of that trip, s."""
        return self.trajectory.travel_time

    @property
    def holds(self) -> bool:
        """True if it is certified."""
        return self.certificate is not None and self.certificate.holds

    @property
    def late(self) -> bool:
        """True if it is certified but for its arrival, which is too late."""
        return self.certificate is not None and self.certificate.late

    @property
    def verdict(self) -> Certificate:
        """The certificate of a run that was not cut off."""
        assert self.certificate is not None
        return self.certificate

    @property
    def wrongs(self) -> tuple[float, int, float]:
        """Worst violation, to a tenth of a micrometre; number of violations; travel time, s."""
        wrong = 0 if self.certificate is None else len(self.certificate.violations)
        return round(self.run.evaluation.worst_violation, 7), wrong, self.travel_time

    def better_than(self, other: CheckedRun[RunT] | None) -> bool:
        """Certified before not certified, then faster; without certificates the lesser violation."""
        if self.certificate is None and not self.holds:
            return False
        if other is None:
            return True
        if self.holds != other.holds:
            return self.holds
        if self.holds or (other.late and self.late):
            return self.travel_time < other.travel_time
        return self.wrongs < other.wrongs


@dataclass(frozen=True)
class ReadyProblem:
    """A problem as it is searched: with all obstacles, and without those too far away to matter to a fast trip."""

    everything: Problem
    near: Problem
    lower_bound: float  # No trip is faster, s

    @classmethod
    def of(cls, everything: Problem, least: float = 0.0) -> ReadyProblem:
        """Return a problem, and its near part, if there is memory for it; no trip takes less than ``least``, s."""
        least = max(least, kinematic_bound(everything.scenario))
        near = without_far_zones(everything, LONGEST_TRIP * least)
        near.check_memory()
        return cls(everything, near, least)


def met_what_was_left_out(problem: Problem, certificate: Certificate) -> bool:
    """True if a trip, longer than expected, met an obstacle that its problem took for too far away to matter."""
    return any(v.obstacle is not None and v.obstacle not in problem.zones.ids for v in certificate.violations)
