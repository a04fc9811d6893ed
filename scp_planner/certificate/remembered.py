"""Trips that were found to keep all limits: as they are driven on, only the zones are new."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from scp_planner.arrays import Array, Index, joined, rows_of
from scp_planner.certificate.checked_trip import CheckedTrip
from scp_planner.certificate.enclosures import Pieces, VehicleDisc
from scp_planner.certificate.verdict import Ends, LimitUse
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.targets import obstacle_met
from scp_planner.trips.space import TripSpace
from scp_planner.trips.trip import Trip

MOST_MOTIONS = 8  # that are remembered


@dataclass(frozen=True)
class PartOfMotion:
    """Pieces of a remembered motion, and the discs of the vehicle on them."""

    pieces: Pieces
    discs: tuple[VehicleDisc, ...]

    def cut(self, checked: CheckedTrip, knots: Array) -> PartOfMotion:
        """Return the same with the pieces cut in which knots (n,), in normalised time, lie; the new ones come last."""
        begins, ends = self.pieces.middle - self.pieces.half, self.pieces.middle + self.pieces.half
        knots = np.append(knots, max(checked.first, begins[0]))
        cut = np.zeros(len(ends), dtype=bool)
        cut[np.searchsorted(ends, knots)] = True
        parts = Pieces.between(np.sort(np.concatenate([begins[cut], ends[cut], knots])))
        # What lies between two pieces that are cut is none of them, unless it is cut, too
        here = cut[np.minimum(np.searchsorted(ends, parts.middle), len(ends) - 1)] & (parts.middle > checked.first)
        parts = rows_of(parts, here)
        whole, lasts = np.searchsorted(ends, parts.middle), checked.trajectory.travel_time
        middle, half = lasts * parts.middle, lasts * parts.half
        discs = [joined([rows_of(disc, ~cut), _expanded(disc, whole, middle, half)]) for disc in self.discs]
        return PartOfMotion(joined([rows_of(self.pieces, ~cut), parts]), tuple(discs))


def _expanded(disc: VehicleDisc, whole: Index, middle: Array, half: Array) -> VehicleDisc:
    """A disc on parts of its pieces, as Taylor's polynomial of degree 1 in the middle of each whole piece has it."""
    center = rows_of(disc, whole)
    away = middle - center.time
    reach = (np.abs(away) + half) / half
    place = center.position + away[:, None] * center.velocity
    # It may be farther from what is near than that by what the polynomial is off: only what is certain counts as hit.
    off = -0.5 * center.acceleration * away * away
    bound = center.acceleration * reach * reach
    return VehicleDisc(middle, half, place, center.velocity, bound, off, np.zeros(len(whole)))


@dataclass(frozen=True)
class KeptMotion:
    """A motion that keeps all limits, on pieces of time."""

    space: TripSpace
    scenario: Scenario  # Whose limits they are
    ends: Ends
    first: float  # From when to when limits were checked, in normalised time
    last: float  # From when to when limits were checked, in normalised time
    pieces: Pieces  # In order
    discs: tuple[VehicleDisc, ...]  # The discs of the vehicle on them
    limits: dict[str, LimitUse]

    def serves(self, checked: CheckedTrip, ends: Ends) -> bool:
        """True if a check of the same control points would find the same limits kept."""
        mine, other = self.scenario, checked.scenario
        return (
            self.space is checked.trajectory.space
            and checked.tube is None  # the discs are without one
            and mine.vehicle is other.vehicle
            and mine.goal is other.goal
            and mine.goals is other.goals
            and mine.goals_order is other.goals_order
            and (mine.obstacles is other.obstacles or not any(map(obstacle_met, (mine.goal, *mine.goals))))
            and mine.bounds is other.bounds
            and mine.speed_limits is other.speed_limits
            and all(limit.line is not None for limit in mine.speed_limits)
            and ends in self.ends
            and self.first <= checked.first
            and checked.last <= self.last
        )

    def part(self, checked: CheckedTrip) -> PartOfMotion | None:
        """Return the pieces that cover what is checked, none across a zone's knot; None if there are none."""
        begins, finishes = self.pieces.middle - self.pieces.half, self.pieces.middle + self.pieces.half
        part = slice(int(np.searchsorted(finishes, checked.first, "right")), int(np.searchsorted(begins, checked.last)))
        if part.start >= part.stop:
            return None
        found = PartOfMotion(rows_of(self.pieces, part), tuple(rows_of(disc, part) for disc in self.discs))
        knots = checked.zone_knots()
        inside = (knots > begins[part.start]) & (knots < finishes[part.stop - 1])
        return found.cut(checked, knots[inside]) if inside.any() else found


class Motions:
    """Trips that were found to keep all limits, of which only the clearance is checked again as they are driven on."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], KeptMotion] = {}

    @staticmethod
    def _name(trip: Trip) -> tuple[Any, ...]:
        trajectory = trip.trajectory
        return trip.frame, trajectory.travel_time, trajectory.theta.tobytes(), trajectory.beta.tobytes()

    def of(self, trip: Trip) -> KeptMotion | None:
        """Known bounds of a trip."""
        return self._known.get(self._name(trip))

    def add(self, trip: Trip, motion: KeptMotion) -> None:
        """Remember a trip; the one that was added first is forgotten for it."""
        name = self._name(trip)
        self._known.pop(name, None)
        while len(self._known) >= MOST_MOTIONS:
            del self._known[next(iter(self._known))]
        self._known[name] = motion
