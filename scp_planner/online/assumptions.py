"""Assumptions of a plan's promise, watched while driving: see `docs/explanation/online.md`."""

from __future__ import annotations

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.frames import PlanningFrame
from scp_planner.online.following import Following
from scp_planner.online.plan import OnlinePlan
from scp_planner.online.safety_gate import Moment
from scp_planner.online.tolerances import LATE, LENGTH, OFF, RELATIVE, TIME
from scp_planner.scenario.checks import room_on_map
from scp_planner.scenario.models import Bounds
from scp_planner.scenario.units import NaturalUnits


class Assumptions:
    """Looks whether what the last plan was promised under still holds."""

    def __init__(self, units: NaturalUnits) -> None:
        self._units = units
        self._before: Moment | None = None
        self._told: frozenset[str] = frozenset()

    def broken(
        self, now: Moment, last: OnlinePlan | None, following: Following, bounds: Bounds | None, period: float
    ) -> tuple[str, ...]:
        """Return what does not hold any more and has not been told yet, and remember the moment; a period is in s."""
        before, self._before = self._before, now
        wider, found = now.scenario.bounds, dict[str, str]()
        if bounds is not None and wider is not None and bounds is not wider:
            out = float(np.subtract([bounds.min, wider.max], [wider.min, bounds.max]).max()) * self._units.length
            found["bounds"] = f"the vehicle is {out:.3g} m outside of the bounds: plans go no farther out"
        if room_on_map(now.scenario, now.scenario.start) < now.scenario.vehicle.radius - LENGTH:
            found["map"] = "the vehicle is on occupied cells of the map"
        if before is not None and last is not None:
            found |= self._escaped(before, now, last.trip.frame) | self._off(before, now, last, following, period)
        new = tuple(text for key, text in found.items() if key not in self._told)
        self._told = frozenset(found)
        return new

    def _off(
        self, before: Moment, now: Moment, last: OnlinePlan, following: Following, period: float
    ) -> dict[str, str]:
        """Replans that come late, and a vehicle that does not keep to its plan."""
        found = dict[str, str]()
        late = now.state.time - before.state.time
        if late > period * (1.0 + LATE) + TIME:
            found["period"] = f"the last replan was {late * self._units.time:.3g} s ago, longer than the period"
        off = now.deviation(last.trip)
        if not following.allows(off):
            length, speed = off.distance * self._units.length, off.speed * self._units.speed
            by = f"{length:.3g} m off its plan, {speed:.3g} m/s in speed and {off.heading:.3g} rad in heading"
            found["track"] = f"the vehicle is {by}: beyond the tracking error"
        return found

    def _escaped(self, before: Moment, now: Moment, frame: PlanningFrame) -> dict[str, str]:
        """Obstacles whose centre is not where the zone of the last replan has it, with what is told of each."""
        old, new = before.batch_in(frame), now.batch_in(frame)
        if old.ids == new.ids:
            first = second = np.arange(old.size)
        else:
            known = {name: place for place, name in enumerate(old.ids)}
            pairs = [(known[name], place) for place, name in enumerate(new.ids) if name in known]
            first, second = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        if not len(first):
            return {}
        clock = np.array([now.state.time - frame.time])
        moved = new.centers.grid(clock)[0, second] - old.centers.grid(clock)[0, first]
        apart = np.hypot(moved[:, 0], moved[:, 1])
        allowed = RELATIVE * old.radius[first] + OFF
        if old.covariances is not None:
            some = old.slot[first] >= 0
            spread = old.covariances.grid(clock)[0, old.slot[first[some]]]
            allowed[some] += _radii_towards(moved[some], spread)
        return {
            new.ids[second[k]]: f"{new.ids[second[k]]} has left its zone: what was certified before may not hold"
            for k in np.flatnonzero(apart > allowed)
        }


def _radii_towards(moved: Array, covariances: Array) -> Array:
    x, y = moved.T
    xx, xy, yy = (covariances + OFF**2 * np.array([1.0, 0.0, 1.0])).T
    squared = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    # Where it is just as predicted it has moved in no direction, and there is nothing to reach
    return np.hypot(x, y) / np.sqrt(np.maximum(squared, np.finfo(float).tiny))
