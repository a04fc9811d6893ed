"""Motions given by positions at times: natural cubic splines, straight on at both ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from scp_planner.arrays import Array, unit_vectors
from scp_planner.mathematics.polynomials import PiecewisePolynomials

LEAD = 1.0  # units of time; the first and the last piece go on for ever


def course_polynomials(times: ArrayLike, positions: ArrayLike) -> PiecewisePolynomials:
    """Return the natural cubic spline through positions (n, 2) m at times (n,) s."""
    from scipy.interpolate import CubicSpline

    clock, place = np.array(times), np.array(positions)
    spline = CubicSpline(clock - clock[0], place - place[0], bc_type="natural")
    pieces = np.zeros((len(clock) + 1, 4, 2))
    pieces[1:-1] = spline.c[::-1].transpose(1, 0, 2)
    pieces[1:-1, 0] += place[0]
    velocity = spline(np.array([0.0, clock[-1] - clock[0]]), 1)
    pieces[0, :2] = place[0] - LEAD * velocity[0], velocity[0]
    pieces[-1, :2] = place[-1], velocity[1]
    return PiecewisePolynomials(_breakpoints(clock), pieces[None])


def course_covariances(times: Sequence[float], covariances: Array) -> PiecewisePolynomials:
    """Return covariances (xx, xy, yy) m^2 that are linear between those (n, 2, 2) at times (n,) s."""
    packed = 0.5 * (covariances + covariances.swapaxes(1, 2))[:, [0, 0, 1], [0, 1, 1]]
    clock = np.array(times)
    pieces = np.zeros((len(clock) + 1, 2, 3))
    pieces[0, 0], pieces[1:, 0] = packed[0], packed
    pieces[1:-1, 1] = np.diff(packed, axis=0) / np.diff(clock)[:, None]
    return PiecewisePolynomials(_breakpoints(clock), pieces[None])


def course_pointing(times: Sequence[float], headings: Sequence[float]) -> PiecewisePolynomials:
    """Return what moves in the direction of headings (n,) rad at times (n,) s; before and after them as at the ends."""
    clock, angles = np.array(times), np.array(headings)
    unit = unit_vectors(angles)
    pieces = np.zeros((len(clock) + 1, 3, 2))
    pieces[0, 1], pieces[1:, 1] = unit[0], unit
    pieces[1:-1, 2] = 0.5 * np.diff(unit, axis=0) / np.diff(clock)[:, None]
    return PiecewisePolynomials(_breakpoints(clock), pieces[None])


def _breakpoints(clock: Array) -> Array:
    return np.concatenate([[clock[0] - LEAD], clock, [np.inf]])[None]
