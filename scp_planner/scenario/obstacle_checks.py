"""Rules of obstacles and their motions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

from scp_planner.errors import MISSING
from scp_planner.scenario.tolerances import DEFINITE, SYMMETRY
from scp_planner.scenario.validation import Objection, Rule

MOST_TURNED = 3.0  # rad from one heading of a course to the next: half a turn could be to either side

WHEREABOUTS = ("motion", "observations", "estimate")
"""Fields of which an obstacle has exactly one."""


def one_is_given(names: tuple[str, ...], missing: str) -> Rule:
    """Make the rule that exactly one of some fields is given, and say what is missing where none is."""

    def rule(part: Any) -> Iterator[Objection]:
        # A faulty one is there all the same: what is left of it is not None.
        given = [(name, value) for name in names if (value := getattr(part, name)) is not None]
        for name, value in given[1:]:
            yield Objection((name,), value, f"must be left out where {given[0][0]} is given")
        if not given:
            yield Objection((names[0],), MISSING, f"missing; {missing} must be given")

    return rule


def no_prior_of_an_estimate(obstacle: Any) -> Iterator[Objection]:
    """An estimate has no prior: the tracker has used it."""
    if obstacle.estimate is not None and obstacle.model.prior is not None:
        yield Objection(("model", "prior"), obstacle.model.prior, "must be null where an estimate is given")


def enough_observations(obstacle: Any) -> Iterator[Objection]:
    """There are enough observations for the model's order, and for the covariance if it is estimated."""
    if obstacle.observations is None:
        return
    model, count = obstacle.model, len(obstacle.observations.time)
    if model.process is not None:
        if not count:
            yield Objection(("observations", "time"), obstacle.observations.time, "must have at least 1 entry")
        return
    order, prior = model.order, model.prior
    # order + 1 coefficients. The quantile of F(2, n - order - 2) and an invertible 2 x 2 estimate of the
    # covariance need two degrees of freedom more.
    estimated = obstacle.observations.covariance is None
    least = order + 3 if estimated else order + 1
    if prior is not None and not estimated:
        # what the prior tells need not be observed
        given = (prior.velocity_deviation, prior.acceleration_deviation)[:order]
        least -= sum(deviation is not None for deviation in given)
    if count < least:
        why = "the covariance to be estimated (null)" if estimated else "a known covariance"
        text = f"too few: order {order} and {why} need at least {least} observations, not {count}"
        yield Objection(("observations", "time"), obstacle.observations.time, text)


def prior_says_something(prior: Any) -> Iterator[Objection]:
    """A prior gives at least one deviation."""
    if prior.velocity_deviation is None and prior.acceleration_deviation is None:
        yield Objection((), MISSING, "must give velocity_deviation, acceleration_deviation or both")


def prior_or_process(model: Any) -> Iterator[Objection]:
    """A motion with process noise has its own prior."""
    if model.prior is not None and model.process is not None:
        yield Objection(("prior",), model.prior, "must be null where process is given")
    if model.manoeuvre > 0.0 and model.process is not None:
        yield Objection(
            ("manoeuvre",), model.manoeuvre, "must be 0 where process is given, which has manoeuvres of its own"
        )


def times_increase(observations: Any) -> Iterator[Objection]:
    """Each observation is later than the one before."""
    times = observations.time
    for i in range(1, len(times)):
        if times[i] <= times[i - 1]:
            yield Objection(("time", i), times[i], f"must be later than the time before it, {times[i - 1]!r} s")


def one_position_a_time(observations: Any) -> Iterator[Objection]:
    """There are as many positions as times."""
    count = len(observations.time)
    if len(observations.position) != count:
        text = f"must have as many entries as time, {count}, not {len(observations.position)}"
        yield Objection(("position",), observations.position, text)


def headings_turn_slowly(course: Any) -> Iterator[Objection]:
    """There are as many headings as times, each less than half a turn from the one before, and no covariance."""
    if course.heading is None:
        return
    if course.covariance is not None:
        yield Objection(("heading",), course.heading, "must be null where a covariance is given")
    if len(course.heading) != len(course.time):
        text = f"must have as many entries as time, {len(course.time)}, not {len(course.heading)}"
        yield Objection(("heading",), course.heading, text)
    for i, (before, after) in enumerate(itertools.pairwise(course.heading), start=1):
        if abs(math.remainder(after - before, 2.0 * math.pi)) >= MOST_TURNED:
            yield Objection(
                ("heading", i), after, f"must be less than {MOST_TURNED:g} rad from the one before it, {before:g}"
            )


def covariance_is_one_or_each(observations: Any) -> Iterator[Objection]:
    """There is one covariance, or as many as times."""
    covariance = observations.covariance
    if covariance is None or not _is_list_of_matrices(covariance):
        return
    count = len(observations.time)
    if len(covariance) != count:
        text = f"must be one matrix or as many as time has entries, {count}, not {len(covariance)}"
        yield Objection(("covariance",), covariance, text)


def covariance_is_definite(observations: Any) -> Iterator[Objection]:
    """Each covariance is symmetric and positive definite."""
    covariance = observations.covariance
    if covariance is None:
        return
    each = _is_list_of_matrices(covariance)
    for i, matrix in enumerate(covariance if each else [covariance]):
        (xx, xy), (yx, yy) = matrix
        path = ("covariance", i) if each else ("covariance",)
        scale = math.sqrt(max(xx, 0.0)) * math.sqrt(max(yy, 0.0))
        if abs(xy - yx) > SYMMETRY * scale and xy != yx:
            yield Objection(path, matrix, "must be symmetric")
        elif not (scale > 0 and (xy / scale) ** 2 < 1 - DEFINITE):
            yield Objection(path, matrix, "must be positive definite")


def _is_list_of_matrices(covariance: Any) -> bool:
    return not isinstance(covariance[0][0], float) if covariance else True
