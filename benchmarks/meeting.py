"""Trips that meet what moves: ``python -m benchmarks.meeting STUDY --count N [--seed S] [--match]``.

========  ==============================================================================================
study     what it measures
========  ==============================================================================================
closed    time against closed forms without obstacles: targets of constant velocity, of constant
          acceleration, and to be matched along one line; turned, shifted and scaled
flee      CPU until a target that gets away is told, with the proof
scenes    5 to 20 moving obstacles: time and CPU of ``plan`` against a fixed goal where the target is met
driven    closed loops to a boat that accelerates, seen at 10 Hz with 0.1 m of noise among three others:
          time against ``plan`` with all motions known
turned    the same to a boat that besides changes its acceleration by N(0, 0.5) m/s2 for 2 s; not to those that then
          get away even from who knows it
ipopt     5 to 20 moving obstacles: against the best of ten starts of CasADi + IPOPT
orders    2 to 4 places and targets on the way, in the fastest order: time against the best of all orders given
========  ==============================================================================================
"""

from __future__ import annotations

from benchmarks import common  # isort: skip  # sets one thread, before numpy is loaded

import argparse
import math
from collections.abc import Iterable
from itertools import permutations
from time import process_time
from typing import Any

import numpy as np
from scipy.optimize import brentq

import scp_planner as sp
from benchmarks.families import crossing
from benchmarks.online_noticing import LONGEST, NOISE, RATE, manoeuvre
from benchmarks.peers.base import judge
from benchmarks.peers.casadi_ipopt import CasadiIpopt
from benchmarks.peers.starts import TEN_STARTS
from scp_planner.arrays import Array
from scp_planner.simulation.worlds import Course, motion_course

VEHICLE = {
    "radius": 0.3,
    "max_speed": 3.0,
    "max_acceleration": 2.0,
    "max_deceleration": 2.0,
    "max_lateral_acceleration": 2.0,
}
EXACT = 1e-3  # of the time, by which a trip may be slower than the closed form


def vector(size: float, angle: float) -> Array:
    return size * np.array([math.cos(angle), math.sin(angle)])


def timed(scenario: sp.Scenario) -> tuple[sp.Plan, float]:
    began = process_time()
    plan = sp.plan(scenario)
    return plan, process_time() - began


def quantiles(name: str, values: Iterable[float], scale: float = 1.0) -> str:
    some = scale * np.array([value for value in values if math.isfinite(value)])
    if not len(some):
        return f"{name}: none"
    middle, most = np.quantile(some, [0.5, 0.95])
    return f"{name} median {middle:.6g}, mean {some.mean():.6g}, 95 % {most:.6g}, worst {some.max():.6g}"


def free_scene(rng: np.random.Generator, kind: int) -> tuple[sp.Scenario, float]:
    """A scene without obstacles and the time of its meeting: the first root of distance less distance driven."""
    size, top = 10.0 ** rng.uniform(-1.0, 3.0), 10.0 ** rng.uniform(-1.0, 1.5)
    rate, brake = top * top / size * rng.uniform(1.0, 5.0, 2)
    origin, away = size * rng.normal(size=2), vector(size, rng.uniform(-math.pi, math.pi))
    velocity = vector(top * rng.uniform(0.0, 0.9), rng.uniform(-math.pi, math.pi))
    change = (
        vector(top * top / size * rng.uniform(0.0, 0.1), rng.uniform(-math.pi, math.pi)) if kind == 1 else 0.0 * away
    )
    if kind == 2:
        velocity = away / size * top * rng.uniform(0.0, 0.9)
    speed = float(np.hypot(*velocity)) if kind == 2 else 0.0

    def gap(time: float) -> float:
        begun, ended = top / rate, (top - speed) / brake if kind == 2 else 0.0
        if (
            kind == 2 and (most := (time + speed / brake) / (1.0 / rate + 1.0 / brake)) < top
        ):  # m/s, the top is not reached
            driven = most**2 / (2.0 * rate) + (most**2 - speed**2) / (2.0 * brake)
        elif time < begun:
            driven = 0.5 * rate * time**2
        else:
            driven = top * time - 0.5 * top * begun - 0.5 * (top - speed) * ended
        return float(np.hypot(*(away + velocity * time + 0.5 * change * time**2))) - driven

    grid = np.linspace(speed / rate, 50.0 * size / top, 20_001)
    first = int(np.argmax([gap(time) <= 0.0 for time in grid]))
    wanted = brentq(gap, grid[first - 1], grid[first], xtol=1e-13 * grid[-1]) if first else math.inf
    limits = {"max_speed": top, "max_acceleration": rate, "max_deceleration": brake, "max_lateral_acceleration": rate}
    motion = {"position": origin + away, "velocity": velocity, "acceleration": change}
    goal = {"target": {"motion": {key: value.tolist() for key, value in motion.items()}}, "match_velocity": kind == 2}
    start = {"time": 0.0, "position": origin.tolist(), "speed": 0.0}
    return sp.Scenario(vehicle={"radius": size / 50.0, **limits}, start=start, goal=goal, obstacles=[]), wanted


