"""Natural units: every scene is planned in units of its own, so that vehicles of every size are planned alike."""

from __future__ import annotations

from collections.abc import KeysView, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar, cast, overload

from scp_planner.pauses import GoOn, with_pauses
from scp_planner.scenario.process_model import (
    MeanRevertingVelocity,
    ProcessModel,
    RandomWalkAcceleration,
    RandomWalkVelocity,
    SingerAcceleration,
)
from scp_planner.scenario.scale import units_of
from scp_planner.units import Point, Units, over

if TYPE_CHECKING:
    from scp_planner.scenario.estimates import Estimate
    from scp_planner.scenario.models import (
        Goal,
        Model,
        Obstacle,
        Passage,
        Prior,
        Reverse,
        Scenario,
        SpeedLimit,
        Start,
        Vehicle,
    )
    from scp_planner.scenario.motions import Futures, GivenMotion, Motion
    from scp_planner.scenario.shapes import PolygonShape, Shape
    from scp_planner.scenario.targets import Target
    from scp_planner.scenario.validation import Part

AnyPart = TypeVar("AnyPart", bound="Part")


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
    def to_check(cls, scenario: Scenario, trip: float | None = None) -> NaturalUnits:
        """Return units to check any plan in; of one that has several legs by its length, m."""
        units, radius = cls.of(scenario, trip), scenario.vehicle.radius
        if radius <= units.length:
            return units
        return replace(units, length=radius, time=units.time * (radius / units.length))

    @property
    def inverse(self) -> NaturalUnits:
        """The units of the user as seen from inside: what they make of a scene in natural units is that of the user."""
        x, y = self.origin
        back = -x / self.length, -y / self.length
        return NaturalUnits(1.0 / self.length, 1.0 / self.time, back, -self.clock / self.time)

    def scenario(self, scenario: Scenario, go_on: GoOn | None = None) -> Scenario:
        """Return a scenario in these units; of many obstacles it is asked now and then whether to go on."""
        if self.are_those_of_the_user:
            return scenario
        return changed(
            scenario,
            vehicle=self._vehicle(scenario.vehicle),
            start=self._start(scenario.start),
            goal=self._goal(scenario.goal),
            goals=tuple(map(self._passage, scenario.goals)),
            guide=self._line(scenario.guide),
            bounds=None
            if scenario.bounds is None
            else changed(scenario.bounds, min=self.place(scenario.bounds.min), max=self.place(scenario.bounds.max)),
            corridor=None if scenario.corridor is None else self.lines(scenario.corridor),
            walls=self.lines(scenario.walls),
            ground=None if scenario.ground is None else changed(scenario.ground, map=scenario.ground.map.inside(self)),
            lanes=self.lines(scenario.lanes),
            speed_limits=tuple(map(self._speed_limit, scenario.speed_limits)),
            obstacles=tuple(self.obstacle(one, go_on) for one in with_pauses(scenario.obstacles, go_on)),
        )

    def obstacle(self, obstacle: Obstacle, go_on: GoOn | None = None) -> Obstacle:
        """Return an obstacle in these units; of many futures it is asked now and then whether to go on."""
        return changed(
            obstacle,
            shape=self.shape(obstacle.shape),
            motion=None if obstacle.motion is None else self.motion(obstacle.motion, go_on),
            observations=None if obstacle.observations is None else self._seen(obstacle.observations),
            estimate=None if obstacle.estimate is None else self.estimate(obstacle.estimate),
            model=self.model(obstacle.model),
            margin=obstacle.margin / self.length,
        )

    def estimate(self, estimate: Estimate) -> Estimate:
        """Return what a tracker says in these units."""
        (u, v), a, sizes = estimate.velocity, estimate.acceleration, (self.length, self.speed, self.acceleration)
        return changed(
            estimate,
            time=self.instant(estimate.time),
            position=self.place(estimate.position),
            velocity=(u / self.speed, v / self.speed),
            acceleration=over(a, self.acceleration),
            covariance=tuple(
                tuple(value / (sizes[i // 2] * sizes[j // 2]) for j, value in enumerate(row))
                for i, row in enumerate(estimate.covariance)
            ),
        )

    def shape(self, shape: Shape) -> Shape:
        """Return a shape in these units."""
        if "polygon" in _names(shape):  # it may have thousands of corners: no call for each
            length, corners = self.length, cast("PolygonShape", shape).polygon
            return changed(shape, polygon=tuple([(x / length, y / length) for x, y in corners]))
        return changed(shape, **{key: over(getattr(shape, key), self.length) for key in _SHAPE_SIZES & _names(shape)})

    def model(self, model: Model) -> Model:
        """Return what is known of a motion in these units."""
        bounded = model.max_speed is not None or model.max_acceleration is not None
        if model.prior is None and model.process is None and model.manoeuvre == 0.0 and not bounded:
            return model
        return changed(
            model,
            max_speed=over(model.max_speed, self.speed),
            max_acceleration=over(model.max_acceleration, self.acceleration),
            prior=None if model.prior is None else self._prior(model.prior),
            manoeuvre=model.manoeuvre / self.acceleration,
            process=None if model.process is None else self.process(model.process),
        )

    def process(self, model: ProcessModel) -> ProcessModel:
        """Return a motion with process noise in these units."""
        process: RandomWalkVelocity | MeanRevertingVelocity | SingerAcceleration | RandomWalkAcceleration
        process = model.process
        sizes = {
            "diffusion": self.factor("m2/s5" if isinstance(process, RandomWalkAcceleration) else "m2/s3"),
            "time_constant": self.time,
            "deviation": self.acceleration,
            "acceleration_deviation": self.acceleration,
        }
        tails = model.tails
        return changed(
            model,
            process=changed(
                process, **{key: getattr(process, key) / sizes[key] for key in sizes.keys() & _names(process)}
            ),
            velocity_deviation=model.velocity_deviation / self.speed,
            noise_deviation=model.noise_deviation / self.length,
            max_speed=over(model.max_speed, self.speed),
            max_acceleration=over(model.max_acceleration, self.acceleration),
            tails=None if tails is None else changed(tails, lead_time=over(tails.lead_time, self.time)),
        )

    def _vehicle(self, vehicle: Vehicle) -> Vehicle:
        return changed(
            vehicle,
            radius=vehicle.radius / self.length,
            max_speed=vehicle.max_speed / self.speed,
            max_acceleration=vehicle.max_acceleration / self.acceleration,
            max_deceleration=vehicle.max_deceleration / self.acceleration,
            max_lateral_acceleration=over(vehicle.max_lateral_acceleration, self.acceleration),
            max_curvature=over(vehicle.max_curvature, 1.0 / self.length),
            max_jerk=over(vehicle.max_jerk, self.jerk),
            max_curvature_rate=over(vehicle.max_curvature_rate, self.factor("1/(m s)")),
            max_total_acceleration=over(vehicle.max_total_acceleration, self.acceleration),
            max_power=over(vehicle.max_power, self.factor("m2/s3")),
            centre=vehicle.centre / self.length,
            reverse=None if vehicle.reverse is None else self._reverse(vehicle.reverse),
            max_turn_rate=None if vehicle.max_turn_rate is None else vehicle.max_turn_rate * self.time,
            discs=over(vehicle.discs, self.length),
        )

    def _reverse(self, reverse: Reverse) -> Reverse:
        return changed(
            reverse,
            max_speed=reverse.max_speed / self.speed,
            max_acceleration=over(reverse.max_acceleration, self.acceleration),
        )

    def _start(self, start: Start) -> Start:
        return changed(
            start,
            time=self.instant(start.time),
            position=self.place(start.position),
            speed=start.speed / self.speed,
            acceleration=over(start.acceleration, self.acceleration),
        )

    def _goal(self, goal: Goal) -> Goal:
        return changed(
            goal,
            position=self.place(goal.position),
            speed=over(goal.speed, self.speed),
            radius=goal.radius / self.length,
            target=None if goal.target is None else self._target(goal.target),
            offset=over(goal.offset, self.length),
            region=self._line(goal.region),
            speed_range=over(goal.speed_range, self.speed),
            arrival_step=over(goal.arrival_step, self.time),
            earliest_arrival=None if goal.earliest_arrival is None else self.instant(goal.earliest_arrival),
            latest_arrival=None if goal.latest_arrival is None else self.instant(goal.latest_arrival),
        )

    def _passage(self, one: Passage) -> Passage:
        return changed(
            one,
            position=self.place(one.position),
            radius=over(one.radius, self.length),
            target=None if one.target is None else self._target(one.target),
            offset=over(one.offset, self.length),
            earliest_arrival=None if one.earliest_arrival is None else self.instant(one.earliest_arrival),
            latest_arrival=None if one.latest_arrival is None else self.instant(one.latest_arrival),
        )

    def _target(self, target: Target) -> Target:
        return changed(
            target,
            motion=None if target.motion is None else self.motion(target.motion),
            observations=None if target.observations is None else self._seen(target.observations),
            estimate=None if target.estimate is None else self.estimate(target.estimate),
            model=self.model(target.model),
        )

    def _speed_limit(self, limit: SpeedLimit) -> SpeedLimit:
        return changed(
            limit,
            from_=limit.from_ / self.length,
            to=over(limit.to, self.length),
            speed=limit.speed / self.speed,
            line=self._line(limit.line),
        )

    @overload
    def _line(self, line: Sequence[Point]) -> tuple[Point, ...]: ...

    @overload
    def _line(self, line: None) -> None: ...

    @overload
    def _line(self, line: Sequence[Point] | None) -> tuple[Point, ...] | None: ...

    def _line(self, line: Sequence[Point] | None) -> tuple[Point, ...] | None:
        if line is None:
            return None
        (x0, y0), length = self.origin, self.length
        return tuple([((x - x0) / length, (y - y0) / length) for x, y in line])  # no call for each point

    def motion(self, motion: GivenMotion, go_on: GoOn | None = None) -> GivenMotion:
        """Return what is given of a motion in these units; for the pauses see `obstacle`."""
        if "futures" in _names(motion):
            several = with_pauses(cast("Futures", motion).futures, go_on)
            return changed(
                cast("Futures", motion), futures=tuple(changed(one, motion=self.motion(one.motion)) for one in several)
            )
        if "velocity" not in _names(motion):
            return self._seen(motion)
        known = cast("Motion", motion)
        return changed(
            motion,
            time=self.instant(known.reference_time),
            position=self.place(known.position),
            velocity=over(known.velocity, self.speed),
            acceleration=over(known.acceleration, self.acceleration),
        )

    def _seen(self, seen: AnyPart) -> AnyPart:
        """Positions at times, with their covariances."""
        record, clock, unit = cast(Any, seen), self.clock, self.time
        return changed(
            seen,
            time=tuple([(time - clock) / unit for time in record.time]),  # no call for each
            position=self._line(record.position),
            covariance=self.covariance(record.covariance),
        )

    def _prior(self, prior: Prior) -> Prior:
        return changed(
            prior,
            velocity=over(prior.velocity, self.speed),
            velocity_deviation=over(prior.velocity_deviation, self.speed),
            acceleration=over(prior.acceleration, self.acceleration),
            acceleration_deviation=over(prior.acceleration_deviation, self.acceleration),
        )


_SHAPE_SIZES = frozenset({"disc", "rectangle", "ellipse"})


def changed(part: AnyPart, **values: Any) -> AnyPart:
    """Return a part of a scenario with other values, which are known to be allowed: so they are not checked again."""
    copied = part.__copy__()
    copied.__dict__.update(values)
    copied.model_fields_set.update(values)
    return copied


def _names(part: object) -> KeysView[str]:
    return _names_of(cast(Any, type(part)))


@cache
def _names_of(kind: Any) -> KeysView[str]:
    fields: Mapping[str, object] = kind.model_fields
    return fields.keys()


AS_GIVEN = NaturalUnits()
"""1 m and 1 s, the origin and the clock as they are."""
