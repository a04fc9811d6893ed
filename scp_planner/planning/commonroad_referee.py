"""States between which CommonRoad's official checker finds the inputs that join them.

The checker looks for constant inputs by a local search (SLSQP, from none at all) for the state that comes nearest.
Above the switching speed the acceleration is cut off at a limit, beyond which the distance is the same for all inputs:
a search that steps there stays there, and what can be driven exactly is called not feasible. It happens where steps are
so long that a place which the limit leads to is another one, and most of all where a car drives straight. Steering
angles that differ by next to nothing lead most such searches another way. And where inputs change much in a step, no
constant ones lead to the next state.

Source: `feasibility_checker.state_transition_feasibility` of commonroad-drivability-checker 2025.4.0; kinematic single
track of M. Althoff and G. Wuersching, "CommonRoad: Vehicle Models", 2020.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import odeint
from scipy.optimize import Bounds, minimize

from scp_planner.arrays import Array, Index
from scp_planner.planning.plan import Plan
from scp_planner.scenario.commonroad_models import Car, VehicleModel

ON_A_STEP = 0.02
"""Part of a step by which an arrival may miss one: the plan keeps its arrival to half of that."""

STEERING, SPEED, HEADING = 2, 3, 4
"""Columns of states, behind the place of the rear axle."""

SAME = np.array([0.02, 0.02, 0.03])
"""m along each axis, and rad: states that differ by less are one. Beyond it a miss of places and speed counts twice."""

OUT_OF_BOUNDS = float(np.linalg.norm(100.0 * SAME))
"""What inputs that cannot be count as."""

DOUBTFUL = 0.5
"""Of what is noticed: where so much is missed by the inputs that the speeds and steering angles ask for, or would be if
the acceleration were at its limit, the checker's search is made."""

CLEARLY = 0.99
"""Of what is noticed: what a place of a point mass may miss, which the search can but lessen."""

NUDGES = tuple(sign * size for size in (1e-6, 1e-5, 3e-5, 1e-4) for sign in (1.0, -1.0))
"""Changes of a steering angle that are tried, rad."""


def axle_states(plan: Plan, step: float, car: Car, orientation: float) -> Array:
    """Return the states of a plan at the steps of a file.

    Parameters
    ----------
    plan : Plan
    step : float
        s.
    car : Car
    orientation : float
        Of the first, rad: the checker compares angles as numbers.

    Returns
    -------
    array
        (n, 5), as in `findable`.

    Raises
    ------
    ValueError
        If the plan does not arrive on a step of the file.
    """
    count = round(plan.travel_time / step)
    if abs(count * step - plan.travel_time) > ON_A_STEP * step:
        raise ValueError(
            f"plan: must take a multiple of the file's step, {step:g} s; it takes {plan.travel_time:.6g} s"
        )
    # The last state is that of the arrival, which is on its step to a hundredth of it.
    times = np.linspace(plan.start_time, plan.arrival_time, count + 1)
    heading = np.unwrap(plan.heading(times))
    heading += 2.0 * math.pi * round((orientation - heading[0]) / (2.0 * math.pi))
    steering = np.arctan(car.wheelbase * plan.curvature(times))
    return np.column_stack([plan.position(times), steering, plan.speed(times), heading])


def shown_states(plan: Plan, step: float, model: VehicleModel, car: Car, orientation: float) -> Array | None:
    """Return the states of a plan between which the checker finds inputs of a model; None if it would not.

    Parameters
    ----------
    plan : Plan
    step : float
        s.
    model : VehicleModel
    car : Car
    orientation : float
        Of the first, rad.

    Returns
    -------
    array or None
        (n, 5), as in `findable`.

    Raises
    ------
    ValueError
        If the plan does not arrive on a step of the file.
    """
    states = axle_states(plan, step, car, orientation)
    if model is not VehicleModel.PM:
        return joined(states, step, car)
    along = np.stack([np.cos(states[:, HEADING]), np.sin(states[:, HEADING])], axis=1)
    velocity = states[:, SPEED, None] * along
    missed = np.diff(states[:, :STEERING], axis=0) - 0.5 * step * (velocity[1:] + velocity[:-1])
    pushed = np.hypot(*np.diff(velocity, axis=0).T) / step
    return states if (np.abs(missed) < CLEARLY * SAME[0]).all() and (pushed < car.acceleration).all() else None


def joined(states: Array, step: float, car: Car) -> Array | None:
    """Return states once they are made findable; None if the checker does not find all inputs between them then.

    Parameters
    ----------
    states, step, car
        As in `findable`.

    Returns
    -------
    array or None
    """
    shown = findable(states, step, car)
    doubtful = _doubtful(shown, step, car).tolist()
    return shown if all(found(shown[k], shown[k + 1], step, car) for k in doubtful) else None


