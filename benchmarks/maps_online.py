"""Closed loops over random maps, checked against the bitmap, densely and without the package's code.

    python -m benchmarks.maps_online [--count N] [--kind KIND ...] [--first SEED] [--moving] [--changing]
        [--deadline S] [--output FILE]

The maps are those of `benchmarks.maps`. Of each replan, what is driven until the next one is read against the cells of
that moment, and of each plan that is called safe all that makes it safe: the trip, or the stop from it. The time is
compared with that of the trip that is planned offline. With ``--changing``, a disc of cells 3 to 5 m ahead of the
vehicle on its trip is occupied for 8 s (a door that shuts, and opens again), twice.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip  # noqa: F401

import argparse
import json
from pathlib import Path
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np

import scp_planner as sp
from benchmarks.maps import CELL, KINDS, Array, apart, moments, scene

PERIOD = 0.1  # s
LONGEST = 90.0  # s
DOOR = 1.0  # m, radius of the cells that change
SHUT = 8.0  # s


class Looks:
    """Reads what is driven, and what is promised, against the cells."""

    def __init__(self, scenario: sp.Scenario, cells: Array) -> None:
        self.scenario, self.cells = scenario, cells
        self.driven = self.promised = np.inf
        self.unsafe = 0

    def plan(self, plan: Any, now: float, after: float) -> None:
        time = now + moments(after - now, self.scenario)
        self.driven = min(self.driven, apart(plan.position(time), plan.heading(time), self.scenario, self.cells))
        self.unsafe += not plan.safe
        if plan.safe:
            trip = plan.trip if plan.stop is None else plan.stop
            ends = trip.frame.time + trip.trajectory.travel_time
            time = now + moments(max(ends - now, 0.0), self.scenario)
            direction = trip.frame.vectors_to_world(trip.at(time)[0].path.direction)
            place, heading = trip.frame.to_world(trip.positions_at(time)), np.arctan2(direction[:, 1], direction[:, 0])
            self.promised = min(self.promised, apart(place, heading, self.scenario, self.cells))


def simulated(scenario: sp.Scenario, cells: Array, deadline: float | None) -> dict[str, Any]:
    """Drive a scenario in `scp_planner.simulate`."""
    looks, cpu, original = Looks(scenario, cells), list[float](), sp.Planner.replan

    def replan(*args: Any, **kwargs: Any) -> sp.OnlinePlan:
        began = process_time()
        plan = original(*args, **kwargs)
        cpu.append(process_time() - began)
        return plan

    with patch.object(sp.Planner, "replan", replan):
        run = sp.simulate(scenario, time_limit=LONGEST, deadline=deadline)
    times = [*(one.time for one in run.records), float(run.time[-1])]
    for plan, now, after in zip(run.plans, times[:-1], times[1:], strict=True):
        looks.plan(plan, now, max(after, now))
    return {"arrived": run.arrived, "contact": run.contact, "time": run.travel_time, **told(looks, run.plans[-1], cpu)}


def changing(scenario: sp.Scenario, cells: Array, deadline: float | None) -> dict[str, Any]:
    """Drive over a map on which a disc of cells ahead is occupied for a while, twice."""
    assert scenario.ground is not None
    ground, shut, changes = scenario.ground.map, None, 0
    planner = sp.Planner(scenario, online=sp.OnlineSettings(period=1.1 * PERIOD))
    looks, cpu = Looks(scenario, cells), list[float]()
    time, heading, speed = 0.0, scenario.start.heading, 0.0
    place, plan = np.array(scenario.start.position), None
    while time < LONGEST:
        if shut is not None and time >= shut + SHUT:
            planner.update_map(ground)
            shut, looks.cells = None, cells
        elif shut is None and changes < 2 and plan is not None and time > 1.0 + 12.0 * changes:
            door = ahead(plan, time, place, scenario, cells)
            if door is not None:
                changes, shut, looks.cells = changes + 1, time, door
                planner.update_map(sp.OccupancyMap(door, CELL, ground.origin, ground.yaw))
        began = process_time()
        plan = planner.replan(time, place, heading, speed, deadline=deadline)
        cpu.append(process_time() - began)
        after = round(time + PERIOD, 6)
        looks.plan(plan, time, min(after, max(plan.arrival_time, time)))
        if plan.arrived:
            break
        time = after
        place, heading = plan.position(time), float(plan.heading(time))
        speed = 0.0 if plan.arrival_time <= time else max(float(plan.speed(time)), 0.0)
    assert plan is not None
    return {"arrived": plan.arrived, "time": time, "changes": changes, **told(looks, plan, cpu)}


def ahead(plan: sp.OnlinePlan, time: float, place: Array, scenario: sp.Scenario, cells: Array) -> Array | None:
    """The cells with a disc on the trip that are occupied besides; None where there is no place for it."""
    assert scenario.ground is not None
    ground = scenario.ground.map
    for later in np.linspace(time, plan.arrival_time, 200):
        there = plan.position(later)
        if 3.0 <= np.hypot(*(there - place)) <= 5.0 and np.hypot(*(there - scenario.goal.position)) > 1.0:
            x, y = ground.local(there)
            rows, columns = np.indices(cells.shape)
            return cells | (np.hypot(columns + 0.5 - x, rows + 0.5 - y) <= DOOR / CELL)
    return None


def told(looks: Looks, last: Any, cpu: list[float]) -> dict[str, Any]:
    found = {"driven": looks.driven, "promised": looks.promised, "unsafe": looks.unsafe}
    return {**found, "plans": len(cpu), "reason": last.reason, "cpu": cpu}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=7, help="maps of each kind")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--kind", nargs="+", choices=sorted(KINDS), default=sorted(KINDS))
    parser.add_argument("--moving", action="store_true", help="three moving discs")
    parser.add_argument("--changing", action="store_true", help="cells ahead that are occupied for a while")
    parser.add_argument("--deadline", type=float, help="s of wall time for a replan")
    parser.add_argument("--output", type=Path, help="JSON lines, one a map")
    asked = parser.parse_args()
    found, drive = list[dict[str, Any]](), changing if asked.changing else simulated
    for kind in asked.kind:
        for seed in range(asked.first, asked.first + asked.count):
            made = scene(kind, seed, asked.moving)
            if made is None:
                continue
            scenario, cells, _ = made
            offline = sp.plan(scenario)
            if not offline.certified:
                continue
            one = {"kind": kind, "seed": seed, **drive(scenario, cells, asked.deadline)}
            one["ratio"] = one["time"] / offline.travel_time
            found.append(one)
            brief = {key: round(value, 4) if isinstance(value, float) else value for key, value in one.items()}
            print({**brief, "cpu": round(max(one["cpu"]), 3)}, flush=True)
            if asked.output:
                with asked.output.open("a") as out:
                    print(json.dumps(one), file=out)
    there = [one for one in found if one["arrived"]]
    cpu = np.concatenate([one["cpu"] for one in found])
    first, ratio = [one["cpu"][0] for one in found], [one["ratio"] for one in there]
    print(f"{len(found)} maps, {len(there)} arrived, {sum(one.get('contact', False) for one in found)} with contact;")
    print(f"touched a cell: {sum(one['driven'] < -1e-6 for one in found)} driven,", end=" ")
    print(f"{sum(one['promised'] < -1e-6 for one in found)} promised;", end=" ")
    print(f"unsafe plans: {sum(one['unsafe'] for one in found)} of {len(cpu)}")
    print(f"time / offline trip: median {np.median(ratio):.3f}, most {max(ratio):.3f}")
    print(f"CPU of a replan: median {np.median(cpu):.4f} s, 99 % {np.quantile(cpu, 0.99):.3f} s,", end=" ")
    print(f"most {cpu.max():.2f} s; of the first: median {np.median(first):.2f} s, most {max(first):.2f} s")


if __name__ == "__main__":
    main()
