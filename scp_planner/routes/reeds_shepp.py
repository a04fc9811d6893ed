"""Shortest paths of bounded curvature ahead and backwards (J. A. Reeds, L. A. Shepp, Pacific J. Math. 145, 1990).

Lengths are in turning radii, negative backwards; formulas are named by their numbers in section 8 of the paper. Each is
used as it is, mirrored in the x axis (left for right), driven in reverse (ahead for backwards), and from its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np

from scp_planner.arrays import Array, Mask

LEFT, STRAIGHT, RIGHT = 1, 0, -1
MOST_PIECES = 5
Word = tuple[tuple[int, ...], list[Array], Mask]
"""Turns of a word's pieces, their lengths, (n,) each, and where there is such a path."""
_QUARTER = pi / 2.0


def words(x: Array, y: Array, heading: Array) -> tuple[Array, Array]:
    """Return all words that lead from the origin, heading along the x axis, to n poses.

    Parameters
    ----------
    x, y, heading : (n,) arrays
        Places in turning radii, headings in rad.

    Returns
    -------
    turns : (w, 5) array
        Of the pieces of each word: 1 left, -1 right, 0 straight.
    lengths : (n, w, 5) array
        Turning radii, negative backwards; NaN where there is no such path.
    """
    back_x, back_y = x * np.cos(heading) + y * np.sin(heading), x * np.sin(heading) - y * np.cos(heading)
    flip, side = np.array(2 * [1.0, 1.0, -1.0, -1.0])[:, None], np.array(4 * [1.0, -1.0])[:, None]
    from_end = np.arange(8) >= 4
    px, py = np.where(from_end[:, None], back_x, x), np.where(from_end[:, None], back_y, y)
    turns, lengths = [], []
    for kinds, pieces, possible in _formulas(flip * px, side * py, flip * side * heading):
        own = np.zeros((MOST_PIECES, 8, len(x)))
        own[: len(kinds)] = np.where(possible, flip * np.stack(pieces), np.nan)
        own[len(kinds) :, ~possible] = np.nan
        own[: len(kinds), from_end] = own[: len(kinds), from_end][::-1]
        turned = np.zeros((MOST_PIECES, 8))
        turned[: len(kinds)] = np.array(kinds)[:, None] * side[:, 0]
        turned[: len(kinds), from_end] = turned[: len(kinds), from_end][::-1]
        turns.append(turned.T)
        lengths.append(np.moveaxis(own, 2, 0).swapaxes(1, 2))
    return np.concatenate(turns), np.concatenate(lengths, axis=1)


def _formulas(x: Array, y: Array, phi: Array) -> Iterator[Word]:
    """Yield the words of the formulas as they are."""
    one, two = (x - np.sin(phi), y - 1.0 + np.cos(phi)), (x + np.sin(phi), y - 1.0 - np.cos(phi))
    always = np.ones(np.shape(x), dtype=bool)
    rho, theta = np.hypot(*one), np.arctan2(one[1], one[0])
    yield (LEFT, STRAIGHT, LEFT), [theta, rho, _angle(phi - theta)], always  # 8.1
    far, near = rho >= 2.0, rho <= 4.0
    turn = -2.0 * np.arcsin(np.minimum(0.25 * rho, 1.0))
    first = _angle(theta + 0.5 * turn + pi)
    yield (LEFT, RIGHT, LEFT), [first, turn, _angle(phi - first + turn)], near  # 8.3, 8.4
    root = np.sqrt(np.maximum(rho**2 - 4.0, 0.0))
    first = _angle(theta + np.arctan2(root, -2.0))
    quarter = np.full(np.shape(x), -_QUARTER)
    yield (LEFT, RIGHT, STRAIGHT, LEFT), [first, quarter, 2.0 - root, _angle(phi - _QUARTER - first)], far  # 8.9
    rho, theta = np.hypot(*two), np.arctan2(two[1], two[0])
    far = rho >= 2.0
    root = np.sqrt(np.maximum(rho**2 - 4.0, 0.0))
    first = _angle(theta + np.arctan2(2.0, root))
    yield (LEFT, STRAIGHT, RIGHT), [first, root, _angle(first - phi)], far  # 8.2
    first = np.arctan2(two[0], -two[1])
    yield (LEFT, RIGHT, STRAIGHT, RIGHT), [first, quarter, 2.0 - rho, _angle(first + _QUARTER - phi)], far  # 8.10
    straight = 4.0 - root
    first = np.arctan2((4.0 - straight) * two[0] - 2.0 * two[1], -2.0 * two[0] + (straight - 4.0) * two[1])
    pieces = [first, quarter, straight, quarter, _angle(first - phi)]
    yield (LEFT, RIGHT, STRAIGHT, LEFT, RIGHT), pieces, far & (straight <= 0.0)  # 8.11
    share = 0.25 * (2.0 + rho)
    turn = np.arccos(np.minimum(share, 1.0))
    yield (LEFT, RIGHT, LEFT, RIGHT), _around(turn, -turn, *two, phi), share <= 1.0  # 8.7
    share = (20.0 - rho**2) / 16.0
    turn = -np.arccos(np.clip(share, 0.0, 1.0))
    yield (LEFT, RIGHT, LEFT, RIGHT), _around(turn, turn, *two, phi), (share >= 0.0) & (share <= 1.0)  # 8.8


def _around(u: Array, v: Array, xi: Array, eta: Array, phi: Array) -> list[Array]:
    """The pieces of a word of four turns, of which the inner two are known (8.5, 8.6)."""
    delta = _angle(u - v)
    a, b = np.sin(u) - np.sin(delta), np.cos(u) - np.cos(delta) - 1.0
    first = np.arctan2(eta * a - xi * b, xi * a + eta * b)
    behind = 2.0 * (np.cos(delta) - np.cos(v) - np.cos(u)) + 3.0 < 0.0
    first = _angle(np.where(behind, first + pi, first))
    return [first, u, v, _angle(first - u + v - phi)]


def _angle(angle: Array) -> Array:
    """Angles in [-pi, pi)."""
    turned: Array = np.remainder(angle + pi, 2.0 * pi) - pi
    return turned


def along(turns: Array, lengths: Array) -> Array:
    """Return the poses at the ends of pieces that begin at the origin, (..., p + 1, 3): x, y and heading.

    Parameters
    ----------
    turns, lengths : (..., p) arrays
        As `words` returns them.
    """
    turned = np.concatenate([np.zeros_like(lengths[..., :1]), np.cumsum(turns * lengths, axis=-1)], axis=-1)
    middle = 0.5 * (turned[..., 1:] + turned[..., :-1])
    chord = lengths * np.sinc(0.5 * turns * lengths / pi)
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)], axis=-1)
    places = np.concatenate([np.zeros_like(steps[..., :1, :]), np.cumsum(steps, axis=-2)], axis=-2)
    return np.concatenate([places, turned[..., None]], axis=-1)
