"""Where an obstacle is expected, and how sure that is, from noisy positions or from what a tracker says.

Independent of the package's filter: motions with process noise are Gaussian processes here. Each component of the
state z obeys dz = A z dt + b dW; it starts at the first observation from an unknown position, about which nothing is
known, and a prior of all else. So an observed position is that constant plus a process of known covariance plus noise,
and the state at the last observation follows by generalised least squares for the constant and regression on the
residuals (universal kriging). From there matrix exponentials carry it on, with the noise by Van Loan's integral.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

from verification.differences import Array

FORECAST_TIMES = 2001  # over which centres and covariances are computed; cubic in between


@dataclass(frozen=True)
class Forecast:
    """Expected centres (n, 2), m, and covariances of their errors (n, 2, 2), m2."""

    centres: Array
    errors: Array


@dataclass(frozen=True)
class System:
    """One component of a motion dz = drift z dt + push dW, position first.

    Attributes
    ----------
    drift : (d, d)
    push : (d,)
    prior : (d, d)
        Covariance of the state before anything was seen, with nothing for the position.
    """

    drift: Array
    push: Array
    prior: Array

    def step(self, lag: float) -> tuple[Array, Array]:
        """Transition (d, d) over a lag, s, and the covariance (d, d) that noise adds, by Van Loan's block matrix."""
        d = len(self.push)
        block = np.zeros((2 * d, 2 * d))
        block[:d, :d] = -self.drift
        block[:d, d:] = np.outer(self.push, self.push)
        block[d:, d:] = self.drift.T
        whole = expm(block * lag)
        transition = whole[d:, d:].T
        return transition, transition @ whole[:d, d:]


def system_of(model: Mapping[str, Any]) -> System:
    """Make the system that a process model describes."""
    process, velocity = model["process"], float(model["velocity_deviation"]) ** 2
    kind = process["kind"]
    if kind == "random_walk":
        drift, push, prior = np.zeros((2, 2)), np.zeros(2), np.diag([0.0, velocity])
        drift[0, 1], push[1] = 1.0, np.sqrt(process["diffusion"])
        return System(drift, push, prior)
    drift, push, prior = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    drift[0, 1] = 1.0
    if kind == "mean_reverting":
        rate, diffusion = 1.0 / process["time_constant"], process["diffusion"]
        drift[1, 1], drift[1, 2], push[1] = -rate, rate, np.sqrt(diffusion)
        prior[1:, 1:] = velocity
        prior[1, 1] += diffusion / (2.0 * rate)
        return System(drift, push, prior)
    drift[1, 2] = 1.0
    if kind == "singer":
        deviation, rate = process["deviation"], 1.0 / process["time_constant"]
        drift[2, 2], push[2] = -rate, deviation * np.sqrt(2.0 * rate)
    else:
        deviation, push[2] = process["acceleration_deviation"], np.sqrt(process["diffusion"])
    return System(drift, push, np.diag([0.0, velocity, deviation**2]))


def predicted(obstacle: Mapping[str, Any], times: Array) -> Forecast:
    """Foretell an obstacle with process noise, or one of which a tracker says the state, at times (n,) s."""
    if obstacle.get("estimate") is not None:
        return _from_tracker(obstacle["estimate"], obstacle.get("model") or {}, times)
    seen, model = obstacle["observations"], obstacle["model"]["process"]
    clock = np.asarray(seen["time"], dtype=float)
    given = seen.get("covariance")
    if given is None:
        given = float(model["noise_deviation"]) ** 2 * np.eye(2)
    noise = np.broadcast_to(np.asarray(given, dtype=float), (len(clock), 2, 2))
    system = system_of(model)
    mean, covariance = _last_state(system, clock, np.asarray(seen["position"], dtype=float), noise)
    return _carried_on(system, mean, covariance, float(clock[-1]), times, model.get("tails"))


