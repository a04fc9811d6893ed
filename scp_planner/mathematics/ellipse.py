"""Signed distance from points to ellipses, vectorised."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scp_planner.arrays import Array
from scp_planner.mathematics.tolerances import CENTRE_GUARD, NEWTON_TOLERANCE

MAX_NEWTON_STEPS = 30


@dataclass(frozen=True)
class Contact:
    """Signed distances and where they are attained."""

    distance: Array  # (n,) Signed distance in m, negative inside
    normal: Array  # (n, 2) Unit vector from the set towards the point at which the support function is touched


def support(covariance: Array, normal: Array) -> Array:
    """Support function sqrt(nu' C nu)."""
    x, y = normal[..., 0], normal[..., 1]
    quadratic = covariance[..., 0] * x * x + 2.0 * covariance[..., 1] * x * y + covariance[..., 2] * y * y
    return np.sqrt(np.maximum(quadratic, 0.0))


def support_point(covariance: Array, normal: Array) -> Array:
    """The point C nu / sqrt(nu' C nu) of an ellipse at which a supporting line touches it, (..., 2)."""
    xx, xy, yy = np.moveaxis(covariance, -1, 0)
    x, y = normal[..., 0], normal[..., 1]
    least = np.maximum(support(covariance, normal), 1e-300)  # against a division by 0, of an ellipse that is a point
    return np.stack([xx * x + xy * y, xy * x + yy * y], axis=-1) / least[..., None]


def ellipse_contact(offset: Array, covariance: Array) -> Contact:
    """Exact signed distance from points to ellipses around the origin."""
    axes = _PrincipalAxes.of(offset, covariance)
    u, w, gap = axes.half_major * axes.y0, axes.half_minor * axes.y1, axes.gap
    # shift = s + minor, so that nothing cancels near the pole
    shift = np.maximum(w, np.sqrt(u * u + w * w) - gap)
    for _ in range(MAX_NEWTON_STEPS):
        far = shift + gap
        p, q = u / far, w / shift
        p *= p
        q *= q
        step = p + q
        step -= 1.0
        step *= 0.5
        p /= far
        q /= shift
        p += q
        step /= p
        shift += np.maximum(step, 0.0)
        if (step <= NEWTON_TOLERANCE * shift).all():
            break
    return axes.contact(axes.y0 / (shift + gap), axes.y1 / shift, offset, covariance)


def far_ellipse_contact(offset: Array, covariance: Array) -> Contact:
    """The other local maximum of nu . d - sqrt(nu' C nu) over unit vectors, across the major axis; -inf without one."""
    axes = _PrincipalAxes.of(offset, covariance)
    u, w, gap = axes.half_major * axes.y0, axes.half_minor * axes.y1, axes.gap
    shift = -w
    exists = shift > -gap
    for _ in range(MAX_NEWTON_STEPS):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            p, q = u / (shift + gap), w / shift
            residual = p * p + q * q - 1.0
            slope = p * p / (shift + gap) + q * q / shift  # minus half the derivative; negative right of the minimum
            step = 0.5 * residual / slope
            exists &= (slope < 0.0) & (shift + step > -gap)
        shift = np.where(exists & (step < 0.0), shift + step, shift)
        if np.all(~exists | (-step <= NEWTON_TOLERANCE * -shift)):
            break
    shift = np.where(exists, shift, -1.0)
    # Left of -minor the normal is (p - q) / s with s < 0: turned round
    along = np.where(exists, axes.y0 / (shift + gap), 1.0)
    found = axes.contact(along, np.where(exists, axes.y1 / shift, 0.0), offset, covariance)
    return Contact(np.where(exists, found.distance, -np.inf), found.normal)


@dataclass(frozen=True)
class _PrincipalAxes:
    """Points in the first quadrant of the principal axes of ellipses, and what leads back."""

    cosine: Array
    sine: Array
    along: Array
    across: Array
    half_major: Array
    half_minor: Array
    gap: Array
    y0: Array
    y1: Array

    @classmethod
    def of(cls, offset: Array, covariance: Array) -> _PrincipalAxes:
        mean = 0.5 * (covariance[:, 0] + covariance[:, 2])
        difference = 0.5 * (covariance[:, 0] - covariance[:, 2])
        radius = np.hypot(difference, covariance[:, 1])
        major = mean + radius
        minor = np.maximum(mean - radius, 1e-18 * major + 1e-300)
        angle = 0.5 * np.arctan2(covariance[:, 1], difference)
        cosine, sine = np.cos(angle), np.sin(angle)
        along = cosine * offset[:, 0] + sine * offset[:, 1]
        across = cosine * offset[:, 1] - sine * offset[:, 0]
        half_minor = np.sqrt(minor)
        y0 = np.maximum(np.abs(along), CENTRE_GUARD * half_minor)
        y1 = np.maximum(np.abs(across), CENTRE_GUARD * half_minor)
        return cls(cosine, sine, along, across, np.sqrt(major), half_minor, major - minor, y0, y1)

    def contact(self, first: Array, second: Array, offset: Array, covariance: Array) -> Contact:
        """The contact with the normal along (first, second), for a point of the first quadrant."""
        scale = 1.0 / np.hypot(first, second)
        first, second = first * scale, second * scale
        np.negative(first, out=first, where=self.along < 0.0)
        np.negative(second, out=second, where=self.across < 0.0)
        normal = np.empty_like(offset)
        normal[:, 0] = self.cosine * first - self.sine * second
        normal[:, 1] = self.sine * first + self.cosine * second
        distance = normal[:, 0] * offset[:, 0] + normal[:, 1] * offset[:, 1] - support(covariance, normal)
        return Contact(distance, normal)
