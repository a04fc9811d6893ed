"""Recorded tracks: where people, cars and cyclists really went, read from files and turned into scenarios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from scp_planner.errors import EstimationError, Fault, TracksError
from scp_planner.files import check_extent
from scp_planner.scenario.models import Scenario
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.track_files import _SUFFIXES, Track, _read


class Tracks(Sequence[Track]):
    """Tracks of one place or several; ids are unique."""

    def __init__(self, tracks: Sequence[Track], source: str = "") -> None:
        self._tracks = tuple(tracks)
        self.source = source
        names: set[str] = set()
        for track in self._tracks:
            if track.id in names:
                raise EstimationError(f"tracks: the id {track.id!r} is there twice")
            names.add(track.id)

    def __getitem__(self, index: Any) -> Any:
        return Tracks(self._tracks[index], self.source) if isinstance(index, slice) else self._tracks[index]

    def __len__(self) -> int:
        return len(self._tracks)

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids, in order."""
        return tuple(track.id for track in self._tracks)

    @property
    def start(self) -> float:
        """Time of the first position of all, s."""
        return min(float(track.times[0]) for track in self._tracks)

    @property
    def stop(self) -> float:
        """Time of the last position of all, s."""
        return max(float(track.times[-1]) for track in self._tracks)

    @property
    def observations(self) -> int:
        """Number of positions in all tracks."""
        return sum(len(track) for track in self._tracks)

    def of(self, name: str) -> Track:
        """Give the track with an id."""
        for track in self._tracks:
            if track.id == name:
                return track
        raise EstimationError(f"tracks: there is none with the id {name!r}")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Tracks:
        """Read a file, or all .csv, .txt and .xml files of a folder and of the folders in it.

        In a folder each id begins with the name of its file, as in ``eth_obsmat/12``.

        Parameters
        ----------
        path : path

        Returns
        -------
        Tracks

        Raises
        ------
        TracksError
            Naming the file and, for each fault, the line and the column.
        OSError
            If the file cannot be read.
        """
        root = Path(path)
        if not root.is_dir():
            return cls(_read(root), str(root))
        try:
            check_extent(root)
        except ValueError as error:
            raise TracksError(str(root), [Fault("", str(root), str(error))]) from None
        names = sorted(p for p in root.rglob("*") if p.suffix.lower() in _SUFFIXES and p.is_file())
        if not names:
            raise TracksError(str(root), [Fault("", root.name, f"must hold files ending in {' or '.join(_SUFFIXES)}")])
        tracks = []
        for name in names:
            place = name.relative_to(root).with_suffix("").as_posix()
            for track in _read(name):
                single = track.id == name.stem
                tracks.append(Track(place if single else f"{place}/{track.id}", track.times, track.positions))
        return cls(tracks, str(root))

    @classmethod
    def joined(cls, paths: Sequence[str | PathLike[str]]) -> Tracks:
        """Read several files or folders as one; then each id begins with the name of its file, too.

        Parameters
        ----------
        paths : sequence of path

        Returns
        -------
        Tracks

        Raises
        ------
        TracksError, OSError
            As in :meth:`load`.
        """
        parts = [cls.load(path) for path in paths]
        if len(parts) == 1:
            return parts[0]
        tracks = [
            Track(f"{Path(path).stem}/{track.id}", track.times, track.positions)
            for path, part in zip(paths, parts, strict=True)
            for track in part
        ]
        return cls(tracks, ", ".join(part.source for part in parts))

    def save(self, path: str | PathLike[str]) -> None:
        """Write a CSV file ``id,time,x,y`` that `load` reads back exactly, whole or not at all."""
        from scp_planner import files

        lines = ["id,time,x,y"]
        for track in self._tracks:
            name = f'"{track.id.replace(chr(34), 2 * chr(34))}"' if set(track.id) & set(',"\n') else track.id
            lines += [
                f"{name},{float(t)!r},{float(x)!r},{float(y)!r}"
                for t, (x, y) in zip(track.times, track.positions, strict=True)
            ]
        files.write_text(path, "\n".join(lines) + "\n")

    def halves(self) -> tuple[Tracks, Tracks]:
        """Split into every other track, in the order of the file: one half to fit, one to test."""
        return self[0::2], self[1::2]

    def scenario_at(
        self,
        time: float,
        *,
        start: Mapping[str, Any],
        window: float = 3.0,
        stale: float = 1.0,
        radius: float = 0.3,
        noise: float | None = 0.05,
        order: int = 1,
        process: ProcessModel | None = None,
        **fields: Any,
    ) -> Scenario:
        """Make the scenario of a vehicle that sets off at a moment, from what had been seen by then.

        Parameters
        ----------
        time : float, s
            The moment, on the clock of the tracks.
        start : mapping
            ``position``, ``heading`` and ``speed`` of the vehicle, as in `scp_planner.scenario.models.Start`; its
            time is ``time``.
        window : float, s
            How far back observations are used.
        stale : float, s
            Obstacles that were last seen longer ago than this have gone.
        radius : float, m
            Of the disc that covers an obstacle.
        noise : float or None, m
            Standard deviation of an observed coordinate; None: estimated from the residuals.
        order : int
            Of the motion. Obstacles seen too rarely for it get the highest order that they were seen often
            enough for.
        process : ProcessModel, optional
            A motion with process noise instead.
        **fields
            Further fields of the scenario: its ``vehicle`` and ``goal``, and ``name``, ``bounds``, ``confidence``,
            ``guide`` or others, as in `scp_planner.scenario.models.Scenario`.

        Returns
        -------
        Scenario

        Raises
        ------
        EstimationError
            If an obstacle was seen too rarely for its noise to be estimated.
        ScenarioError
            If the vehicle, its start or its goal is faulty.
        """
        obstacles = []
        for track in self._tracks:
            seen = track.between(time - window, time)
            if seen is None or seen.times[-1] < time - stale:
                continue
            model = {"order": _order_of(seen, order, noise is None and process is None), "process": process}
            covariance = None if noise is None else [[noise**2, 0.0], [0.0, noise**2]]
            positions = {"time": seen.times.tolist(), "position": seen.positions.tolist(), "covariance": covariance}
            shape = {"disc": radius}
            obstacles.append({"id": track.id, "shape": shape, "observations": positions, "model": model})
        named = {"name": f"{Path(self.source).stem or 'tracks'} at {time:g} s", **fields}
        return Scenario(start={**start, "time": float(time)}, obstacles=obstacles, **named)


def _order_of(seen: Track, order: int, is_noise_estimated: bool) -> int:
    """Give the highest order up to one asked for that a track is long enough for."""
    highest = len(seen) - (3 if is_noise_estimated else 1)
    if highest < 0:
        raise EstimationError(f"track {seen.id!r}: {len(seen)} positions are too few to estimate their noise; give it")
    return min(order, highest)
