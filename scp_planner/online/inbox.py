"""Observations that come in at any time, also from another thread while a replan is at work."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from threading import Lock

from scp_planner.arrays import Array
from scp_planner.online import sensor_frames
from scp_planner.online.obstacle_tracks import ObstacleTracks
from scp_planner.online.track import Seen
from scp_planner.online.updates import Forecast, Update
from scp_planner.scenario.units import NaturalUnits

MOST_NOTES = 100


@dataclass(frozen=True)
class Sighting:
    """An observation of an obstacle, in the units of the scene.

    Attributes
    ----------
    obstacle : str
        Its id.
    time : float
        s.
    position : (x, y)
        m.
    covariance : (2, 2) array or None
        m2.
    """

    obstacle: str
    time: float
    position: tuple[float, float]
    covariance: Array | None


class Inbox:
    """What has been observed and not been taken in yet.

    Parameters
    ----------
    obstacles : ObstacleTracks
        That take it in.
    units : NaturalUnits
        Of the scene: notes are in those of the user.
    forget_after : float
        Units of time after which an obstacle that is not seen has gone.

    Attributes
    ----------
    notes : deque of str
        What was odd about observations, the newest last.
    work : Lock
        Held by whoever works on the obstacles.
    """

    def __init__(self, obstacles: ObstacleTracks, units: NaturalUnits, forget_after: float) -> None:
        self.obstacles, self.notes = obstacles, deque[str](maxlen=MOST_NOTES)
        self.work = Lock()
        self._units, self._forget_after = units, forget_after
        self._queue: deque[Sighting | Update | Forecast] = deque()

    def __bool__(self) -> bool:
        """Whether there is anything in it."""
        return bool(self._queue)

    def put(self, one: Sighting | Update | Forecast) -> None:
        """Take an observation, or what a tracker or a predictor says.

        What is seen at about the same time is taken in together: when it is needed, or when there is as much of it as
        there are obstacles. A replan that is at work takes it in itself.
        """
        self._queue.append(one)
        if len(self._queue) >= len(self.obstacles.tracks):
            self.settle()

    def settle(self) -> None:
        """Let the obstacles take in what has been observed, if nobody is at work on them."""
        if self.work.acquire(blocking=False):
            try:
                self.take_in()
                self.obstacles.prepare()
            finally:
                self.work.release()

    def take_in(self) -> None:
        """Let the obstacles take in what has been observed."""
        frame: dict[str, Sighting] = {}
        while self._queue:
            one = self._queue.popleft()
            if isinstance(one, Sighting) and one.obstacle not in frame:
                frame[one.obstacle] = one
                continue
            self._take_in_frame(frame)
            frame = {}
            if isinstance(one, Sighting):
                frame[one.obstacle] = one
            elif isinstance(one, Forecast):
                one.taken_in(self.obstacles)
            else:
                self._note(one, one.taken_in(self.obstacles))
        self._take_in_frame(frame)

    def _take_in_frame(self, frame: Mapping[str, Sighting]) -> None:
        some = [one for name, one in frame.items() if name in self.obstacles.tracks]
        if not some:
            return
        seen = [Seen(one.time, one.position, one.covariance) for one in some]
        said = sensor_frames.take_in(self.obstacles, [one.obstacle for one in some], seen)
        for one, fault in zip(some, said, strict=True):
            self._note(one, fault)

    def _note(self, one: Sighting | Update, fault: str | None) -> None:
        if fault is not None:
            self.notes.append(f"{one.obstacle} at t = {self._units.absolute(one.time):.3f} s: {fault}")

    def forget(self, time: float) -> None:
        """Forget the obstacles that have not been seen for long, at a time, s."""
        for track in list(self.obstacles.tracks.values()):
            if track.times and track.fixed is None and time - track.times[-1] > self._forget_after:
                gone_for = self._forget_after * self._units.time
                self.notes.append(f"{track.id}: forgotten, not seen for {gone_for:g} s")
                self.obstacles.remove(track.id)
