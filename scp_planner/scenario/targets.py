"""A target: something that moves and that the trip is to meet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field

from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.motions import KnownMotion, timed
from scp_planner.scenario.obstacle_checks import enough_observations, no_prior_of_an_estimate, one_is_given
from scp_planner.scenario.obstacles import Observations, OfModel, any_model
from scp_planner.scenario.validation import OfParts, Part, Rule, TakenAs, by_default
from scp_planner.scenario.values import Text

PartT = TypeVar("PartT", bound=Part)
_FORMS = ("motion", "observations", "estimate", "obstacle")
_HAS_ONE_FORM = one_is_given(_FORMS, "a motion, observations, an estimate or an obstacle")


class Target(Part):
    """Motion to meet, in the form that an obstacle has it, or the id of an obstacle, whose motion it then is."""

    rules: ClassVar[tuple[Rule, ...]] = (_HAS_ONE_FORM, enough_observations, no_prior_of_an_estimate)

    motion: OfParts[KnownMotion | None] = by_default(
        None, description="known exactly, or predicted: a motion or a course"
    )
    observations: OfParts[Observations | None] = by_default(None, description="from which the motion is estimated")
    estimate: OfParts[Estimate | None] = by_default(None, description="state and covariance from a tracker")
    obstacle: Text | None = Field(default=None, description="id of an obstacle of the scenario")
    model: OfModel = any_model()


def as_target(data: Any) -> Any:
    """Read the id of an obstacle as a target, and a course as its motion."""
    if isinstance(data, str):
        return {"obstacle": data}
    if isinstance(data, Mapping) and "course" in data and "motion" not in data:
        return {**{key: value for key, value in data.items() if key != "course"}, "motion": data["course"]}
    return data


OfTarget = TakenAs[Annotated[Target | None, BeforeValidator(as_target)], Target | Mapping[str, Any] | str | None]
"""Target of a goal or of a place to pass, or None: a part, its data, or the id of an obstacle."""


def target_timed(goal: PartT, time: float) -> PartT:
    """Return a goal or a place whose target's motion, if it does not say when it holds, holds at a time, s."""
    target = _field(goal, "target")
    motion = None if target is None or target.motion is None else timed(target.motion, time)
    if motion is None or motion is target.motion:
        return goal
    return goal.model_copy(update={"target": target.model_copy(update={"motion": motion})})


def obstacle_met(goal: Any) -> str | None:
    """Id of the obstacle that the data of a goal, or a goal, is to meet; None where there is none."""
    name = _field(as_target(_field(goal, "target")), "obstacle")
    return name if isinstance(name, str) else None


def about_where(data: Any, obstacles: Any, start: Any, speed: Any) -> tuple[float, float] | None:
    """Place at which a vehicle of a speed, m/s, that sets out now could meet a target; None of faulty data.

    The target is taken to keep the velocity that it has. The place only sets the scale of the scene, and where the
    search for the meeting begins.
    """
    target = as_target(data)
    name = _field(target, "obstacle")
    if name is not None:
        some = obstacles if isinstance(obstacles, Sequence) else ()
        target = next((one for one in some if _field(one, "id") == name), None)
    try:
        begin = tuple(float(value) for value in _field(start, "position"))
        time, place, velocity = _state(target, float(_field(start, "time")))
        away = [p + v * time - b for p, v, b in zip(place, velocity, begin, strict=True)]
        ahead = _time_to_meet(away, velocity, float(speed))
        x, y = (b + d + v * ahead for b, d, v in zip(begin, away, velocity, strict=True))
    except (TypeError, ValueError, IndexError, AttributeError, OverflowError):
        return None
    return (x, y) if math.isfinite(x) and math.isfinite(y) else None


def _field(data: Any, name: str) -> Any:
    value = data.get(name) if isinstance(data, Mapping) else getattr(data, name, None)
    return value.tolist() if isinstance(value, np.ndarray) else value


def _state(target: Any, now: float) -> tuple[float, list[float], list[float]]:
    """Time from a state to now, s, and the state's position and velocity."""
    seen = _field(target, "observations")
    given = next((one for one in (_field(target, "motion"), seen, _field(target, "estimate")) if one is not None), None)
    times, positions = _field(given, "time"), _field(given, "position")
    if isinstance(times, Sequence):
        ends = (0, -1) if seen is not None else (-2, -1)
        (first, last), (p, q) = ([float(times[k]) for k in ends], [positions[k] for k in ends])
        passed = last - first
        velocity = [(float(b) - float(a)) / passed if passed > 0.0 else 0.0 for a, b in zip(p, q, strict=True)]
        if seen is None and float(times[0]) > now:
            return 0.0, [float(value) for value in positions[0]], [0.0, 0.0]
        return now - last, [float(value) for value in q], velocity
    velocity = [float(value) for value in _field(given, "velocity") or (0.0, 0.0)]
    return 0.0 if times is None else now - float(times), [float(value) for value in positions], velocity


def _time_to_meet(away: Sequence[float], velocity: Sequence[float], speed: float) -> float:
    """Least t >= 0 with |away + t velocity| = t speed, s; 0 where there is none."""
    a = sum(v * v for v in velocity) - speed * speed
    half = sum(d * v for d, v in zip(away, velocity, strict=True))
    c = sum(d * d for d in away)
    inside = half * half - a * c
    if c == 0.0 or inside < 0.0 or (a >= 0.0 and half >= 0.0):
        return 0.0
    root = math.sqrt(inside)
    return (root + half) / -a if half > 0.0 else c / (root - half)