def closed(asked: argparse.Namespace) -> None:
    over: dict[int, list[float]] = {0: [], 1: [], 2: []}
    work = []
    for seed in range(asked.seed, asked.seed + asked.count):
        scenario, wanted = free_scene(np.random.default_rng(seed), seed % 3)
        if wanted == math.inf:
            continue
        plan, taken = timed(scenario)
        work.append(taken)
        error = plan.travel_time / wanted - 1.0 if plan.certified else math.inf
        over[seed % 3].append(error)
        if not -1e-6 <= error <= EXACT:
            common.say(f"{seed}: {plan.status}, {error:.2e} over the closed form")
    for name, errors in zip(("constant velocity", "constant acceleration", "matched"), over.values(), strict=True):
        good = sum(-1e-6 <= error <= EXACT for error in errors)
        common.say(f"{name}: {good} of {len(errors)} within {EXACT}; {quantiles('over', errors)}")
    common.say(quantiles("CPU, ms:", work, 1e3))


def flee(asked: argparse.Namespace) -> None:
    work, told = [], 0
    for seed in range(asked.seed, asked.seed + asked.count):
        rng = np.random.default_rng(seed)
        away = vector(rng.uniform(3.0, 30.0), rng.uniform(-math.pi, math.pi))
        ahead = away / np.hypot(*away)
        motion = {"position": away, "velocity": rng.uniform(1.0, 2.0) * 3.0 * ahead}
        if seed % 2:
            motion = {"position": away, "velocity": 2.0 * ahead, "acceleration": rng.uniform(1.0, 2.0) * ahead}
        goal = {"target": {"motion": {key: value.tolist() for key, value in motion.items()}}}
        others = crossing(rng, 10)
        scenario = sp.Scenario(vehicle=VEHICLE, start=others["start"], goal=goal, obstacles=others["obstacles"])
        plan, taken = timed(scenario)
        work.append(taken)
        told += (plan.reason or "").startswith("no trip meets") and math.isinf(sp.lower_bound(scenario))
    common.say(f"told {told} of {asked.count}; {quantiles('CPU, ms:', work, 1e3)}")


def crowded(seed: int, match: bool) -> dict[str, Any]:
    """A scene with 5 to 20 obstacles that cross, and a target some 20 m away."""
    rng = np.random.default_rng(seed)
    scene = crossing(rng, int(rng.integers(5, 21)))
    velocity = vector(rng.uniform(0.0, 1.8), rng.uniform(-math.pi, math.pi))
    place = np.array([20.0, rng.normal(0.0, 2.0)]) - 4.0 * velocity
    motion = {"position": place, "velocity": velocity, "acceleration": rng.normal(0.0, 0.05, 2)}
    target = {"motion": {key: value.tolist() for key, value in motion.items()}}
    return {**scene, "name": f"meet{seed}", "goal": {"target": target, "match_velocity": match}}


def at_target(data: dict[str, Any], time: float) -> dict[str, Any]:
    """The scene with a goal that stands where the target is at a time, s."""
    motion = data["goal"]["target"]["motion"]
    place, velocity, change = (np.array(motion[key]) for key in ("position", "velocity", "acceleration"))
    goal: dict[str, Any] = {"position": (place + time * (velocity + 0.5 * time * change)).tolist()}
    if data["goal"]["match_velocity"]:
        u, v = velocity + time * change
        goal |= {"speed": math.hypot(u, v), "heading": math.atan2(v, u)}
    return {**data, "goal": goal}


