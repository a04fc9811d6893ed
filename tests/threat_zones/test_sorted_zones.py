"""Zones of which discs are there as numbers: what is told of them is what is told of zones that are all made."""

from __future__ import annotations

import math

import numpy as np
from scenes import disc, observed, scene
from zone_kinds import shaped

from scp_planner.threat_zones.of_scenario import ZonesOf
from scp_planner.threat_zones.sorted_zones import known_until, told_of

MIXED = scene(
    disc("first", (5.0, 2.0), (0.0, -0.5)),
    observed("seen", 2),
    shaped("box", {"rectangle": [2.0, 1.0]}, (9.0, 3.0)),
    disc("last", (12.0, -2.0), (0.3, 0.0), (0.0, 0.1)),
)


def test_what_is_told_does_not_depend_on_how_zones_are_kept() -> None:
    kept, made = ZonesOf(MIXED), tuple(ZonesOf(MIXED))
    for names in ((), ("first",), ("last", "box"), ("seen", "nobody")):
        told = told_of(kept, names)
        assert [zone.id for zone in told] == [zone.id for zone in made if zone.id in {*names, "seen"}]
        assert [zone.id for zone in told_of(made, names)] == [zone.id for zone in told]


def test_zones_hold_until_the_first_of_them_ends() -> None:
    kept, made = ZonesOf(MIXED), tuple(ZonesOf(MIXED))
    assert known_until(kept) == known_until(made) == min(zone.until for zone in made) < math.inf
    assert known_until(ZonesOf(scene(disc("first", (5.0, 2.0))))) == math.inf


def test_discs_as_numbers_move_as_their_zones_do() -> None:
    kept = ZonesOf(MIXED)
    times = np.array([0.0, 1.0, 3.5])
    centers = kept.discs.centers.grid(times)
    for number, index in enumerate(kept.discs.index.tolist()):
        assert kept[index].id == kept.discs.ids[number] and kept[index].radius == kept.discs.radius[number]
        assert np.allclose(centers[:, number], kept[index].centers.grid(times)[:, 0], rtol=0.0, atol=1e-12)
