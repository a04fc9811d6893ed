"""Parking, turning round and leaving dead ends: trips of several legs against a direct method with the same legs.

Run ``python -m benchmarks.parking --count 40 --seed 0 --starts 10``: parallel and perpendicular gaps, narrow roads and
dead ends in turn, every second four with somebody who walks by. It prints the share that is certified, and the time of
those relative to the best of so many starts of CasADi with IPOPT (``pip install casadi``), if that is there.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable
from math import pi
from time import process_time
from typing import Any

import numpy as np

import scp_planner as sp
from scp_planner.arrays import Array

CAR: dict[str, Any] = {
    "radius": 0.95,
    "discs": [0.0, 1.3, 2.6],
    "max_speed": 3.0,
    "max_acceleration": 1.5,
    "max_deceleration": 2.0,
    "max_curvature": 0.2,
    "max_lateral_acceleration": 2.0,
    "reverse": {"max_speed": 1.5, "max_acceleration": 1.0},
}
INTERVALS, POINTS = 24, 2  # of a leg, and places in each at which the reference keeps clear
PERTURBED = 0.15  # of what the starts of the reference are apart
Draw = Callable[[np.random.Generator], sp.Scenario]


def box(left: float, low: float, right: float, high: float) -> list[list[float]]:
    return [[left, low], [right, low], [right, high], [left, high]]


def _scene(
    name: str, start: tuple[float, float, float], goal: tuple[float, float, float], **more: Any
) -> dict[str, Any]:
    return {
        "name": name,
        "vehicle": CAR,
        "start": {"time": 0.0, "position": start[:2], "heading": start[2], "speed": 0.0},
        "goal": {"position": goal[:2], "heading": goal[2], "speed": 0.0},
        **more,
    }


def parallel(draw: np.random.Generator) -> dict[str, Any]:
    gap = draw.uniform(5.8, 7.5)  # a car takes 4.5 m
    start = (draw.uniform(3.0, 8.0), draw.uniform(2.3, 3.2), draw.uniform(-0.15, 0.15))
    walls = [box(-9, -1, -1.3, 1), box(gap - 1.3, -1, 16, 1), box(-9, -2.3, 16, -1.2)]
    bounds = {"min": [-9, -2.3], "max": [16, 6.5]}
    return _scene("parallel", start, (draw.uniform(0.0, gap - 5.5), 0.0, 0.0), walls=walls, bounds=bounds)


def perpendicular(draw: np.random.Generator) -> dict[str, Any]:
    half, aisle = 0.5 * draw.uniform(2.5, 3.2), draw.uniform(5.5, 7.5)
    start = (draw.uniform(-9.0, -4.0), draw.uniform(0.35, 0.65) * aisle, draw.uniform(-0.15, 0.15))
    nose_in = draw.random() < 0.5
    goal = (0.0, -1.2, -pi / 2) if nose_in else (0.0, -3.8, pi / 2)
    walls = [box(-12, -6, -half, 0), box(half, -6, 12, 0)]
    bounds = {"min": [-12, -6], "max": [12, aisle]}
    return _scene("perpendicular", start, goal, walls=walls, bounds=bounds)


def three_points(draw: np.random.Generator) -> dict[str, Any]:
    half = 0.5 * draw.uniform(6.3, 9.0)
    start, goal = (0.0, -half + 1.5, draw.uniform(-0.1, 0.1)), (draw.uniform(-3.0, 3.0), half - 1.5, pi)
    return _scene("three-point", start, goal, bounds={"min": [-20, -half], "max": [20, half]})


def dead_end(draw: np.random.Generator) -> dict[str, Any]:
    half, mouth = 0.5 * draw.uniform(2.5, 3.4), draw.uniform(-8.0, -5.0)
    walls = [box(3.8, -half, 5, half), box(mouth, half, 5, half + 1), box(mouth, -half - 1, 5, -half)]
    side = draw.choice([-1.0, 1.0])
    goal = (mouth - draw.uniform(2.0, 6.0), side * draw.uniform(4.0, 8.0), side * pi / 2)
    bounds = {"min": [-22, -12], "max": [5, 12]}
    return _scene("dead end", (0.0, 0.0, 0.0), goal, walls=walls, bounds=bounds)


KINDS = (parallel, perpendicular, three_points, dead_end)
CROSSINGS = {"parallel": (2.0, 2.2), "perpendicular": (1.0, 1.5), "three-point": (4.0, 0.0), "dead end": (-11.0, 2.0)}


def scenario_of(number: int, seed: int) -> sp.Scenario:
    draw = np.random.default_rng([seed, number])
    scene = KINDS[number % 4](draw)
    while number // 4 % 2:  # somebody walks where it manoeuvres, who does not begin in it
        toward = draw.uniform(-pi, pi)
        velocity = draw.uniform(0.7, 1.3) * np.array([np.cos(toward), np.sin(toward)])
        position = np.array(CROSSINGS[scene["name"]]) - velocity * draw.uniform(3.0, 6.0)
        motion = {"position": position.tolist(), "velocity": velocity.tolist()}
        scene["obstacles"] = [{"id": "walker", "shape": {"disc": 0.3}, "motion": motion}]
        if np.hypot(*(position - scene["start"]["position"])) > 5.0:
            break
    return sp.Scenario(**scene)


class Reference:
    """Direct multiple shooting with IPOPT: legs of constant inputs on intervals, each leg with its own duration."""

    def __init__(self, scenario: sp.Scenario, signs: list[float]) -> None:  # noqa: C901, PLR0915 - one problem
        import casadi as ca

        vehicle, count, legs = scenario.vehicle, INTERVALS, len(signs)
        assert vehicle.reverse is not None
        back = vehicle.reverse
        states, inputs = ca.SX.sym("states", 4, legs * (count + 1)), ca.SX.sym("inputs", 2, legs * count)
        spent, waits = ca.SX.sym("spent", legs), ca.SX.sym("waits", legs)
        rows, low, high = [], list[float](), list[float]()

        def keep(expression: Any, least: float, most: float) -> None:
            rows.append(ca.vec(expression))
            low.extend([least] * rows[-1].numel())
            high.extend([most] * rows[-1].numel())

        def moved(state: Any, control: Any, time: Any, sign: float) -> Any:
            length = state[3] * time + control[0] * time**2 / 2
            half = sign * control[1] * length / 2
            chord = sign * length * (1 - half**2 / 6 + half**4 / 120)
            heading = state[2] + half
            return ca.vertcat(
                state[0] + chord * ca.cos(heading),
                state[1] + chord * ca.sin(heading),
                state[2] + 2 * half,
                state[3] + control[0] * time,
            )

        clock: Any = scenario.start.time
        boxes = [(np.min(wall, axis=0), np.max(wall, axis=0)) for wall in scenario.walls]

        def clear(state: Any, time: Any) -> None:
            for offset in vehicle.discs:
                x, y = state[0] + offset * ca.cos(state[2]), state[1] + offset * ca.sin(state[2])
                for (left, bottom), (right, top) in boxes:
                    dx, dy = ca.fmax(ca.fmax(left - x, x - right), 0), ca.fmax(ca.fmax(bottom - y, y - top), 0)
                    keep(dx**2 + dy**2, vehicle.radius**2, np.inf)
                for one in scenario.obstacles:
                    (px, py), (vx, vy) = one.motion.position, one.motion.velocity  # type: ignore[union-attr]
                    away = (x - px - vx * time) ** 2 + (y - py - vy * time) ** 2
                    keep(away, (vehicle.radius + 0.3) ** 2, np.inf)
                if scenario.bounds is not None:
                    for value, axis in ((x, 0), (y, 1)):
                        keep(value, *(scenario.bounds.min[axis] + 0.95, scenario.bounds.max[axis] - 0.95))

        for leg, sign in enumerate(signs):
            first = leg * (count + 1)
            before = states[:, first - 1] if leg else None
            if before is not None:
                keep(states[:3, first] - before[:3], 0.0, 0.0)
                keep(before[3], 0.0, 0.0)
            for share in np.linspace(0.0, 1.0, 4):
                if scenario.obstacles:
                    clear(states[:, first], clock + share * waits[leg])
            clock = clock + waits[leg]
            top, gain = (vehicle.max_speed, vehicle.max_acceleration) if sign > 0.0 else (back.max_speed, 1.0)
            keep(states[3, first], 0.0, 0.0)
            for k in range(count):
                state, control = states[:, first + k], inputs[:, leg * count + k]
                step = spent[leg] / count
                keep(states[:, first + k + 1] - moved(state, control, step, sign), 0.0, 0.0)
                keep(states[3, first + k + 1], 0.0, top)
                keep(control[0], -vehicle.max_deceleration, gain)
                for speed in (state[3], states[3, first + k + 1]):
                    keep(control[1] * speed**2, -2.0, 2.0)
                for point in range(1, POINTS + 1):
                    time = step * point / POINTS
                    clear(moved(state, control, time, sign), clock + step * k + time)
            clock = clock + spent[leg]
        start, goal = scenario.start, scenario.goal
        begin: list[float] = [*start.position, start.heading or 0.0]
        keep(states[:3, 0] - ca.DM(begin), 0.0, 0.0)
        keep(states[:2, -1] - ca.DM(list(goal.position)), 0.0, 0.0)
        keep(ca.sin((states[2, -1] - (goal.heading or 0.0)) / 2), 0.0, 0.0)
        keep(states[3, -1], 0.0, 0.0)
        free = ca.vertcat(ca.vec(states), ca.vec(inputs), spent, waits)
        smooth = 1e-5 * (ca.sumsqr(inputs[1, :]) + 1e-2 * ca.sumsqr(inputs[0, :]))
        problem = {"x": free, "f": ca.sum1(spent) + ca.sum1(waits) + smooth, "g": ca.vertcat(*rows)}
        ipopt = {"print_level": 0, "sb": "yes", "max_iter": 400, "tol": 1e-6, "mu_init": 1e-3}
        options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": ipopt}
        self.solver = ca.nlpsol("legs", "ipopt", problem, options)
        self.legs, self.signs, self.low, self.high = legs, signs, np.array(low), np.array(high)
        self.moves, self.curvature = bool(scenario.obstacles), float(vehicle.max_curvature or np.inf)

    def best(self, plan: sp.Plan, starts: int, draw: np.random.Generator) -> float:
        """Return the least time of so many starts near a plan, s; inf without a success."""
        return min((self._solved(plan, draw, PERTURBED * (number > 0)) for number in range(starts)), default=np.inf)

    def _solved(self, plan: sp.Plan, draw: np.random.Generator, apart: float) -> float:
        assert plan.legs is not None
        states, inputs, spent = list[Array](), list[Array](), list[float]()
        for leg in plan.legs.legs:
            times = np.linspace(leg.begin, leg.end, INTERVALS + 1)
            inside = np.clip(times, leg.begin + 1e-9, leg.end - 1e-9)
            heading = np.unwrap(plan.heading(inside))
            if states:
                heading += 2.0 * pi * round((states[-1][-1, 2] - heading[0]) / (2.0 * pi))
            states.append(np.column_stack([plan.position(inside), heading, plan.speed(inside)]))
            middle = 0.5 * (times[1:] + times[:-1])
            bend = np.where(leg.backward, -1.0, 1.0) * plan.curvature(middle)
            inputs.append(np.column_stack([plan.acceleration(middle), bend]))
            spent.append(leg.end - leg.begin)
        waits = [pause.end.time - pause.begin.time for pause in plan.legs.pauses[:-1]]
        every, controls = np.vstack(states), np.vstack(inputs)
        every[:, :3] += apart * draw.normal(size=every[:, :3].shape) * [1.0, 1.0, 0.3]
        lengths = np.array(spent) * np.exp(apart * draw.normal(size=self.legs))
        x = np.concatenate([every.ravel(), controls.ravel(), lengths, waits])
        lower, upper = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        bends = slice(every.size + 1, every.size + controls.size, 2)
        lower[bends], upper[bends] = -self.curvature, self.curvature
        lower[-2 * self.legs :], upper[-self.legs :] = 0.0, np.inf if self.moves else 0.0
        lower[-2 * self.legs : -self.legs] = 0.01
        answer = self.solver(x0=x, lbx=lower, ubx=upper, lbg=self.low, ubg=self.high)
        found: Array = np.asarray(answer["x"]).ravel()
        return float(found[-2 * self.legs :].sum()) if self.solver.stats()["success"] else np.inf


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--starts", type=int, default=10)
    chosen = parser.parse_args()
    compare = chosen.starts > 0 and importlib.util.find_spec("casadi") is not None
    certified, ratios, spent = 0, list[float](), list[float]()
    for number in range(chosen.count):
        scenario = scenario_of(number, chosen.seed)
        began = process_time()
        plan = sp.plan(scenario)
        spent.append(process_time() - began)
        certified += plan.certified
        told = f"{number:4} {scenario.name:14} {plan.status} {plan.travel_time:7.3f} s in {spent[-1]:5.2f} s"
        if plan.certified and plan.legs is not None and compare:
            signs = [-1.0 if leg.backward else 1.0 for leg in plan.legs.legs]
            draw = np.random.default_rng([chosen.seed, number, 1])
            best = Reference(scenario, signs).best(plan, chosen.starts, draw)
            ratios.append(plan.travel_time / min(best, plan.travel_time * 10.0) if np.isfinite(best) else np.nan)
            told += f", {len(signs)} legs, {ratios[-1]:.4f} of the reference"
        print(told, flush=True)
    took = f"median {np.median(spent):.2f} s of processor time, most {max(spent):.2f}"
    print(f"certified {certified} of {chosen.count}; {took}")
    known = np.array(ratios)[np.isfinite(ratios)]
    if len(known):
        shares = ", ".join(f"{q} %: {np.percentile(known, q):.4f}" for q in (50, 90, 95, 100))
        within = f"{int((known <= 1.02).sum())} of {len(known)} within 1.02"
        print(f"time relative to the reference, {shares}; {within}; {len(ratios) - len(known)} without a reference")


if __name__ == "__main__":
    main()