def findable(states: Array, step: float, car: Car) -> Array:
    """Return states that differ by next to nothing in their steering angle, between which the checker finds inputs.

    Parameters
    ----------
    states : array
        Places of the rear axle, m, steering angle, rad, speed, m/s, heading, rad, at steps; (n, 5).
    step : float
        s.
    car : Car

    Returns
    -------
    array
        (n, 5); a state for which nothing else is found stays as it is.
    """
    shown = states.copy()
    for k in _doubtful(states, step, car).tolist():
        if found(shown[k], shown[k + 1], step, car):
            continue
        for nudge in NUDGES:
            tried = shown[k].copy()
            tried[STEERING] += nudge
            if found(tried, shown[k + 1], step, car) and (k == 0 or found(shown[k - 1], tried, step, car)):
                shown[k] = tried
                break
    return shown


def found(before: Array, after: Array, step: float, car: Car) -> bool:
    """Tell whether the checker finds inputs that lead from one state to the next.

    Parameters
    ----------
    before, after : array
        (5,), as in `findable`.
    step : float
        s.
    car : Car

    Returns
    -------
    bool
    """
    bounds = Bounds([-car.steering_rate, -car.acceleration], [car.steering_rate, car.acceleration])

    def miss(inputs: Array) -> float:
        reached = _reached(before, inputs, step, car)
        if reached is None:
            return OUT_OF_BOUNDS
        apart = after - reached
        far = np.append(apart[[0, 1, SPEED]], _turned(after, reached))
        over = np.abs(far[:3]) - SAME
        return float(np.linalg.norm(far) + np.linalg.norm(np.maximum(over, 0.0)))

    best = minimize(miss, np.zeros(2), method="SLSQP", bounds=bounds, options={"maxiter": 100, "ftol": 1e-8}).x
    reached = _reached(before, best, step, car)
    if reached is None:
        return False
    far = np.append(np.abs((after - reached)[:2]), _turned(after, reached))
    return bool((np.round(far, 4) < SAME).all())


def _doubtful(states: Array, step: float, car: Car) -> Index:
    """From which states the checker might not find its way to the next."""
    before, after = states[:-1], states[1:]
    inputs = (after - before)[:, [STEERING, SPEED]] / step
    # By Runge and Kutta's classic step, of all at once.
    reached, now, weights = before.copy(), before, (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
    for weight, part in zip(weights, (0.5, 0.5, 1.0, 0.0), strict=True):
        change = _change(now, inputs, car)
        reached, now = reached + weight * step * change, before + part * step * change
    missed = np.abs(after - reached)[:, [0, 1, HEADING]]
    rise, speed = inputs[:, 1], np.maximum(before[:, SPEED], car.switching_speed)
    most = car.acceleration * car.switching_speed / speed
    cut = (rise > 0.0) & (after[:, SPEED] > car.switching_speed)
    beyond = cut & (0.5 * step**2 * (most - rise) > DOUBTFUL * SAME[0])
    doubtful: Index = np.flatnonzero(beyond | (missed > DOUBTFUL * SAME).any(axis=1))
    return doubtful


def _change(states: Array, inputs: Array, car: Car) -> Array:
    """How fast states change with inputs that break no limit, (n, 5)."""
    speed, heading = states[:, SPEED], states[:, HEADING]
    bend = np.tan(states[:, STEERING]) / car.wheelbase
    moved = (speed * np.cos(heading), speed * np.sin(heading), inputs[:, 0], inputs[:, 1], speed * bend)
    return np.stack(moved, axis=1)


def _reached(state: Array, inputs: Array, step: float, car: Car) -> Array | None:
    """The state that constant inputs lead to; none if they are out of bounds or of the friction circle."""
    rate, acceleration = float(inputs[0]), float(inputs[1])
    if abs(round(rate, 4)) > car.steering_rate or abs(round(acceleration, 4)) > car.acceleration:
        return None
    across = state[SPEED] ** 2 * math.tan(state[STEERING]) / car.wheelbase
    if acceleration**2 + across**2 > car.acceleration**2:
        return None

    def change(now: Array, _: float) -> list[float]:
        speed, angle = now[SPEED], now[STEERING]
        limit = car.acceleration * min(1.0, car.switching_speed / speed) if speed > 0.0 else car.acceleration
        turn = 0.0 if abs(angle) >= car.steering_angle and angle * rate >= 0.0 else rate
        rise = 0.0 if speed >= car.speed and acceleration >= 0.0 else min(acceleration, limit)
        along, up = math.cos(now[HEADING]), math.sin(now[HEADING])
        return [speed * along, speed * up, turn, rise, speed * math.tan(angle) / car.wheelbase]

    reached: Array = odeint(change, state, [0.0, step])[1]
    return reached


def _turned(one: Array, other: Array) -> float:
    """The angle between two headings, rad."""
    return math.acos(min(1.0, max(-1.0, math.cos(one[HEADING] - other[HEADING]))))
