"""Cars and models of CommonRoad, as its referee looks at them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from scp_planner.scenario.models import Vehicle

SPEED_RESERVE, SLOWEST = 1.5, 2.0  # a point mass swerves at so many times its speed at the start, and at least so fast


@dataclass(frozen=True)
class PlannedCar:
    """Distance of a planned car from what the referee allows."""

    # Of limits, not planned with: constant inputs that join states may lie so much above the plan's
    reserve: float = 0.01
    # m of the file; the official checker takes places for the same that differ by less than twice as much
    unnoticed: float = 0.01
    coarse: float = 0.5  # Of the swerve from one side to the other in one step: a smaller one is asked for
    # Less power where a trip is planned more softly: for the official checker's search it is another one
    weaker: float = 0.1
    fewest_discs: int = 5  # That cover a car; a trailer is none of it


PLANNED = PlannedCar()


class VehicleModel(StrEnum):
    """Models of motion that solutions are made for."""

    PM = "PM"  # a point mass; its reference is the centre of the car
    KS = "KS"  # kinematic single track; its reference is the rear axle
    KST = "KST"  # kinematic single track with a trailer; for the checker its rear axle is the centre of the car

    @classmethod
    def named(cls, name: str) -> VehicleModel:
        """Return a model by its name."""
        try:
            return cls(name)
        except ValueError:
            raise ValueError(f"model: must be one of {', '.join(cls)}, not {name!r}") from None


@dataclass(frozen=True)
class Car:
    """One of the benchmark's cars."""

    number: int  # in the benchmark's ids of solutions
    length: float  # m
    width: float  # m
    front_axle: float  # m from the centre
    rear_axle: float  # m from the centre
    steering_angle: float  # largest, rad
    steering_rate: float  # largest, rad/s
    acceleration: float  # largest, along and across together, m/s^2
    switching_speed: float  # above it the acceleration along falls as 1 / speed, m/s
    speed: float  # largest, m/s
    trailer_wheelbase: float | None = None  # m

    @property
    def wheelbase(self) -> float:
        """Distance of the axles, m."""
        return self.front_axle + self.rear_axle


CARS = {  # by the names of commonroad-io
    "FORD_ESCORT": Car(1, 4.298, 1.674, 0.88392, 1.50876, 0.910, 0.4, 11.5, 4.755, 45.8),
    "BMW_320i": Car(2, 4.508, 1.610, 1.1561957064, 1.4227170936, 1.066, 0.4, 11.5, 7.319, 50.8),
    "VW_VANAGON": Car(3, 4.569, 1.844, 1.1507916024, 1.3211363976, 1.023, 0.4, 11.5, 7.824, 41.7),
    "TRUCK": Car(4, 5.100, 2.550, 1.8, 1.8, 0.55, 0.7103, 11.5, 7.824, 22.22, 8.1),
}


def car_named(name: str | None, model: VehicleModel) -> Car:
    """Return a car that a model is made for; None: the default one."""
    name = name or default_car(model)
    if name not in CARS:
        raise ValueError(f"car: must be one of {', '.join(CARS)}, not {name!r}")
    car = CARS[name]
    if (model is VehicleModel.KST) != (car.trailer_wheelbase is not None):
        fitting = ", ".join(
            key for key, one in CARS.items() if (one.trailer_wheelbase is None) != bool(car.trailer_wheelbase is None)
        )
        raise ValueError(f"car: model {model} needs one of {fitting}, not {name!r}")
    return car


def default_car(model: VehicleModel) -> str:
    """Return the name of the car that a model is planned with where none is named."""
    return "TRUCK" if model is VehicleModel.KST else "BMW_320i"


def centre_of(car: Car, model: VehicleModel) -> float:
    return car.rear_axle if model is VehicleModel.KS else 0.0


def vehicle_of(car: Car, model: VehicleModel, discs: int = PLANNED.fewest_discs) -> dict[str, Any]:
    """Return the vehicle of a scenario that moves as the referee allows."""
    keep = 1.0 - PLANNED.reserve
    vehicle: dict[str, Any] = {
        **_covered(car, centre_of(car, model), discs),
        "centre": centre_of(car, model),
        "max_speed": keep * car.speed,
        "max_acceleration": keep * car.acceleration,
        "max_deceleration": keep * car.acceleration,
        "max_lateral_acceleration": keep * car.acceleration,
        "max_curvature": keep * math.tan(car.steering_angle) / car.wheelbase,
        "max_total_acceleration": keep * car.acceleration,
    }
    if model is not VehicleModel.PM:
        vehicle["max_power"] = keep * car.acceleration * car.switching_speed
        vehicle["max_curvature_rate"] = keep * car.steering_rate / car.wheelbase
    return vehicle


def swerving(vehicle: Mapping[str, Any], step: float, speed: float) -> dict[str, float]:
    """Return what curvature a point mass may have, and how fast it may change."""
    speed, jerk = SPEED_RESERVE * max(speed, SLOWEST), 12.0 * PLANNED.unnoticed / step**3
    rate, hardest = jerk / speed**2, float(vehicle["max_total_acceleration"])
    if rate >= PLANNED.coarse * 2.0 * hardest / (step * speed**2):
        return {}
    bend = min(float(vehicle["max_curvature"]), jerk / (2.0 * speed * hardest))
    return {"max_curvature_rate": rate, "max_curvature": bend}


def softer(vehicle: Vehicle, step: float, speed: float, part: float) -> dict[str, float]:
    """Return limits of a car whose inputs constant ones follow better, where the checker joins states by these."""
    jerk = part * 12.0 * 2.0 * PLANNED.unnoticed / step**3
    if vehicle.max_power is not None and vehicle.max_curvature_rate is not None:
        power = (1.0 - PLANNED.weaker * (1.5 - part)) * vehicle.max_power
        return {"max_jerk": jerk, "max_power": power, "max_curvature_rate": part * vehicle.max_curvature_rate}
    least = swerving(vehicle.model_dump(), step, speed / SPEED_RESERVE)
    return {"max_jerk": jerk, **{key: part * value for key, value in least.items()}}


def _covered(car: Car, centre: float, count: int) -> dict[str, Any]:
    """Equal discs that cover the rectangle of a car, seen from its reference point, and one there."""
    share = car.length / count
    offsets = [centre + share * (k - 0.5 * (count - 1)) for k in range(count)]
    nearest = min(range(count), key=lambda k: abs(offsets[k]))
    if abs(offsets[nearest]) < 1e-9 * car.length:
        offsets[nearest] = 0.0
    else:
        offsets.append(0.0)
    return {"radius": math.hypot(0.5 * car.width, 0.5 * share), "discs": tuple(sorted(offsets))}