def scenes(asked: argparse.Namespace) -> None:
    ratios, work, spent, met = [], [], np.zeros(2), 0
    sp.plan(sp.Scenario.model_validate(crowded(0, asked.match)))
    for seed in range(asked.seed, asked.seed + asked.count):
        data = crowded(seed, asked.match)
        scenario = sp.Scenario.model_validate(data)
        plan, taken = timed(scenario)
        met += plan.certified
        if not plan.certified:
            common.say(f"{seed}: {plan.status}: {plan.reason}")
            continue
        fixed_goal = at_target(data, plan.arrival_time)
        fixed, other = timed(sp.Scenario.model_validate(fixed_goal))
        ratios.append(plan.travel_time / fixed.travel_time if fixed.certified else math.nan)
        work.append(taken / other)
        spent += (taken, other)
        if asked.verbose:
            common.say(f"{seed}: time {ratios[-1]:.6f}, CPU {1e3 * taken:.0f} and {1e3 * other:.0f} ms, {work[-1]:.2f}")
    common.say(f"certified {met} of {asked.count}; {quantiles('time', ratios)}")
    common.say(f"{quantiles('CPU ratio', work)}; of the sums {spent[0] / spent[1]:.3f}")


def ipopt(asked: argparse.Namespace) -> None:
    peer, found, ratios, work = CasadiIpopt(), np.zeros(3, dtype=int), [], []
    for seed in range(asked.seed, asked.seed + asked.count):
        data = crowded(seed, asked.match)
        scenario = sp.Scenario.model_validate(data)
        plan, taken = timed(scenario)
        data["goal"]["position"] = scenario.goal.position  # about where it is met
        peer.build([data])
        began, best = process_time(), math.inf
        for start in TEN_STARTS:
            one = peer.solve(data, start)
            report = judge(at_target(data, one.arrival_time), one)
            if one.success and report is not None and report.ok:
                best = min(best, one.travel_time)
        work.append((process_time() - began) / taken)
        found += (plan.certified, best < math.inf, plan.certified and best < math.inf)
        ratios.append(plan.travel_time / best if plan.certified else math.nan)
        if asked.verbose or not plan.certified or ratios[-1] > 1.005:
            common.say(f"{seed}: {plan.status} {plan.travel_time:.4f} s, theirs {best:.4f} s, CPU {taken:.2f} s")
    common.say(f"certified {found[0]} of {asked.count}, by IPOPT {found[1]}, by both {found[2]}")
    common.say(f"{quantiles('time', [one for one in ratios if one > 0.0])}; {quantiles('CPU of IPOPT', work)}")
    common.say(f"slower by over 0.5 %: {sum(one > 1.005 for one in ratios)}")


def boats(seed: int, match: bool) -> tuple[sp.Scenario, np.random.Generator]:
    """A boat that accelerates some 20 m away, to be met among three others that move."""
    rng = np.random.default_rng([seed, 47])
    scene = crossing(rng, 3)
    velocity = vector(rng.uniform(0.3, 1.5), rng.uniform(-math.pi, math.pi))
    motion = {
        "position": np.array([20.0, rng.normal(0.0, 2.0)]) - 4.0 * velocity,
        "velocity": velocity,
        "acceleration": rng.normal(0.0, 0.05, 2),
    }
    boat = {"id": "boat", "shape": {"disc": 0.5}, "motion": motion}
    goal = {"target": "boat", "radius": 0.5, "match_velocity": match}
    return sp.Scenario(**{**scene, "name": f"boat{seed}", "goal": goal, "obstacles": [*scene["obstacles"], boat]}), rng


def gets_away(scenario: sp.Scenario, course: Course) -> bool:
    """True if a target is never as near to the start as the vehicle can have driven by then, up to `LONGEST`."""
    start, vehicle, times = scenario.start, scenario.vehicle, np.linspace(0.0, LONGEST, 6001)
    rise = np.minimum(times, (vehicle.max_speed - start.speed) / vehicle.max_acceleration)
    reach = start.speed * rise + 0.5 * vehicle.max_acceleration * rise**2 + vehicle.max_speed * (times - rise)
    away = np.hypot(*(course(start.time + times) - start.position).T)
    return bool((away > reach + scenario.goal.radius).all())


