"""Motions of obstacles as they are given: known exactly, predicted with a covariance, or several that are possible."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from numbers import Real
from typing import Annotated, Any, ClassVar

from pydantic import Discriminator, Field, Tag

from scp_planner.scenario import obstacle_checks
from scp_planner.scenario.validation import (
    Numbers,
    Objection,
    OfNumbers,
    OfParts,
    Part,
    Row,
    Rule,
    TakenAs,
    by_default,
    variant,
)
from scp_planner.scenario.values import Matrix, Number, Rate, Vector


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
    """A motion known exactly: position + velocity t + acceleration t^2 / 2, with t counted from its `time`.

    A scenario fills in its `start.time` where no time is given; so does a planner, for motions that it is given later.
    """

    time: Number | None = Field(
        default=None,
        description="when the obstacle is at the position and has the velocity, s on the clock of start.time; null:"
        " start.time",
    )
    position: OfNumbers[Vector] = Field(description="[x, y] at that time, m")
    velocity: OfNumbers[Rate] = by_default((0.0, 0.0), description="[x, y] at that time, m/s")
    acceleration: OfNumbers[Rate] = by_default((0.0, 0.0), description="[x, y], m/s2")

    @property
    def reference_time(self) -> float:
        """Time at which position and velocity hold, s.

        Raises
        ------
        ValueError
            If it is not known: no time is given, and no scenario has filled it in.
        """
        if self.time is None:
            raise ValueError("motion.time: None; it is start.time of a scenario, and this motion is of none")
        return self.time


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

    time: OfNumbers[Annotated[Row[Number], Field(min_length=2)]] = Field(description="s, increasing")
    position: OfNumbers[Row[Vector]] = Field(description="[[x, y], ...], m, one for each time")
    covariance: TakenAs[Covariance | None, Numbers | None] = by_default(
        None,
        description="of the positions [[xx, xy], [xy, yy]], or one matrix for each time, m2; null: known exactly",
    )
    heading: TakenAs[Row[Number] | None, Numbers | None] = by_default(
        None,
        description="where the shape heads, rad, one for each time, each less than half a turn from the one before;"
        " null: along the velocity, and as last known while it stands",
    )


def _motion_case(data: Any) -> str:
    """Tell a course from a motion by its times: a motion has one, or none."""
    times = data.get("time") if isinstance(data, Mapping) else None
    several = times is not None and not isinstance(times, Real)
    return variant("course" if several or isinstance(data, Course) else "motion")


KnownMotion = Annotated[
    Annotated[Motion, Tag(variant("motion"))] | Annotated[Course, Tag(variant("course"))], Discriminator(_motion_case)
]


class Future(Part):
    """One of the courses that an obstacle may take, and how probable it is."""

    weight: Annotated[float, Field(strict=True, ge=0, le=1)] = Field(description="its probability, from 0 to 1")
    motion: OfParts[KnownMotion] = Field(description="as that of an obstacle: exact, or with a covariance")


def _weights_add_up(futures: Any) -> Iterator[Objection]:
    """The weights of all futures are a probability of 1."""
    total = math.fsum(future.weight for future in futures.futures)
    if abs(total - 1.0) > 1e-6:
        yield Objection(("futures",), total, f"the weights must add up to 1; they add up to {total:.9g}")


class Futures(Part):
    """Several courses that an obstacle may take, of which it takes one: as predictors give them that were learnt.

    All of them are kept clear of, each by as much as it takes for the probability to be outside of all their zones to
    be no larger than the level of confidence allows: see `scp_planner.tracking.confidence`.
    """

    rules: ClassVar[tuple[Rule, ...]] = (_weights_add_up,)

    futures: TakenAs[Annotated[Row[Future], Field(min_length=1)], Sequence[Future | Mapping[str, Any]]] = Field(
        description="[{weight, motion}, ...]; the weights add up to 1, to 1e-06"
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


def timed(motion: GivenMotion, time: float) -> GivenMotion:
    """Motion that holds at a time, s, where it does not say when; in futures too."""
    if isinstance(motion, Motion):
        return motion.model_copy(update={"time": time}) if motion.time is None else motion
    if isinstance(motion, Futures):
        several = [one.model_copy(update={"motion": timed(one.motion, time)}) for one in motion.futures]
        same = all(new.motion is one.motion for new, one in zip(several, motion.futures, strict=True))
        return motion if same else motion.model_copy(update={"futures": tuple(several)})
    return motion


def moves(motion: GivenMotion) -> bool:
    """True if a motion, or any of several futures, is more than a position."""
    if isinstance(motion, Futures):
        return any(moves(one.motion) for one in motion.futures)
    return isinstance(motion, Course) or any((*motion.velocity, *motion.acceleration))


def all_timed(obstacles: Iterable[Any], time: float) -> tuple[Any, ...]:
    """Obstacles whose motions all hold at a time, s, where they do not say when."""
    return tuple([_obstacle_timed(obstacle, time) for obstacle in obstacles])


def _obstacle_timed(obstacle: Any, time: float) -> Any:
    motion = None if obstacle.motion is None else timed(obstacle.motion, time)
    return obstacle if motion is obstacle.motion else obstacle.model_copy(update={"motion": motion})


def is_uncertain(motion: GivenMotion | None) -> bool:
    """True if a motion, or that of an obstacle that has only been observed (None), is not known exactly."""
    if isinstance(motion, Futures):
        return any(is_uncertain(future.motion) for future in motion.futures)
    return motion is None or (isinstance(motion, Course) and motion.covariance is not None)
