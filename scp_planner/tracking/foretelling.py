"""Predictions of many motions over one span of time, all of one kind at once."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence

from scp_planner.tracking.dynamics import WhiteJerk
from scp_planner.tracking.motion_estimate import MotionEstimate, PolynomialEstimate, lengths_together
from scp_planner.tracking.process_estimate import ProcessEstimate, spans_of


def foretell(estimates: Iterable[MotionEstimate], start: float, span: float) -> None:
    """Compute what zones of several motions are made from, and have the estimates keep it."""
    alike: dict[tuple[float, Hashable], list[MotionEstimate]] = {}
    for one in estimates:
        alike.setdefault((max(start, one.earliest), _kind(one)), []).append(one)
    for (begin, _), some in alike.items():
        _foretell_processes([one for one in some if isinstance(one, ProcessEstimate)], begin, begin + span)
        _foretell_polynomials([one for one in some if isinstance(one, PolynomialEstimate)], begin, begin + span)


def _kind(one: MotionEstimate) -> Hashable:
    """Key of motions that can be computed together."""
    if isinstance(one, ProcessEstimate):
        return one.dynamics, one.tails, one.reference_time
    if isinstance(one, PolynomialEstimate):
        return one.order, one.regressors is None, one.center_time, one.time_scale
    return None


def _foretell_processes(some: Sequence[ProcessEstimate], start: float, stop: float) -> None:
    if not some:
        return
    spans, (first, last) = spans_of(some), (float(some[0].lead(time)) for time in (start, stop))
    for one, length in zip(some, spans.lengths(first, last).tolist(), strict=True):
        one.keep((start, stop), length)
    if not isinstance(spans.dynamics, WhiteJerk):  # whose polynomials are exact, and at hand
        for one, pieces in zip(some, spans.pieces(first, last), strict=True):
            one.keep((start, stop), pieces)


def _foretell_polynomials(some: Sequence[PolynomialEstimate], start: float, stop: float) -> None:
    if not some or some[0].order == 0:
        return
    for one, length in zip(some, lengths_together(some, start, stop).tolist(), strict=True):
        one.keep((start, stop), length)
