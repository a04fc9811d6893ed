"""Zones of many obstacles at once: polynomial motions of one order whose noise is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial

import numpy as np

from scp_planner.arrays import Array, Index
from scp_planner.estimation.confidence import alpha_of_one, uniform_scale
from scp_planner.estimation.error_laws import NormalErrors
from scp_planner.estimation.motion_estimate import POLYNOMIAL_TERMS, standardised_speed
from scp_planner.estimation.recursive import SquareRoots
from scp_planner.mathematics.polynomials import PiecewisePolynomials, shift_matrices
from scp_planner.mathematics.quadrature import gauss_rule
from scp_planner.online.foretold import Later, Pieces, Prediction
from scp_planner.online.mixtures import Mixture, even
from scp_planner.online.suspicions import Suspicions
from scp_planner.online.track import ObstacleTrack
from scp_planner.scenario.models import Confidence, ConfidenceLevel
from scp_planner.threat_zones.of_scenario import HORIZON
from scp_planner.threat_zones.zone import ThreatZone

PANELS, NODES = 4, 12  # of the quadrature of standardised lengths


_NORMAL = NormalErrors()


@dataclass(frozen=True)
class Level:
    """The level of confidence that zones are made for.

    Attributes
    ----------
    confidence : Confidence
    estimated : int
        How many obstacles are not known exactly.
    """

    confidence: Confidence
    estimated: int

    @cached_property
    def alpha(self) -> float:
        """The probability that one obstacle may be outside with, at one time or at any by the level."""
        return alpha_of_one(str(self.confidence.level), self.confidence.probability, self.estimated)

    def scales(self, count: int, lengths: Callable[[], Array], terms: int | None = None) -> Array:
        """Give q for so many motions of known noise, (n,).

        Parameters
        ----------
        count : int
            n.
        lengths : callable
            Gives their standardised lengths, (n,): what holds at one time does not depend on them.
        terms : int or None
            Of motions that are polynomials.

        Returns
        -------
        (n,) array
        """
        if self.confidence.level is ConfidenceLevel.PER_TIME:
            return np.full(count, _NORMAL.pointwise_scale(self.alpha))
        every = lengths().tolist()  # who has been seen together for as long has the same
        found = {one: uniform_scale(self.alpha, one, _NORMAL, terms) for one in set(every)}
        return np.array([found[one] for one in every])


def zones_together(
    tracks: Sequence[ObstacleTrack],
    roots: SquareRoots,
    start: float,
    level: Level,
    manoeuvre: float = 0.0,
    suspicions: Suspicions | None = None,
    sizing: Sizing | None = None,
) -> list[ThreatZone]:
    """Make the zones of polynomial motions of one order whose noise is known, all at once.

    Parameters
    ----------
    tracks : sequence of ObstacleTrack
    roots : SquareRoots
        What their estimates are made from.
    start : float
        Absolute time from which on the zones hold, s.
    level : Level
    manoeuvre : float
        Standard deviation of a change of acceleration that may begin with the last observation, m/s^2.
    suspicions : Suspicions, optional
        Changes of acceleration that are likely by now.
    sizing : Sizing, optional

    Returns
    -------
    list of ThreatZone
        One for each track, in order.
    """
    order = tracks[0].model.order
    middle = roots.center
    first = np.array([track.times[0] for track in tracks])
    last = np.array([track.times[-1] for track in tracks])
    inverse = np.linalg.inv(roots.factor)
    spread, coefficients = inverse @ inverse.transpose(0, 2, 1), inverse @ roots.right
    sigma = np.array([track.covariance for track in tracks])
    sigma *= np.array([track.noise_factor for track in tracks])[:, None, None]
    if manoeuvre > 0.0:
        order = 2
        spread, coefficients = _with_manoeuvre(spread, coefficients, last - middle, manoeuvre**2 / _least(sigma))
    if suspicions is not None and suspicions.probability.any():
        order = 2
        spread = _padded(spread, 3) + suspicions.spread
        coefficients = _padded(coefficients, 2) + suspicions.shift
    shift = shift_matrices(order + 1, start - middle)
    count, terms = len(tracks), order + 1
    center = shift @ coefficients
    center[:, 0] += roots.origin
    local = shift @ spread @ shift.transpose(0, 2, 1)
    growth = local.reshape(count, -1) @ _products(terms)
    noise = sigma[:, [0, 0, 1], [0, 1, 1]]

    def lengths() -> Array:
        clocks = np.stack([first, last, middle])
        alike = bool((clocks == clocks[:, :1]).all() and (spread == spread[0]).all())  # all were seen at the same times
        some = slice(1 if alike else None)
        (begin, end, own), each = clocks[:, some], spread[some]
        half, about = np.where(end > begin, 0.5 * (end - begin), 1.0), 0.5 * (begin + end)
        shift = _shift(order, about - own, half)
        found = _lengths(
            shift @ each @ shift.transpose(0, 2, 1), (start - about) / half, (start + HORIZON - about) / half
        )
        return np.repeat(found, count) if alike else found

    covariance = growth[:, :, None] * noise[:, None]
    future = Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None])
    return made_zones(tracks, future, level.scales(count, lengths, terms), sizing)


@dataclass(frozen=True)
class Sizing:
    """What regions of n obstacles are sized by, see `scp_planner.online.regions`.

    Attributes
    ----------
    leads : (n, H) array
        Times ahead for which sizes are known, s; all but the first are the same for all.
    kinds : (n,) array of int
        Of the predictions.
    sizes : (n, H) array
        Linear between leads; see `scp_planner.estimation.conformal.sized`.
    """

    leads: Array
    kinds: Index
    sizes: Array

    def among(self, some: Index) -> Sizing:
        """Those of some obstacles."""
        return Sizing(self.leads[some], self.kinds[some], self.sizes[some])

    @cached_property
    def others(self) -> Index:
        """Those whose regions are not right as they are."""
        return np.flatnonzero((self.sizes != 1.0).any(axis=1))


@dataclass(frozen=True)
class Future:
    """Where K obstacles are expected, as polynomials of the time since the beginning of each of S pieces.

    Attributes
    ----------
    breaks : (S + 1,) array
        Absolute times, s.
    centers : (K, S, P, 2) array
        m.
    covariances : (K, S, Q, 3) array
        Elements xx, xy, yy, not scaled, m^2.
    """

    breaks: Array
    centers: Array
    covariances: Array


def zones_of_mixtures(
    tracks: Sequence[ObstacleTrack], mixtures: Mixture, start: float, level: Level, sizing: Sizing | None = None
) -> list[ThreatZone]:
    """Make the zones of motions that mixtures of filters predict, all at once.

    Parameters
    ----------
    tracks : sequence of ObstacleTrack
    mixtures : Mixture
        Of each, at the start.
    start : float
        Absolute time from which on the zones hold, s.
    level : Level
    sizing : Sizing, optional

    Returns
    -------
    list of ThreatZone
    """
    scales = level.scales(len(tracks), partial(lengths_of, mixtures))
    return made_zones(tracks, future_of(mixtures, start), scales, sizing)


def future_of(mixtures: Mixture, start: float) -> Future:
    """What mixtures predict from a time on, s, at which they are given: one piece."""
    center = mixtures.mean / np.array([1.0, 1.0, 2.0])[:, None]
    covariance = mixtures.errors[:, :, [0, 0, 1], [0, 1, 1]]
    return Future(np.array([start, start + HORIZON]), center[:, None], covariance[:, None])


def lengths_of(mixtures: Mixture) -> Array:
    """Standardised lengths over `HORIZON` of what K mixtures predict, (K,)."""
    p, (swerve, jerk) = mixtures.covariance, mixtures.noises
    # of the error with its rate, where the two parts of the mixed terms differ
    cross = np.stack(
        [
            p[:, 0, :, 1],
            p[:, 1, :, 1] + p[:, 0, :, 2],
            p[:, 1, :, 2] + 0.5 * p[:, 2, :, 1] + 0.5 * swerve,
            0.5 * p[:, 2, :, 2],
            jerk / 8.0,
        ],
        axis=1,
    )
    rate = np.stack([p[:, 1, :, 1], 2.0 * even(p[:, 1, :, 2]) + swerve, p[:, 2, :, 2], jerk / 3.0], axis=1)
    return lengths_of_polynomials(mixtures.errors, cross, rate)


def times_linear(
    covariances: PiecewisePolynomials, leads: Array, factors: Array, added: Array | None = None
) -> PiecewisePolynomials:
    """Multiply covariances by factors that are linear between leads after their start, and constant after the last.

    Parameters
    ----------
    covariances : PiecewisePolynomials
        Of K zones over the same pieces: entries xx, xy, yy.
    leads : (H,) array
        s, from 0 on, increasing.
    factors : (K, H) array
    added : (K, H) array, optional
        What is then added to the variances in every direction, m^2, linear between leads too.

    Returns
    -------
    PiecewisePolynomials
        Of K zones, over the same pieces as each other.
    """
    breaks, whole = covariances.breakpoints[0], covariances.coefficients
    edges = np.unique(np.concatenate([breaks, breaks[0] + leads[breaks[0] + leads < breaks[-1]]]))
    begins, widths = edges[:-1], np.diff(edges)
    piece = np.searchsorted(breaks, begins, "right") - 1
    weights = np.array([np.interp(edges - breaks[0], leads, one) for one in np.eye(len(leads))])
    shifted = shift_matrices(whole.shape[2], begins - breaks[piece]) @ whole[:, piece]
    product = np.zeros((len(whole), len(begins), whole.shape[2] + 1, whole.shape[3]))
    at = factors @ weights
    product[:, :, :-1] = at[:, :-1, None, None] * shifted
    product[:, :, 1:] += (np.diff(at) / widths)[:, :, None, None] * shifted
    if added is not None:
        more = added @ weights
        product[:, :, 0, [0, 2]] += more[:, :-1, None]
        product[:, :, 1, [0, 2]] += (np.diff(more) / widths)[:, :, None]
    return PiecewisePolynomials(np.tile(edges, (len(whole), 1)), product)


def made_zones(
    tracks: Sequence[ObstacleTrack],
    future: Future,
    scales: Array,
    sizing: Sizing | None = None,
    soon: Future | None = None,
) -> list[ThreatZone]:
    """Zones of covariances that are so many times those of a future, and what is seen next is expected by it.

    Parameters
    ----------
    tracks : sequence of ObstacleTrack
    future : Future
        Of each.
    scales : (K,) array
    sizing : Sizing, optional
        Then it is kept what is predicted, to be compared with what comes.
    soon : Future, optional
        One piece for what is seen next, where the future has several.

    Returns
    -------
    list of ThreatZone
    """
    start = float(future.breaks[0])
    center, covariance = _foretold(tracks, future, sizing, soon)
    scaled = scales[:, None, None, None] * future.covariances
    breaks = future.breaks[None]
    sized: dict[int, PiecewisePolynomials] = {}
    if sizing is not None and len(sizing.others):
        others = sizing.others
        edges, pieces = sized_pieces(future, others, sizing)
        pieces *= scales[others, None, None, None]
        sized = {k: PiecewisePolynomials(edges[n, None], pieces[n, None]) for n, k in enumerate(others.tolist())}
    zones = []
    for k, (track, path, spread) in enumerate(zip(tracks, future.centers[:, None], scaled[:, None], strict=True)):
        centers = PiecewisePolynomials(breaks, path)
        later = None if soon is None else Later(centers, PiecewisePolynomials(breaks, future.covariances[k, None]))
        track.predicted = Prediction(start, center[k], covariance[k], _NORMAL, later)
        zones.append(
            ThreatZone(
                track.id,
                track.body.radius + track.margin,
                centers,
                sized[k] if k in sized else PiecewisePolynomials(breaks, spread),
                track.body.outlines,
                until=start + HORIZON,
            )
        )
    return zones


def _foretold(
    tracks: Sequence[ObstacleTrack], future: Future, sizing: Sizing | None, soon: Future | None
) -> tuple[Array, Array]:
    """Let the bank of some tracks know what is predicted; centers and covariances of what is seen next."""
    first, near = tracks[0].estimator, soon or future
    center, covariance = near.centers[:, 0], near.covariances[:, 0]
    if first is not None and first.bank is not None:
        told = first.bank.foretold
        slots = np.array([track.estimator.slot for track in tracks if track.estimator is not None], dtype=np.intp)
        told.put(slots, float(future.breaks[0]), center, covariance)
        if sizing is not None:
            told.kinds[slots] = sizing.kinds
            if soon is not None:
                told.put_later(Pieces(slots, future.breaks, future.centers, future.covariances))
    return center, covariance


def sized_pieces(future: Future, some: Index, sizing: Sizing) -> tuple[Array, Array]:
    """Covariances of some obstacles, (n,), sized linearly in time between leads, and constantly after the last.

    Parameters
    ----------
    future : Future
        Of K.
    some : (n,)
    sizing : Sizing
        Of K. Where the future has several pieces, sizes are linear between their ends, and up to the last lead.

    Returns
    -------
    (n, E + 1) array
        Ends of the pieces, s.
    (n, E, Q + 1, 3) array
        Their coefficients, m^2.
    """
    leads, sizes = sizing.leads[some], sizing.sizes[some]
    start, count = future.breaks[0], len(some)
    if len(future.breaks) == 2:
        begins, at = np.zeros((count, leads.shape[1] + 1)), np.empty((count, leads.shape[1] + 2))
        begins[:, 1:], at[:, 1:-1], at[:, 0], at[:, -1] = leads, sizes, sizes[:, 0], sizes[:, -1]
        # Where sizes stay as they are for all, one piece will do for several: each takes time wherever zones are asked.
        turns = (at[:, 1:] != at[:, :-1]).any(axis=0)
        needed = np.flatnonzero(np.append(True, turns[:-1] | turns[1:]))
        begins, at = begins[:, needed], at[:, np.append(needed, -1)]
        piece = np.zeros(len(needed), dtype=np.intp)
    else:
        lead = leads.mean(axis=0)
        edges = np.unique(np.append(future.breaks[:-1] - start, lead[-1]))
        begins = np.broadcast_to(edges, (count, len(edges)))
        weights = np.array([np.interp(np.append(edges, np.inf), lead, one) for one in np.eye(len(lead))])
        at = sizes @ weights
        piece = np.searchsorted(future.breaks[:-1] - start, edges, "right") - 1
    ends = np.empty((count, begins.shape[1] + 1))
    ends[:, :-1], ends[:, -1] = begins, future.breaks[-1] - start
    whole = future.covariances[some][:, piece]
    powers, shift = whole.shape[2], begins - (future.breaks[piece] - start)
    shifted = (shift_matrices(powers, shift.ravel()) @ whole.reshape(-1, powers, 3)).reshape(whole.shape)
    pieces = np.zeros((count, len(piece), powers + 1, 3))
    parts, widths = np.empty((2, *at.shape)), ends[:, 1:] - ends[:, :-1]
    np.minimum(at, 1.0, out=parts[0])
    np.maximum(at - 1.0, 0.0, out=parts[1])
    # of what was seen twice at one time the first piece is empty
    steps = parts[:, :, 1:] - parts[:, :, :-1]
    slopes = np.divide(steps, widths, out=np.zeros_like(steps), where=widths > 0.0)
    factor, more = parts[:, :, :-1]
    pieces[:, :, :-1] = factor[:, :, None, None] * shifted
    pieces[:, :, 1:] += slopes[0][:, :, None, None] * shifted
    pieces[:, :, 0, [0, 2]] += more[:, :, None]
    pieces[:, :, 1, [0, 2]] += slopes[1][:, :, None]
    return start + ends, pieces


def _least(sigma: Array) -> Array:
    """Smaller eigenvalues of covariances (K, 2, 2)."""
    mean, half = 0.5 * (sigma[:, 0, 0] + sigma[:, 1, 1]), 0.5 * (sigma[:, 0, 0] - sigma[:, 1, 1])
    return np.asarray(mean - np.hypot(half, sigma[:, 0, 1]))


def _with_manoeuvre(spread: Array, coefficients: Array, last: Array, change: Array) -> tuple[Array, Array]:
    """Allow for changes of acceleration at times ``last``; see `PolynomialEstimate.with_manoeuvre`."""
    shift = np.empty((len(last), 3))
    shift[:, 0], shift[:, 1], shift[:, 2] = 0.5 * (last * last), -last, 0.5
    return _padded(spread, 3) + change[:, None, None] * shift[:, :, None] * shift[:, None], _padded(coefficients, 2)


def _padded(values: Array, width: int) -> Array:
    """Values (K, p, ...) of motions of any order as those of order 2, (K, 3, width)."""
    count, terms, given = values.shape
    if terms == 3:
        return values
    padded = np.zeros((count, 3, width))
    padded[:, :terms, :given] = values
    return padded


def lengths_of_polynomials(error: Array, cross: Array, rate: Array) -> Array:
    """Standardised lengths over `HORIZON` of K motions, (K,).

    From the covariances of the error (K, P, 2, 2), of it with its rate (K, Q, 2, 2), and of its rate (K, R, 2, 2),
    polynomials of time of at most six terms. Errors turn in the time in which the velocity blurs the position, then
    ever more slowly.
    """
    nodes, weights = _quadrature()
    scale = np.sqrt(np.trace(error[:, 0], axis1=1, axis2=2) / np.trace(rate[:, 0], axis1=1, axis2=2))
    last = np.log1p(HORIZON / scale)
    grown = scale[:, None] * np.exp(last[:, None] * nodes)
    powers = (grown - scale[:, None])[:, :, None] ** np.arange(6)
    at = [np.einsum("knp,kpab->knab", powers[:, :, : part.shape[1]], part) for part in (error, cross, rate)]
    speed = standardised_speed(*at)
    return last * ((grown * speed) @ weights)


def _shift(order: int, shift: Array, scale: Array) -> Array:
    """Matrices from coefficients of powers of u to those of s, where u = shift + scale s, (K, p, p)."""
    matrix = shift_matrices(order + 1, shift)
    matrix *= scale[:, None, None] ** np.arange(order + 1)[:, None]
    return matrix


@lru_cache(maxsize=8)
def _products(terms: int) -> Array:
    """Matrix from the products of coefficients k and m, in rows, to the coefficient k + m."""
    matrix = np.zeros((terms, terms, POLYNOMIAL_TERMS))
    for k in range(terms):
        for m in range(terms):
            matrix[k, m, k + m] = 1.0
    return matrix.reshape(-1, POLYNOMIAL_TERMS)


def _lengths(spread: Array, start: Array, stop: Array) -> Array:
    """Standardised lengths of K polynomial motions over spans of normalised time, (K,).

    See `scp_planner.estimation.motion_estimate`: s = tan(angle), and the rows (1, s, s^2) become (cos^2, sin cos,
    sin^2).
    """
    order = spread.shape[1] - 1
    if order == 0:
        return np.zeros(len(spread))
    nodes, weights = _quadrature()
    low, high = np.arctan(start), np.arctan(stop)
    angles = low[:, None] + (high - low)[:, None] * nodes
    sine, cosine = np.sin(angles), np.cos(angles)
    x, y = np.empty((2, *angles.shape, order + 1))
    if order == 1:
        x[..., 0], x[..., 1] = cosine, sine
        y[..., 0], y[..., 1] = -sine, cosine
    else:
        both, squares = sine * cosine, (cosine * cosine, sine * sine)
        x[..., 0], x[..., 1], x[..., 2] = squares[0], both, squares[1]
        y[..., 0], y[..., 1], y[..., 2] = -2.0 * both, squares[0] - squares[1], 2.0 * both
    weighted = x @ spread
    error, cross, rate = _summed(weighted * x), _summed(weighted * y), _summed((y @ spread) * y)
    speed = np.sqrt(np.maximum(rate * error - cross * cross, 0.0)) / error
    return (high - low) * (speed @ weights)


def _summed(terms: Array) -> Array:
    """Sums over the last axis of two or three: a sum of numpy over so short an axis takes several times as long."""
    total: Array = terms[..., 0] + terms[..., 1]
    for term in range(2, terms.shape[-1]):
        total += terms[..., term]
    return total


@cache
def _quadrature() -> tuple[Array, Array]:
    rule = gauss_rule(NODES)
    edges = np.arange(PANELS) / PANELS
    points = (edges[:, None] + (0.5 + 0.5 * rule.nodes) / PANELS).ravel()
    return points, np.tile(0.5 * rule.weights / PANELS, PANELS)
