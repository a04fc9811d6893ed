"""OpenSCvx: its penalised trust region method, on the same kinematics, with constraints in continuous time.

States x, y, heading, speed; controls acceleration and curvature, held over equal intervals; free final time. Speed,
lateral acceleration and clearance are continuous-time constraints (`ctcs`), the package's own strength; the
obstacles are one parameter under `Vmap`, so that a family is compiled once. Double precision, its default QP
solver (QOCO).

What was tried on `crossing5`, `headon` and `crossing10`, and kept: 30 nodes rather than 20 (half as many answers
fail the check); `lam_cost` 0.1 (0.03: 0.5 % longer travel times; 1: no convergence); `lam_prox` 0.03 (0.1:
travel times 0.3 % longer; 0.01: none of `headon` from the first start); continuous-time rather than nodal
clearance (nodal: twice the time, fewer checked answers); QOCO rather than Clarabel (a quarter faster); ten times its
own tolerance of the step, and a hundred times that of the dynamics (a third of the time, as many certified answers,
travel times 0.2 % longer; with ten times more, fewer).
"""

from __future__ import annotations

import contextlib
import io
import json
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers.base import TIME_LIMIT, Attempt, MissingPeerError, Scenario, disc_arrays, require_plain
from benchmarks.peers.casadi_ipopt import ArcTrip
from benchmarks.peers.starts import FirstGuess, Start, first_guess

NODES_PER_SECOND = 4.0  # of the trip at top speed: 30 for 20 m, 50 (the most) for 40 m
MOST_NODES = 50
MARGIN = 2e-2  # m: the continuous-time constraint is met up to its own tolerance
ROOM = 10.0  # m to each side
ALGORITHM: dict[str, Any] = {"lam_cost": 1e-1, "lam_prox": 3e-2, "k_max": 100, "ep_tr": 1e-3, "ep_vc": 1e-6}
RELAXATION = 1e-6  # allowed integral of the violation over an interval


@dataclass(frozen=True)
class _Built:
    problem: Any
    set_guess: Callable[[FirstGuess], None]
    nodes: int


