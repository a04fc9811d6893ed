"""Plans as solutions of CommonRoad's benchmark: files that commonroad-io writes and its official checker reads."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from scp_planner.arrays import Array, unit_vectors
from scp_planner.files import write_text
from scp_planner.formats.commonroad.cars import Car, VehicleModel, car_named, centre_of, default_car
from scp_planner.formats.commonroad.checker import HEADING, SPEED_COLUMN, STEERING, axle_states, joined, velocities
from scp_planner.formats.commonroad.reading import read_commonroad
from scp_planner.planning.plan import Plan

COSTS = ("JB1", "SM1", "WX1")  # that solutions are submitted for: the time alone; comfort; time and comfort
HITCH_STEPS = 20  # to a step of the file, of the integral of the trailer's angle


def export_commonroad_solution(
    plan: Plan,
    commonroad_file: str | PathLike[str],
    path: str | PathLike[str],
    *,
    model: str = "PM",
    car: str | None = None,
    cost: str = "JB1",
    problem: int | None = None,
) -> None:
    """Write a plan as a solution file."""
    moved = VehicleModel.named(model)
    name, body = car or default_car(moved), car_named(car, moved)
    if cost not in COSTS:
        raise ValueError(f"cost: must be one of {', '.join(COSTS)}, not {cost!r}")
    file = read_commonroad(commonroad_file, problem)
    from commonroad.common import solution
    from commonroad.scenario.trajectory import Trajectory

    first = int(file.problem.initial_state.time_step)
    shown = joined(axle_states(plan, file.step, body, file.heading), file.step, moved, body)
    if shown is None:
        raise ValueError("plan: the official checker would not find the inputs between its states")
    states = _states(plan, shown, first, moved, body)
    answer = solution.PlanningProblemSolution(
        file.problem.planning_problem_id,
        solution.VehicleModel[moved.value],
        solution.VehicleType[name],
        solution.CostFunction[cost],
        Trajectory(first, states),
    )
    whole = solution.Solution(file.world.scenario_id, [answer], computation_time=plan.wall_time)
    write_text(Path(path), solution.CommonRoadSolutionWriter(whole).dump())


def _states(plan: Plan, shown: Array, first: int, model: VehicleModel, car: Car) -> list[Any]:
    """Give the states of a plan that are shown, (n, 5), in classes of commonroad-io; the first is at a step."""
    from commonroad.scenario import state

    speed, heading, count = shown[:, SPEED_COLUMN], shown[:, HEADING], len(shown) - 1
    along = unit_vectors(heading)
    places = shown[:, :STEERING] + centre_of(car, model) * along
    steps = range(first, first + count + 1)
    if model is VehicleModel.PM:
        return [
            state.PMState(time_step=k, position=place, velocity=float(v[0]), velocity_y=float(v[1]))
            for k, place, v in zip(steps, places, velocities(shown, car), strict=True)
        ]
    steering = shown[:, STEERING]
    shared = [
        {"time_step": k, "position": place, "steering_angle": angle, "velocity": v, "orientation": turn}
        for k, place, angle, v, turn in zip(
            steps, places, *(x.tolist() for x in (steering, speed, heading)), strict=True
        )
    ]
    if model is VehicleModel.KS:
        return [state.KSState(**each) for each in shared]
    hitch = _hitch_angles(plan, np.linspace(plan.start_time, plan.arrival_time, count + 1), car)
    return [state.KSTState(**each, hitch_angle=float(angle)) for each, angle in zip(shared, hitch, strict=True)]


def _hitch_angles(plan: Plan, times: Array, car: Car) -> Array:
    """Angles of the trailer behind the truck at times, (n,) rad; 0 at the first."""
    assert car.trailer_wheelbase is not None
    fine = np.linspace(times[0], times[-1], 2 * HITCH_STEPS * (len(times) - 1) + 1)
    speed, curvature = plan.speed(fine), plan.curvature(fine)
    wheelbase, step = car.trailer_wheelbase, 2.0 * (fine[1] - fine[0])

    def rate(angle: float, at: int) -> float:
        return -float(speed[at]) * (math.sin(angle) / wheelbase + float(curvature[at]))

    angles = [0.0]
    for k in range(0, len(fine) - 1, 2):
        angle = angles[-1]
        a = rate(angle, k)
        b = rate(angle + 0.5 * step * a, k + 1)
        c = rate(angle + 0.5 * step * b, k + 1)
        d = rate(angle + step * c, k + 2)
        angles.append(angle + step * (a + 2.0 * b + 2.0 * c + d) / 6.0)
    return np.array(angles[::HITCH_STEPS])
