"""Zones of motions that are given, kept from one replan to the next."""

from __future__ import annotations

from dataclasses import dataclass

from scp_planner.scenario.motions import GivenMotion
from scp_planner.threat_zones.zone import ThreatZone


@dataclass(frozen=True)
class GivenZones:
    """Zones of a motion that is given, and what they were made of: many replans ask for the same ones."""

    motion: GivenMotion
    uncertain: int
    zones: tuple[ThreatZone, ...]