class OpenScvx:
    """Sequential convex programming with OpenSCvx on JAX (processor)."""

    name = "openscvx"
    own_starts = False

    def __init__(self, nodes: int | None = None, algorithm: dict[str, Any] | None = None) -> None:
        self._nodes = nodes
        self._algorithm = ALGORITHM | (algorithm or {})
        self._built: dict[str, _Built] = {}

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """Compile one problem for each number of obstacles, vehicle, start and goal among the scenarios."""
        for scenario in scenarios:
            require_plain(scenario)
            key = _key(scenario)
            if key not in self._built:
                # It prints a banner, and silences all warnings of the process: undo the latter.
                with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
                    self._built[key] = self._build(scenario)
                # The first solve compiles what is left.
                self.solve(scenario, Start(0.5))

    def _build(self, scenario: Scenario) -> _Built:
        try:
            import openscvx as ox
        except ImportError as error:
            raise MissingPeerError("openscvx is not installed: pip install openscvx") from error
        vehicle, start, goal = scenario["vehicle"], scenario["start"], scenario["goal"]
        first, last = np.asarray(start["position"], dtype=float), np.asarray(goal["position"], dtype=float)
        length, top = float(np.linalg.norm(last - first)), float(vehicle["max_speed"])
        nodes = self._nodes or max(10, min(MOST_NODES, round(NODES_PER_SECOND * length / top + 3)))
        discs = disc_arrays(scenario)

        position = ox.State("position", shape=(2,))
        position.min, position.max = np.minimum(first, last) - ROOM, np.maximum(first, last) + ROOM
        position.initial, position.final = first, last
        heading = ox.State("heading", shape=(1,))
        heading.min, heading.max = np.array([-np.pi]), np.array([np.pi])
        wanted = start.get("heading")
        heading.initial = [ox.Free(0.0)] if wanted is None else np.array([float(wanted)])
        heading.final = [ox.Free(0.0)]
        speed = ox.State("speed", shape=(1,))
        speed.min, speed.max = np.array([0.0]), np.array([top])
        speed.initial, speed.final = np.array([float(start["speed"])]), [ox.Free(top)]
        acceleration = ox.Control("acceleration", shape=(1,), parameterization="ZOH")
        acceleration.min = np.array([-float(vehicle["max_deceleration"])])
        acceleration.max = np.array([float(vehicle["max_acceleration"])])
        curvature = ox.Control("curvature", shape=(1,), parameterization="ZOH")
        bend = float(vehicle["max_curvature"]) if vehicle.get("max_curvature") is not None else 10.0
        curvature.min, curvature.max = np.array([-bend]), np.array([bend])
        begin = float(start.get("time", 0.0))
        shortest = length / top
        time = ox.Time(
            initial=begin,
            final=ox.Minimize(begin + shortest),
            min=begin,
            max=begin + 4.0 * shortest,
            uniform_time_grid=True,
        )

        def set_guess(guess: FirstGuess) -> None:
            position.guess, heading.guess = guess.states[:, :2].copy(), guess.states[:, 2:3].copy()
            speed.guess = guess.states[:, 3:4].copy()
            acceleration.guess, curvature.guess = guess.accelerations[:, None], guess.curvatures[:, None]
            time.guess = guess.times[:, None].copy()
            time.time_dilation_guess = np.full(nodes, guess.duration)

        set_guess(first_guess(scenario, Start(0.5)).at(np.linspace(0.0, 1.0, nodes)))
        constraints = [ox.ctcs(speed <= speed.max), ox.ctcs(speed.min <= speed)]
        if vehicle.get("max_lateral_acceleration") is not None:
            limit = float(vehicle["max_lateral_acceleration"])
            lateral = curvature[0] * speed[0] ** 2
            constraints += [ox.ctcs(lateral <= limit), ox.ctcs(-limit <= lateral)]
        if discs.shape[0]:
            parameter = ox.Parameter("discs", shape=discs.shape, value=discs)

            def clearance(disc: Any) -> Any:
                centre = ox.Concat(
                    disc[0] + disc[2] * time[0] + disc[4] * time[0] ** 2 / 2,
                    disc[1] + disc[3] * time[0] + disc[5] * time[0] ** 2 / 2,
                )
                return ox.linalg.Norm(position - centre) - disc[6]

            constraints.append(ox.ctcs(ox.Vmap(clearance, batch=parameter) >= MARGIN))
        problem = ox.Problem(
            dynamics={
                "position": ox.Concat(speed[0] * ox.Cos(heading[0]), speed[0] * ox.Sin(heading[0])),
                "heading": curvature[0] * speed[0],
                "speed": acceleration[0],
            },
            states=[position, heading, speed],
            controls=[acceleration, curvature],
            time=time,
            constraints=constraints,
            N=nodes,
            licq_max=RELAXATION,
            algorithm=self._algorithm,
            float_dtype="float64",
        )
        problem.settings.dev.printing = False
        problem.initialize()
        return _Built(problem, set_guess, nodes)

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Solve from the states and controls of the start, with the scenario's obstacles as parameters."""
        built = self._built[_key(scenario)]
        problem = built.problem
        built.set_guess(first_guess(scenario, start).at(np.linspace(0.0, 1.0, built.nodes)))
        discs = disc_arrays(scenario)
        if discs.shape[0]:
            problem.parameters["discs"] = discs
        problem.reset()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of cvxpy, about how OpenSCvx sets sparse parameters
            answer = problem.solve(time_limit=TIME_LIMIT)
        begin = float(scenario["start"].get("time", 0.0))
        duration = float(np.ravel(answer.t_final)[0]) - begin
        nodes = answer.nodes
        controls = np.column_stack([nodes["acceleration"][:-1, 0], nodes["curvature"][:-1, 0]])
        first = np.array([*nodes["position"][0], nodes["heading"][0, 0], nodes["speed"][0, 0]])
        return Attempt(
            success=bool(answer.converged),
            position=ArcTrip(begin, first, controls, duration),
            start_time=begin,
            arrival_time=begin + duration,
            iterations=int(problem.state.k),
            detail="converged" if answer.converged else "not converged",
        )


def _key(scenario: Scenario) -> str:
    """What is compiled in: everything but the obstacles' motions and sizes."""
    return json.dumps(
        [len(scenario["obstacles"]), scenario["vehicle"], scenario["start"], scenario["goal"]], sort_keys=True
    )
