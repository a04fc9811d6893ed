"""Out of the way: what is driven where no trip to the goal can be left for a stop that stays clear.

What is promised is that the vehicle is not hit, not that it stands. So it leaves along a dodge
(`scp_planner.online.dodges`) that keeps clear until it stands, and for a while after that. Of several such the one that
ends nearest to the goal is driven, so that a goal that is blocked for now is approached as near as is safe. Where
there is none, the one that keeps clear for longest is driven, and of those the one that comes least deep into zones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.certificate.verdict import Certificate
from scp_planner.online.dodges import Dodges
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import Outcome
from scp_planner.online.stops import STANDING
from scp_planner.online.vetting import Moment, Stop
from scp_planner.scenario.limits import Box, Limits
from scp_planner.trips.trip import Trip

TRIED = 4
"""Dodges that are certified in one replan, at most."""
ROOM = 1.0
"""Widths of the vehicle. More room than this is no better."""
ROOM_WORTH = 0.5
"""Of the room that a dodge keeps, against the way to the goal that it leads on."""
ENOUGH = 1.0
"""Times that a stop must stay clear. Where no dodge is safe, keeping clear for longer than this is no better."""


@dataclass(frozen=True)
class Dodge:
    """A dodge that was chosen.

    Attributes
    ----------
    trip : Trip
    certificate : Certificate
        Up to when it is over.
    clear : float
        How long it keeps clear, s from now, as far as samples tell; inf until it is over.
    lasts : bool
        Whether that is longer than it takes to stop.
    least : float
        The least clearance until then, m, as far as samples tell.
    blocked_by : str or None
        Which zone keeps the vehicle from coming nearer to the goal; None for none, or the border of the workspace.
    threat : str or None
        Which zone it enters first, or comes nearest to.
    moves : bool
        Whether the vehicle does not just stand.
    nears : bool
        Whether it leads nearer to the goal.
    """

    trip: Trip
    certificate: Certificate
    clear: float
    lasts: bool
    least: float
    blocked_by: str | None
    threat: str | None
    moves: bool
    nears: bool

    @property
    def safe(self) -> bool:
        """Whether it is certified until the vehicle has stood for as long as it has to."""
        return self.certificate.holds

    @property
    def outcome(self) -> Outcome:
        """What driving it is called."""
        return Outcome.EVADING if self.moves else Outcome.BRAKING


@dataclass(frozen=True)
class _Outlook:
    """What is seen of C dodges at J samples.

    Attributes
    ----------
    least : (C, J) array
        Clearances, m; inf after the dodge is over.
    whose : (C, J) array of int
        The nearest zone, -1 for the border of the workspace.
    clear : (C,) array
        How long each keeps clear, s from now; inf for those that do until they are over.
    away : (C, J) array
        What is left of the way to the goal, m.
    """

    least: Array
    whose: Index
    clear: Array
    away: Array


class Evasion:
    """Finds a way out of the way.

    Parameters
    ----------
    means : Means
    """

    def __init__(self, means: Means) -> None:
        self._means = means

    def safest(self, now: Replan) -> Dodge:
        """Return the dodge that is certified and ends nearest to the goal, or the one that is clear for longest."""
        moment = now.moment
        dodges = self._dodges(moment)
        seen = self._look(moment, dodges)
        now.lap("evasion")
        safe = self._first_safe(now, moment, dodges, seen)
        return safe or self._made(moment, dodges, seen, self._longest_clear(moment, dodges, seen))

    def least_risk(self, now: Replan, shares: Sequence[float]) -> tuple[Dodge, float] | None:
        """Where no dodge is safe: one that is at the highest lower level at which any is.

        Parameters
        ----------
        now : Replan
        shares : sequence of float
            Sizes of regions, as shares of those at the level asked for, from the largest on.

        Returns
        -------
        (Dodge, float) or None
            And its share.
        """
        dodges = self._dodges(now.moment)
        for share in shares:
            moment = now.moment.with_smaller_zones(share)
            seen = self._look(moment, dodges)
            now.lap("evasion")
            safe = self._first_safe(now, moment, dodges, seen)
            if safe is not None:
                return safe, share
        return None

    def _first_safe(self, now: Replan, moment: Moment, dodges: Dodges, seen: _Outlook) -> Dodge | None:
        """The certified one that ends nearest to the goal, among the zones of a moment; None if there is none."""
        clear = np.flatnonzero(np.isinf(seen.clear))
        worth = self._worth(moment, seen, np.full(len(seen.clear), -1))
        for number in clear[np.argsort(-worth[clear], kind="stable")][:TRIED].tolist():
            found = self._made(moment, dodges, seen, number)
            now.lap("certificate")
            if found.safe:
                return found
        return None

    def _dodges(self, moment: Moment) -> Dodges:
        state = moment.state
        heading = None if state.heading is None else state.heading - moment.frame.heading
        limits = Limits.of(moment.scenario, self._means.settings.limit_margin)
        return Dodges.of(heading, state.speed, 0.0, limits, moment.scenario.vehicle.radius, self._means.wait)

    def _look(self, moment: Moment, dodges: Dodges) -> _Outlook:
        vehicle = moment.scenario.vehicle
        least, whose = dodges.distances(moment.batch, Box.of(moment.scenario, moment.frame, 0.0), vehicle)
        least = np.where(dodges.times > dodges.until[:, None], np.inf, least)
        entered = least < self._means.settings.clearance_margin
        clear = np.where(entered.any(axis=1), dodges.times[entered.argmax(axis=1)], np.inf)
        goal = moment.frame.to_frame(np.array(moment.scenario.goal.position))
        away = np.hypot(dodges.position[..., 0] - goal[0], dodges.position[..., 1] - goal[1])
        return _Outlook(least, whose, clear, away)

    def _worth(self, moment: Moment, seen: _Outlook, sample: Index) -> Array:
        """What speaks for each dodge besides being safe, (C,) m: how near to the goal it is at a sample, and room."""
        width = 2.0 * moment.scenario.vehicle.radius
        room = np.minimum(seen.least.min(axis=1), ROOM * width)
        worth: Array = ROOM_WORTH * room - seen.away[np.arange(len(sample)), sample]
        return worth

    def _longest_clear(self, moment: Moment, dodges: Dodges, seen: _Outlook) -> int:
        """Where no dodge is safe: the one that keeps clear for longest, and of those the one that comes least deep.

        What enters a zone before the vehicle could stop is judged by depth alone: late is not gentle.
        """
        soon = self._soon(moment)
        long = min(self._means.wait * ENOUGH, float(dodges.times[-1]))
        lasts = np.minimum(np.minimum(seen.clear, dodges.until), max(long, soon))
        lasts = np.where(lasts > soon, lasts, 0.0)
        depth = -np.minimum(seen.least, 0.0).sum(axis=1)
        worth = self._worth(moment, seen, np.searchsorted(dodges.times, lasts).clip(max=len(dodges.times) - 1))
        if lasts.any():
            return int(np.lexsort((depth, -worth, -lasts))[0])
        return int(np.lexsort((-worth, depth))[0])

    def _soon(self, moment: Moment) -> float:
        """How long it takes to stop, after the next replan, s."""
        return self._means.online.period + moment.state.speed / moment.scenario.vehicle.max_deceleration

    def _made(self, moment: Moment, dodges: Dodges, seen: _Outlook, number: int) -> Dodge:
        trip = dodges.trip(number, moment.frame)
        certificate = self._means.vetting.certify_stop(moment, Stop(trip, trip.frame.time), None)
        profile = number % len(dodges.profiles.span)
        return Dodge(
            trip,
            certificate,
            float(seen.clear[number]),
            bool(seen.clear[number] > self._soon(moment)),
            float(seen.least[number].min()),
            self._blocked_by(moment, seen, number),
            self._threat(moment, seen, number),
            bool(dodges.profiles.speed[profile].max() > STANDING),
            bool(seen.away[number, -1] < seen.away[number, 0]),
        )

    @staticmethod
    def _threat(moment: Moment, seen: _Outlook, number: int) -> str | None:
        """The zone that a dodge enters first, or comes nearest to."""
        entered = seen.least[number] <= max(float(seen.least[number].min()), 0.0)
        zone = int(seen.whose[number, int(entered.argmax())])
        return moment.batch.ids[zone] if zone >= 0 else None

    def _blocked_by(self, moment: Moment, seen: _Outlook, number: int) -> str | None:
        """The zone that is in the way of the dodge that would lead nearest to the goal."""
        nearest = int(seen.away[:, -1].argmin())
        if nearest == number or np.isinf(seen.clear[nearest]):
            return None
        return self._threat(moment, seen, nearest)
