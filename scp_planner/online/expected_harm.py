"""Expected harm of a trip where nothing is safe: probability of contact and the speed at it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from scp_planner.arrays import Array
from scp_planner.online.border import Border
from scp_planner.online.evasive_manoeuvres import WHOLE, EvasiveManoeuvres, Size, in_parts
from scp_planner.online.manoeuvre_outlooks import WORTH, a_moment
from scp_planner.online.safety_gate import Moment
from scp_planner.online.stops import STOPS
from scp_planner.online.tolerances import LENGTH
from scp_planner.prediction.foresight import foreseen
from scp_planner.scenario.models import Confidence
from scp_planner.threat_zones.batch import ZoneBatch
from scp_planner.tracking.confidence import marginal_scale
from scp_planner.trips.trip import Trip


@dataclass(frozen=True)
class HarmParameters:
    # Share of the zones' extents at which distances are looked at besides, to tell from both how far they reach
    part: float = 0.1
    standing: float = 0.5  # Cost of a contact while the vehicle stands, relative to one at its top speed
    # Cost of a contact while it creeps, relative to one at its top speed. Where it gives way early, among people who do
    # not look, it is no better to stand than to creep
    creeping: float = 0.75
    # Share of how much less it counts to stand than to creep, that it counts besides to drive while it is touched
    setting_off: float = 0.4
    # Moments for which zones grow: what is farther ahead will be known better by when the vehicle has to be out of it
    growing: float = 0.5
    # Deviations of a gap, beyond which a touch is so improbable that no sum with anything probable shows it
    far: float = 9.0
    leaving: float = 0.5  # Share of the way by which a contact is to get shallower, for the vehicle to leave it
    dead_end: float = 0.1  # Cost of an end from which the vehicle cannot drive on, relative to a contact at top speed
    alike: float = 0.05  # Share of a speed at contact, by which others are as good


HARM = HarmParameters()


@dataclass(frozen=True)
class Harms:
    """Harm of n trips."""

    expected: Array  # Between 0 and 1
    # m/s: highest speeds in contact with obstacles where they are expected, in the time in which the vehicle can stop
    impact: Array
    driven: Array  # m, in that time: less of those that brake sooner

    def no_harder_than(self, least: float, braking: float) -> Array:
        """Harms; inf of trips that hit harder than braking, or, where each hits, than the one that hits least."""
        most = least if least > 0.0 else braking
        return np.where(self.impact <= (1.0 + HARM.alike) * most, self.expected, np.inf)


@dataclass(frozen=True)
class HarmModel:
    """Harm that is to be expected at a moment."""

    moment: Moment
    border: Border
    confidence: Confidence
    standing: float  # Cost of a contact while the vehicle stands
    soon: float  # Time in which the vehicle can stop, s

    def of_manoeuvres(self, manoeuvres: EvasiveManoeuvres) -> Harms:
        """Harm to be expected of manoeuvres, (C,)."""
        vehicle, whole = self.moment.scenario.vehicle, self._grown(self.moment.batch)
        near, harms = manoeuvres.within_reach(whole, vehicle), []
        weights, scale = self._weights(manoeuvres.times, manoeuvres.position), self._deviations
        # the border is one more, also where no zone is near
        for some in in_parts(max(len(near), 1), manoeuvres.heading.size):
            each, less = manoeuvres.rooms(whole, self.border, vehicle, np.inf, near[some], (WHOLE, Size(HARM.part)))
            harms.append(_harms(each.each, less.each, scale, weights))
        spared = np.prod([1.0 - each.expected for each in harms], axis=0)
        return Harms(1.0 - spared, np.max([each.impact for each in harms], axis=0), harms[0].driven)

    def of_trips(self, trips: Sequence[Trip], times: Array) -> Harms:
        """Harm to be expected of trips that are being driven, or stops, (n,)."""
        if not trips:
            return Harms(np.zeros(0), np.zeros(0), np.zeros(0))
        moment, place = self.moment, np.empty((len(trips), len(times), 2))
        for trip, put in zip(trips, place, strict=True):
            put[:] = moment.frame.to_frame(trip.frame.to_world(trip.positions_at(moment.state.time + times)))
        clock, points = np.tile(times, len(trips)), place.reshape(-1, 2)
        exact = WORTH.exact_widths * 2.0 * moment.scenario.vehicle.radius
        zones = (self._grown(one.batch) for one in (moment, moment.with_smaller_zones(HARM.part)))
        away = (each.distances(clock, points, exact).T.reshape(-1, *place.shape[:2]) for each in zones)
        edge = np.minimum(self.border.room(place), exact)[None]
        whole, less = (np.concatenate([each, edge]) for each in away)
        return _harms(whole, less, self._deviations, self._weights(times, place))

    def _grown(self, batch: ZoneBatch) -> ZoneBatch:
        """Zones that grow for the same while, whatever the vehicle does."""
        return foreseen(batch, HARM.growing * a_moment(self.moment.scenario.vehicle), {})

    @property
    def _deviations(self) -> float:
        """Standard deviations that zones are large."""
        level, uncertain = str(self.confidence.level), max(len(self.moment.batch.uncertain), 1)
        return math.sqrt(marginal_scale(level, self.confidence.probability, 1, uncertain))

    def _weights(self, times: Array, place: Array) -> _Weights:
        vehicle, speed = self.moment.scenario.vehicle, np.zeros(place.shape[:2])
        speed[:, :-1] = np.hypot(*np.moveaxis(np.diff(place, axis=1), -1, 0)) / np.diff(times)
        drives = HARM.creeping + (1.0 - HARM.creeping) * np.minimum(speed / vehicle.max_speed, 1.0)
        moves = speed > STOPS.standing
        counts = np.where(moves, drives, self.standing)
        fading = 1.0 / (1.0 + WORTH.fading * times / a_moment(vehicle))  # there will be replans until then
        sets_off = np.where(moves[:, 0], HARM.setting_off * (HARM.creeping - self.standing), 0.0)
        driven = speed[:, :-1] * np.diff(times)
        soon = times <= max(self.soon, times[1])
        speed = np.where(soon & moves, speed, 0.0)
        return _Weights(counts, fading, sets_off, driven, speed[:, :-1], (driven * soon[1:]).sum(axis=1))


@dataclass(frozen=True)
class _Weights:
    counts: Array  # (C, J) Cost of a contact
    fading: Array  # (J,)
    sets_off: Array  # (C,)
    driven: Array  # (C, J - 1) m, from each sample to the next
    speed: Array  # (C, J - 1) m/s, up to each sample but the first; 0 of those after the vehicle may have stopped
    driven_soon: Array  # (C,) m, until the vehicle may have stopped


def _harms(whole: Array, less: Array, scale: float, weights: _Weights) -> Harms:
    """Return harms, (C,), by distances (L, C, J) to zones and those of a part of the size, m."""
    extent = less - whole
    np.maximum(extent, 0.0, out=extent)
    extent /= 1.0 - HARM.part
    gap = whole + extent
    extent /= scale
    np.maximum(extent, LENGTH, out=extent)
    away = np.divide(gap, extent, out=extent)
    near = away < HARM.far
    touched = np.zeros(gap.shape)
    touched[near] = ndtr(-away[near])
    touched *= weights.counts
    touched *= weights.fading
    harm = touched.max(axis=2, initial=0.0)
    # Who is touched now is no better off by what it was: it gets away the sooner, the better, if that is worth it.
    zone, manoeuvre = np.nonzero(gap[..., 0] < 0.0)
    harm[zone, manoeuvre] = touched[zone, manoeuvre].sum(axis=1) / weights.fading.sum() + weights.sets_off[manoeuvre]
    # To leave what touches it is no impact, to scrape along it is.
    hits = (gap[..., 1:] < np.minimum(gap[..., :-1] + HARM.leaving * weights.driven, 0.0)).any(axis=0)
    impact = (weights.speed * hits).max(axis=1)
    return Harms(1.0 - np.prod(1.0 - np.minimum(harm, 1.0), axis=0), impact, weights.driven_soon)
