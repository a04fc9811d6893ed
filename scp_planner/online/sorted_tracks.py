"""Tracks sorted by how their zones are made, and by whether more is learnt of them."""

from __future__ import annotations

from enum import Enum

from scp_planner.online.track import ObstacleTrack


class TrackKind(Enum):
    """How zones of several tracks are made together."""

    SETTLED = "polynomials from what was seen alone"
    ALARMED = "mixtures of filters"
    NEW = "polynomials from a prior, too"


def track_kind(track: ObstacleTrack, headings: bool) -> TrackKind | None:
    """Return how the zone of a track is made together with others.

    Parameters
    ----------
    track : ObstacleTrack
    headings : bool
        Whether headings are estimated, of what turns with its motion.

    Returns
    -------
    TrackKind or None
        None if it is made alone.
    """
    if track.fixed is not None or track.estimator is None or not track.simple:
        return None
    if track.alarmed:
        return TrackKind.ALARMED
    if headings and track.body.turning is not None:
        return None  # its heading is estimated, too
    if track.settled:
        return TrackKind.SETTLED
    return TrackKind.NEW if track.model.order > 0 else None  # of order 0 no prior tells anything


def learns(track: ObstacleTrack) -> bool:
    """Return whether more is learnt of the polynomial motion of a track with each observation."""
    observed = bool(track.times) and track.fixed is None and track.given is None
    return observed and track.model.process is None and not (track.alarmed or track.suspected)
