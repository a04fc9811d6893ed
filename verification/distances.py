"""Distances to obstacles, known, predicted or observed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verification.differences import Array
from verification.findings import Finding, Tolerances, find_least_room
from verification.forecasts import predicted

HARDLY_MOVES = 0.25  # of the fastest on a course: well above what the planner takes for standing
STANDS = 1e-9  # of the largest speed: below it a motion has no direction
AT_ONCE = 40_000  # times at most, at which forecasts are made together: each takes some matrices
BORDER_POINTS = 24  # of a region, from which what is no disc is looked at
NEWTON_STEPS = 60  # at most, for the nearest point of an ellipse: some eight do, but at the tip of a needle
FIRST_LOOKS = 100  # samples, of which one is looked at from the border before it is known which others may matter


def clearances(
    data: Mapping[str, Any],
    times: Array,
    positions: Array,
    allowed: Tolerances,
    regions: Mapping[str, float],
    *,
    falling: bool = False,
) -> list[Finding]:
    """Least clearance to each obstacle, of positions (n, 2) m at times (n,) s, with the regions of `check_trip`.

    Targets that the vehicle is to come as near to as to touch them are not kept clear of.
    """
    radius = float(data["vehicle"]["radius"])
    found = []
    touched = [str(obstacle["id"]) for obstacle in data.get("obstacles", ()) if _is_touched(data, obstacle)]
    for name, obstacle in _each_future(data):
        if str(obstacle["id"]) in touched:
            continue
        uncertain = _is_uncertain(obstacle)
        if uncertain and name not in regions and name != str(obstacle["id"]):
            continue  # a future that is improbable enough
        if uncertain and name not in regions:
            raise ValueError(f"obstacle {name!r} has no exact motion: give the size of its region")
        if uncertain:
            parts = np.array_split(np.arange(times.size), math.ceil(times.size / AT_ONCE))
            distance = np.concatenate(
                [distance_to_uncertain(obstacle, times[part], positions[part], regions[name]) for part in parts]
            )
        else:
            distance = signed_distance(obstacle, times, positions)
        clearance = distance - radius - float(obstacle.get("margin") or 0.0)
        found.append(find_least_room("clearance", clearance, allowed.clearance, times, subject=name, falling=falling))
    return found


def _is_touched(data: Mapping[str, Any], obstacle: Mapping[str, Any]) -> bool:
    """Whether the goal or a place is on an obstacle that is its target, and not as far beside it as to lead past."""
    radius = float(data["vehicle"]["radius"])
    for place, usual in ((data["goal"], 0.0), *((one, radius) for one in data.get("goals") or ())):
        target = place.get("target")
        met = target.get("obstacle") if isinstance(target, Mapping) else target
        if met != obstacle["id"]:
            continue
        near = usual if place.get("radius") is None else float(place["radius"])
        reach = near + radius + float(obstacle.get("margin") or 0.0) + _largest_radius(obstacle["shape"])
        if math.hypot(*(place.get("offset") or (0.0, 0.0))) <= reach:
            return True
    return False


def expected_motion(obstacle: Mapping[str, Any], times: Array, start_time: float) -> tuple[Array, Array]:
    """Centres and velocities (n, 2) at times (n,) of something that is known, predicted or observed."""
    motion = obstacle.get("motion")
    if motion is not None:
        timed = motion if motion.get("time") is not None else {**motion, "time": start_time}
        return _moved(timed, times)[:2]
    step = 1e-3
    around = np.concatenate([times - step, times, times + step])
    if obstacle.get("estimate") is not None or (obstacle.get("model") or {}).get("process") is not None:
        order = np.argsort(around)
        centres = np.empty((len(around), 2))
        centres[order] = predicted(obstacle, around[order]).centres
    else:
        centres = observed(obstacle, around)[0]
    before, here, after = np.split(centres, 3)
    return here, (after - before) / (2.0 * step)


def _each_future(data: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Each obstacle by its name, and of one with several futures each that is possible, as obstacles of their own."""
    for obstacle in data.get("obstacles", ()):
        name = str(obstacle["id"])
        motion = obstacle.get("motion") or {}
        futures = motion.get("futures")
        if futures is None:
            yield name, {**obstacle, "motion": _timed(motion, data)} if motion else obstacle
            continue
        for k, future in enumerate(futures):
            if float(future["weight"]) > 0.0:
                yield f"{name}[{k}]", {**obstacle, "motion": _timed(future["motion"], data)}


