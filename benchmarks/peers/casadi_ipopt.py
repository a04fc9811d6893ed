"""CasADi + IPOPT: direct multiple shooting on the vehicle's kinematics, free final time.

States x, y, heading, speed; controls acceleration and curvature, constant over each of the equal intervals.
Over such an interval the path is an arc, and the shooting map is written down instead of integrated: with s
the distance driven and q = curvature s / 2, the chord is s sinc(q) in the direction heading + q. The series
of sinc to q^4 is exact to 1e-7 m here, cheaper than Runge-Kutta, and has no singular point.

Obstacles are parameters, so that a family is built once. The clearance holds at points close enough, and with
a margin large enough, for nearly every answer to pass the check in between.

What was tried on the reference scenarios, and kept because it was faster or succeeded more often: the
distance instead of its square as constraint (half the iterations); a monotone barrier that starts small,
with the primal warm start (a fifth of the time of the adaptive one); an elastic clearance, one slack an
obstacle with an exact penalty (a seventh of the time at 20 obstacles, where the restoration phase took over
without it; with a weight of 10 or 50 instead of 2 no more answers are certified, in up to five times the time); 40
intervals for 20 m rather than 50 (two thirds of the time for 1e-4 more travel time).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.peers.base import (
    TIME_LIMIT,
    Attempt,
    MissingPeerError,
    Scenario,
    disc_arrays,
    motion_row,
    require_plain,
)
from benchmarks.peers.starts import Start, first_guess
from scp_planner.arrays import Array

INTERVALS_PER_SECOND = 5.6  # of the trip at top speed: 40 for 20 m, 60 (the most) for 40 m
MOST_INTERVALS = 60
POINTS = 3  # clearance points an interval
MARGIN = 1e-2  # m, for what happens between the points
SMOOTHING = 1e-4  # weight of the mean squared curvature and acceleration: makes the answer unique
SLACK_WEIGHT = 2.0  # s/m, above the multipliers of the clearances in the reference scenarios
SLACK_ALLOWED = 1e-3  # m, of an answer that counts as a success
ROUNDING = 1e-8  # m2, keeps the distance differentiable at the centre

IPOPT_OPTIONS: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "linear_solver": "mumps",
    "max_iter": 300,
    "max_wall_time": TIME_LIMIT,
    "tol": 1e-5,
    "constr_viol_tol": 1e-6,
    "mu_strategy": "monotone",
    "mu_init": 1e-3,
    "warm_start_init_point": "yes",
}


class CasadiIpopt:
    """Direct multiple shooting with IPOPT."""

    name = "casadi-ipopt"
    own_starts = False

    def __init__(
        self,
        intervals: int | None = None,
        points: int = POINTS,
        margin: float = MARGIN,
        options: dict[str, Any] | None = None,
    ) -> None:

        self._intervals = intervals
        self._points = points
        self._margin = margin
        self._options = IPOPT_OPTIONS | (options or {})
        self._solvers: dict[tuple[int, int, int], Any] = {}

    def build(self, scenarios: Sequence[Scenario]) -> None:
        """One solver for each number of obstacles among the scenarios."""
        for scenario in scenarios:
            require_plain(scenario)
            key = self._key(scenario)
            if key not in self._solvers:
                self._solvers[key] = self._build(*key)

    def _key(self, scenario: Scenario) -> tuple[int, int, int]:
        """Number of obstacles, of intervals, and of conditions at the end that change with its time."""
        reach = np.subtract(scenario["goal"]["position"], scenario["start"]["position"])
        shortest = float(np.linalg.norm(reach)) / float(scenario["vehicle"]["max_speed"])
        fitting = max(10, min(MOST_INTERVALS, round(INTERVALS_PER_SECOND * (shortest + 0.5))))
        moving = 0 if scenario["goal"].get("target") is None else 4 if scenario["goal"].get("match_velocity") else 2
        return len(scenario["obstacles"]), self._intervals or fitting, moving

    def _build(self, count: int, intervals: int, moving: int) -> Any:
        try:
            import casadi as ca
        except ImportError as error:
            raise MissingPeerError("casadi is not installed: pip install casadi") from error
        points = self._points

        state, control = ca.SX.sym("state", 4), ca.SX.sym("control", 2)
        duration = ca.SX.sym("duration")
        distance = state[3] * duration + control[0] * duration**2 / 2
        half_turn = control[1] * distance / 2
        chord = distance * (1 - half_turn**2 / 6 + half_turn**4 / 120)
        after = ca.vertcat(
            state[0] + chord * ca.cos(state[2] + half_turn),
            state[1] + chord * ca.sin(state[2] + half_turn),
            state[2] + 2 * half_turn,
            state[3] + control[0] * duration,
        )
        drive = ca.Function("drive", [state, control, duration], [after])

        states = ca.SX.sym("states", 4, intervals + 1)
        controls = ca.SX.sym("controls", 2, intervals)
        total = ca.SX.sym("total")
        discs = ca.SX.sym("discs", 7, count)
        begin, target = ca.SX.sym("begin"), ca.SX.sym("target", 6)
        slack = ca.SX.sym("slack", count)
        step = total / intervals

        ends = drive.map(intervals)(states[:, :-1], controls, ca.repmat(step, 1, intervals))
        gaps = ca.vec(ends - states[:, 1:])
        lateral = ca.vertcat(ca.vec(controls[1, :] * states[3, :-1] ** 2), ca.vec(controls[1, :] * states[3, 1:] ** 2))
        clearances = []
        for k in range(intervals):
            for j in range(points):
                time = begin + step * (k + j / points)
                place = states[:2, k] if j == 0 else drive(states[:, k], controls[:, k], step * j / points)[:2]
                if k == 0 and j == 0:
                    continue
                centres = discs[0:2, :] + discs[2:4, :] * time + discs[4:6, :] * time**2 / 2
                squares = ca.sum1((ca.repmat(place, 1, count) - centres) ** 2)
                clearances.append((ca.sqrt(squares + ROUNDING) - discs[6, :]).T + slack)
        end, arrival = states[:, -1], begin + total
        place = target[0:2] + target[2:4] * arrival + target[4:6] * arrival**2 / 2
        driven = end[3] * ca.vertcat(ca.cos(end[2]), ca.sin(end[2]))
        missed = ca.vertcat(end[:2] - place, driven - target[2:4] - target[4:6] * arrival)[:moving]
        smoothing = ca.sumsqr(controls) / intervals
        problem: dict[str, Any] = {
            "x": ca.vertcat(ca.vec(states), ca.vec(controls), slack, total),
            "p": ca.vertcat(begin, target, ca.vec(discs)),
            "f": total + SMOOTHING * smoothing + SLACK_WEIGHT * ca.sum1(slack),
            "g": ca.vertcat(gaps, missed, lateral, *clearances),
        }
        options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": self._options}
        return ca.nlpsol("planner", "ipopt", problem, options)

    def solve(self, scenario: Scenario, start: Start) -> Attempt:
        """Solve from the states and controls of the start."""
        count, intervals, moving = self._key(scenario)
        solver = self._solvers[count, intervals, moving]
        vehicle = scenario["vehicle"]
        begin = float(scenario["start"].get("time", 0.0))
        guess = first_guess(scenario, start)
        nodes = guess.at(np.linspace(0.0, 1.0, intervals + 1))
        middles = guess.at((np.arange(intervals) + 0.5) / intervals)
        controls = np.column_stack([middles.accelerations, middles.curvatures])

        discs = disc_arrays(scenario)
        discs[:, 6] += self._margin
        free = np.inf
        lower_states = np.tile([-free, -free, -free, 0.0], (intervals + 1, 1))
        upper_states = np.tile([free, free, free, float(vehicle["max_speed"])], (intervals + 1, 1))
        place, heading = scenario["start"]["position"], scenario["start"].get("heading")
        for bound, unbounded in ((lower_states, -free), (upper_states, free)):
            bound[0] = [*place, unbounded if heading is None else heading, scenario["start"]["speed"]]
            if not moving:
                bound[-1, :2] = scenario["goal"]["position"]
        target = motion_row(scenario["goal"]["target"]["motion"]) if moving else [0.0] * 6
        equalities = np.zeros(4 * intervals + moving)
        bend = _or_infinity(vehicle.get("max_curvature"))
        lateral = _or_infinity(vehicle.get("max_lateral_acceleration"))
        lower_controls = np.tile([-float(vehicle["max_deceleration"]), -bend], intervals)
        upper_controls = np.tile([float(vehicle["max_acceleration"]), bend], intervals)
        clearances = (intervals * self._points - 1) * count
        answer = solver(
            x0=np.concatenate([nodes.states.ravel(), controls.ravel(), np.full(count, 1e-2), [guess.duration]]),
            p=np.concatenate([[begin], target, discs.ravel()]),
            lbx=np.concatenate([lower_states.ravel(), lower_controls, np.zeros(count), [0.1]]),
            ubx=np.concatenate([upper_states.ravel(), upper_controls, np.full(count, free), [10.0 * guess.duration]]),
            lbg=np.concatenate([equalities, np.full(2 * intervals, -lateral), np.zeros(clearances)]),
            ubg=np.concatenate([equalities, np.full(2 * intervals, lateral), np.full(clearances, free)]),
        )
        statistics = solver.stats()
        found = np.asarray(answer["x"], dtype=float).ravel()
        split = 4 * (intervals + 1)
        trip = ArcTrip(begin, found[:4], found[split : split + 2 * intervals].reshape(-1, 2), float(found[-1]))
        slack = float(found[split + 2 * intervals : -1].max(initial=0.0))
        return Attempt(
            success=bool(statistics["success"]) and slack <= SLACK_ALLOWED,
            position=trip,
            start_time=begin,
            arrival_time=begin + trip.duration,
            iterations=int(statistics["iter_count"]),
            detail=f"{statistics['return_status']}, slack {slack:.1e} m",
        )


def _or_infinity(limit: float | None) -> float:
    return np.inf if limit is None else float(limit)


class ArcTrip:
    """The trip that constant controls drive: exact arcs, from the first state on."""

    def __init__(self, begin: float, first: Array, controls: Array, duration: float) -> None:
        """Take the state (4,) at time ``begin`` and controls (n, 2), each held for duration / n."""
        self.duration = duration
        self._begin = begin
        self._controls = controls
        self._step = duration / controls.shape[0]
        states = [np.asarray(first, dtype=float)]
        for control in controls:
            states.append(_drive(states[-1][None], control[None], np.array([self._step]))[0])
        self._states = np.array(states)

    def __call__(self, times: Array) -> Array:
        """Positions (n, 2) at times (n,)."""
        elapsed = np.asarray(times, dtype=float) - self._begin
        interval = np.clip((elapsed / self._step).astype(int), 0, self._controls.shape[0] - 1)
        inside = elapsed - interval * self._step
        return _drive(self._states[interval], self._controls[interval], inside)[:, :2]


def _drive(states: Array, controls: Array, duration: Array) -> Array:
    distance = states[:, 3] * duration + controls[:, 0] * duration**2 / 2.0
    half_turn = controls[:, 1] * distance / 2.0
    chord = distance * np.sinc(half_turn / np.pi)
    direction = states[:, 2] + half_turn
    return np.column_stack(
        [
            states[:, 0] + chord * np.cos(direction),
            states[:, 1] + chord * np.sin(direction),
            states[:, 2] + 2.0 * half_turn,
            states[:, 3] + controls[:, 0] * duration,
        ]
    )
