"""Zones of a planner against the truth: share held, size, the best constant size in hindsight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks.prediction.motion import Array, Family, Motion, Sensor

LEADS = 0.25 * np.arange(1, 9)  # s, of a tube
SHOWN = (0.5, 1.0, 2.0)  # s
BODY = 0.3  # m
LEARNT = 5.0  # s of tracking before a prediction counts
EVERY = 0.5  # s between predictions
AFTER = (0.2, 0.5, 1.0)  # s after a change
FAR = 1e4  # m, at which the vehicle stands
ANGLES = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
DIRECTIONS = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


@dataclass(frozen=True)
class Errors:
    """Predictions of many tracks: a row each, a column a lead.

    Attributes
    ----------
    error : (n, L) array
        Distance of the truth from the region's centre, m; NaN after the end of a motion.
    radius : (n, L) array
        Radius of the disc with the region's area, m.
    held : (n, L) array of bool
        Whether the truth is in the region.
    after : (n,) array
        Time since the last change where that is one of ``AFTER``, s; else NaN.
    track : (n,) array of int
    """

    error: Array
    radius: Array
    held: Array
    after: Array
    track: Array


def predict_family(family: Family, level: str, probability: float = 0.95, seed: int = 0) -> Errors:
    """Measure the motions of each scene together, and compare each prediction with the truth."""
    rows: list[tuple[Array, Array, Array, float, int]] = []
    number = 0
    for k, scene in enumerate(family.scenes):
        rows += _predict_scene(scene, family.sensor, level, probability, np.random.default_rng([seed, k]), number)
        number += len(scene)
    error, radius, held, after, track = (np.array(part) for part in zip(*rows, strict=True))
    return Errors(error, radius, held, after, track)


def _predict_scene(
    scene: Sequence[Motion], sensor: Sensor, level: str, probability: float, rng: np.random.Generator, number: int
) -> list[tuple[Array, Array, Array, float, int]]:
    planner = _standing_planner(1.0 / sensor.rate, level, probability)
    times = np.arange(min(each.times[0] for each in scene), max(each.times[-1] for each in scene), 1.0 / sensor.rate)
    places = np.array([each.at(times) for each in scene])
    sigma = np.where(rng.random(places.shape[:2]) < sensor.outliers, 10.0, 1.0) * sensor.noise
    seen = places + sigma[..., None] * rng.standard_normal(places.shape)
    due = _prediction_times(scene, times)
    there = np.zeros(len(scene), dtype=bool)
    rows = []
    for k, time in enumerate(times):
        visible = ~np.isnan(places[:, k, 0])
        for i in np.flatnonzero(visible & ~there).tolist():
            facts: dict[str, Any] = {"model": scene[i].model} if scene[i].model else {}
            if sensor.noise > 0.0:
                facts["covariance"] = sensor.noise**2 * np.eye(2)
            planner.add_obstacle(str(i), {"disc": BODY}, **facts)
        for i in np.flatnonzero(there & ~visible).tolist():
            planner.remove_obstacle(str(i))
        there = visible
        for i in np.flatnonzero(visible).tolist():
            planner.observe(str(i), float(time), seen[i, k])
        since = due.get(k)
        if since is None:
            continue
        planner.replan(float(time), (FAR, 0.0), 0.0, 0.0)
        for zone in planner.zones:
            i = int(zone.id)
            if time - scene[i].times[0] >= LEARNT:
                rows.append((*_compare(zone, scene[i], float(time)), since[i], number + i))
    return rows


def _standing_planner(period: float, level: str, probability: float) -> sp.Planner:
    """Return a planner whose vehicle stands at its goal, far from all motions."""
    scenario = sp.Scenario(
        vehicle={"radius": 0.3, "max_speed": 1.5, "max_acceleration": 1.0, "max_deceleration": 1.5},
        start={"time": 0.0, "position": [FAR - 5.0, 0.0], "heading": 0.0, "speed": 0.0},
        goal={"position": [FAR, 0.0], "speed": 0.0},
        confidence={"probability": probability, "level": level},
        obstacles=[],
    )
    return sp.Planner(scenario, online=sp.OnlineSettings(period=period))


def _prediction_times(scene: Sequence[Motion], times: Array) -> dict[int, Array]:
    """Steps at which predictions are made, and the time since a change of each motion where one is due."""
    step = times[1] - times[0]
    found = {k: np.full(len(scene), np.nan) for k in range(0, len(times), max(round(EVERY / step), 1))}
    for i, each in enumerate(scene):
        for change in each.changes:
            for after in AFTER:
                k = int(np.ceil((change + after - times[0]) / step - 1e-9))
                if k < len(times):
                    found.setdefault(k, np.full(len(scene), np.nan))[i] = after
    return found


def _compare(zone: sp.ThreatZone, motion: Motion, time: float) -> tuple[Array, Array, Array]:
    """Errors (L,), radii (L,), and whether the truth is held (L,), of one zone."""
    truth = motion.at(time + LEADS)
    centre = np.asarray(zone.center(time + LEADS))
    error = np.linalg.norm(truth - centre, axis=1)
    radius, held = np.empty(len(LEADS)), np.zeros(len(LEADS), dtype=bool)
    for k, at in enumerate(time + LEADS):
        support = np.asarray(zone.support(float(at), DIRECTIONS)) - BODY
        radius[k] = np.sqrt(max(_area(support), 0.0) / np.pi)
        if np.isfinite(error[k]):
            held[k] = bool(np.max(DIRECTIONS @ (truth[k] - centre[k]) - support) <= 1e-9)
    return error, radius, held


def _area(support: Array) -> float:
    """Area of the polygon with these distances from an inner point to its sides, whose normals are ``DIRECTIONS``."""
    turn = ANGLES[1]
    sides = (np.roll(support, 1) + np.roll(support, -1) - 2.0 * support * np.cos(turn)) / np.sin(turn)
    return float(0.5 * support @ sides)


@dataclass(frozen=True)
class Summary:
    """Figures of a family at one level, by ``SHOWN``; shares in [0, 1], lengths in m."""

    number: int
    tracks: int
    held: Array
    radius: Array
    best: Array  # constant radius that holds the level, in hindsight
    tube: float  # share of the tubes that are held whole
    tube_best: float  # radius at 1 s of the best constant tube
    ratio: float  # (radius at 1 s + s) / (best + s), s = max(noise, 0.1 m)
    after: Array  # share held at 1 s, by ``AFTER``


def summarise(errors: Errors, noise: float, level: str, probability: float = 0.95) -> Summary:
    """Reduce predictions to figures; predictions right after changes count among ``after`` alone."""
    shown = [int(np.flatnonzero(LEADS == lead)[0]) for lead in SHOWN]
    one = shown[SHOWN.index(1.0)]
    usual = np.isnan(errors.after)
    whole = usual & np.isfinite(errors.error[:, -1])
    ok = [usual & np.isfinite(errors.error[:, k]) for k in shown]
    best = np.array([np.quantile(errors.error[some, k], probability) for some, k in zip(ok, shown, strict=True)])
    by_lead = np.quantile(errors.error[whole], probability, axis=0)
    factor = float(np.quantile((errors.error[whole] / np.maximum(by_lead, 1e-12)).max(axis=1), probability))
    tube_best = float(by_lead[one] * factor)
    radius = np.array([errors.radius[some, k].mean() for some, k in zip(ok, shown, strict=True)])
    spare = max(noise, 0.1)
    against = best[SHOWN.index(1.0)] if level == "per_time" else tube_best
    after = [errors.held[(errors.after == each) & np.isfinite(errors.error[:, one]), one] for each in AFTER]
    return Summary(
        int(whole.sum()),
        len(np.unique(errors.track[whole])),
        np.array([errors.held[some, k].mean() for some, k in zip(ok, shown, strict=True)]),
        radius,
        best,
        float(errors.held[whole].all(axis=1).mean()),
        tube_best,
        float((radius[SHOWN.index(1.0)] + spare) / (against + spare)),
        np.array([each.mean() if each.size else np.nan for each in after]),
    )
