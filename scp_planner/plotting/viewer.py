"""A plan, or whatever else was recorded, as one HTML file to look at in a browser."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from html import escape
from importlib.resources import files
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.arrays import Array
from scp_planner.files import check_suffix, write_text
from scp_planner.plotting.borders import borders_of
from scp_planner.plotting.ground import slow_boxes
from scp_planner.plotting.recording import ObstacleRecord, Recording, Truth, record_plan
from scp_planner.plotting.scales import unit_of
from scp_planner.settings.pictures import PAGE_SUFFIXES

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario

FEWEST_SAMPLES, PAGE_SAMPLES = 100, 800


def save_viewer(plan: Plan, scenario: Scenario, path: str | PathLike[str], *, truth: Truth | None = None) -> None:
    """Save a plan as an HTML file: map with zones and vehicle, profiles against limits, time slider.

    Parameters
    ----------
    plan : Plan
    scenario : Scenario
    path : path
        .html
    truth : mapping, optional
        What obstacles really did, see `scp_planner.plotting.recording.Truth`.

    Raises
    ------
    ValueError
        If the suffix is another one, or `truth` names an unknown obstacle.
    """
    # A sample each 0.05 s.
    samples = int(np.clip(math.ceil(plan.travel_time / 0.05), FEWEST_SAMPLES, PAGE_SAMPLES))
    save_recording(record_plan(plan, scenario, samples + 1, truth), path)


def save_recording(recording: Recording, path: str | PathLike[str]) -> None:
    """Save a recording as an HTML file.

    Parameters
    ----------
    recording : Recording
    path : path
        .html

    Raises
    ------
    ValueError
        If the suffix is another one.
    """
    check_suffix(path, PAGE_SUFFIXES)
    write_text(path, to_html(recording))


def to_html(recording: Recording) -> str:
    """Give the viewer's page for a recording."""
    page = (files("scp_planner.plotting") / "assets" / "viewer.html").read_text(encoding="utf-8")
    before, rest = page.split("[[title]]")
    between, after = rest.split("[[data]]")
    return "".join([before, escape(recording.name), between, _script_safe(_data_of(recording)), after])


def _script_safe(data: dict[str, Any]) -> str:
    """Write JSON that can stand in a script element: no text of the data can end it or begin another."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _data_of(recording: Recording) -> dict[str, Any]:
    """Give what the page's script reads; positions are relative to an origin, as SVG knows only single precision."""
    low, high = recording.extent()
    origin = np.round(0.5 * (low + high))
    # About 1e-5 of the picture: far less than a pixel.
    digits = max(0, 5 - math.floor(math.log10(float((high - low).max()))))
    rounding = _Rounding(digits)

    def placed(points: Any) -> Any:
        return None if points is None else rounding.of(np.asarray(points) - origin)

    return {
        "name": recording.name,
        "facts": recording.facts,
        "origin": origin.tolist(),
        "time": np.round(recording.time - recording.epoch, 6).tolist(),
        "position": placed(recording.position),
        "heading": _Rounding(5).of(recording.heading),
        "speed": _Rounding(5).of(recording.speed),
        "radius": recording.radius,
        "discs": list(recording.discs),
        "speeds": list(recording.speeds),
        "body": None if recording.vehicle_body is None else rounding.of(recording.vehicle_body),
        "goal": placed(recording.goal),
        "places": rounding.of(np.array(recording.places).reshape(-1, 2) - origin),
        "goalRadius": recording.goal_radius,
        "goalRegion": placed(recording.goal_region),
        "bounds": placed(recording.bounds),
        "corridor": list(map(placed, recording.corridor)),
        "corridorBorder": rounding.of(borders_of(recording.corridor) - origin) if recording.corridor else [],
        "walls": list(map(placed, recording.walls)),
        "lanes": list(map(placed, recording.lanes)),
        "guide": placed(recording.guide),
        "slow": _slow_data(recording, origin, rounding),
        "unit": asdict(unit_of(float((high - low).max()))),
        "replans": [{**asdict(each), "time": each.time - recording.epoch} for each in recording.replans],
        "extent": rounding.of(np.stack([low, high]) - origin),
        "paths": list(map(placed, recording.paths)),
        "pathIndex": recording.path_index.tolist(),
        "profiles": [
            {
                "name": profile.name,
                "unit": profile.unit,
                "values": _Rounding(5).of(profile.values),
                "lower": profile.lower,
                "upper": profile.upper,
                "upperAt": None if profile.upper_at is None else _Rounding(5).of(profile.upper_at),
            }
            for profile in recording.profiles
        ],
        "clearance": rounding.of_known(recording.clearance) if recording.obstacles else None,
        "obstacles": [_obstacle_data(obstacle, origin, rounding) for obstacle in recording.obstacles],
    }


def _slow_data(recording: Recording, origin: Array, rounding: _Rounding) -> list[dict[str, Any]]:
    """Give slow places as far as somebody may look who moves the map by half of it."""
    low, high = recording.extent()
    beyond = 0.5 * (high - low)
    return [
        {"speed": speed, "boxes": rounding.of(np.array(boxes) - origin)}
        for speed, boxes in slow_boxes(recording, low - beyond, high + beyond).items()
    ]


def _obstacle_data(obstacle: ObstacleRecord, origin: Array, rounding: _Rounding) -> dict[str, Any]:
    # A boundary that is not known at some time is not the same all the time either.
    grows = not np.ptp(obstacle.boundary, axis=0).max() <= 0.5 * 10.0**-rounding.digits
    return {
        "id": obstacle.id,
        "outside": obstacle.outside,
        "center": rounding.of_known(obstacle.center - origin),
        "heading": _Rounding(4).of(obstacle.heading) if obstacle.turns else None,
        "turns": obstacle.turns,
        "body": rounding.of(obstacle.body),
        "grows": grows,
        "boundary": rounding.of_known(obstacle.boundary if grows else obstacle.boundary[:1]),
        "clearance": rounding.of_known(obstacle.clearance),
        "truth": None if obstacle.truth is None else rounding.of_known(obstacle.truth - origin),
        "observed": None if obstacle.observed is None else rounding.of(obstacle.observed - origin),
    }


class _Rounding:
    """Rounds to a number of digits after the point, which is what keeps the file small."""

    def __init__(self, digits: int) -> None:
        self.digits = digits

    def of(self, values: Array) -> Any:
        """Give finite values as lists of numbers."""
        # The sum with 0 makes -0 a 0, which takes a character less.
        return (np.round(values, self.digits) + 0.0).tolist()

    def of_known(self, values: Array) -> list[Any]:
        """Give values as a list, None for those that are not finite, or hold any that is not."""
        return [self.of(value) if np.isfinite(value).all() else None for value in values]
