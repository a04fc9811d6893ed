"""Approximate clearance, gain and worth of evasive manoeuvres, before any is certified."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from scp_planner.arrays import Array, Index, Mask, unit_vectors
from scp_planner.certificate.ends import can_reverse
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.mathematics.polylines import lengths_along, points_at
from scp_planner.online.border import CELL_WINDOW, Border, CellDistances
from scp_planner.online.evasive_manoeuvres import BORDER, WHOLE, Driven, EvasiveManoeuvres, Room, Size
from scp_planner.online.manoeuvre_courses import COURSES
from scp_planner.online.means import Means
from scp_planner.online.safety_gate import Moment, Stop
from scp_planner.online.stops import time_from_a_stand
from scp_planner.online.tolerances import LENGTH
from scp_planner.online.way_left import WAY, way_left, way_left_both_ways, way_on
from scp_planner.prediction.foresight import foreseen
from scp_planner.scenario.limits import Limits
from scp_planner.scenario.models import Steering, Vehicle
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.threat_zones.nearness import SweptBoxes, least_clearances
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class WorthParameters:
    # Widths that the vehicle drives in a moment, from a stand: so one that starts slowly looks ahead for longer
    moment_widths: float = 0.8
    # Moments, at which the way to the goal is taken that a manoeuvre gains: what comes later is decided by later
    # replans. With half as many a vehicle goes along with who crosses its way rather than let them pass
    gain_time: float = 3.5
    nearness: float = 4.0  # Widths of way that a moment of touching a zone is worth, if it were now
    close: float = 1.0 / 4.0  # Widths of more clearance, by which nearness falls to 1 / e, now
    close_growth: float = 1.0 / 20.0  # Widths a moment, by which that grows with time
    # Per moment: how soon nearness that is to come counts less, since there will be replans until then
    fading: float = 0.9
    outlook: float = 5.0  # Moments for which nearness counts
    # Moments for which zones grow, where nearness to them and harm are judged: of what is farther ahead the vehicle
    # will know as much by when it is there. Zones that grow on fill a crowd, and drive the vehicle away to where nobody
    # is
    growing: float = 1.0
    # Widths within which distances of what is driven are exact: what is farther away hardly counts
    exact_widths: float = 2.0
    harm: float = 50.0  # Widths of way that a width of depth in a zone is worth, if it were now
    harm_at_all: float = 1.0 / 6.0  # Widths of depth that any entry into a zone counts besides
    patience: float = 10.0  # Moments without coming nearer to the goal, after which nearness and spare room count half
    # Widths of clearance, below which a place counts as within the zone of who moves as fast as the vehicle may: a
    # small turn takes as much. Of who is slower: in proportion
    spare: float = 1.0 / 24.0
    # Lengths of way that a length is worth by which a manoeuvre shortens what can be driven: it ends in a dead end
    lost: float = 4.0


WORTH = WorthParameters()


def a_moment(vehicle: Vehicle) -> float:
    """Time unit of evasion, s: a vehicle drives `moment_widths` of its width in it, from a stand."""
    return time_from_a_stand(vehicle, WORTH.moment_widths * 2.0 * vehicle.radius)


@dataclass(frozen=True)
class Outlook:
    least: Array  # (C, J) Clearances, m; inf after the manoeuvre is over
    room: Room  # From which zones
    clear: Array  # (C,)
    then: Array  # (C,) Way to the goal that is left at its end, m
    worth: Array  # (C,)
    lost: Array  # (C,) Way that the vehicle could drive on which it cannot after it, m; nan where that is not looked at

    def some(self, which: Index) -> Outlook:
        room = Room(self.room.zones, self.room.each[:, which])
        each = (values[which] for values in (self.clear, self.then, self.worth, self.lost))
        return Outlook(self.least[which], room, *each)


class ManoeuvreOutlooks:
    def __init__(self, means: Means) -> None:
        self._means = means
        self._patience = 1.0
        self._cells: CellDistances | None = None
        self._next: tuple[Moment, Array, float] | None = None  # The place that manoeuvres lead to, of a moment
        self._growing = WORTH.growing * a_moment(means.given.vehicle)  # s for which zones grow in judging

    def be_patient(self, waited: float) -> None:
        """Say for how long the vehicle has come no nearer to its goal: the longer, the less nearness counts."""
        lasts = WORTH.patience * a_moment(self._means.given.vehicle)
        self._patience = lasts / (lasts + waited)

    def of(self, moment: Moment, manoeuvres: EvasiveManoeuvres, near: Index, best: int) -> Outlook:
        """Judge manoeuvres among the zones of a moment; the worth of all but the best few is an upper bound."""
        vehicle = moment.scenario.vehicle
        sizes, period = (WHOLE, Size(latest=self._growing)), self._means.safety_gate.period
        room, judged = manoeuvres.rooms(moment.batch, self.border(moment), vehicle, period, near, sizes)
        seen = self._with_dead_ends(moment, manoeuvres, self.seen(moment, manoeuvres, room, judged), best)
        if vehicle.steering is Steering.BOTH_WAYS and not can_reverse(vehicle, moment.state.speed):
            return self._with_backing_out(moment, manoeuvres, seen)
        return seen

    def _with_backing_out(self, moment: Moment, manoeuvres: EvasiveManoeuvres, seen: Outlook) -> Outlook:
        """Judge a stop of a vehicle that drives both ways as if it then left backwards, where that is better."""
        vehicle, times = moment.scenario.vehicle, manoeuvres.times
        stands = float(manoeuvres.families[0].profiles.stands[0])
        starting = vehicle.max_speed / vehicle.max_acceleration
        since = np.maximum(times - stands, 0.0)
        gone = 0.5 * vehicle.max_acceleration * np.minimum(since, starting) ** 2
        gone += vehicle.max_speed * np.maximum(since - starting, 0.0)
        heading = manoeuvres.heading[0]
        place = manoeuvres.position[0] - gone[:, None] * unit_vectors(heading)
        grown = min(max(stands, self._means.safety_gate.period), self._growing)
        away = foreseen(moment.batch, grown, {}).distances(times, place)
        room = self._room_of(moment, place, away)
        left = self.seen(moment, Driven(times, place[None], heading[None], times[-1:]), room, room)
        stops = np.arange(0, manoeuvres.families[0].size, len(manoeuvres.families[0].profiles.stands))
        worth = seen.worth.copy()
        worth[stops] = np.maximum(worth[stops], left.worth[0])
        return replace(seen, worth=worth)

    def _room_of(self, moment: Moment, place: Array, away: Array) -> Room:
        """Room at places (J, 2), m, in the planning frame, that are (J, Z) m away from the zones."""
        numbers = np.append(np.arange(away.shape[1]), BORDER)
        return Room(numbers, np.concatenate([away.T, self.border(moment).room(place)[None]])[:, None])

    def of_stop(self, moment: Moment, stop: Stop, times: Array) -> Outlook:
        """Return what is seen of a stop that is being driven: as of one manoeuvre."""
        trip, begin = stop.trip, moment.state.time
        points, _ = trip.at(begin + times)
        place = moment.frame.to_frame(trip.frame.to_world(points.path.position))
        clock, zones = begin + times - trip.frame.time, moment.batch_in(trip.frame)
        grown = max(stop.stands, self._means.safety_gate.unseen_until(moment))
        sizes = (foreseen(zones, until - trip.frame.time, {}) for until in (grown, min(grown, begin + self._growing)))
        exact = WORTH.exact_widths * 2.0 * moment.scenario.vehicle.radius
        away = (batch.distances(clock, points.path.position, exact) for batch in sizes)
        room, judged = (self._room_of(moment, place, each) for each in away)
        direction = points.path.direction
        heading = np.arctan2(direction[:, 1], direction[:, 0]) + trip.frame.heading - moment.frame.heading
        driven = Driven(times, place[None], heading[None], np.array([stop.stands + self._means.wait - begin]))
        return self.with_every_dead_end(moment, driven, self.seen(moment, driven, room, judged))

    def with_every_dead_end(self, moment: Moment, driven: Driven, seen: Outlook) -> Outlook:
        return self._less_lost(moment, driven, seen, np.flatnonzero(np.isnan(seen.lost)))

    def _less_lost(self, moment: Moment, driven: Driven, seen: Outlook, some: Index) -> Outlook:
        """Subtract from the worth of some manoeuvres the way that they lose by ending in a dead end."""
        lost, worth = seen.lost.copy(), seen.worth.copy()
        lost[some] = self._way_lost(moment, driven, some)
        worth[some] -= WORTH.lost * lost[some]
        return replace(seen, worth=worth, lost=lost)

    def _with_dead_ends(self, moment: Moment, driven: Driven, seen: Outlook, best: int) -> Outlook:
        """Look for dead ends after the clear manoeuvres of the highest worth, until the best few are known."""
        order = np.flatnonzero(np.isinf(seen.clear))
        order = order[np.argsort(-seen.worth[order], kind="stable")]
        for first in range(0, len(order), 2 * best):
            some, known = order[first : first + 2 * best], np.sort(seen.worth[order[:first]])
            if first and known[-best] >= seen.worth[some[0]]:
                break
            seen = self._less_lost(moment, driven, seen, some)
        return seen

    def seen(self, moment: Moment, driven: Driven, room: Room, judged: Room) -> Outlook:
        """Judge what is driven by the room that it keeps, but for dead ends."""
        vehicle, after, near = moment.scenario.vehicle, driven.times > driven.until[:, None], room.least
        least = np.where(after, np.inf, near)
        # A certified stop may end nearer to a zone than the margin: then it must not come nearer still.
        entered = until_over(near, driven) < np.clip(near[:, :1], 0.0, self._means.settings.clearance_margin)
        clear = np.where(entered.any(axis=1), driven.times[entered.argmax(axis=1)], np.inf)
        width = 2.0 * vehicle.radius
        time = driven.times / a_moment(vehicle)
        left = self._way_left(moment, driven, time)
        # It is not meant to stand for ever where somebody comes, but it may be hemmed in by then.
        counted = np.where(after & (time > WORTH.outlook), np.inf, judged.less(self._spare(moment)))
        worth = left[0] - left[1] - self._cost(time, judged.least / width, counted / width) * width
        return Outlook(least, room, clear, left[2], worth, np.full(len(worth), np.nan))

    def _way_lost(self, moment: Moment, driven: Driven, some: Index) -> Array:
        """By how much less the vehicle can drive in all, m, if it drives some; 0 if it can turn or back out."""
        radius, heading, none = self.tightest(moment), moment.state.heading, np.zeros(len(some))
        if radius == 0.0 or heading is None or moment.scenario.vehicle.steering is Steering.BOTH_WAYS:
            return none
        border, standing = self.border(moment), _that_stand(moment.batch)
        if not border.is_there and not standing.size:
            return none
        steps = np.hypot(*np.moveaxis(np.diff(driven.position[some], axis=1), -1, 0))
        place = np.concatenate([np.zeros((1, 2)), driven.position[some, -1]])
        headings = np.append(heading - moment.frame.heading, driven.heading[some, -1])
        lost = np.zeros(len(steps))
        # Where something that stands is in the way, it still matters whether the vehicle can go on when that is gone.
        for zones in (standing.subset(np.zeros(0, dtype=np.intp)), standing)[: 1 + min(standing.size, 1)]:
            left = way_on(place, headings, radius, partial(_is_clear, border, zones))
            lost = np.maximum(lost, left[0] - steps.sum(axis=1) - left[1:])
        return lost

    def _way_left(self, moment: Moment, driven: Driven, time: Array) -> Array:
        position, heading = (
            np.stack([values[:, 0], value_at(WORTH.gain_time, time, values), values[:, -1]])
            for values in (driven.position, driven.heading)
        )
        return self._way_from(moment, moment.frame, position, heading)

    def _way_from(self, moment: Moment, frame: PlanningFrame, position: Array, heading: Array) -> Array:
        scenario, tightest = moment.scenario, self.tightest(moment)
        vehicle, (goal, radius) = scenario.vehicle, self._next_place(moment, frame)
        if vehicle.steering is not Steering.BOTH_WAYS:
            return way_left(position, heading, goal, tightest, radius)
        turning_back = 0.5 * vehicle.max_speed**2 * (1.0 / vehicle.max_acceleration + 1.0 / vehicle.max_deceleration)
        return way_left_both_ways(position, heading, goal, tightest, radius, turning_back)

    def _next_place(self, moment: Moment, frame: PlanningFrame) -> tuple[Array, float]:
        """The place, (2,) m in a frame, that manoeuvres lead to, and its radius, m.

        The next place to pass, or the goal; where something that stands hides the guide, its last visible place.
        """
        if self._next is None or self._next[0] is not moment:
            self._next = moment, *self._found_next(moment)
        return frame.to_frame(self._next[1]), self._next[2]

    def _found_next(self, moment: Moment) -> tuple[Array, float]:
        scenario = moment.scenario
        place = next(iter(scenario.goals), scenario.goal)
        found, radius = np.array(place.position), place.radius or 0.0
        if scenario.guide is not None:
            steps, border = scenario.vehicle.radius, self.border(moment)
            standing = moment.batch.subset(np.flatnonzero(moment.stands))
            line = np.array(scenario.guide)
            along = lengths_along(line)
            ahead = points_at(np.arange(steps, min(along[-1], self._sight(moment)), steps), along, line)
            seen = np.linspace(0.0, 1.0, WAY.steps)[:, None, None] * (ahead - line[0]) + line[0]
            hidden = ~_is_clear(border, standing, moment.frame.to_frame(seen)).all(axis=0)
            if hidden.any():
                found, radius = ahead[max(int(hidden.argmax()) - 1, 0)], 0.0
        return found, radius

    def _lost_by_going_on(self, moment: Moment, trip: Trip) -> float:
        """By how much more the vehicle drives, m, as a trip goes on in one direction."""
        if moment.scenario.vehicle.steering is not Steering.BOTH_WAYS:
            return 0.0
        points, _ = trip.at(np.array([moment.state.time]))
        place, direction = points.path.position, points.path.direction
        heading = np.arctan2(direction[:, 1], direction[:, 0])
        goal, radius = self._next_place(moment, trip.frame)
        onward = way_left(place, heading, goal, self.tightest(moment), radius)
        return float((onward - self._way_from(moment, trip.frame, place, heading))[0])

    def _cost(self, time: Array, near: Array, counted: Array) -> Array:
        return WORTH.nearness * self._patience * nearness(time, near) + harm(time, counted)

    def _spare(self, moment: Moment) -> Array:
        """Clearance from each of L zones, (L, 1) m, below which a place counts as within them."""
        vehicle = moment.scenario.vehicle
        share = np.minimum(moment.speeds / vehicle.max_speed, 1.0)
        spare: Array = WORTH.spare * self._patience * 2.0 * vehicle.radius * share
        return spare[:, None]

    def border(self, moment: Moment) -> Border:
        ground, cells = moment.scenario.ground, None
        if ground is not None:
            place, reach = np.array(moment.state.position), self._sight(moment)
            if self._cells is None or not self._cells.covers(ground.map, place, reach):
                self._cells = CellDistances.about(ground.map, place, CELL_WINDOW.reaches * reach)
            cells = self._cells
        return Border.of(moment.scenario, moment.frame, cells)

    def _sight(self, moment: Moment) -> float:
        """Reach of manoeuvres and of ways on from their ends, m."""
        lasts = (WORTH.outlook + 1.0) * a_moment(moment.scenario.vehicle)
        return moment.scenario.vehicle.max_speed * lasts + WAY.far * self.tightest(moment)

    def worth_of(self, moment: Moment, trip: Trip, times: Array) -> float:
        """Return what speaks for a trip, as for manoeuvres; foreseen zones speak against it if it is not certified."""
        vehicle, begin = moment.scenario.vehicle, moment.state.time
        width = 2.0 * vehicle.radius
        ahead = times[times <= (WORTH.outlook + 1.0) * a_moment(vehicle)]
        points, _ = trip.at(begin + ahead)
        place = points.path.position
        clock = ahead + (begin - trip.frame.time)
        batch = foreseen(moment.batch_in(trip.frame), begin - trip.frame.time + self._growing, {})
        each = batch.distances(clock, place, width).T[:, None]
        room = Room(np.arange(len(each)), each)
        time = ahead / a_moment(vehicle)
        # All of its way leads to the goal, round what a manoeuvre would end at; who has arrived has no more to gain.
        driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(place, axis=0).T))])
        over = np.maximum(clock - trip.trajectory.travel_time, 0.0)
        gained = value_at(WORTH.gain_time, time, (driven + vehicle.max_speed * over)[None])
        gained = gained - self._lost_by_going_on(moment, trip)
        near = np.where(over > 0.0, np.inf, room.least)
        counted = np.where(over > 0.0, np.inf, room.less(self._spare(moment)))
        return float((gained - self._cost(time, near / width, counted / width) * width)[0])

    def dead_end(self, moment: Moment, seen: Outlook) -> Array:
        """Share of the way that the vehicle could drive on, which it cannot after each manoeuvre, (C,)."""
        return seen.lost / max(WAY.far * self.tightest(moment), LENGTH)

    def tightest(self, moment: Moment) -> float:
        """Return the radius of the tightest turn that manoeuvres with a heading take, m; 0 where that is free."""
        vehicle = moment.scenario.vehicle
        turns = moment.state.heading is None or vehicle.steering in (Steering.ANY, Steering.ON_THE_SPOT)
        if turns or not vehicle.max_curvature:
            return 0.0
        return 1.0 / (COURSES.limit_share * Limits.of(moment.scenario, self._means.settings.limit_margin).curvature)


def _that_stand(batch: ZoneBatch) -> ZoneBatch:
    stands = ~np.any(batch.velocities.coefficients, axis=(1, 2, 3))
    stands[batch.uncertain] = False
    return batch.subset(np.flatnonzero(stands))


def _is_clear(border: Border, standing: ZoneBatch, place: Array) -> Mask:
    """True if places (..., 2), m, are within the border, and clear of zones that stand."""
    clear: Mask = border.room(place) >= 0.0
    points = place.reshape(-1, 2)
    if not standing.size or not len(points):
        return clear
    near = standing.subset(_within_box(standing, points))  # most of the walls of a long corridor are nowhere near
    if near.size:
        away = near.distances(np.zeros(len(points)), points, 0.0).min(axis=1)
        clear = clear & (away >= 0.0).reshape(clear.shape)
    return clear


def _within_box(standing: ZoneBatch, points: Array) -> Index:
    """Zones that stand and may reach into the box round points, (n, 2) m."""
    box = SweptBoxes(np.zeros(1), 0.0, points.min(axis=0)[None], points.max(axis=0)[None])
    return np.flatnonzero(least_clearances(standing, box) <= 0.0)


def until_over(near: Array, driven: Driven) -> Array:
    """Return clearances up to the end of each manoeuvre, which lies between two samples; inf after that."""
    times, until, near = driven.times, driven.until[:, None], np.minimum(near, 1e9)
    step = times[1] - times[0]
    share = np.clip((until - times) / step, 0.0, 1.0)[:, :-1]
    # The first sample after the end stands for the end.
    last = near[:, :-1] + share * (near[:, 1:] - near[:, :-1])
    over = times > until
    found = np.where(over, np.inf, near)
    found[:, 1:] = np.where(over[:, 1:] & ~over[:, :-1], last, found[:, 1:])
    return found


def nearness(time: Array, clearance: Array) -> Array:
    weight = np.where(time <= WORTH.outlook, time[1] - time[0], 0.0) / (1.0 + WORTH.fading * time)
    # How deep it is inside of a zone is not judged here.
    return np.exp(-np.maximum(clearance, -WORTH.close) / (WORTH.close + WORTH.close_growth * time)) @ weight


def harm(time: Array, clearance: Array) -> Array:
    depth = np.where(clearance < 0.0, WORTH.harm_at_all - clearance, 0.0)
    return WORTH.harm * (depth / (1.0 + WORTH.fading * time)).max(axis=1)


def value_at(time: float, times: Array, values: Array) -> Array:
    """Return values (C, ...) at a time, of those (C, J, ...) at times (J,)."""
    after = int(np.searchsorted(times, time).clip(1, len(times) - 1))
    share = min((time - times[after - 1]) / (times[after] - times[after - 1]), 1.0)
    return np.asarray(values[:, after - 1] + share * (values[:, after] - values[:, after - 1]))
