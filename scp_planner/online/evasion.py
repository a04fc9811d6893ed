"""Out of the way: what is driven where no trip to the goal can be left for a stop that stays clear.

What is promised is that the vehicle is not hit, not that it stands. So it leaves along a dodge
(`scp_planner.online.dodges`) that keeps clear until it stands, and for a while after that. Of several such the one is
driven that soon gains most of the way to the goal, less what its nearness to zones is worth: people turn by more than
their zones allow for, and who is near cannot be evaded then. What comes nearly into zones, or into them where nothing
is safe, counts as harm, the more the sooner and deeper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scp_planner.arrays import Array
from scp_planner.certificate.ends import can_reverse
from scp_planner.certificate.verdict import Certificate
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.braking import braking_of
from scp_planner.online.dodge_courses import GRADUAL, LIMIT_SHARE, PROMPT, SPANS, DodgeProfiles, Profiles
from scp_planner.online.dodge_worth import GAIN, NEARNESS, OUTLOOK, a_moment, harm, nearness, value_at
from scp_planner.online.dodges import BORDER, Dodges, Room
from scp_planner.online.foresight import foreseen
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import AWAY, Outcome
from scp_planner.online.ramped_profiles import RampedProfiles
from scp_planner.online.stops import STANDING
from scp_planner.online.vetting import Moment, Stop
from scp_planner.online.way_left import way_left, way_left_both_ways
from scp_planner.scenario.limits import Box, Limits
from scp_planner.scenario.models import Steering, Vehicle
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.trips.trip import Trip

TRIED = 4
"""Dodges that are certified in one replan, at most."""
BETTER = 0.1
"""Widths of way by which a dodge must do better for the vehicle to leave a trip."""
ALIKE = 0.1
"""Widths of way by which a dodge must do better than the one that is being driven for the vehicle to change over."""
PATIENCE = 10.0
"""Moments without coming nearer to the goal, after which nearness and spare room count half."""
SPARE = 1.0 / 24.0
"""Widths of clearance, below which a place counts as within the zone of who moves as fast as the vehicle may: a small
turn takes as much. Of who is slower: in proportion."""
FARTHEST = 1e9
"""Stands for a clearance without a zone, where clearances are interpolated."""
_SHARES = np.linspace(0.0, 1.0, SPANS + 1)


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
class _Driven:
    """What C dodges drive: at times (J,), s from now, places (C, J, 2), m, headings (C, J), rad; until (C,), s."""

    times: Array
    position: Array
    heading: Array
    until: Array


@dataclass(frozen=True)
class _Outlook:
    """What is seen of C dodges at J samples.

    Attributes
    ----------
    least : (C, J) array
        Clearances, m; inf after the dodge is over.
    room : Room
        From which zones.
    clear : (C,) array
        How long each keeps clear, s from now; inf for those that do until they are over.
    now, soon, then : (C,) arrays
        What is left of the way to the goal, m, as the vehicle can turn: now, at `GAIN`, and at the end.
    worth : (C,) array
        What speaks for each besides being safe, m: the way to the goal that it gains soon, less its nearness to zones
        and the harm of coming into them or nearly so.
    """

    least: Array
    room: Room
    clear: Array
    now: Array
    soon: Array
    then: Array
    worth: Array


@dataclass(frozen=True)
class _SeenDodges:
    """A moment, its dodges, and what is seen of them and of what was begun before, if the vehicle is on that."""

    moment: Moment
    dodges: Dodges
    seen: _Outlook
    begun: Stop | None
    going_on: _Outlook | None


class Evasion:
    """Finds a way out of the way.

    Parameters
    ----------
    means : Means
    """

    def __init__(self, means: Means) -> None:
        self._means = means
        self._view: _SeenDodges | None = None
        self._patience = 1.0

    def be_patient(self, waited: float) -> None:
        """Say for how long the vehicle has come no nearer to its goal, s: the longer, the less nearness counts.

        So a vehicle does not wait for ever for more room than there is.
        """
        lasts = PATIENCE * a_moment(self._means.given.vehicle)
        self._patience = lasts / (lasts + waited)

    def safest(self, now: Replan) -> Dodge | None:
        """Return the certified dodge that is worth most, or the one that is driven, if that is worth nearly as much.

        None if none is certified.
        """
        view = self._looked(now)
        return self._still_good(now) or self._first_safe(now, now.moment, view.dodges, view.seen, view.seen.worth)

    def least_harmful(self, now: Replan) -> Dodge:
        """Return what does best where nothing is safe: by what it gains, and how soon and deep it enters zones."""
        view = self._looked(now)
        return self._made(now.moment, view.dodges, view.seen, int(np.argmax(view.seen.worth)))

    def going_on(self, now: Replan) -> Dodge | None:
        """Go on getting out of the way as before, where no new dodge does better; None where one does.

        New dodges begin to turn as if the vehicle drove straight on. If each replan began one, it would never turn.

        Parameters
        ----------
        now : Replan
            In which no new dodge is certified.

        Returns
        -------
        Dodge or None
            None, too, where the vehicle is not on what it drove last, or that is over.
        """
        view = self._looked(now)
        if view.begun is None or view.going_on is None or view.going_on.worth[0] < view.seen.worth.max():
            return None
        return self._gone_on_with(now.moment, view.going_on, view.begun)

    def _still_good(self, now: Replan, least: float = -np.inf) -> Dodge | None:
        """What was begun, if it is certified, worth nearly as much as all new that is clear, and more than least, m.

        What does hardly better now may do hardly worse at the next replan: who always takes the best turns to and fro.
        """
        view = self._looked(now)
        if view.begun is None or view.going_on is None or np.isfinite(view.going_on.clear[0]):
            return None
        best = view.seen.worth.max(where=np.isinf(view.seen.clear), initial=-np.inf)
        if view.going_on.worth[0] <= max(best - ALIKE * 2.0 * now.moment.scenario.vehicle.radius, least):
            return None
        found = self._gone_on_with(now.moment, view.going_on, view.begun)
        now.lap("certificate")
        return found if found.safe else None

    def _begun(self, now: Replan) -> Stop | None:
        """What was begun at the last replan to get out of the way, unless the vehicle is not on it, or that is over."""
        moment, last = now.moment, now.last
        if last is None or last.outcome not in AWAY or not self._means.vetting.is_on(moment, last.trip):
            return None
        stop = Stop(last.trip, last.trip.frame.time)
        return stop if stop.stands > moment.state.time else None

    def _gone_on_with(self, moment: Moment, seen: _Outlook, stop: Stop) -> Dodge:
        """What was begun, as one dodge, among the zones of a moment in which that is seen of it."""
        certificate = self._means.vetting.certify_stop(moment, stop, moment.state.time)
        return self._dodge(moment, seen, 0, stop.trip, certificate)

    def sooner(self, now: Replan, trip: Trip) -> Dodge | None:
        """A certified dodge that does clearly better than going on with a trip; None if there is none.

        Parameters
        ----------
        now : Replan
        trip : Trip
            That is safe too.

        Returns
        -------
        Dodge or None
        """
        moment, view = now.moment, self._looked(now)
        seen, least = view.seen, self._worth_of(moment, trip, view.dodges.times)
        least += BETTER * 2.0 * moment.scenario.vehicle.radius
        now.lap("evasion")
        before = self._still_good(now, least)
        if before is not None:
            return before
        better = seen.worth > least
        if not (better & np.isinf(seen.clear)).any():
            return None
        seen = replace(seen, clear=np.where(better, seen.clear, 0.0))
        return self._first_safe(now, moment, view.dodges, seen, seen.worth)

    def at_lower_level(self, now: Replan, moment: Moment) -> Dodge | None:
        """Where no dodge is safe: one that is among smaller zones, what was begun before all others; None if none is.

        Parameters
        ----------
        now : Replan
        moment : Moment
            The same with those zones.

        Returns
        -------
        Dodge or None
        """
        view = self._looked(now)
        if view.begun is not None:
            seen = self._look_on(moment, view.begun, view.dodges.times)
            going_on = self._gone_on_with(moment, seen, view.begun)
            now.lap("certificate")
            if going_on.safe:
                return going_on
        seen = self._look(moment, view.dodges)
        now.lap("evasion")
        # Of those the one that does least harm in whole zones: it is no time to gain way.
        return self._first_safe(now, moment, view.dodges, seen, view.seen.worth)

    def _first_safe(self, now: Replan, moment: Moment, dodges: Dodges, seen: _Outlook, worth: Array) -> Dodge | None:
        """The certified one that is worth (C,) most, among the zones of a moment; None if there is none."""
        clear = np.flatnonzero(np.isinf(seen.clear))
        for number in clear[np.argsort(-worth[clear], kind="stable")][:TRIED].tolist():
            found = self._made(moment, dodges, seen, number)
            now.lap("certificate")
            if found.safe:
                return found
        return None

    def _looked(self, now: Replan) -> _SeenDodges:
        """What is seen in a moment, which is looked at once."""
        if self._view is None or self._view.moment is not now.moment:
            dodges, begun = self._dodges(now.moment), self._begun(now)
            if now.late:
                dodges = dodges.hurried(now.moment.batch.size)
            going_on = None if begun is None else self._look_on(now.moment, begun, dodges.times)
            self._view = _SeenDodges(now.moment, dodges, self._look(now.moment, dodges), begun, going_on)
            now.lap("evasion")
        return self._view

    def _dodges(self, moment: Moment) -> Dodges:
        state = moment.state
        heading = None if state.heading is None else state.heading - moment.frame.heading
        limits = Limits.of(moment.scenario, self._means.settings.limit_margin)
        vehicle, width, wait = moment.scenario.vehicle, 2.0 * moment.scenario.vehicle.radius, self._means.wait
        profiles: DodgeProfiles = (
            Profiles.of(state.speed, limits, width, wait)
            if vehicle.max_jerk is None
            else RampedProfiles.of(state, limits, vehicle.max_jerk, width, wait)
        )
        both_ways = can_reverse(vehicle, state.speed)
        bend = PROMPT if vehicle.max_curvature_rate is None else GRADUAL
        return Dodges.of(heading, profiles, 0.0, limits, vehicle.radius, wait, both_ways, bend)

    def _look(self, moment: Moment, dodges: Dodges) -> _Outlook:
        vehicle = moment.scenario.vehicle
        room = dodges.room(moment.batch, self._box(moment), vehicle)
        seen = self._seen(moment, _Driven(dodges.times, dodges.position, dodges.heading, dodges.until), room)
        if vehicle.steering is Steering.BOTH_WAYS and not can_reverse(vehicle, moment.state.speed):
            return self._with_backing_out(moment, dodges, seen)
        return seen

    def _with_backing_out(self, moment: Moment, dodges: Dodges, seen: _Outlook) -> _Outlook:
        """Judge a stop of a vehicle that drives both ways as if it then left backwards, where that is better.

        It has to stand before it can, and where it stands it may be in the way of somebody whom it would then leave.
        """
        vehicle, times = moment.scenario.vehicle, dodges.times
        stands = float(dodges.families[0].profiles.stands[0])
        starting = vehicle.max_speed / vehicle.max_acceleration
        since = np.maximum(times - stands, 0.0)
        gone = 0.5 * vehicle.max_acceleration * np.minimum(since, starting) ** 2
        gone += vehicle.max_speed * np.maximum(since - starting, 0.0)
        heading = dodges.heading[0]
        place = dodges.position[0] - gone[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        away = foreseen(moment.batch, stands, {}).distances(times, place)
        room = self._room_of(moment, place, away)
        left = self._seen(moment, _Driven(times, place[None], heading[None], times[-1:]), room)
        stops = np.arange(0, dodges.families[0].size, len(dodges.families[0].profiles.stands))
        worth = seen.worth.copy()
        worth[stops] = np.maximum(worth[stops], left.worth[0])
        return replace(seen, worth=worth)

    def _room_of(self, moment: Moment, place: Array, away: Array) -> Room:
        """Room at places (J, 2), m, in the planning frame, that are (J, Z) m away from the zones."""
        numbers = np.append(np.arange(away.shape[1]), BORDER)
        return Room(numbers, np.concatenate([away.T, self._box(moment).room(place)[None]])[:, None])

    def _look_on(self, moment: Moment, stop: Stop, times: Array) -> _Outlook:
        """What is seen of a stop that is being driven, at times (J,), s from now: as of one dodge."""
        trip, begin = stop.trip, moment.state.time
        points, _ = trip.at(begin + times)
        batch = foreseen(moment.batch_in(trip.frame), stop.stands - trip.frame.time, {})
        away = batch.distances(begin + times - trip.frame.time, points.path.position)
        place = moment.frame.to_frame(trip.frame.to_world(points.path.position))
        room, direction = self._room_of(moment, place, away), points.path.direction
        heading = np.arctan2(direction[:, 1], direction[:, 0]) + trip.frame.heading - moment.frame.heading
        driven = _Driven(times, place[None], heading[None], np.array([stop.stands + self._means.wait - begin]))
        return self._seen(moment, driven, room)

    def _seen(self, moment: Moment, driven: _Driven, room: Room) -> _Outlook:
        """Judge what is driven by the room that it keeps."""
        vehicle, after, near = moment.scenario.vehicle, driven.times > driven.until[:, None], room.least
        least = np.where(after, np.inf, near)
        # A certified stop may end nearer to a zone than the margin: then it must not come nearer still.
        entered = _until(near, driven) < np.clip(near[:, :1], 0.0, self._means.settings.clearance_margin)
        clear = np.where(entered.any(axis=1), driven.times[entered.argmax(axis=1)], np.inf)
        width = 2.0 * vehicle.radius
        time = driven.times / a_moment(vehicle)
        left = self._way_left(moment, driven, time)
        # It is not meant to stand for ever where somebody comes, but it may be hemmed in by then.
        counted = np.where(after & (time > OUTLOOK), np.inf, room.less(self._spare(moment.batch, vehicle)))
        worth = left[0] - left[1] - self._cost(time, near / width, counted / width) * width
        return _Outlook(least, room, clear, left[0], left[1], left[2], worth)

    def _way_left(self, moment: Moment, driven: _Driven, time: Array) -> Array:
        """What is left of the way to the goal, m, now, at `GAIN` and at the end, (3, C), of what is driven at times."""
        position, heading = (
            np.stack([values[:, 0], value_at(GAIN, time, values), values[:, -1]])
            for values in (driven.position, driven.heading)
        )
        return self._way_from(moment, moment.frame, position, heading)

    def _way_from(self, moment: Moment, frame: PlanningFrame, position: Array, heading: Array) -> Array:
        """What is left of the way to the goal, (...) m, from places (..., 2), m, with headings (...), in a frame."""
        scenario, tightest = moment.scenario, self._tightest(moment)
        vehicle, goal = scenario.vehicle, frame.to_frame(np.array(scenario.goal.position))
        if vehicle.steering is not Steering.BOTH_WAYS:
            return way_left(position, heading, goal, tightest, scenario.goal.radius)
        turning_back = 0.5 * vehicle.max_speed**2 * (1.0 / vehicle.max_acceleration + 1.0 / vehicle.max_deceleration)
        return way_left_both_ways(position, heading, goal, tightest, scenario.goal.radius, turning_back)

    def _lost_by_going_on(self, moment: Moment, trip: Trip) -> float:
        """By how much more the vehicle drives, m, as a trip goes on in one direction, than if it turned back for once.

        A trip may lead once more round a goal that is beside the vehicle.
        """
        if moment.scenario.vehicle.steering is not Steering.BOTH_WAYS:
            return 0.0
        points, _ = trip.at(np.array([moment.state.time]))
        place, direction = points.path.position, points.path.direction
        heading = np.arctan2(direction[:, 1], direction[:, 0])
        goal = trip.frame.to_frame(np.array(moment.scenario.goal.position))
        onward = way_left(place, heading, goal, self._tightest(moment), moment.scenario.goal.radius)
        return float((onward - self._way_from(moment, trip.frame, place, heading))[0])

    def _cost(self, time: Array, near: Array, counted: Array) -> Array:
        """What speaks against dodges, (C,) widths of way, by their clearances (C, J) and those that may be harmful."""
        return NEARNESS * self._patience * nearness(time, near) + harm(time, counted)

    def _spare(self, batch: ZoneBatch, vehicle: Vehicle) -> Array:
        """Clearance from each of L zones, (L,) m, below which a place counts as within them."""
        speeds = np.hypot(*batch.velocities.grid(np.zeros(1))[0].T)
        spare: Array = SPARE * self._patience * 2.0 * vehicle.radius * np.minimum(speeds / vehicle.max_speed, 1.0)
        return spare

    @staticmethod
    def _box(moment: Moment) -> Box:
        return Box.of(moment.scenario, moment.frame, 0.0)

    def _worth_of(self, moment: Moment, trip: Trip, times: Array) -> float:
        """What speaks for a trip, m, as for dodges; foreseen zones, where it is not certified, speak against it."""
        vehicle, begin = moment.scenario.vehicle, moment.state.time
        width = 2.0 * vehicle.radius
        ahead = times[times <= (OUTLOOK + 1.0) * a_moment(vehicle)]
        points, _ = trip.at(begin + ahead)
        place = points.path.position
        clock = ahead + (begin - trip.frame.time)
        each = moment.batch_in(trip.frame).distances(clock, place, width).T[:, None]
        room = Room(np.arange(len(each)), each)
        time = ahead / a_moment(vehicle)
        # All of its way leads to the goal, round what a dodge would end at; and who has arrived has no more to gain.
        driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(place, axis=0).T))])
        over = np.maximum(clock - trip.trajectory.travel_time, 0.0)
        gained = value_at(GAIN, time, (driven + vehicle.max_speed * over)[None]) - self._lost_by_going_on(moment, trip)
        near = np.where(over > 0.0, np.inf, room.least)
        counted = np.where(over > 0.0, np.inf, room.less(self._spare(moment.batch, vehicle)))
        return float((gained - self._cost(time, near / width, counted / width) * width)[0])

    def _tightest(self, moment: Moment) -> float:
        """Radius of the tightest turn that dodges of a vehicle with a heading take, m; 0 where that is free."""
        vehicle = moment.scenario.vehicle
        turns = moment.state.heading is None or vehicle.steering in (Steering.ANY, Steering.ON_THE_SPOT)
        if turns or not vehicle.max_curvature:
            return 0.0
        return 1.0 / (LIMIT_SHARE * Limits.of(moment.scenario, self._means.settings.limit_margin).curvature)

    def _soon(self, moment: Moment) -> float:
        """How long it takes to stop, after the next replan, s."""
        return self._means.online.period + braking_of(moment.scenario.vehicle).time(moment.state.speed)

    def _made(self, moment: Moment, dodges: Dodges, seen: _Outlook, number: int) -> Dodge:
        trip = dodges.trip(number, moment.frame)
        certificate = self._means.vetting.certify_stop(moment, Stop(trip, trip.frame.time), None)
        return self._dodge(moment, seen, number, trip, certificate)

    def _dodge(self, moment: Moment, seen: _Outlook, number: int, trip: Trip, certificate: Certificate) -> Dodge:
        """One of what is seen, with what is told of it."""
        speeds = trip.trajectory.drive_at(_SHARES).speed
        return Dodge(
            trip,
            certificate,
            float(seen.clear[number]),
            bool(seen.clear[number] > self._soon(moment)),
            float(seen.least[number].min()),
            self._blocked_by(moment, seen, number),
            self._threat(moment, seen, number),
            bool(speeds.max() > STANDING),
            bool(seen.then[number] < seen.now[number]),
        )

    @staticmethod
    def _threat(moment: Moment, seen: _Outlook, number: int) -> str | None:
        """The zone that a dodge enters first, or comes nearest to."""
        entered = seen.least[number] <= max(float(seen.least[number].min()), 0.0)
        zone = seen.room.nearest(number, int(entered.argmax()))
        return None if zone == BORDER else moment.batch.ids[zone]

    def _blocked_by(self, moment: Moment, seen: _Outlook, number: int) -> str | None:
        """The zone that is in the way of the dodge that would lead nearest to the goal."""
        nearest = int(seen.then.argmin())
        if nearest == number or np.isinf(seen.clear[nearest]):
            return None
        return self._threat(moment, seen, nearest)


def _until(near: Array, driven: _Driven) -> Array:
    """Clearances (C, J), m, up to the end of each dodge, which lies between two samples; inf after that."""
    times, until, near = driven.times, driven.until[:, None], np.minimum(near, FARTHEST)
    step = times[1] - times[0]
    share = np.clip((until - times) / step, 0.0, 1.0)[:, :-1]
    # The first sample after the end stands for the end.
    last = near[:, :-1] + share * (near[:, 1:] - near[:, :-1])
    over = times > until
    found = np.where(over, np.inf, near)
    found[:, 1:] = np.where(over[:, 1:] & ~over[:, :-1], last, found[:, 1:])
    return found
