"""Observations that come in at any time, also from another thread, and the clocks that they are stamped by."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, Self

from scp_planner.arrays import Array
from scp_planner.online.tolerances import RELATIVE
from scp_planner.prediction import sensor_frames
from scp_planner.prediction.obstacle_tracks import ObstacleTracks
from scp_planner.prediction.track import Seen
from scp_planner.scenario.estimates import Estimate
from scp_planner.scenario.models import Model
from scp_planner.scenario.motions import GivenMotion, moves, timed
from scp_planner.scenario.shapes import Shape
from scp_planner.scenario.units import NaturalUnits, changed
from scp_planner.settings.online import SceneOnlineSettings
from scp_planner.tracking.motion_estimate import HORIZON


@dataclass(frozen=True)
class Stamped:
    """A measurement or a tracker's state of an obstacle."""

    obstacle: str  # Its id
    time: float  # Its stamp, s

    def at(self, time: float) -> Self:
        """A copy with another stamp, s."""
        return replace(self, time=time)


@dataclass(frozen=True)
class Measurement(Stamped):
    """An observation of an obstacle, in the units of the scene."""

    position: tuple[float, float]  # m
    covariance: Array | None  # (2, 2) m2


@dataclass(frozen=True)
class Update(Stamped):
    """State of an obstacle that a tracker reports."""

    given: Estimate

    def at(self, time: float) -> Update:
        return replace(self, time=time, given=changed(self.given, time=time))


@dataclass(frozen=True)
class Forecast:
    obstacle: str  # Its id
    motion: GivenMotion


@dataclass(frozen=True)
class InboxParameters:
    most_notes: int = 100  # Notes that are kept: the last ones
    most_gone: int = 100_000  # Obstacles that have gone, of which it is kept how they were added: the last ones
    most_named: int = 5  # Obstacles named in one note
    most_held: int = 1000  # Measurements of one obstacle that are held back; what comes then is dropped
    # Stamps too late by about as much, by which a lead of a sensor's clock is told from single wrong stamps
    alike: int = 5
    calm: int = 50  # Stamps in time in a row after which there is no lead any more: another one is reported anew


INBOX = InboxParameters()


@dataclass(frozen=True)
class Gone:
    """An obstacle that was removed or forgotten, as it was added; a measurement later than ``time``, s, restores it."""

    time: float
    shape: Shape
    model: Model
    margin: float
    covariance: Array | None


@dataclass
class Lead:
    """Stamps of one obstacle that are too late."""

    held: list[Stamped] = field(default_factory=list)
    ahead: deque[float] = field(default_factory=lambda: deque(maxlen=INBOX.alike))  # s
    reported: bool = False
    dropped: bool = False
    calm: int = 0  # Stamps in time since the last one that was too late


class Stamps:
    """Measurements held back, and leads of their stamps."""

    def __init__(self, start: float, period: float) -> None:
        self.now = start
        self._period = period
        self._interval: float | None = None  # between the last two replans; None before the first one
        self._leads: dict[str, Lead] = {}

    @property
    def begun(self) -> bool:
        """True if there has been a replan."""
        return self._interval is not None

    def tick(self, now: float) -> None:
        """Begin a replan at a time, s."""
        self._interval = 0.0 if self._interval is None else now - self.now
        self.now = now

    def latest(self, replanning: bool) -> float:
        """Latest stamp that is in time, s; between replans the next one is expected as late as the last."""
        ahead = self._period if replanning else max(self._period, self._interval or 0.0)
        return self.now + ahead * (1.0 + RELATIVE)

    def due(self) -> Iterator[Stamped]:
        """Take out of what is held back all whose time has come, in order of time."""
        found = []
        for lead in self._leads.values():
            if lead.held:
                found += [one for one in lead.held if one.time <= self.now]
                lead.held = [one for one in lead.held if one.time > self.now]
        yield from sorted(found, key=lambda one: one.time)

    def in_time(self, one: Stamped) -> bool:
        """Note a stamp in time, and drop what is held back of its obstacle; tell if that is the first to be dropped."""
        lead = self._leads.get(one.obstacle)
        if lead is None:
            return False
        first = bool(lead.held) and not lead.dropped
        lead.held, lead.dropped, lead.calm = [], lead.dropped or first, lead.calm + 1
        if lead.calm >= INBOX.calm:
            del self._leads[one.obstacle]
        return first

    def hold(self, one: Stamped) -> bool:
        """Hold a measurement back; tell if it is the first one of its obstacle for long."""
        first = one.obstacle not in self._leads
        lead = self._leads.setdefault(one.obstacle, Lead())
        if len(lead.held) < INBOX.most_held:
            lead.held.append(one)
        lead.ahead.append(one.time - self.now)
        lead.calm = 0
        return first

    def leading(self) -> dict[str, float]:
        """Leads of obstacles that are constant and have not been reported yet, s: now they have."""
        found, spread = {}, 2.0 * max(self._period, self._interval or 0.0)
        for name, lead in self._leads.items():
            if not lead.reported and len(lead.ahead) == INBOX.alike and max(lead.ahead) - min(lead.ahead) <= spread:
                found[name], lead.reported = sum(lead.ahead) / INBOX.alike, True
        return found

    def forget(self, name: str) -> None:
        self._leads.pop(name, None)


