"""Out of the way: what is driven where no trip to the goal can be left for a stop that stays clear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from scp_planner.arrays import Index
from scp_planner.certificate.ends import can_reverse
from scp_planner.certificate.verdict import Certificate
from scp_planner.mathematics.occupancy import NAME as MAP
from scp_planner.online.evasive_manoeuvres import BORDER, EvasiveManoeuvres
from scp_planner.online.expected_harm import HARM, HarmModel
from scp_planner.online.manoeuvre_courses import COURSES, GRADUAL, PROMPT, ManoeuvreProfiles, Profiles, RampedProfiles
from scp_planner.online.manoeuvre_outlooks import ManoeuvreOutlooks, Outlook
from scp_planner.online.means import Means, Replan
from scp_planner.online.plan import AWAY, Outcome
from scp_planner.online.reasons import CandidateKind
from scp_planner.online.safety_gate import Moment, Stop
from scp_planner.online.stops import STOPS, braking_of
from scp_planner.online.tolerances import TIME
from scp_planner.scenario.limits import Limits
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class EvasionParameters:
    pace_kept: float = 0.9  # Share of the last pace that is kept, if the next evaluation is faster
    harm_takes: float = 3.0  # Evaluations of all manoeuvres that finding the expected harm takes as long as
    # Share of the expected harm of the trip under way that another may have at most, for the vehicle to change over
    steady: float = 0.75
    # Harm that makes no difference: of those that differ by no more, the one that is worth most is driven
    even: float = 0.02
    fewest: int = 24  # Manoeuvres that are evaluated where there is no time left
    first_pace: float = 3e-6  # s that the evaluation of a manoeuvre and a zone is expected to take before any was timed
    most_samples: int = 20_000_000  # Samples of manoeuvres, times zones, that are evaluated at most
    tried: int = 4  # Manoeuvres that are certified in one replan, at most
    better: float = 0.1  # Widths of way by which a manoeuvre must do better for the vehicle to leave a trip
    # Widths of way by which a manoeuvre must do better than the one under way for the vehicle to change over
    alike: float = 0.1


EVASION = EvasionParameters()


@dataclass(frozen=True)
class Manoeuvre:
    trip: Trip
    certificate: Certificate  # Up to when it is over
    threat: str | None  # The obstacle in its way, or in that of what leads nearest to the goal
    moves: bool

    @property
    def safe(self) -> bool:
        """True if it is certified until the vehicle has stood for as long as it has to."""
        return self.certificate.holds

    @property
    def allowed_speed(self) -> float:
        """The lowest limit of speed that it breaks at a place, m/s; inf if none."""
        broken = (one.allowed for one in self.certificate.violations if one.what.startswith("speed_limits"))
        return min(broken, default=np.inf)

    @property
    def outcome(self) -> Outcome:
        return Outcome.EVADING if self.moves else Outcome.BRAKING


@dataclass(frozen=True)
class _SeenEvasiveManoeuvres:
    """A moment, its manoeuvres, what is seen of them and of what was begun, if the vehicle is on that."""

    moment: Moment
    manoeuvres: EvasiveManoeuvres
    near: Index
    seen: Outlook
    begun: Stop | None
    going_on: Outlook | None


class Evasion:
    def __init__(self, means: Means) -> None:
        self._means = means
        self.outlooks = ManoeuvreOutlooks(means)
        self._view: _SeenEvasiveManoeuvres | None = None
        self._each = EVASION.first_pace  # s that it took to see how far one manoeuvre keeps from one zone

    def safest(self, now: Replan) -> Manoeuvre | None:
        """Return the certified manoeuvre that is worth most, or the one under way, if it is worth nearly as much."""
        view = self._looked(now)
        return self._still_good(now) or self._first_safe(now, view.manoeuvres, view.seen)

    def least_harmful(self, now: Replan, others: Sequence[Stop]) -> Manoeuvre | Stop:
        """Return what does least harm where nothing is safe: a manoeuvre, or one of some other trips and stops."""
        view = self._with_time_for_harm(now)
        moment, standing = now.moment, HARM.standing if self._means.gives_way_late else HARM.creeping
        goes_on = int(bool(others) and now.last is not None and others[0].trip is now.last.trip)
        soon = self._means.period + braking_of(moment.scenario.vehicle).time(moment.state.speed)
        model = HarmModel(moment, self.outlooks.border(moment), self._means.given.confidence, standing, soon)
        trips = model.of_trips([each.trip for each in others], view.manoeuvres.times)
        manoeuvres = model.of_manoeuvres(view.manoeuvres)
        least = min(trips.impact.min(initial=np.inf), manoeuvres.impact.min())
        braking = min(float(manoeuvres.impact[0]), trips.impact[goes_on:].min(initial=np.inf))
        harms, of_manoeuvres = (each.no_harder_than(least, braking) for each in (trips, manoeuvres))
        seen = self.outlooks.with_every_dead_end(moment, view.manoeuvres, view.seen)
        if seen.lost.any():
            of_manoeuvres = of_manoeuvres + HARM.dead_end * self.outlooks.dead_end(moment, seen)
            ends = [float(self.outlooks.dead_end(moment, self._seen_of(now, each))[0]) for each in others]
            harms = harms + HARM.dead_end * np.array(ends)
        now.lap("evasion")
        for each, harm in zip(others, trips.expected.tolist(), strict=True):
            self._means.consider(now, CandidateKind.STOP, each.trip, None, severity=harm)
        harmless = np.where(harms <= EVASION.even, trips.driven, np.inf)
        if np.isfinite(harmless).any():  # until a contact is to be feared, who brakes first can do the most about it
            return others[int(harmless.argmin())]
        # Who always turns to where it is best drives to and fro; but it may brake at any time.
        if goes_on and EVASION.steady * harms[0] <= of_manoeuvres.min() and harms[0] <= harms.min() + EVASION.even:
            return others[0]
        most = min(harms.min(initial=np.inf), of_manoeuvres.min()) + EVASION.even
        even = [each for each, harm in zip(others, harms.tolist(), strict=True) if harm <= most]
        if even:
            return even[0] if len(even) == 1 else max(even, key=lambda each: float(self._seen_of(now, each).worth[0]))
        good = of_manoeuvres <= most
        if moment.state.speed <= STOPS.standing:
            # Who stands goes on with that, too.
            still = view.manoeuvres.until <= view.manoeuvres.wait
            stays = still & ((EVASION.steady * of_manoeuvres <= of_manoeuvres.min()) | good)
            good = stays if stays.any() else good
        order = np.argsort(np.where(good, -seen.worth, np.inf), kind="stable")[: min(int(good.sum()), EVASION.tried)]
        made = list[Manoeuvre]()
        for number in order.tolist():
            made.append(self._made(now, view.manoeuvres, seen, number, float(of_manoeuvres[number])))
            if not made[-1].certificate.limits_broken:
                break
        return min(made, key=lambda each: each.certificate.limits_broken)

    def as_manoeuvre(self, now: Replan, stop: Stop) -> Manoeuvre:
        return self._gone_on_with(now, self._seen_of(now, stop), stop)

    def stays_clear(self, now: Replan, stop: Stop) -> bool:
        """True if a stop, and the stand after it, is clear for as long as manoeuvres are looked ahead."""
        return bool(np.isinf(self._seen_of(now, stop).clear[0]))

    def _seen_of(self, now: Replan, stop: Stop) -> Outlook:
        view = self._looked(now)
        if view.begun is not None and view.going_on is not None and stop.trip is view.begun.trip:
            return view.going_on
        return self.outlooks.of_stop(now.moment, stop, view.manoeuvres.times)

    def _still_good(self, now: Replan, least: float = -np.inf) -> Manoeuvre | None:
        view = self._looked(now)
        if view.begun is None or view.going_on is None or np.isfinite(view.going_on.clear[0]):
            return None
        best = view.seen.worth.max(where=np.isinf(view.seen.clear), initial=-np.inf)
        if view.going_on.worth[0] <= max(best - EVASION.alike * 2.0 * now.moment.scenario.vehicle.radius, least):
            return None
        found = self._gone_on_with(now, view.going_on, view.begun)
        now.lap("certificate")
        return found if found.safe else None

    def begun(self, now: Replan) -> Stop | None:
        moment, last = now.moment, now.last
        if last is None or last.outcome not in AWAY or not self._means.safety_gate.is_on(moment, last.trip):
            return None
        stop = Stop(last.trip, last.trip.frame.time)
        return stop if stop.stands > moment.state.time else None

    def _gone_on_with(self, now: Replan, seen: Outlook, stop: Stop) -> Manoeuvre:
        moment = now.moment
        certificate = self._means.safety_gate.certify_stop(moment, stop, moment.state.time)
        self._means.consider(now, CandidateKind.EVASION, stop.trip, certificate, float(seen.worth[0]))
        return self._manoeuvre(moment, seen, 0, stop.trip, certificate)

    def sooner(self, now: Replan, trip: Trip) -> Manoeuvre | None:
        """A certified manoeuvre that does clearly better than going on with a trip; None if there is none."""
        moment, view = now.moment, self._looked(now)
        seen, least = view.seen, self.outlooks.worth_of(moment, trip, view.manoeuvres.times)
        least += EVASION.better * 2.0 * moment.scenario.vehicle.radius
        now.lap("evasion")
        before = self._still_good(now, least)
        if before is not None:
            return before
        better = seen.worth > least
        if not (better & np.isinf(seen.clear)).any():
            return None
        seen = replace(seen, clear=np.where(better, seen.clear, 0.0))
        return self._first_safe(now, view.manoeuvres, seen)

    def _first_safe(self, now: Replan, manoeuvres: EvasiveManoeuvres, seen: Outlook) -> Manoeuvre | None:
        """The certified one that is worth most, or else the stop at once; None if none of those tried is certified."""
        clear = np.flatnonzero(np.isinf(seen.clear))
        left, tried = clear[np.argsort(-seen.worth[clear], kind="stable")], list[int]()
        while len(left) and len(tried) < EVASION.tried:
            tried.append(int(left[0]))
            found = self._made(now, manoeuvres, seen, tried[-1])
            now.lap("certificate")
            if found.safe:
                return found
            if not now.has_time("manoeuvre", "certificate"):
                break
            # Others that are as fast would break that limit, too
            left = left[1:][manoeuvres.fastest[left[1:]] <= found.allowed_speed]
        if 0 in tried or not np.isinf(seen.clear[0]):
            return None
        stop = self._made(now, manoeuvres, seen, 0)
        now.lap("certificate")
        return stop if stop.safe else None

    def _looked(self, now: Replan) -> _SeenEvasiveManoeuvres:
        if self._view is None or self._view.moment is not now.moment:
            moment = now.moment
            manoeuvres, begun = self._manoeuvres(moment), self.begun(now)
            near = manoeuvres.within_reach(moment.batch, moment.scenario.vehicle)
            manoeuvres = manoeuvres.few(EVASION.most_samples / max(len(near) * len(manoeuvres.times), 1))
            going_on = None if begun is None else self.outlooks.of_stop(moment, begun, manoeuvres.times)
            some = manoeuvres.few(self._in_time(now, len(near), 1.0))
            seen = self._seen(now, some, near, some is not manoeuvres)
            self._view = _SeenEvasiveManoeuvres(moment, some, near, seen, begun, going_on)
        return self._view

    def _seen(self, now: Replan, manoeuvres: EvasiveManoeuvres, near: Index, hurried: bool) -> Outlook:
        now.lap("evasion")
        begin, pairs = now.clock, len(manoeuvres.position) * len(near)
        seen = self.outlooks.of(now.moment, manoeuvres, near, EVASION.tried)
        now.lap("evasion")
        took = 0.0 if hurried else (now.clock - begin) / max(pairs, 1)  # most of the time of a few goes elsewhere
        self._each = max(EVASION.pace_kept * self._each, took)
        return seen

    def _in_time(self, now: Replan, zones: int, takes: float) -> float:
        """Number of manoeuvres that there is time to evaluate, so many times each."""
        each = takes * self._each * max(zones, 1)
        return max((now.until("certificate") - perf_counter()) / max(each, TIME), EVASION.fewest)

    def _with_time_for_harm(self, now: Replan) -> _SeenEvasiveManoeuvres:
        view = self._looked(now)
        most = self._in_time(now, len(view.near), EVASION.harm_takes)
        if most < len(view.seen.worth):
            few, numbers = view.manoeuvres.best(most, view.seen.worth)
            view = self._view = replace(view, manoeuvres=few, seen=view.seen.some(numbers))
        return view

    def _manoeuvres(self, moment: Moment) -> EvasiveManoeuvres:
        state = moment.state
        heading = None if state.heading is None else state.heading - moment.frame.heading
        vehicle, width, wait = moment.scenario.vehicle, 2.0 * moment.scenario.vehicle.radius, self._means.wait
        margin, total = self._means.settings.limit_margin, vehicle.max_total_acceleration
        limits = replace(Limits.of(moment.scenario, margin), deceleration=vehicle.max_deceleration)
        limits = limits.both_within(total and total * (1.0 - margin))
        profiles: ManoeuvreProfiles = (
            Profiles.of(state.speed, limits, width, wait)
            if vehicle.max_jerk is None
            else RampedProfiles.of(state, limits, vehicle.max_jerk, width, wait)
        )
        both_ways = can_reverse(vehicle, state.speed)
        bend = PROMPT if vehicle.max_curvature_rate is None else GRADUAL
        return EvasiveManoeuvres.of(heading, profiles, limits, vehicle.radius, wait, both_ways, bend)

    def _made(
        self, now: Replan, manoeuvres: EvasiveManoeuvres, seen: Outlook, number: int, severity: float | None = None
    ) -> Manoeuvre:
        moment, trip = now.moment, manoeuvres.trip(number, now.moment.frame)
        certificate = self._means.safety_gate.certify_stop(moment, Stop(trip, trip.frame.time), None)
        self._means.consider(now, CandidateKind.EVASION, trip, certificate, float(seen.worth[number]), severity)
        return self._manoeuvre(moment, seen, number, trip, certificate)

    def _manoeuvre(self, moment: Moment, seen: Outlook, number: int, trip: Trip, certificate: Certificate) -> Manoeuvre:
        """One of what is seen, with what is told of it."""
        speeds = trip.trajectory.drive_at(np.linspace(0.0, 1.0, COURSES.spans + 1)).speed
        return Manoeuvre(
            trip,
            certificate,
            self._blocked_by(moment, seen, number) or self._threat(moment, seen, number),
            bool(speeds.max() > STOPS.standing),
        )

    @staticmethod
    def _threat(moment: Moment, seen: Outlook, number: int) -> str | None:
        """The zone that a manoeuvre enters first, or comes nearest to."""
        entered = seen.least[number] <= max(float(seen.least[number].min()), 0.0)
        zone = seen.room.nearest(number, int(entered.argmax()))
        if zone != BORDER:
            return moment.batch.ids[zone]
        return None if moment.scenario.ground is None else MAP

    def _blocked_by(self, moment: Moment, seen: Outlook, number: int) -> str | None:
        """The zone that is in the way of the manoeuvre that would lead nearest to the goal."""
        nearest = int(seen.then.argmin())
        if nearest == number or np.isinf(seen.clear[nearest]):
            return None
        return self._threat(moment, seen, nearest)
