"""What a check allows, what it finds, and what it says of that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Tolerances:
    """How far a limit may be exceeded; the defaults cover the errors of the differences, given above.

    ``clearance`` is about twice what is overlooked between samples; ``heading`` is far more than the error of
    extrapolating the first two chords to the first point, 1e-5 where curvature changes by 100 /m2, unless samples are
    farther apart than these chords.
    """

    clearance: float = 3e-6  # m
    position: float = 1e-6  # m
    start_time: float = 1e-9  # s
    arrival: float = 1e-3  # s
    heading: float = 2e-4  # rad
    boundary_speed: float = 2e-4  # m/s, one-sided differences at the ends
    goal_speed: float = 0.0  # m/s; of a planner that promises that of the goal less closely
    speed: float = 1e-5  # m/s
    acceleration: float = 5e-4  # m/s2
    first_acceleration: float = 0.02  # m/s2, one-sided second differences at the start
    jerk: float = 0.02  # m/s3
    curvature_rate: float = 0.02  # 1/(m s)
    lateral_acceleration: float = 5e-4  # m/s2
    curvature: float = 2e-4  # 1/m


@dataclass(frozen=True)
class Finding:
    """Worst value of one quantity over the trip.

    ``excess`` is how far it is beyond its limit (negative: within), in the quantity's unit.
    """

    name: str
    value: float
    limit: float
    excess: float
    tolerance: float
    time: float
    subject: str = ""

    @property
    def ok(self) -> bool:
        """Whether the limit holds within the tolerance; a value that is not a number does not."""
        return self.excess <= self.tolerance

    def __str__(self) -> str:
        about = f" ({self.subject})" if self.subject else ""
        return (
            f"{self.name}{about} {self.value:.9g} against {self.limit:.9g} at t = {self.time:.6f} s: "
            f"{self.excess:.3g} beyond, {self.tolerance:.3g} allowed"
        )


@dataclass(frozen=True)
class DenseReport:
    """All findings of one check; ``ok`` only if every one of them is."""

    findings: tuple[Finding, ...]
    travel_time: float

    @property
    def ok(self) -> bool:
        """Whether every limit holds within its tolerance."""
        return all(finding.ok for finding in self.findings)

    @property
    def violations(self) -> tuple[Finding, ...]:
        """The findings that are beyond their tolerance."""
        return tuple(finding for finding in self.findings if not finding.ok)

    def __getitem__(self, name: str) -> Finding:
        """The worst finding of this name."""
        return max((f for f in self.findings if f.name == name), key=lambda f: f.excess)

    def __str__(self) -> str:
        return "holds" if self.ok else "; ".join(str(finding) for finding in self.violations)


def find_worst(
    name: str,
    values: NDArray[np.float64],
    limit: float,
    tolerance: float,
    when: NDArray[np.float64],
    *,
    subject: str = "",
    falling: bool = False,
) -> list[Finding]:
    """Find the largest of some values (n,) against a limit; nothing of none.

    Where it may be ``falling``, values that begin beyond the limit may stay beyond it as long as they never rise.
    """
    if not values.size:
        return []
    beyond = values - limit
    if falling:
        least = np.minimum.accumulate(values)
        beyond = values - np.maximum(limit, np.append(least[:1], least[:-1]))
    worst = int(np.argmax(beyond))
    return [Finding(name, float(values[worst]), limit, float(beyond[worst]), tolerance, float(when[worst]), subject)]


def find_least_room(
    name: str,
    room: NDArray[np.float64],
    tolerance: float,
    when: NDArray[np.float64],
    *,
    subject: str = "",
    falling: bool = False,
) -> Finding:
    """Find the least room (n,), m, which may be missing at first where it may be ``falling``, but never more."""
    found = find_worst(name, -room, 0.0, tolerance, when, subject=subject, falling=falling)[0]
    return Finding(name, -found.value, 0.0, found.excess, tolerance, found.time, subject)