def driven(asked: argparse.Namespace) -> None:
    met, touched, left_out, ratios = 0, 0, 0, []
    for seed in range(asked.seed, asked.seed + asked.count):
        scenario, rng = boats(seed, asked.match)
        known = sp.plan(scenario)
        if not known.certified:  # such as one that gets away
            left_out += 1
            continue
        world = {one.id: motion_course(one.motion) for one in scenario.obstacles if isinstance(one.motion, sp.Motion)}
        if asked.study == "turned":
            begin = rng.uniform(0.0, known.travel_time)
            world["boat"] = manoeuvre(world["boat"], begin, 0.5 * rng.standard_normal(2))
            if gets_away(scenario, world["boat"]):
                left_out += 1
                continue
        run = sp.simulate(scenario, NOISE, RATE, seed, world=world)
        met += run.arrived
        touched += run.contact or run.contact_standing
        ratios.append(run.travel_time / known.travel_time if run.arrived else math.nan)
        if asked.verbose or not run.arrived or run.contact or run.contact_standing:
            how = f"arrived {run.arrived}, contact {run.contact}, standing {run.contact_standing}"
            common.say(f"{seed}: {how}, time {ratios[-1]:.3f} of {known.travel_time:.2f} s")
    common.say(f"met {met} of {len(ratios)}, {left_out} get away or have no certified plan, touched {touched}")
    common.say(quantiles("time", ratios))


def visited(seed: int) -> dict[str, Any]:
    """A scene with 2 to 4 places and targets on the way, some with a window, among up to 4 obstacles that cross."""
    rng = np.random.default_rng([seed, 48])
    scene = crossing(rng, int(rng.integers(0, 5)))
    goals = list[dict[str, Any]]()
    for _ in range(rng.choice([2, 3, 4], p=[0.4, 0.45, 0.15])):
        place = [rng.uniform(0.0, 20.0), rng.uniform(-8.0, 8.0)]
        one: dict[str, Any] = {"position": place, "radius": 0.5}
        if rng.random() < 0.6:
            velocity = vector(rng.uniform(0.1, 1.2), rng.uniform(-math.pi, math.pi)).tolist()
            one = {"target": {"motion": {"position": place, "velocity": velocity}}, "radius": 0.5}
        if rng.random() < 0.3:
            begin = rng.uniform(2.0, 10.0)
            one |= {"earliest_arrival": begin, "latest_arrival": begin + rng.uniform(2.0, 10.0)}
        goals.append(one)
    return {**scene, "name": f"visit{seed}", "goals": goals}


def orders(asked: argparse.Namespace) -> None:
    met, missed, ratios, work = 0, 0, [], []
    for seed in range(asked.seed, asked.seed + asked.count):
        data = visited(seed)
        plan, taken = timed(sp.Scenario.model_validate({**data, "goals_order": "fastest"}))
        work.append(taken)
        found = dict[tuple[int, ...], float]()
        for order in permutations(range(len(data["goals"]))):
            one = sp.plan(sp.Scenario.model_validate({**data, "goals": [data["goals"][k] for k in order]}))
            if one.certified:
                found[order] = one.travel_time
        met, missed = met + plan.certified, missed + (bool(found) and not plan.certified)
        if not found or not plan.certified:
            common.say(f"{seed}: {plan.status}, {len(found)} orders are certified")
            continue
        best = min(found, key=lambda order: found[order])
        ratios.append(plan.travel_time / found[best])
        if asked.verbose or ratios[-1] > 1.0 + EXACT:
            own = tuple(sp.meetings(plan.planned, plan)) if plan.planned else ()
            ways = f"order {best}, {found.get(own, 0.0):.3f} s in {own}"
            common.say(f"{seed}: {ratios[-1]:.5f} of {found[best]:.3f} s in {ways}")
    common.say(f"certified {met} of {asked.count}, {missed} missed that an order has; {quantiles('time', ratios)}")
    slower = sum(one > 1.0 + EXACT for one in ratios)
    common.say(f"slower by over {EXACT}: {slower}; {quantiles('CPU, ms:', work, 1e3)}")


def main() -> None:
    """Run a study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    studies = {
        "closed": closed,
        "flee": flee,
        "scenes": scenes,
        "driven": driven,
        "turned": driven,
        "orders": orders,
        "ipopt": ipopt,
    }
    parser.add_argument("study", choices=studies)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--match", action="store_true", help="match the velocity, too")
    parser.add_argument("--verbose", action="store_true", help="a line a seed")
    asked = parser.parse_args()
    studies[asked.study](asked)


if __name__ == "__main__":
    main()
