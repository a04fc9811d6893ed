"""Bank of Kalman filters of many tracks: weights by likelihood, prior by class, hazard of a change of motion.

Members are random walks of velocity of several diffusions, standing, and oscillators about a walk. Each track is in a
slot, the last axis of all arrays. Axes are those in which the declared noise of the track is independent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from scp_planner.arrays import Array, Index, Mask, grown, run_of
from scp_planner.tracking.tolerances import LEAST_DEVIATION


@dataclass(frozen=True)
class BankParameters:
    # Diffusions of the members, as multiples of the expected one of the track's class
    diffusions: tuple[float, ...] = tuple(10.0 ** (0.6 * k - 4.0) for k in range(11))
    hazard: float = 0.1  # Changes of motion per unit of time
    spread: float = 0.2  # Share of the prior that is uniform over the logarithm of the diffusion
    standing: float = 0.25  # Prior probability that a track stands
    weaving: float = 0.05  # Prior probability that it weaves
    # Periods of the oscillators, as multiples of the time that a tentative track takes to its velocity
    periods: tuple[float, ...] = (0.83, 1.17, 1.6, 2.2)
    swing: float = 0.09  # Standard deviation of a swing, as a multiple of the way in that time
    damping: float = 0.03  # Damping ratio of a swing
    course: float = 0.01  # Diffusion of an oscillator's course, as a multiple of that of tentative tracks
    memory: float = 40.0  # Units of time in which it fades how restless a track was
    nodes: tuple[float, ...] = (0.125, 0.375, 0.625, 0.875)  # Shares of a lead at which a standing track sets out


BANK = BankParameters()
WALKS = len(BANK.diffusions)
STANDS = WALKS  # Index of the member that stands
MEMBERS = WALKS + 1 + len(BANK.periods)
COMPONENTS = MEMBERS + len(BANK.nodes)


@dataclass(frozen=True)
class TrackPrior:
    """Prior of the motion of a class of obstacles."""

    diffusion: float  # m^2/s^3
    degrees: float  # of freedom of the inverse gamma law of the diffusion; inf: it is known
    velocity_deviation: float  # m/s
    acceleration: float  # m/s^2, standard deviation of a component when an obstacle sets out

    @property
    def weights(self) -> Array:
        """Prior probability of each member."""
        ratio = np.array(BANK.diffusions)
        half = 0.5 * min(self.degrees, 100.0)
        log = -half * (np.log(ratio) + 1.0 / ratio)
        known = np.exp(log - log.max())
        walks = (1.0 - BANK.spread) * known / known.sum() + BANK.spread / WALKS
        others = 1.0 - BANK.standing - BANK.weaving
        swings = np.full(len(BANK.periods), BANK.weaving / len(BANK.periods))
        return np.concatenate([others * walks, [BANK.standing], swings])


@dataclass
class Filters:
    """States of M filters of n tracks: position and velocity of a course, and a swing about it where there is one."""

    mean: Array  # (d, 2, M, n) m, m/s
    spread: Array  # (d, d, 2, M, n)
    diffusion: Array  # (M, n) m^2/s^3
    rate: Array  # (M, 1) rad/s, of swings
    swing: float = 0.0  # m, standard deviation

    def taken(self, slots: Index) -> Self:
        """Copy the states of some slots."""
        some = run_of(slots)
        mean, spread, diffusion = (np.array(each[..., some]) for each in (self.mean, self.spread, self.diffusion))
        return replace(self, mean=mean, spread=spread, diffusion=diffusion)

    def put(self, slots: Index, part: Self) -> None:
        run = run_of(slots)
        for name in ("mean", "spread", "diffusion"):
            getattr(self, name)[..., run] = getattr(part, name)

    def grow(self, size: int) -> None:
        for name in ("mean", "spread", "diffusion"):
            setattr(self, name, grown(getattr(self, name), size))

    def begin(self, slots: Index, positions: Array, noise: Array, velocity_variance: Array, diffusion: Array) -> None:
        """Begin at positions (2, n), m, seen with variances (2, n), m^2; velocities (M, n) m^2/s^2 are unknown."""
        self.mean[..., slots], self.spread[..., slots] = 0.0, 0.0
        self.mean[0][..., slots] = positions[:, None]
        self.spread[0, 0][..., slots] = noise[:, None]
        self.spread[1, 1][..., slots] = velocity_variance
        self.diffusion[..., slots] = diffusion
        for k in range(2, len(self.mean)):
            self.spread[k, k][..., slots] = self.swing**2

    def _moved(self, values: Array, lag: Array, turn: tuple[Array, Array] | None) -> Array:
        """Apply the transition over lags (n,) along the first axis."""
        moved = np.empty_like(values)
        moved[0], moved[1] = values[0] + lag * values[1], values[1]
        if turn is not None:
            cosine, sine = turn
            moved[2], moved[3] = cosine * values[2] + sine * values[3], cosine * values[3] - sine * values[2]
        return moved

    def predict(self, lag: Array) -> None:
        """Move on by lags (n,), s."""
        turn, kept = None, None
        if len(self.mean) > 2:
            kept = np.exp(-BANK.damping * self.rate * lag)
            turn = kept * np.cos(self.rate * lag), kept * np.sin(self.rate * lag)
        self.mean = self._moved(self.mean, lag, turn)
        self.spread = self._moved(self._moved(self.spread, lag, turn).swapaxes(0, 1), lag, turn)
        grown_by = self.diffusion * lag
        self.spread[1, 1] += grown_by
        grown_by = grown_by * (0.5 * lag)
        self.spread[0, 1] += grown_by
        self.spread[1, 0] += grown_by
        self.spread[0, 0] += grown_by * (lag * (2.0 / 3.0))
        if kept is not None:
            more = self.swing**2 * (1.0 - kept * kept)
            self.spread[2, 2] += more
            self.spread[3, 3] += more

    @property
    def position(self) -> tuple[Array, Array]:
        """Expected positions (2, M, n), m, and their variances, m^2."""
        if len(self.mean) == 2:
            return self.mean[0], self.spread[0, 0]
        variance = self.spread[0, 0] + 2.0 * self.spread[0, 2] + self.spread[2, 2]
        return self.mean[0] + self.mean[2], variance

    def update(self, positions: Array, noise: Array) -> Array:
        """Take in positions (2, n), m, with variances (2, n), m^2; return the log likelihoods, (M, n)."""
        expected, spread = self.position
        innovation, variance = positions[:, None] - expected, spread + noise[:, None]
        column = self.spread[:, 0] if len(self.mean) == 2 else self.spread[:, 0] + self.spread[:, 2]
        gain = column / variance
        self.mean += gain * innovation
        rest = noise[:, None] * gain[0] if len(self.mean) == 2 else None  # of the position: never 0 by rounding
        self.spread -= gain[:, None] * column
        if rest is not None:
            self.spread[0, 0] = rest
        return -0.5 * (innovation * innovation / variance + np.log(variance)).sum(axis=0)


@dataclass(frozen=True)
class Mixture:
    """Predicted positions of n tracks as mixtures of normal components, all about their mean."""

    center: Array  # (2, n) m
    variance: Array  # (2, C, n) m^2, with the scatter of the members' means
    weight: Array  # (C, n)

    def tail(self, offset: Array, noise: Array | None = None) -> Array:
        """Probability to be farther off than offsets (2, n), m, seen with variances (2, n) m^2: (n,)."""
        variance = self.variance if noise is None else self.variance + noise[:, None]
        squares = (offset * offset)[:, None] / variance
        return np.asarray((self.weight * np.exp(-0.5 * (squares[0] + squares[1]))).sum(axis=0))

    def radii(self, alpha: Array) -> Array:
        """Half axes (2, n), m, of the regions where the tail is at least alpha, (n,)."""
        if len(self.variance) == 2 and (self.variance[0] == self.variance[1]).all():  # no direction is another
            return np.repeat(replace(self, variance=self.variance[:1]).radii(alpha), 2, axis=0)
        squares = self.variance * (-2.0 * np.log(np.minimum(alpha, 1.0)))
        least, most = np.zeros((len(squares), len(alpha))), squares.max(axis=1, initial=0.0)
        for _ in range(_HALVINGS):
            middle = 0.5 * (least + most)
            far = (self.weight * np.exp(-0.5 * middle[:, None] / self.variance)).sum(axis=1) > alpha
            least, most = np.where(far, middle, least), np.where(far, most, middle)
        return np.asarray(np.sqrt(most))


_HALVINGS = 24
_TINY = float(np.finfo(float).tiny)


class FilterBank:
    """Filters of K tracks, each in a slot."""

    def __init__(self, velocity_deviation: float, acceleration_deviation: float, hazard: float = BANK.hazard) -> None:
        time = velocity_deviation / acceleration_deviation
        self.hazard = hazard
        rates = 2.0 * np.pi / (time * np.array(BANK.periods))[:, None]
        m = WALKS + 1
        self.walks = Filters(np.zeros((2, 2, m, 0)), np.zeros((2, 2, 2, m, 0)), np.zeros((m, 0)), np.zeros((m, 1)))
        k = len(rates)
        swing = BANK.swing * velocity_deviation * time
        empty = np.zeros((4, 2, k, 0)), np.zeros((4, 4, 2, k, 0)), np.zeros((k, 0))
        self.swings = Filters(*empty, rates, swing)
        self.course = BANK.course * velocity_deviation * acceleration_deviation
        self.log_weight, self.prior = np.zeros((2, MEMBERS, 0))
        self.last, self.stood, self.acceleration, self.restless = np.zeros((4, 0))
        self.count = np.zeros(0, dtype=np.intp)

    @property
    def size(self) -> int:
        return len(self.last)

    def grow(self, size: int) -> None:
        for name in ("log_weight", "prior", "last", "stood", "acceleration", "restless", "count"):
            setattr(self, name, grown(getattr(self, name), size))
        self.walks.grow(size)
        self.swings.grow(size)

    def begin(self, slots: Index, times: Array, positions: Array, noise: Array, priors: list[TrackPrior]) -> None:
        """Begin tracks at their first positions (2, n), m, seen with variances (2, n), m^2."""
        velocity = np.array([one.velocity_deviation**2 for one in priors])
        diffusion = np.array([one.diffusion for one in priors])
        ratio = np.append(BANK.diffusions, 0.0)[:, None]
        self.walks.begin(slots, positions, noise, velocity * (ratio > 0.0), diffusion * ratio)
        self.swings.begin(slots, positions, noise, velocity, np.full_like(diffusion, self.course))
        self.prior[:, slots] = np.stack([one.weights for one in priors], axis=1)
        self.log_weight[:, slots] = np.log(self.prior[:, slots])
        self.acceleration[slots] = [one.acceleration for one in priors]
        self.last[slots], self.stood[slots], self.restless[slots], self.count[slots] = times, 0.0, 0.0, 1

    def update(self, slots: Index, times: Array, positions: Array, noise: Array) -> None:
        """Take in newer positions (2, n), m, with variances (2, n), m^2."""
        lag = times - self.last[slots]
        walks, swings = self.walks.taken(slots), self.swings.taken(slots)
        walks.predict(lag)
        swings.predict(lag)
        log = self._changed(slots, lag) + np.concatenate(
            [walks.update(positions, noise), swings.update(positions, noise)]
        )
        log -= log.max(axis=0)
        log -= np.log(np.exp(log).sum(axis=0))
        self.log_weight[:, slots] = log
        shown = (np.exp(log[:STANDS]) * walks.diffusion[:STANDS]).sum(axis=0)
        fading = np.maximum(-np.expm1(-lag / BANK.memory), 1.0 / (self.count[slots] + 1.0))
        self.restless[slots] += fading * (shown - self.restless[slots])
        self.walks.put(slots, walks)
        self.swings.put(slots, swings)
        self.last[slots] = times
        self.count[slots] += 1

    def _changed(self, slots: Index, lag: Array) -> Array:
        """Log weights after lags (n,), s, in which motions may have changed."""
        weight = np.exp(self.log_weight[:, slots])
        leaving = -np.expm1(-self.hazard * lag) * weight
        leaving[STANDS] = (
            weight[STANDS] * lag / np.maximum(self.stood[slots] + 2.0 * lag, _TINY)
        )  # the rule of succession
        stays = weight[STANDS] - leaving[STANDS]
        weight = weight - leaving + leaving.sum(axis=0) * self.prior[:, slots]
        share = stays / np.maximum(weight[STANDS], _TINY)
        self.stood[slots] = (self.stood[slots] + lag) * np.minimum(share, 1.0)
        return np.asarray(np.log(weight))

    def weights(self, slots: Index) -> Array:
        """Probabilities of the members, (MEMBERS, n)."""
        return np.asarray(np.exp(self.log_weight[:, slots]))

    def stands(self, slots: Index) -> Mask:
        """True if a track is more likely to stand than not, (n,)."""
        return np.asarray(self.log_weight[STANDS, slots] > np.log(0.5))

    def predicted(self, slots: Index, lead: Array) -> Mixture:
        """Predict positions of slots (n,), leads (n,), s, after their last measurements."""
        return self.snapshot(slots).predicted(lead)

    def snapshot(self, slots: Index) -> Snapshot:
        return Snapshot(
            self.walks.taken(slots),
            self.swings.taken(slots),
            self.weights(slots),
            self.stood[slots],
            self.acceleration[slots],
            self.last[slots],
        )

    def velocity(self, slots: Index) -> Mixture:
        """Velocities of the courses."""
        walks, swings, weight = self.walks, self.swings, self.weights(slots)
        mean = np.concatenate([walks.mean[1][..., slots], swings.mean[1][..., slots]], axis=1)
        variance = np.concatenate([walks.spread[1, 1][..., slots], swings.spread[1, 1][..., slots]], axis=1)
        return _about_mean(mean, variance, weight)


@dataclass
class Snapshot:
    """Filters of n tracks as they were at a time, to predict from."""

    walks: Filters
    swings: Filters
    weight: Array  # (MEMBERS, n)
    stood: Array  # (n,) s
    acceleration: Array  # (n,) m/s^2
    time: Array  # (n,) s

    def taken(self, some: Index) -> Snapshot:
        """Copy some of the tracks."""
        rest = {name: getattr(self, name)[..., some] for name in ("weight", "stood", "acceleration", "time")}
        return Snapshot(self.walks.taken(some), self.swings.taken(some), **rest)

    def predicted(self, lead: Array) -> Mixture:
        """Predict positions after leads (n,), s."""
        walks, swings = replace(self.walks), replace(self.swings)
        walks.predict(lead)
        swings.predict(lead)
        (one, two), (three, four) = walks.position, swings.position
        mixture = _about_mean(np.concatenate([one, three], axis=1), np.concatenate([two, four], axis=1), self.weight)
        # Stands on, or sets out within the lead (the rule of succession) and then accelerates in any direction.
        stands, total = self.weight[STANDS], np.maximum(self.stood + lead, _TINY)
        weight = self.weight.copy()
        weight[STANDS] = stands * self.stood / total
        left = 1.0 - np.array(BANK.nodes)[:, None]
        ramp = 0.5 * self.acceleration * (left * lead) ** 2
        variance = mixture.variance[:, STANDS, None] + ramp * ramp
        each = np.broadcast_to(stands * lead / total / len(BANK.nodes), ramp.shape)
        return Mixture(
            mixture.center,
            np.concatenate([mixture.variance, variance], axis=1),
            np.concatenate([weight, each]),
        )


def _about_mean(mean: Array, variance: Array, weight: Array) -> Mixture:
    center = (weight * mean).sum(axis=1)
    apart = mean - center[:, None]
    return Mixture(center, np.maximum(variance + 0.5 * (apart * apart).sum(axis=0), LEAST_DEVIATION**2), weight)
