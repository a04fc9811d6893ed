"""Cuts of zones against zones: what is not blocked is free, and what is blocked deeply is not."""

from __future__ import annotations

import numpy as np
import pytest
from zone_kinds import KINDS, batch_of

from scp_planner.threat_zones.sections import sections

pytestmark = pytest.mark.numerics


def test_sections_contain_exactly_what_is_inside() -> None:
    _, batch = batch_of(KINDS)
    rng = np.random.default_rng(0)
    lines = 16
    index = np.repeat(np.arange(batch.size), lines)
    times = rng.uniform(0.0, 6.0, len(index))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(index))
    tangents = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normals = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    origins = batch.centers.at(index, times) + rng.normal(size=(len(index), 2)) * 1.5
    cut = sections(batch, index, times, origins, tangents)
    offsets = np.linspace(-15.0, 15.0, 2001)
    met, slack = 0, []
    for row in range(len(index)):
        points = origins[row] + offsets[:, None] * normals[row]
        distance = batch.contacts(np.full(2001, index[row]), np.full(2001, times[row]), points).distance
        inside = offsets[distance < 0.0]
        if len(inside):
            met += 1
            assert cut.lower[row] <= inside[0] and inside[-1] <= cut.upper[row]
            if offsets[0] < inside[0] and inside[-1] < offsets[-1]:
                slack += [inside[0] - cut.lower[row], cut.upper[row] - inside[-1]]
        elif cut.lower[row] <= cut.upper[row]:
            # only a round corner's tangents reach the line
            assert distance.min() < 0.02 * (1.0 + batch.reach(times[row : row + 1])[0, index[row]])
    assert met > 0.6 * len(index)
    assert np.median(slack) < 0.02
    assert np.quantile(slack, 0.9) < 0.2


def test_what_stands_is_known_to_stand() -> None:
    _, batch = batch_of(KINDS)
    assert [batch.ids[k] for k in batch.standing] == ["standing", "wall", "standing egg"]
    assert sorted([*batch.standing, *batch.moving]) == list(range(batch.size))
