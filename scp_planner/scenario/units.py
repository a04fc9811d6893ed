"""Natural units: every scene is planned in units of its own, so that vehicles of every size are planned alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar

from scp_planner.pauses import GoOn, with_pauses
from scp_planner.scenario.scale import OTHER_LENGTH, TRIP_LENGTH, units_of
from scp_planner.scenario.validation import Part
from scp_planner.units import Units, over

if TYPE_CHECKING:
    from scp_planner.scenario.models import Scenario

AnyPart = TypeVar("AnyPart", bound=Part)


@dataclass(frozen=True)
class NaturalUnits(Units):
    """Units of a scene, and where its origin and its clock stand in those of the user."""

    @classmethod
    def of(cls, scenario: Scenario, trip: float | None = None) -> NaturalUnits:
        """Return the units of a scene: by its trip, or one of a length in m, and the highest speed that it allows."""
        if not hasattr(scenario, "vehicle"):  # the first that all who are given a scenario ask for
            made = "Scenario(**data) makes one of a dictionary, Scenario.load(path) reads one"
            raise TypeError(f"scenario: must be a Scenario, not {type(scenario).__name__}; {made}")
        found = units_of(scenario, trip)
        return cls(found.length, found.time, found.origin, found.clock)

    @classmethod
    def to_check(cls, scenario: Scenario, driven: float) -> NaturalUnits:
        """Return units to check a plan in: of the scene, or by the distance that is driven, m, if that is another."""
        length = max(driven if 0.0 <= driven < inf else 0.0, TRIP_LENGTH * scenario.vehicle.radius)
        units = cls.of(scenario)
        alike = 1.0 / OTHER_LENGTH <= length / (TRIP_LENGTH * units.length) <= OTHER_LENGTH
        return units if alike else cls.of(scenario, length)

    @property
    def inverse(self) -> NaturalUnits:
        """The units of the user as seen from inside: what they make of a scene in natural units is that of the user."""
        x, y = self.origin
        back = -x / self.length, -y / self.length
        return NaturalUnits(1.0 / self.length, 1.0 / self.time, back, -self.clock / self.time)

    def scenario(self, scenario: Scenario, go_on: GoOn | None = None) -> Scenario:
        """Return a scenario in these units; of many obstacles it is asked now and then whether to go on."""
        return scenario if self.are_those_of_the_user else self.part(scenario, go_on)

    def part(self, part: AnyPart, go_on: GoOn | None = None) -> AnyPart:
        """Return a part of a scenario in these units; of many parts of it it is asked now and then whether to go on."""
        fields = part.__dict__
        values = {name: scaled(self, fields[name]) for name, scaled in _quantities_of(type(part)).items()}
        for name in fields.keys() - values.keys():
            value = fields[name]
            if isinstance(value, Part):
                values[name] = self.part(value, go_on)
            elif isinstance(value, tuple) and value and isinstance(value[0], Part):
                values[name] = tuple([self.part(one, go_on) for one in with_pauses(value, go_on)])
        return changed(part, **values)

    obstacle = estimate = motion = part


_QUANTITIES = {
    "m": "radius centre discs offset margin from_ to disc rectangle ellipse noise_deviation",
    "s": "arrival_step time_constant lead_time",
    "m/s": "max_speed speed speed_range velocity velocity_deviation",
    "m/s2": "max_acceleration max_deceleration max_lateral_acceleration max_total_acceleration acceleration"
    " acceleration_deviation deviation manoeuvre",
    "m/s3": "max_jerk",
    "1/m": "max_curvature",
    "1/(m s)": "max_curvature_rate",
    "m2/s3": "max_power diffusion",
    "m2/s5": "RandomWalkAcceleration.diffusion",
    "rate of turns": "max_turn_rate",
    "instants": "time earliest_arrival latest_arrival",
    "places": "position min max guide region line corridor walls lanes",
    "corners": "polygon",
    "covariance of a place": "covariance",
    "covariance of a state": "Estimate.covariance",
    "cells": "map",
}
"""Units of the fields of all parts, or another word for how their values change; others have no dimension."""


def _instants(units: NaturalUnits, value: Any) -> Any:
    if isinstance(value, tuple):
        clock, unit = units.clock, units.time
        return tuple([(time - clock) / unit for time in value])  # no call for each
    return None if value is None else units.instant(value)


def _places(units: NaturalUnits, value: Any) -> Any:
    if not value:
        return value
    if not isinstance(value[0], tuple):
        return units.place(value)
    return units.lines(value) if isinstance(value[0][0], tuple) else units.lines([value])[0]


def _corners(units: NaturalUnits, value: Any) -> Any:
    length = units.length
    return tuple([(x / length, y / length) for x, y in value])  # there may be thousands: no call for each


def _covariance_of_state(units: NaturalUnits, value: Any) -> Any:
    sizes = [size for size in (units.length, units.speed, units.acceleration) for _ in "xy"]
    rows = zip(value, sizes, strict=False)
    return tuple([tuple([each / (own * other) for each, other in zip(row, sizes, strict=False)]) for row, own in rows])


_SCALED: dict[str, Callable[[NaturalUnits, Any], Any]] = {
    "m": lambda units, value: over(value, units.length),
    "s": lambda units, value: over(value, units.time),
    "m/s": lambda units, value: over(value, units.speed),
    "m/s2": lambda units, value: over(value, units.acceleration),
    "m/s3": lambda units, value: over(value, units.jerk),
    "1/m": lambda units, value: over(value, units.factor("1/m")),
    "1/(m s)": lambda units, value: over(value, units.factor("1/(m s)")),
    "m2/s3": lambda units, value: over(value, units.factor("m2/s3")),
    "m2/s5": lambda units, value: over(value, units.factor("m2/s5")),
    "rate of turns": lambda units, value: None if value is None else value * units.time,
    "instants": _instants,
    "places": _places,
    "corners": _corners,
    "covariance of a place": NaturalUnits.covariance,
    "covariance of a state": _covariance_of_state,
    "cells": lambda units, value: value.inside(units),
}
_HOW = {name: _SCALED[how] for how, names in _QUANTITIES.items() for name in names.split()}


@cache
def _quantities_of(kind: type[Part]) -> dict[str, Callable[[NaturalUnits, Any], Any]]:
    """Fields of a kind of part that have a dimension, and how the value of each changes."""
    how = {name: _HOW.get(f"{kind.__name__}.{name}") or _HOW.get(name) for name in kind.model_fields}
    return {name: scaled for name, scaled in how.items() if scaled is not None}


def changed(part: AnyPart, **values: Any) -> AnyPart:
    """Return a part of a scenario with other values, which are known to be allowed: so they are not checked again."""
    copied = part.__copy__()
    copied.__dict__.update(values)
    copied.model_fields_set.update(values)
    return copied


AS_GIVEN = NaturalUnits()
"""1 m and 1 s, the origin and the clock as they are."""