def _timed(motion: Mapping[str, Any], data: Mapping[str, Any]) -> Mapping[str, Any]:
    """A motion that says when it holds: at the start of a scenario, where it did not."""
    return motion if motion.get("time") is not None else {**motion, "time": float(data["start"]["time"])}


def _is_course(motion: Mapping[str, Any]) -> bool:
    """Whether a motion is given at several times."""
    return np.ndim(motion.get("time", 0.0)) > 0


def _is_uncertain(obstacle: Mapping[str, Any]) -> bool:
    motion = obstacle.get("motion")
    return motion is None or motion.get("covariance") is not None


def signed_distance(obstacle: Mapping[str, Any], times: Array, positions: Array) -> Array:
    """Distance (n,) from the points to the obstacle at the same times, m; negative inside, if it is no ellipse."""
    name, motion, shape = obstacle["id"], obstacle.get("motion"), obstacle["shape"]
    if motion is None or motion.get("covariance") is not None:
        raise ValueError(f"obstacle {name!r} has no exact motion: give the size of its region")
    centres, velocities, fastest = _moved(motion, times)
    offsets = positions - centres
    if "rectangle" not in shape and "ellipse" not in shape:
        return _distance_to_shape(shape, offsets, 0.0, name)
    if shape.get("heading") is not None:
        return _distance_to_shape(shape, offsets, float(shape["heading"]), name)
    if motion.get("heading") is not None:
        return _distance_to_shape(shape, offsets, _pointing(motion, times), name)
    speeds = np.linalg.norm(velocities, axis=1)
    heading = np.arctan2(velocities[:, 1], velocities[:, 0])
    if not _is_course(motion) and _is_straight(motion):
        # It heads along its line all the time, also while it turns back.
        along = np.asarray(motion.get("velocity", (0.0, 0.0)), dtype=float)
        more = np.asarray(motion.get("acceleration", (0.0, 0.0)), dtype=float)
        along = along if along @ along >= more @ more else more
        return _distance_to_shape(shape, offsets, math.atan2(along[1], along[0]), name)
    # Where it hardly moves its velocity says nothing of its heading: only what it covers at any is known.
    hardly = speeds < HARDLY_MOVES * fastest
    anyhow = np.linalg.norm(offsets, axis=1) - _least_radius(shape)
    return np.where(hardly, anyhow, _distance_to_shape(shape, offsets, heading, name))


def _moved(motion: Mapping[str, Any], times: Array) -> tuple[Array, Array, float]:
    """Centres and velocities (n, 2) of a motion that is known, and its largest speed."""
    if _is_course(motion):
        clock = np.asarray(motion["time"], dtype=float)
        all_along = np.linspace(clock[0], clock[-1], 50 * len(clock))
        fastest = float(np.linalg.norm(_on_course(motion, all_along)[1], axis=1).max())
        return *_on_course(motion, times), fastest
    velocity = np.asarray(motion.get("velocity", (0.0, 0.0)), dtype=float)
    acceleration = np.asarray(motion.get("acceleration", (0.0, 0.0)), dtype=float)
    clock = times[:, None] - float(motion.get("time", 0.0))
    centres = np.asarray(motion["position"], dtype=float) + velocity * clock + acceleration * clock**2 / 2.0
    velocities = velocity + acceleration * clock
    return centres, velocities, float(np.linalg.norm(velocities, axis=1).max())


def _is_straight(motion: Mapping[str, Any]) -> bool:
    velocity, acceleration = (np.asarray(motion.get(key, (0.0, 0.0)), dtype=float) for key in _RATES)
    across = abs(velocity[0] * acceleration[1] - velocity[1] * acceleration[0])
    return bool(across <= STANDS * np.linalg.norm(velocity) * np.linalg.norm(acceleration))


_RATES = ("velocity", "acceleration")


def _on_course(motion: Mapping[str, Any], times: Array) -> tuple[Array, Array]:
    """Centres and velocities (n, 2) on the natural cubic spline through positions at times, straight on outside."""
    from scipy.interpolate import CubicSpline

    clock = np.asarray(motion["time"], dtype=float)
    spline = CubicSpline(clock, np.asarray(motion["position"], dtype=float), bc_type="natural")
    inside = np.clip(times, clock[0], clock[-1])
    velocities = spline(inside, 1)
    return spline(inside) + (times - inside)[:, None] * velocities, velocities


