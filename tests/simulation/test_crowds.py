"""Settings among people."""

from __future__ import annotations

import pytest

import scp_planner as sp
from scp_planner.settings.online import Regions
from scp_planner.simulation.crowds import among_people


def test_a_stop_stays_clear_for_as_long_as_it_takes_to_get_under_way() -> None:
    """Half a width at top speed, 0.3 s, for who has its speed at once; two thirds of 1.5 s for who needs that long."""
    quick = sp.Vehicle(radius=0.3, max_speed=1.0, max_acceleration=4.0, max_deceleration=4.0)
    slow = sp.Vehicle(radius=0.3, max_speed=1.5, max_acceleration=1.0, max_deceleration=1.0)
    assert among_people(quick, 0.25).stay_clear == pytest.approx(0.3)
    assert among_people(slow, 0.1).stay_clear == pytest.approx(1.0)


def test_zones_among_people_are_those_of_the_model() -> None:
    """Zones that follow what came of them fill a crowd."""
    walker = sp.Vehicle(radius=0.3, max_speed=1.0, max_acceleration=4.0, max_deceleration=4.0)
    assert among_people(walker, 0.25).regions is Regions.MODEL
