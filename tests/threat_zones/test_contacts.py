"""Contacts that others of the same place imply, against moves drawn at random."""

from __future__ import annotations

import numpy as np
import pytest

from scp_planner.threat_zones.contacts import ZoneContacts, leading

pytestmark = pytest.mark.numerics

MOVE = 0.4


def contacts_at(places: int, each: int) -> tuple[np.ndarray, ZoneContacts]:
    """Contacts with walls to two sides of some places, many of them with nearly the same ones."""
    rng = np.random.default_rng(4)
    place = np.repeat(np.arange(places), each)
    way = np.where(rng.random(len(place)) < 0.5, 0.0, np.pi) + 0.3 * rng.normal(size=len(place))
    distance = rng.uniform(-0.1, 0.5, len(place))
    return place, ZoneContacts(distance, np.stack([np.cos(way), np.sin(way)], axis=1), np.zeros(len(place)))


def test_what_is_left_out_is_implied_by_what_is_kept_for_all_moves() -> None:
    place, contacts = contacts_at(30, 12)
    kept = leading(place, contacts, MOVE)
    assert np.all(np.diff(kept) > 0)
    assert 30 <= len(kept) < 0.7 * len(place)
    rng = np.random.default_rng(5)
    way, far = rng.uniform(0.0, 2.0 * np.pi, 400), MOVE * np.sqrt(rng.random(400))
    moves = np.stack([far * np.cos(way), far * np.sin(way)])
    left = contacts.distance[:, None] + contacts.normal @ moves
    for one in range(30):
        mine = np.flatnonzero(place == one)
        least = left[np.intersect1d(kept, mine)].min(axis=0)
        assert np.all(left[mine].min(axis=0) >= least - 1e-7)


def test_those_that_are_one_but_for_rounding_are_told_once() -> None:
    normal = np.array([[0.0, 1.0], [1e-12, 1.0], [0.0, -1.0], [0.0, 1.0]])
    contacts = ZoneContacts(np.array([0.2, 0.2 - 1e-14, 0.2, 0.2]), normal, np.zeros(4))
    assert leading(np.array([0, 0, 0, 1]), contacts, 1e3).tolist() == [0, 2, 3]
    assert leading(np.zeros(0, dtype=np.intp), ZoneContacts(np.zeros(0), np.zeros((0, 2)), np.zeros(0)), 1.0).size == 0