def _pointing(motion: Mapping[str, Any], times: Array) -> Array:
    """Headings (n,) on a course that has some: between two its direction goes straight from one to the other."""
    clock, angles = (np.asarray(motion[key], dtype=float) for key in ("time", "heading"))
    return np.arctan2(np.interp(times, clock, np.sin(angles)), np.interp(times, clock, np.cos(angles)))


def _distance_to_shape(shape: Mapping[str, Any], offsets: Array, heading: Array | float, name: object) -> Array:
    """Distance (n,) from offsets (n, 2) off its centre to a shape at headings; negative inside, but for ellipses."""
    if "disc" in shape:
        return np.asarray(np.linalg.norm(offsets, axis=1) - float(shape["disc"]))
    if "polygon" in shape:
        return distance_to_polygon(offsets, np.asarray(shape["polygon"], dtype=float))
    along = np.cos(heading) * offsets[:, 0] + np.sin(heading) * offsets[:, 1]
    across = np.cos(heading) * offsets[:, 1] - np.sin(heading) * offsets[:, 0]
    if "rectangle" in shape:
        length, width = (float(value) / 2.0 for value in shape["rectangle"])
        beyond = np.stack([np.abs(along) - length, np.abs(across) - width])
        return np.asarray(np.hypot(*np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=0), 0.0))
    if "ellipse" in shape:
        squares = np.diag(np.asarray(shape["ellipse"], dtype=float) ** 2)
        turned = np.stack([along, across], axis=1)
        return distance_to_ellipses(turned, squares[None])
    raise ValueError(f"obstacle {name!r}: this check does not know the shape {shape!r}")


def _least_radius(shape: Mapping[str, Any]) -> float:
    """Radius, m, of the disc that a rectangle or an ellipse covers at any heading."""
    return min(float(value) / 2.0 for value in shape["rectangle"]) if "rectangle" in shape else min(shape["ellipse"])


def _largest_radius(shape: Mapping[str, Any]) -> float:
    """Radius, m, of the disc around its centre that covers a shape."""
    if "rectangle" in shape:
        return 0.5 * math.hypot(*shape["rectangle"])
    corners = [math.hypot(*corner) for corner in shape.get("polygon") or ()]
    return float(max(corners or shape.get("ellipse") or [shape["disc"]]))


def distance_to_uncertain(obstacle: Mapping[str, Any], times: Array, positions: Array, region: float) -> Array:
    """Distance (n,) to a shape whose centre is somewhere in a region about where it is expected."""
    if obstacle.get("motion") is not None:
        expected, errors = _on_uncertain_course(obstacle["motion"], times)
    elif obstacle.get("estimate") is not None or (obstacle.get("model") or {}).get("process") is not None:
        forecast = predicted(obstacle, times)
        expected, errors = forecast.centres, forecast.errors
    else:
        expected, errors = observed(obstacle, times)
    offsets, shape = positions - expected, obstacle["shape"]
    if "disc" in shape:
        return distance_to_ellipses(offsets, region * errors) - float(shape["disc"])
    if "polygon" in shape or shape.get("heading") is not None:
        return _from_border(shape, offsets, region * errors, float(shape.get("heading") or 0.0), obstacle["id"])
    return distance_to_ellipses(offsets, region * errors) - _least_radius(shape)


