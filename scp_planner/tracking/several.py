"""The motions of many obstacles, estimated together where they follow one model of motion with process noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from scp_planner.arrays import Array
from scp_planner.pauses import GoOn, with_pauses
from scp_planner.scenario.models import Observations, Obstacle
from scp_planner.scenario.process_model import ProcessModel
from scp_planner.tracking.estimate import estimate_obstacle
from scp_planner.tracking.motion_estimate import MotionEstimate
from scp_planner.tracking.motion_filter import FEW, MotionFilter

TRACKS_AT_ONCE = 4096  # observations that are taken in together


def estimate_together(obstacles: Sequence[Obstacle], go_on: GoOn | None = None) -> list[MotionEstimate]:
    """Estimate the motions of obstacles of a scenario, from their ``observations`` or ``estimate``."""
    found: dict[int, MotionEstimate] = {}
    alike: dict[tuple[ProcessModel, int], list[int]] = {}
    single = []
    for place, obstacle in enumerate(obstacles):
        model, seen = obstacle.model.process, obstacle.observations
        if model is None or seen is None:
            single.append(place)
        else:
            # Long histories are put together at once, each stretch with that of the others.
            count = len(seen.time)
            alike.setdefault((model, count if count > FEW else 0), []).append(place)
    for place in with_pauses(single, go_on):
        found[place] = estimate_obstacle(obstacles[place])
    for number, (model, places, records) in enumerate(_in_parts(alike, obstacles)):
        if number and go_on is not None:
            go_on()
        filtered = _filtered(model, records, go_on)
        found.update((place, filtered.estimate(k)) for k, place in enumerate(places))
    return [found[place] for place in range(len(obstacles))]


def _in_parts(
    alike: Mapping[tuple[ProcessModel, int], Sequence[int]], obstacles: Sequence[Obstacle]
) -> Iterator[tuple[ProcessModel, Sequence[int], list[Observations]]]:
    """Groups of obstacles, none of them too large: their model, their places, and what was seen of them."""
    for (model, long), places in alike.items():
        size = max(1, TRACKS_AT_ONCE // (long or FEW))
        for begin in range(0, len(places), size):
            some = places[begin : begin + size]
            yield model, some, [seen for place in some if (seen := obstacles[place].observations) is not None]


def _filtered(model: ProcessModel, records: Sequence[Observations], go_on: GoOn | None) -> MotionFilter:
    """Filter states after all observations of obstacles that follow one model."""
    counts = np.array([len(record.time) for record in records])
    longest = int(counts.max())
    times, positions = np.zeros((longest, len(records))), np.zeros((longest, len(records), 2))
    noise = np.broadcast_to(np.eye(2), (longest, len(records), 2, 2)).copy()
    for k, (size, record) in enumerate(zip(counts, records, strict=True)):
        times[:size, k], positions[:size, k] = record.time, record.position
        noise[:size, k] = _noise(model, record)
    filtered = MotionFilter(model, len(records))
    one_by_one = longest if longest <= FEW else 1
    for i in range(one_by_one):
        filtered.update(times[i], positions[i], noise[i], seen=counts > i)
    for begin in range(one_by_one, longest, TRACKS_AT_ONCE):
        if begin > one_by_one and go_on is not None:
            go_on()
        some = slice(begin, begin + TRACKS_AT_ONCE)
        filtered.take_in(times[some], positions[some], noise[some])
    return filtered


def _noise(model: ProcessModel, record: Observations) -> Array:
    """Covariance of an observation, one for all or one for each."""
    if record.covariance is None:
        return model.noise_deviation**2 * np.eye(2)
    given = np.array(record.covariance)
    return 0.5 * (given + np.swapaxes(given, -1, -2))
