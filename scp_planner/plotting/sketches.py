"""Small pictures for notebooks, of plans and scenarios."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scp_planner.plotting.drawn import map_extent
from scp_planner.plotting.maps import Box, draw_map, draw_scene
from scp_planner.plotting.profiles import draw_profile
from scp_planner.plotting.recording import Profile, Recording, record_course, record_plan
from scp_planner.plotting.scales import nearest_indices, nice_times
from scp_planner.plotting.style import settle, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from scp_planner.planning.plan import Plan
    from scp_planner.scenario.models import Scenario

SAMPLES = 300
WIDTH, LEAST_HEIGHT, MOST_HEIGHT = 7.5, 2.6, 6.0
"""inches"""


def sketch_plan(plan: Plan, scenario: Scenario | None = None) -> Figure:
    """Draw where a plan leads, in the colours of its speed, and its speed over time; obstacles are the scenario's."""
    none = np.array([], dtype=np.intp)
    recording, indices = _bare(plan), none
    if scenario is not None:
        shown = nice_times(plan.start_time, plan.arrival_time, 4)
        grid = np.linspace(plan.start_time, plan.arrival_time, SAMPLES)
        recording = record_plan(plan, scenario, np.union1d(grid, shown))
        indices = nearest_indices(recording.time, shown)
    box = map_extent(recording, indices)
    with style():
        figure = _figure(0.6 * WIDTH, box)
        places, speeds = figure.subplots(1, 2, width_ratios=[3, 2])
        draw_map(places, recording, indices, box)
        draw_profile(speeds, recording, recording.profiles[0], indices)
        settle(figure)
    return figure


def sketch_scenario(scenario: Scenario) -> Figure:
    """Draw a scenario at its start, and how the obstacles go on for as long as the shortest trip takes."""
    recording, first = record_course(scenario, SAMPLES), np.zeros(1, dtype=np.intp)
    box = _with_obstacles(recording, map_extent(recording, first))
    with style():
        figure = _figure(WIDTH, box)
        draw_scene(figure.subplots(), recording, first, box)
        settle(figure)
    return figure


def _with_obstacles(recording: Recording, box: Box) -> Box:
    """Widen a map to where obstacles are at first, as far as the map is wide."""
    low, high = box
    size = float((high - low).max())
    bodies = np.concatenate([box, *(obstacle.body_at(0) for obstacle in recording.bodies)])
    seen = bodies[((bodies > low - size) & (bodies < high + size)).all(axis=1)]
    edge = 0.03 * size
    return np.minimum(low, seen.min(axis=0) - edge), np.maximum(high, seen.max(axis=0) + edge)


def _figure(width: float, box: Box) -> Figure:
    from matplotlib.figure import Figure

    low, high = box
    height = width * float((high[1] - low[1]) / (high[0] - low[0])) + 0.8
    figure: Any = Figure(figsize=(WIDTH, float(np.clip(height, LEAST_HEIGHT, MOST_HEIGHT))), dpi=110)
    figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
    return figure


def _bare(plan: Plan) -> Recording:
    """Sample a plan whose vehicle and scenario nobody knows."""
    time = np.linspace(plan.start_time, plan.arrival_time, SAMPLES)
    position, speed = plan.position(time), plan.speed(time)
    x, y = position[-1].tolist()
    return Recording(
        name=plan.scenario,
        time=time,
        position=position,
        heading=plan.heading(time),
        speed=speed,
        radius=0.0,
        max_speed=float(speed.max()),
        goal=(x, y),
        paths=(position,),
        path_index=np.zeros(SAMPLES, dtype=np.intp),
        profiles=(Profile("speed", "m/s", speed, lower=0.0),),
    )
