"""Distances to obstacles, known, foretold or observed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from verification.differences import Array
from verification.findings import Finding, Tolerances

HARDLY_MOVES = 0.25  # of the fastest on a course: well above what the planner takes for standing


def clearances(
    data: Mapping[str, Any],
    times: Array,
    positions: Array,
    allowed: Tolerances,
    regions: Mapping[str, float],
) -> list[Finding]:
    """Least clearance to each obstacle, of positions (n, 2) m at times (n,) s, with the regions of `check_trip`."""
    radius = float(data["vehicle"]["radius"])
    found = []
    for obstacle in data.get("obstacles", ()):
        name = str(obstacle["id"])
        keep = radius + float(obstacle.get("margin") or 0.0)
        if name in regions and obstacle.get("motion") is not None:
            clearance = _distance_to_foretold(obstacle, times, positions, regions[name]) - keep
        elif obstacle.get("motion") is None and name in regions:
            clearance = distance_to_observed(obstacle, times, positions, regions[name]) - keep
        else:
            clearance = signed_distance(obstacle, times, positions) - keep
        worst = int(np.argmin(clearance))
        least = float(clearance[worst])
        found.append(Finding("clearance", least, 0.0, -least, allowed.clearance, float(times[worst]), name))
    return found


def signed_distance(obstacle: Mapping[str, Any], times: Array, positions: Array) -> Array:
    """Distance (n,) from the points to the obstacle at the same times, m; negative inside."""
    name = obstacle["id"]
    motion = obstacle.get("motion")
    if motion is None:
        raise ValueError(f"obstacle {name!r} has no exact motion: give the size of its region")
    if "time" in motion:
        return _distance_on_course(obstacle, times, positions)
    velocity = np.asarray(motion.get("velocity", (0.0, 0.0)), dtype=float)
    acceleration = np.asarray(motion.get("acceleration", (0.0, 0.0)), dtype=float)
    clock = times[:, None]
    centres = np.asarray(motion["position"], dtype=float) + velocity * clock + acceleration * clock**2 / 2.0
    offsets = positions - centres
    shape = obstacle["shape"]
    if "disc" in shape:
        distances: Array = np.linalg.norm(offsets, axis=1) - float(shape["disc"])
        return distances
    if "polygon" in shape:
        return distance_to_polygon(offsets, np.asarray(shape["polygon"], dtype=float))
    if "rectangle" in shape and not acceleration.any():
        length, width = (float(value) / 2.0 for value in shape["rectangle"])
        heading = math.atan2(velocity[1], velocity[0])
        axes = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
        corners = np.array([[length, width], [-length, width], [-length, -width], [length, -width]])
        return distance_to_polygon(offsets, corners @ axes.T)
    raise ValueError(f"obstacle {name!r}: this check does not know the shape {shape!r}")


def _on_course(motion: Mapping[str, Any], times: Array) -> tuple[Array, Array]:
    """Centres and velocities (n, 2) on the natural cubic spline through positions at times, straight on outside."""
    from scipy.interpolate import CubicSpline

    clock = np.asarray(motion["time"], dtype=float)
    spline = CubicSpline(clock, np.asarray(motion["position"], dtype=float), bc_type="natural")
    inside = np.clip(times, clock[0], clock[-1])
    velocities = spline(inside, 1)
    return spline(inside) + (times - inside)[:, None] * velocities, velocities


def _distance_on_course(obstacle: Mapping[str, Any], times: Array, positions: Array) -> Array:
    motion, shape, name = obstacle["motion"], obstacle["shape"], obstacle["id"]
    if motion.get("covariance") is not None:
        raise ValueError(f"obstacle {name!r} is not on its course for certain: give the size of its region")
    centres, velocities = _on_course(motion, times)
    offsets = positions - centres
    if "polygon" in shape:
        return distance_to_polygon(offsets, np.asarray(shape["polygon"], dtype=float))
    if "disc" in shape:
        distances: Array = np.linalg.norm(offsets, axis=1) - float(shape["disc"])
        return distances
    if "rectangle" in shape and shape.get("heading") is None:
        length, width = (float(value) / 2.0 for value in shape["rectangle"])
        speeds = np.linalg.norm(velocities, axis=1)
        clock = np.asarray(motion["time"], dtype=float)
        fastest = np.linalg.norm(_on_course(motion, np.linspace(clock[0], clock[-1], 50 * len(clock)))[1], axis=1).max()
        ahead = velocities / np.where(speeds > 0.0, speeds, 1.0)[:, None]
        along = np.abs((offsets * ahead).sum(axis=1)) - length
        across = np.abs(ahead[:, 0] * offsets[:, 1] - ahead[:, 1] * offsets[:, 0]) - width
        beyond = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        # Where it hardly moves its velocity says nothing of its heading: only what it covers at any is known.
        hardly = speeds < HARDLY_MOVES * fastest
        anyhow = np.linalg.norm(offsets, axis=1) - min(length, width)
        return np.where(hardly, anyhow, beyond + np.minimum(np.maximum(along, across), 0.0))
    raise ValueError(f"obstacle {name!r}: this check does not know the shape {shape!r} on a course")


def _distance_to_foretold(obstacle: Mapping[str, Any], times: Array, positions: Array, region: float) -> Array:
    """Distance (n,) to a disc whose centre is in an ellipse about its course, of covariances linear in between."""
    motion = obstacle["motion"]
    if motion.get("covariance") is None or "disc" not in obstacle["shape"]:
        raise ValueError(f"obstacle {obstacle['id']!r}: only discs on courses with covariances have a region")
    clock = np.asarray(motion["time"], dtype=float)
    given = np.broadcast_to(np.asarray(motion["covariance"], dtype=float), (clock.size, 2, 2)).reshape(-1, 4)
    errors = np.stack([np.interp(times, clock, column) for column in given.T], axis=1).reshape(-1, 2, 2)
    offsets = positions - _on_course(motion, times)[0]
    return distance_to_ellipses(offsets, region * errors) - float(obstacle["shape"]["disc"])


def distance_to_polygon(points: Array, corners: Array) -> Array:
    """Signed distance (n,) from points (n, 2) to a simple polygon (m, 2); negative inside."""
    nearest = np.full(points.shape[0], np.inf)
    inside = np.zeros(points.shape[0], dtype=bool)
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = end - begin
        share = np.clip((points - begin) @ edge / (edge @ edge), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - begin - share[:, None] * edge, axis=1))
        # Even-odd rule: count the edges that a ray in +x crosses.
        straddles = (begin[1] > points[:, 1]) != (end[1] > points[:, 1])
        if edge[1] != 0.0:
            crossing = begin[0] + edge[0] * (points[:, 1] - begin[1]) / edge[1]
            inside ^= straddles & (points[:, 0] < crossing)
    return np.where(inside, -nearest, nearest)


def distance_to_observed(obstacle: Mapping[str, Any], times: Array, positions: Array, region: float) -> Array:
    """Distance (n,) to a disc whose centre is somewhere in the confidence ellipse; negative inside.

    The centre moves as a polynomial, fitted to the observations by generalised least squares; what is known beforehand
    of velocity and acceleration at the last of them counts like observations of these.
    """
    name, model = obstacle["id"], obstacle.get("model") or {}
    seen = obstacle.get("observations")
    if seen is None or seen.get("covariance") is None or "disc" not in obstacle["shape"]:
        raise ValueError(f"obstacle {name!r}: only discs with observations of known covariance can be checked")
    if model.get("process") is not None:
        raise ValueError(f"obstacle {name!r}: this check does not know process noise")
    order = int(model.get("order", 2))
    observed = np.asarray(seen["position"], dtype=float)
    when = np.asarray(seen["time"], dtype=float)
    covariance = np.broadcast_to(np.asarray(seen["covariance"], dtype=float), (when.size, 2, 2))
    weights = np.linalg.inv(covariance)
    # Times are shifted and scaled to [-1, 1] over the observations: the normal equations keep their digits.
    middle, half = (when.max() + when.min()) / 2.0, (when.max() - when.min()) / 2.0 or 1.0
    rows = np.vander((when - middle) / half, order + 1, increasing=True)
    # Unknowns: coefficients (order + 1, 2), flattened.
    size = 2 * (order + 1)
    information = np.einsum("ni,nj,nab->iajb", rows, rows, weights)
    moments = np.einsum("ni,nab,nb->ia", rows, weights, observed)
    for derivative, what in ((1, "velocity"), (2, "acceleration")):
        deviation = (model.get("prior") or {}).get(f"{what}_deviation")
        if deviation is not None and derivative <= order:
            powers = np.eye(order + 1)
            row = [np.polynomial.polynomial.polyder(power, derivative) for power in powers]
            last = np.array([np.polynomial.polynomial.polyval((when.max() - middle) / half, each) for each in row])
            last /= half**derivative
            information += np.einsum("i,j,ab->iajb", last, last, np.eye(2) / float(deviation) ** 2)
            mean = np.asarray(model["prior"].get(what) or (0.0, 0.0), dtype=float)
            moments += np.outer(last, mean / float(deviation) ** 2)
    information = information.reshape(size, size)
    fitted = np.linalg.solve(information, moments.ravel())
    spread = np.linalg.inv(information).reshape(order + 1, 2, order + 1, 2)
    powers = np.vander((times - middle) / half, order + 1, increasing=True)
    centres = powers @ fitted.reshape(order + 1, 2)
    errors = np.einsum("ni,iajb,nj->nab", powers, spread, powers)
    # A change of acceleration may begin with the last observation, in proportion to the noise.
    noise = covariance.mean(axis=0)
    change = float(model.get("manoeuvre") or 0.0) ** 2 * noise / np.linalg.eigvalsh(noise)[0]
    errors = region * (errors + ((times - when.max()) ** 4 / 4.0)[:, None, None] * change)
    return distance_to_ellipses(positions - centres, errors) - float(obstacle["shape"]["disc"])


def distance_to_ellipses(points: Array, matrices: Array) -> Array:
    """Distance (n,) from points (n, 2) to the ellipses z' M^-1 z <= 1 of matrices (n, 2, 2); zero inside.

    Along the axes of the ellipse, of half lengths a and b, its nearest point to y is
    (a^2 y1 / (a^2 + t), b^2 y2 / (b^2 + t)), t >= 0 the root of a decreasing function: bisection.
    """
    squares, axes = np.linalg.eigh(matrices)
    local = np.abs(np.einsum("nij,ni->nj", axes, points))
    outside = (local**2 / squares).sum(axis=1) > 1.0
    low = np.zeros(points.shape[0])
    high = np.linalg.norm(local, axis=1) * np.sqrt(squares[:, 1])
    for _ in range(80):
        t = (low + high) / 2.0
        beyond = (squares * local**2 / (squares + t[:, None]) ** 2).sum(axis=1) > 1.0
        low, high = np.where(beyond, t, low), np.where(beyond, high, t)
    nearest = squares * local / (squares + high[:, None])
    distances: Array = np.where(outside, np.linalg.norm(local - nearest, axis=1), 0.0)
    return distances
