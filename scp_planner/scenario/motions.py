"""Motions of obstacles as they are given: known exactly, predicted with a covariance, or several that are possible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Discriminator, Field, Tag

from scp_planner.scenario import obstacle_checks
from scp_planner.scenario.validation import Objection, Part, Row, Rule, variant
from scp_planner.scenario.values import Matrix, Number, Rate, Vector

WEIGHTS_ROUNDING = 1e-6
"""By so much the weights of futures may miss 1, as those of a predictor that computes in single precision do."""


def _covariance_case(data: Any) -> str:
    """Tell one matrix from a list of matrices by what stands two brackets deep."""
    try:
        return variant("each" if isinstance(data[0][0], (list, tuple)) else "common")
    except (TypeError, LookupError):
        return variant("common")


Covariance = Annotated[
    Annotated[Matrix, Tag(variant("common"))] | Annotated[Row[Matrix], Tag(variant("each"))],
    Discriminator(_covariance_case),
]


class Motion(Part):
    """A motion known exactly: position + velocity t + acceleration t^2 / 2, t the clock of `start.time`."""

    position: Vector = Field(description="[x, y] at t = 0, m")
    velocity: Rate = Field(default=(0.0, 0.0), description="[x, y] at t = 0, m/s")
    acceleration: Rate = Field(default=(0.0, 0.0), description="[x, y], m/s2")


class Course(Part):
    """A motion given by positions at times, such as another program's prediction: a cubic spline through them.

    After the last time it goes straight on at the speed that it then has, and before the first one too. With a
    covariance the positions are those of a prediction: the obstacle keeps clear of at the level of confidence that is
    asked for, its errors between two times in line with those there, and after the last time as large as then.
    """

    rules: ClassVar[tuple[Rule, ...]] = (
        obstacle_checks.times_increase,
        obstacle_checks.one_position_a_time,
        obstacle_checks.covariance_is_one_or_each,
        obstacle_checks.covariance_is_definite,
        obstacle_checks.headings_turn_slowly,
    )

    time: Annotated[Row[Number], Field(min_length=2)] = Field(description="s, increasing")
    position: Row[Vector] = Field(description="[[x, y], ...], m, one for each time")
    covariance: Covariance | None = Field(
        default=None,
        description="of the positions [[xx, xy], [xy, yy]], or one matrix for each time, m2; null: known exactly",
    )
    heading: Row[Number] | None = Field(
        default=None,
        description="where the shape heads, rad, one for each time, each less than half a turn from the one before;"
        " null: along the velocity, and as last known while it stands",
    )


def _motion_case(data: Any) -> str:
    """Tell a course from a motion by its times."""
    given = isinstance(data, Course) or (isinstance(data, Mapping) and "time" in data)
    return variant("course" if given else "motion")


KnownMotion = Annotated[
    Annotated[Motion, Tag(variant("motion"))] | Annotated[Course, Tag(variant("course"))],
    Discriminator(_motion_case),
]


class Future(Part):
    """One of the courses that an obstacle may take, and how probable it is."""

    weight: Annotated[float, Field(strict=True, ge=0, le=1)] = Field(description="its probability, from 0 to 1")
    motion: KnownMotion = Field(description="as that of an obstacle: exact, or with a covariance")


def _weights_add_up(futures: Any) -> Iterator[Objection]:
    """The weights of all futures are a probability of 1."""
    total = math.fsum(future.weight for future in futures.futures)
    if abs(total - 1.0) > WEIGHTS_ROUNDING:
        yield Objection(("futures",), total, f"the weights must add up to 1; they add up to {total:.9g}")


class Futures(Part):
    """Several courses that an obstacle may take, of which it takes one: as predictors give them that were learnt.

    All of them are kept clear of, each by as much as it takes for the probability to be outside of all their zones to
    be no larger than the level of confidence allows: see `scp_planner.estimation.risk`.
    """

    rules: ClassVar[tuple[Rule, ...]] = (_weights_add_up,)

    futures: Annotated[Row[Future], Field(min_length=1)] = Field(
        description=f"[{{weight, motion}}, ...]; the weights add up to 1, to {WEIGHTS_ROUNDING:g}"
    )


def _given_case(data: Any) -> str:
    """Tell several futures from one motion."""
    if isinstance(data, Futures) or (isinstance(data, Mapping) and "futures" in data):
        return variant("futures")
    return _motion_case(data)


GivenMotion = Annotated[
    Annotated[Motion, Tag(variant("motion"))]
    | Annotated[Course, Tag(variant("course"))]
    | Annotated[Futures, Tag(variant("futures"))],
    Discriminator(_given_case),
]


def is_uncertain(motion: GivenMotion | None) -> bool:
    """Whether a motion, or that of an obstacle that has only been observed (None), is not known exactly.

    Futures without a covariance are all kept clear of: so what they say is certain.
    """
    if isinstance(motion, Futures):
        return any(is_uncertain(future.motion) for future in motion.futures)
    return motion is None or (isinstance(motion, Course) and motion.covariance is not None)