def _last_state(system: System, clock: Array, seen: Array, noise: Array) -> tuple[Array, Array]:
    """State (d, 2) at the last of some observations (n, 2), and its covariance (d, 2, d, 2)."""
    n, d = len(clock), len(system.push)
    states, transitions = [system.prior], []
    for lag in np.diff(clock):
        move, added = system.step(float(lag))
        transitions.append(move)
        states.append(move @ states[-1] @ move.T + added)
    among = np.zeros((n, n))  # covariances of the positions, but for the unknown constant
    to_last = np.zeros((d, n))  # of the state at the last one with these
    for i in range(n):
        since = states[i][:, 0]
        among[i, i] = since[0]
        for j in range(i + 1, n):
            since = transitions[j - 1] @ since
            among[i, j] = among[j, i] = since[0]
        to_last[:, i] = since
    two = np.eye(2)
    covariance = np.kron(among, two)
    for i in range(n):
        covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += noise[i]
    inverse = np.linalg.inv(covariance)
    constant, own = (
        np.kron(np.ones((n, 1)), two),
        np.kron(np.eye(d, 1), two),
    )  # how it enters what is seen, and the state
    gain = np.kron(to_last, two) @ inverse
    spread = np.linalg.inv(constant.T @ inverse @ constant)
    origin = spread @ constant.T @ inverse @ seen.ravel()
    mean = own @ origin + gain @ (seen.ravel() - constant @ origin)
    rest = own - gain @ constant
    error = np.kron(states[-1], two) - gain @ np.kron(to_last, two).T + rest @ spread @ rest.T
    return mean.reshape(d, 2), np.asarray(error, dtype=float).reshape(d, 2, d, 2)


def _carried_on(
    system: System, mean: Array, covariance: Array, last: float, times: Array, tails: Mapping[str, Any] | None
) -> Forecast:
    """Positions at times from a state (d, 2) at one and its covariance (d, 2, d, 2)."""
    from scipy.interpolate import CubicSpline

    clock = np.linspace(max(last, float(times[0])), float(times[-1]), FORECAST_TIMES)
    centres, errors = np.empty((len(clock), 2)), np.empty((len(clock), 2, 2))
    hop, hop_noise = system.step(float(clock[1] - clock[0]))
    move, added = system.step(float(clock[0]) - last)
    for k in range(len(clock)):
        if k:
            move, added = hop @ move, hop @ added @ hop.T + hop_noise
        centres[k] = move[0] @ mean
        errors[k] = np.einsum("i,iajb,j->ab", move[0], covariance, move[0]) + added[0, 0] * np.eye(2)
    found = CubicSpline(clock, errors.reshape(-1, 4))(times).reshape(-1, 2, 2)
    if tails is not None:
        found *= np.interp(times - last, tails["lead_time"], tails["inflation"])[:, None, None]
    return Forecast(CubicSpline(clock, centres)(times), found)


def _from_tracker(said: Mapping[str, Any], model: Mapping[str, Any], times: Array) -> Forecast:
    """Go on from a state that is given at a time, with its covariance."""
    known = [said[key] for key in ("position", "velocity", "acceleration") if said.get(key) is not None]
    mean, last = np.asarray(known, dtype=float), float(said["time"])
    covariance = np.asarray(said["covariance"], dtype=float).reshape(len(mean), 2, len(mean), 2)
    if model.get("process") is not None:
        return _from_tracker_with_process(mean, covariance, last, model["process"], times)
    terms = min(int(model.get("order", 2)) + 1, len(mean))
    lag = times - last
    powers = np.stack([np.ones_like(lag), lag, 0.5 * lag**2], axis=1)[:, :terms]
    errors = np.einsum("ni,iajb,nj->nab", powers, covariance[:terms, :, :terms], powers)
    noise = covariance[0, :, 0]
    change = float(model.get("manoeuvre") or 0.0) ** 2 * noise / np.linalg.eigvalsh(noise)[0]
    return Forecast(powers @ mean[:terms], errors + (lag**4 / 4.0)[:, None, None] * change)


def _from_tracker_with_process(
    mean: Array, covariance: Array, last: float, model: Mapping[str, Any], times: Array
) -> Forecast:
    """Go on with process noise: what the tracker does not say is normal, given what it says of the same component.

    Before anything is seen, position aside, the state is normal with the prior; the rest of it given its first
    components follows by regression.
    """
    system, known = system_of(model), len(mean)
    d = len(system.push)
    keep = min(known, 2 if model["process"]["kind"] == "mean_reverting" else d)
    matrix, own = np.zeros((d, known)), np.zeros((d, d))
    matrix[:keep, :keep] = np.eye(keep)
    if keep < d:
        given, rest = slice(1, keep), slice(keep, d)
        share = np.linalg.solve(system.prior[given, given], system.prior[given, rest]).T
        matrix[rest, given] = share
        own[rest, rest] = system.prior[rest, rest] - share @ system.prior[given, rest]
    state = np.einsum("ij,jakb,lk->ialb", matrix, covariance, matrix)
    state += np.einsum("il,ab->ialb", own, np.eye(2))
    return _carried_on(system, matrix @ mean, state, last, times, model.get("tails"))