def _from_border(shape: Mapping[str, Any], offsets: Array, matrices: Array, heading: float, name: object) -> Array:
    """Distance (n,) to a shape at a heading whose centre is anywhere in the ellipses of matrices (n, 2, 2).

    From the centre and some places on the border: it is at most by a part of the region too large. Only so where it
    may be the least of all, elsewhere from the centre alone: no place is nearer by more than the region reaches.
    """
    distances = _distance_to_shape(shape, offsets, heading, name)
    turns = np.linspace(0.0, 2.0 * math.pi, BORDER_POINTS, endpoint=False)
    directions = np.stack([np.cos(turns), np.sin(turns)])
    reach = np.sqrt(np.linalg.eigvalsh(matrices)[:, 1])

    def from_places(chosen: NDArray[np.intp]) -> Array:
        places = np.swapaxes(np.linalg.cholesky(matrices[chosen]) @ directions, 1, 2)
        seen = _distance_to_shape(shape, (offsets[chosen, None, :] - places).reshape(-1, 2), heading, name)
        return np.minimum(distances[chosen], seen.reshape(-1, BORDER_POINTS).min(axis=1))

    some = np.unique(np.append(np.arange(0, len(offsets), FIRST_LOOKS), np.argmin(distances - reach)))
    distances[some] = from_places(some)
    left = np.flatnonzero(distances - reach <= distances.min())
    for part in np.array_split(left, math.ceil(left.size / (AT_ONCE // BORDER_POINTS))):
        distances[part] = from_places(part)
    return distances


def _on_uncertain_course(motion: Mapping[str, Any], times: Array) -> tuple[Array, Array]:
    """Centres (n, 2) on a course, and covariances (n, 2, 2) that are linear in between."""
    clock = np.asarray(motion["time"], dtype=float)
    given = np.broadcast_to(np.asarray(motion["covariance"], dtype=float), (clock.size, 2, 2)).reshape(-1, 4)
    errors = np.stack([np.interp(times, clock, column) for column in given.T], axis=1).reshape(-1, 2, 2)
    return _on_course(motion, times)[0], errors


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


def observed(obstacle: Mapping[str, Any], times: Array) -> tuple[Array, Array]:
    """Expected centres (n, 2) of an obstacle that was observed, and covariances (n, 2, 2) of their errors.

    The centre moves as a polynomial, fitted to the observations by generalised least squares; what is known beforehand
    of velocity and acceleration at the last of them counts like observations of these.
    """
    model, seen = obstacle.get("model") or {}, obstacle["observations"]
    order = int(model.get("order", 2))
    places = np.asarray(seen["position"], dtype=float)
    when = np.asarray(seen["time"], dtype=float)
    given = seen.get("covariance")
    if given is None:
        given = _residual_covariance(when, places, order)
    covariance = np.broadcast_to(np.asarray(given, dtype=float), (when.size, 2, 2))
    weights = np.linalg.inv(covariance)
    # Times are shifted and scaled to [-1, 1] over the observations: the normal equations keep their digits.
    middle, half = (when.max() + when.min()) / 2.0, (when.max() - when.min()) / 2.0 or 1.0
    rows = np.vander((when - middle) / half, order + 1, increasing=True)
    # Unknowns: coefficients (order + 1, 2), flattened.
    size = 2 * (order + 1)
    information = np.einsum("ni,nj,nab->iajb", rows, rows, weights)
    moments = np.einsum("ni,nab,nb->ia", rows, weights, places)
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
    return centres, errors + ((times - when.max()) ** 4 / 4.0)[:, None, None] * change


def _residual_covariance(when: Array, seen: Array, order: int) -> Array:
    """Covariance (2, 2) of the noise of positions (n, 2) about a polynomial in time, without bias."""
    rows = np.vander((when - when.mean()) / (np.ptp(when) or 1.0), order + 1)
    residuals = seen - rows @ np.linalg.lstsq(rows, seen, rcond=None)[0]
    return residuals.T @ residuals / (len(when) - order - 1)


def distance_to_ellipses(points: Array, matrices: Array) -> Array:
    """Distance (n,) from points (n, 2) to the ellipses z' M^-1 z <= 1 of matrices (n or 1, 2, 2); zero inside.

    Along the axes of the ellipse, of half lengths a and b, its nearest point to y is
    (a^2 y1 / (a^2 + t), b^2 y2 / (b^2 + t)), t >= 0 the root of f(t) = (a y1 / (a^2 + t))^2 + (b y2 / (b^2 + t))^2 - 1,
    which decreases and is convex: Newton's method from below never passes it, and begins where one term alone is 1.
    """
    squares, axes = np.linalg.eigh(matrices)
    local = np.abs(np.matmul(points[:, None, :], axes)[:, 0])
    distances = np.zeros(len(points))
    outside = np.flatnonzero((local**2 / squares).sum(axis=1) > 1.0)
    first, second = local[outside].T
    wide, high = np.broadcast_to(squares, points.shape)[outside].T
    one, other = wide * first**2, high * second**2
    t = np.maximum(np.maximum(np.sqrt(one) - wide, np.sqrt(other) - high), 0.0)
    for _ in range(NEWTON_STEPS):
        terms = one / (wide + t) ** 2, other / (high + t) ** 2
        slope = 2.0 * (terms[0] / (wide + t) + terms[1] / (high + t))
        later = t + np.maximum(terms[0] + terms[1] - 1.0, 0.0) / slope
        if np.array_equal(later, t):
            break
        t = later
    distances[outside] = np.hypot(first * t / (wide + t), second * t / (high + t))
    return distances