class Inbox:
    def __init__(
        self, obstacles: ObstacleTracks, units: NaturalUnits, start: float, online: SceneOnlineSettings
    ) -> None:
        self.obstacles, self.notes = obstacles, deque[str](maxlen=INBOX.most_notes)
        self.work = Lock()
        self.gone: dict[str, Gone] = {}
        self.stamps = Stamps(start, online.period)
        self._units, self._forget_after = units, online.forget_after
        self._queue: deque[Stamped | Forecast] = deque()

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the lock: a copy has its own."""
        return {name: value for name, value in self.__dict__.items() if name != "work"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.work = Lock()

    def __bool__(self) -> bool:
        return bool(self._queue)

    def put(self, one: Stamped | Forecast) -> None:
        """Take an observation, or what a tracker or a predictor says."""
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

    def take_in(self, replanning: bool = False) -> None:
        """Let the obstacles take in what has been observed, but for stamps of times that have not come yet."""
        frame: dict[str, Measurement] = {}
        for one in self._in_time(replanning):
            if isinstance(one, Measurement) and one.obstacle not in frame:
                frame[one.obstacle] = one
                continue
            self._take_in_frame(frame)
            frame = {}
            if isinstance(one, Measurement):
                frame[one.obstacle] = one
            elif isinstance(one, Forecast):
                if self._returned(one.obstacle, math.inf):
                    self.obstacles.foretell(one.obstacle, one.motion)
            elif isinstance(one, Update) and self._returned(one.obstacle, one.time):
                self._note(one, self.obstacles.update(one.obstacle, one.given))
        self._take_in_frame(frame)

    def _in_time(self, replanning: bool) -> Iterator[Stamped | Forecast]:
        """Give what was held back and is due, then what has come since."""
        latest = self.stamps.latest(replanning)
        yield from self.stamps.due()
        while self._queue:
            one = self._queue[0]
            if not isinstance(one, Forecast) and one.time > latest and not replanning:
                return
            self._queue.popleft()
            if isinstance(one, Forecast):
                yield one
            elif one.time > latest:
                self._hold(one)
            else:
                if self.stamps.in_time(one):
                    self._note(one, "it came after one with a later stamp, which is dropped")
                if one.time >= self.stamps.now - HORIZON:
                    yield one
                elif self._is_news(one):
                    yield one.at(self.stamps.now - HORIZON)

    def _is_news(self, one: Stamped) -> bool:
        """True if anything older than zones reach is worth knowing, since nothing newer is: then it is all there is."""
        track = self.obstacles.tracks.get(one.obstacle)
        if track is not None and (track.fixed is not None or track.newest > self.stamps.now - HORIZON):
            self._note(one, "it is older than anything is predicted, and left out")
            return False
        self._note(one, "it is older than anything is predicted, and taken for as old as that")
        return True

    def _afresh(self, name: str) -> None:
        """Begin a track again that has seen nothing for longer than anything is predicted, if it is such a one."""
        track = self.obstacles.tracks[name]
        if track.history and track.newest <= self.stamps.now - HORIZON:
            self.obstacles.remove(name)
            margin = track.margin - self.obstacles.margin
            self.obstacles.add_unseen(name, track.shape, track.model, margin, track.covariance)

    def _hold(self, one: Stamped) -> None:
        if self.stamps.hold(one):
            ahead = (one.time - self.stamps.now) * self._units.time
            self._note(one, f"it is {ahead:.3g} s ahead of the clock of the replans, and held back until then")

    def _returned(self, name: str, time: float) -> bool:
        """Bring an obstacle back that is seen after it had gone; tell if there is one of that name."""
        if name in self.obstacles.tracks:
            return True
        gone = self.gone.get(name)
        if gone is None or time <= gone.time:
            return False
        self.obstacles.add_unseen(name, gone.shape, gone.model, gone.margin, gone.covariance)
        self.notes.append(f"{name}: it had gone, and is back as it was added")
        return True

    def timed(self, name: str, motion: GivenMotion) -> GivenMotion:
        """Motion that holds at the start, in SI units, where it does not say when; with a note once replans began."""
        made, start = timed(motion, self._units.clock), self._units.clock
        if made is not motion and self.stamps.begun and moves(made):
            self.notes.append(f"{name}: its motion has no time, and is taken to hold at the start, {start:.3f} s")
        return made

    def leads(self) -> Iterator[str]:
        """Report the leads of clocks that have been noticed since it was last asked."""
        leading = self.stamps.leading()
        if not leading:
            return
        names, more = ", ".join(list(leading)[: INBOX.most_named]), len(leading) - INBOX.most_named
        others = f" and {more} others" if more > 0 else ""
        ahead = sum(leading.values()) / len(leading) * self._units.time
        yield (
            f"stamps of {names}{others} are about {ahead:.3g} s ahead of the clock of the replans: what is seen is"
            " used so much too late, and taken for newer than it is"
        )

    def _take_in_frame(self, frame: Mapping[str, Measurement]) -> None:
        some = [one for name, one in frame.items() if self._returned(name, one.time)]
        if not some:
            return
        for one in some:
            self._afresh(one.obstacle)
        seen = [Seen(one.time, one.position, one.covariance) for one in some]
        said = sensor_frames.take_in(self.obstacles, [one.obstacle for one in some], seen)
        for one, fault in zip(some, said, strict=True):
            self._note(one, fault)

    def _note(self, one: Stamped, fault: str | None) -> None:
        if fault is not None:
            self.notes.append(f"{one.obstacle} at t = {self._units.absolute(one.time):.3f} s: {fault}")

    def knows(self, name: str) -> bool:
        """True if an obstacle of that name has ever been added."""
        return name in self.obstacles.tracks or name in self.gone

    def forget(self, time: float) -> None:
        """Forget the obstacles that have not been seen for long, at a time, s."""
        for track in list(self.obstacles.tracks.values()):
            if track.history and track.fixed is None and time - track.newest > self._forget_after:
                gone_for = self._forget_after * self._units.time
                self.notes.append(f"{track.id}: forgotten, not seen for {gone_for:g} s")
                self.remove(track.id, time - self._forget_after)

    def dismiss(self, name: str) -> None:
        """Remove an obstacle now, if it has not gone already; what waits is of this one, and not of its next."""
        self.settle()
        if name in self.obstacles.tracks:
            self.remove(name, self.stamps.now)
        else:
            self.notes.append(f"{name}: removed, but it had gone already")

    def remove(self, name: str, time: float) -> None:
        """Remove an obstacle and what is held back of it; what is seen of it after a time, s, brings it back."""
        track = self.obstacles.tracks[name]
        self.gone[name] = Gone(time, track.shape, track.model, track.margin - self.obstacles.margin, track.covariance)
        if len(self.gone) > INBOX.most_gone:
            del self.gone[next(iter(self.gone))]
        self.obstacles.remove(name)
        self.stamps.forget(name)
