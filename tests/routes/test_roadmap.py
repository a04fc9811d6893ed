"""Routes of scenarios: outlines that leave every passage open, lengths that are known, loops."""

from __future__ import annotations

from itertools import islice
from math import pi

import numpy as np
import pytest
from scenes import disc, scene

import scp_planner as sp
from scp_planner.problem.build import build_problem
from scp_planner.routes.outlines import polygons_around, standing_shapes
from scp_planner.routes.roadmap import Roadmap
from scp_planner.routes.turns import arcs_to
from scp_planner.scenario.places import Line
from scp_planner.settings.planning import Settings, for_scene


def roadmap_of(scenario: sp.Scenario) -> Roadmap:
    problem = build_problem(scenario, sp.zones(scenario), for_scene(Settings()))
    return Roadmap(scenario, problem.frame, problem.limits, problem.zones, problem.box)


def shelf(name: str, x: float, y: float, width: float, height: float, heading: float = 0.0) -> dict[str, object]:
    shape = {"rectangle": [width, height], "heading": heading}
    return {"id": name, "shape": shape, "motion": {"position": [x, y]}}


def test_polygons_hold_their_zones_and_touch_them() -> None:
    scenario = scene(
        shelf("shelf", 6.0, 3.0, 3.0, 1.0, 0.4),
        disc("post", (10.0, 2.0)),
        {"id": "pond", "shape": {"ellipse": [2.0, 0.8], "heading": 1.0}, "motion": {"position": [14.0, -2.0]}},
    )
    shapes = standing_shapes(build_problem(scenario, sp.zones(scenario), for_scene(Settings())).zones)
    angles = np.linspace(0.0, 2.0 * pi, 360)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for shape, polygon in zip(shapes, polygons_around(shapes, np.zeros((1, 2))), strict=True):
        more = (directions @ polygon.T).max(axis=1) - shape.support(directions)
        assert more.min() > -1e-9
        assert more.max() < 0.4
        edges = np.roll(polygon, -1, axis=0) - polygon
        normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(*edges.T)[:, None]
        assert (normals * polygon).sum(axis=1) == pytest.approx(shape.support(normals), abs=1e-9)


@pytest.mark.parametrize("turn", [0.6, 0.9, 1.4])
def test_a_gap_a_little_wider_than_the_vehicle_is_a_passage(turn: float) -> None:
    """Between a corner and a disc, across which no side of either lies."""
    for width, passed in ((0.61, True), (0.59, False)):
        away = (1.0 + width) * np.array([np.cos(turn), np.sin(turn)])
        corner = np.array([10.0, 0.0]) - [1.0, 1.0]
        scenario = scene(
            shelf("shelf", corner[0], corner[1], 2.0, 2.0), disc("post", (10.0 + away[0], away[1]), radius=1.0)
        )
        middle = np.array([10.0, 0.0]) + 0.5 * width / (1.0 + width) * away
        routes = islice(roadmap_of(scenario).routes(), 4)
        near = [float(Line(route.points).distances(middle[None])[0]) for route in routes]
        assert (min(near) < 0.05) is passed


def test_routes_lead_round_a_wall_to_both_sides() -> None:
    routes = list(islice(roadmap_of(scene(shelf("wall", 10.0, 1.0, 1.0, 18.0))).routes(), 3))
    assert len(routes) == 2
    for route, beyond in zip(routes, (8.0, 10.0), strict=True):
        rounded = 2.0 * np.hypot(9.5, beyond) + 1.0
        assert rounded < route.length < rounded + 1.0
    assert routes[0].least_time < routes[1].least_time


def test_what_moves_stands_in_no_way() -> None:
    first = next(roadmap_of(scene(disc("slow", (10.0, 0.0), (0.0, 0.1), radius=3.0))).routes())
    assert first.straight and first.length == pytest.approx(20.0)


@pytest.mark.parametrize("heading", [0.0, 2.0, -2.5])
def test_goals_beside_and_behind_take_loops_that_the_vehicle_can_drive(heading: float) -> None:
    goal = [0.4 * np.cos(heading + 2.0), 0.4 * np.sin(heading + 2.0)]
    scenario = scene(start={"heading": heading, "speed": 0.0}, goal={"position": goal})
    roadmap = roadmap_of(scenario)
    routes = list(roadmap.routes())
    assert routes and all(route.loop for route in routes)
    assert [route.length for route in routes] == sorted(route.length for route in routes)
    for route in routes:
        steps = np.diff(route.points, axis=0)
        turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
        assert np.abs(turns / np.hypot(*steps.T)[1:]).max() < 1.01 * scenario.vehicle.max_curvature  # type: ignore[operator]
        first = steps[0] / np.hypot(*steps[0])
        turned = roadmap.headings[0]
        assert turned is not None and first @ [np.cos(turned), np.sin(turned)] > 0.99


def test_arcs_leave_along_the_heading_and_end_at_their_target() -> None:
    start, target = np.array([1.0, 2.0]), np.array([-3.0, 4.0])
    for arc in arcs_to(start, 0.5, target, 0.8):
        steps = np.diff(arc, axis=0)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        assert abs(headings[0] - 0.5) < 0.07
        assert arc[[0, -1]] == pytest.approx(np.stack([start, target]))
        assert np.abs(np.diff(headings)).max() < 0.13
    assert len(list(arcs_to(start, 0.0, start + np.array([0.0, 0.5]), 0.8))) == 1
