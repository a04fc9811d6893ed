"""States between which CommonRoad's official checker finds the inputs that join them."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from scipy.integrate import odeint
from scipy.optimize import Bounds, minimize

from scp_planner.arrays import Array, unit_vectors
from scp_planner.formats.commonroad.cars import Car, VehicleModel, centre_of
from scp_planner.planning.plan import Plan

STEERING, SPEED_COLUMN, HEADING = 2, 3, 4  # columns of states, behind the place of the rear axle
SAME = np.array([0.02, 0.02, 0.03])  # m along each axis, and rad: states that differ by less are one
SAME_POINT = np.full(4, 0.02)  # m and m/s along each axis: states of a point mass that differ by less are one
OUT_OF_BOUNDS = float(np.linalg.norm(100.0 * SAME))  # cost of inputs that cannot be


def axle_states(plan: Plan, step: float, car: Car, orientation: float) -> Array:
    """Return the states of a plan at the steps of a file."""
    count = round(plan.travel_time / step)
    if abs(count * step - plan.travel_time) > 0.02 * step:
        raise ValueError(
            f"plan: must take a multiple of the file's step, {step:g} s; it takes {plan.travel_time:.6g} s"
        )
    # The last state is that of the arrival, which is on its step to a hundredth of it.
    times = np.linspace(plan.start_time, plan.arrival_time, count + 1)
    heading = np.unwrap(plan.heading(times))
    heading += 2.0 * math.pi * round((orientation - heading[0]) / (2.0 * math.pi))
    steering = np.arctan(car.wheelbase * plan.curvature(times))
    return np.column_stack([plan.position(times), steering, plan.speed(times), heading])


def joined(states: Array, step: float, model: VehicleModel, car: Car) -> Array | None:
    """Return states between which the checker finds inputs: some with a steering angle changed by next to nothing."""
    shown = states.copy()
    leads = partial(found, step=step, model=model, car=car)

    for k in range(len(shown) - 1):
        if leads(shown[k], shown[k + 1]):
            continue
        for nudge in (1e-6, -1e-6, 1e-5, -1e-5, 3e-5, -3e-5, 1e-4, -1e-4) if model is not VehicleModel.PM else ():
            tried = shown[k].copy()
            tried[STEERING] += nudge
            if leads(tried, shown[k + 1]) and (k == 0 or leads(shown[k - 1], tried)):
                shown[k] = tried
                break
        else:
            return None
    return shown


def velocities(states: Array, car: Car) -> Array:
    """Return the velocities of a point mass in some states, (n, 5), as they are written; (n, 2) m/s."""
    speed, heading = np.maximum(states[:, SPEED_COLUMN], 1e-6 * car.speed), states[:, HEADING]
    return speed[:, None] * unit_vectors(heading)


def found(before: Array, after: Array, step: float, model: VehicleModel, car: Car) -> bool:
    """Tell whether the checker finds inputs that lead from one state to the next."""
    point = model is VehicleModel.PM
    pair = np.stack([before, after])
    if point:
        pair = np.hstack([pair[:, :STEERING], velocities(pair, car)])
    else:  # as it is read from a file of the car's centres
        ahead = centre_of(car, model) * unit_vectors(pair[:, HEADING])
        pair[:, :STEERING] = (pair[:, :STEERING] + ahead) - ahead
    reached_from = _point_reached if point else _car_reached
    first = car.acceleration if point else car.steering_rate
    bounds = Bounds([-first, -car.acceleration], [first, car.acceleration])

    def miss(inputs: Array) -> float:
        reached = reached_from(pair[0], inputs, step, car)
        if reached is None:
            return OUT_OF_BOUNDS
        apart = pair[1] - reached
        if point:
            return float(np.linalg.norm(apart))
        far = np.append(apart[[0, 1, SPEED_COLUMN]], _turned(pair[1], reached))
        over = np.abs(far[:3]) - SAME
        return float(np.linalg.norm(far) + np.linalg.norm(np.maximum(over, 0.0)))

    best = minimize(miss, np.zeros(2), method="SLSQP", bounds=bounds, options={"maxiter": 100, "ftol": 1e-8}).x
    reached = reached_from(pair[0], best, step, car)
    if reached is None:
        return False
    apart = np.abs(pair[1] - reached)
    far, same = (apart, SAME_POINT) if point else (np.append(apart[:2], _turned(pair[1], reached)), SAME)
    return bool((np.round(far, 4) < same).all())


def _point_reached(state: Array, inputs: Array, step: float, car: Car) -> Array | None:
    """State of a point mass that constant accelerations lead to; None if they are out of bounds or of the circle."""
    if (np.abs(np.round(inputs, 4)) > car.acceleration).any() or np.linalg.norm(inputs) > car.acceleration:
        return None
    moved = state[:2] + step * state[2:] + 0.5 * step**2 * inputs
    return np.append(moved, state[2:] + step * inputs)


def _car_reached(state: Array, inputs: Array, step: float, car: Car) -> Array | None:
    """State that constant inputs lead to; None if they are out of bounds or of the friction circle."""
    rate, acceleration = float(inputs[0]), float(inputs[1])
    if abs(round(rate, 4)) > car.steering_rate or abs(round(acceleration, 4)) > car.acceleration:
        return None
    across = state[SPEED_COLUMN] ** 2 * math.tan(state[STEERING]) / car.wheelbase
    if acceleration**2 + across**2 > car.acceleration**2:
        return None

    def change(now: Array, _: float) -> list[float]:
        _, _, angle, speed, heading = now.tolist()
        limit = car.acceleration * min(1.0, car.switching_speed / speed) if speed > 0.0 else car.acceleration
        turn = 0.0 if abs(angle) >= car.steering_angle and angle * rate >= 0.0 else rate
        rise = 0.0 if speed >= car.speed and acceleration >= 0.0 else min(acceleration, limit)
        along, up = math.cos(heading), math.sin(heading)
        return [speed * along, speed * up, turn, rise, speed * math.tan(angle) / car.wheelbase]

    reached: Array = odeint(change, state, [0.0, step])[1]
    return reached


def _turned(one: Array, other: Array) -> float:
    """Angle between two headings, rad."""
    return math.acos(min(1.0, max(-1.0, math.cos(one[HEADING] - other[HEADING]))))
