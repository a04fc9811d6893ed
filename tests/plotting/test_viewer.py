"""The HTML viewer: what stands in the file, and what a real browser makes of it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import BROWSER_VARIABLE, Browser, find_browser
from figure_parts import tall_scenario
from scenes import POCKET, scene, shaped

import scp_planner as sp
from scp_planner.plotting.recording import record_plan
from scp_planner.plotting.viewer import save_recording, save_viewer, to_html


@pytest.fixture(scope="module")
def page(plan: sp.Plan, scenario: sp.Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("viewer") / "radar.html"
    save_viewer(plan, scenario, path)
    return path


def data_of(page: Path) -> dict[str, Any]:
    """Data that the page's script will read."""
    return data_in(page.read_text(encoding="utf-8"))


def data_in(text: str) -> Any:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found
    return json.loads(found[1])


def test_file_holds_the_plan(page: Path, plan: sp.Plan, scenario: sp.Scenario) -> None:
    data = data_of(page)
    origin = np.array(data["origin"])
    time = np.array(data["time"])
    assert time[0] == plan.start_time and abs(time[-1] - plan.arrival_time) < 1e-5
    assert np.abs(np.array(data["position"]) + origin - plan.position(time)).max() < 1e-3
    assert np.abs(np.array(data["speed"]) - plan.speed(time)).max() < 1e-4
    assert [obstacle["id"] for obstacle in data["obstacles"]] == [o.id for o in scenario.obstacles]


def test_straight_lines_between_samples_are_near_the_trip(page: Path, plan: sp.Plan) -> None:
    data = data_of(page)
    time, position = np.array(data["time"]), np.array(data["position"]) + np.array(data["origin"])
    fine = np.linspace(plan.start_time, plan.arrival_time, 5000)
    drawn = np.stack([np.interp(fine, time, position[:, axis]) for axis in (0, 1)], axis=-1)
    assert np.linalg.norm(drawn - plan.position(fine), axis=1).max() < 2e-3


def test_file_asks_for_nothing_from_elsewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    addresses = set(re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"'<]*", text))
    assert addresses == {"http://www.w3.org/2000/svg"}  # the name of the SVG language, not a place
    assert not re.search(
        r"<(?:link|img|iframe)\b|\bsrc=|@import|url\((?!#)", text
    )  # url(#...) is a part of the page itself


def test_ground_and_units_stand_in_the_file(plan: sp.Plan) -> None:
    wall = [[4.0, 1.2], [8.0, 1.2], [8.0, 3.0], [4.0, 3.0]]
    limits = [{"from": 5.0, "to": 9.0, "speed": 1.5, "line": [[0.0, 0.0], [20.0, 0.0]]}]
    goal = {"region": [[18.0, -2.0], [23.0, -2.0], [23.0, 1.0], [18.0, 2.0]]}
    yard = scene(
        walls=[wall], speed_limits=limits, guide=[[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]], goal=goal, lanes=[wall]
    )
    recording = record_plan(plan, yard, 10)
    data = data_in(to_html(recording))
    origin = np.array(data["origin"])
    assert np.allclose(np.array(data["walls"][0]) + origin, wall, atol=1e-3)
    assert np.allclose(np.array(data["lanes"][0]) + origin, wall, atol=1e-3)
    assert np.allclose(np.array(data["goalRegion"]) + origin, goal["region"], atol=1e-3)
    assert yard.guide is not None
    assert np.allclose(np.array(data["guide"]) + origin, yard.guide, atol=1e-3)
    (slow,) = data["slow"]
    ((low, high),) = np.array(slow["boxes"]) + origin  # one box: the borders run across
    cell = 2.0 * float(np.subtract(*recording.extent()[::-1]).max()) / 320
    assert slow["speed"] == 1.5 and np.abs([low[0] - 5.0, high[0] - 9.0]).max() <= cell
    assert low[1] < recording.extent()[0][1] and high[1] > recording.extent()[1][1]
    assert data["unit"] == {"name": "m", "size": 1.0} and data["replans"] == []


def test_hostile_names_stay_text(plan: sp.Plan, scenario: sp.Scenario) -> None:
    evil = "</script><script>document.title = 'taken'</script><!--\u2028 [[data]] [[title]]"
    obstacle = scenario.obstacles[0].model_copy(update={"id": evil})
    hostile = scenario.model_copy(update={"name": evil, "obstacles": (obstacle,)})
    text = to_html(record_plan(plan, hostile, 10))
    assert text.count("</script>") == 2  # the data's and the script's own
    assert text.count("<script") == 2
    assert "<!--" not in text.replace("<!-- Nothing is ever fetched. -->", "")
    assert data_in(text)["obstacles"][0]["id"] == evil


# In a real browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    executable = find_browser()
    if executable is None:
        pytest.skip(f"needs Chromium or Chrome: none is installed, and {BROWSER_VARIABLE} names none")
    with Browser(executable, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def opened(browser: Browser, page: Path) -> Iterator[Browser]:
    """The browser with the page; whatever a test does with it, nothing may go wrong in it."""
    browser.open(page.as_uri())
    yield browser
    assert browser.faults == []
    assert browser.requests == [page.as_uri()]


def test_browser_notices_what_goes_wrong(browser: Browser, tmp_path: Path) -> None:
    """Without this the tests below could pass by looking away."""
    broken = tmp_path / "broken.html"
    broken.write_text("<img src='missing.png'><script>console.error('one'); undefinedThing();</script>")
    browser.open(broken.as_uri())
    assert len(browser.faults) == 3
    assert browser.requests == [broken.as_uri(), (tmp_path / "missing.png").as_uri()]


MINUS = "\N{MINUS SIGN}"
VEHICLE = "['cx', 'cy'].map((name) => Number(document.querySelector('#vehicle').getAttribute(name)))"


def shown_time(browser: Browser) -> float:
    return float(browser.evaluate("document.querySelector('#time').textContent").split()[0])


def shown_position(browser: Browser) -> list[float]:
    """The vehicle's x and y, m, as the page tells them."""
    texts = browser.evaluate("[...document.querySelectorAll('#now div')].map((row) => row.lastChild.textContent)")
    return [float(text.replace(MINUS, "-").removesuffix(" m")) for text in texts[:2]]


def move_slider(browser: Browser, time: float) -> None:
    browser.evaluate(
        f"(() => {{ const s = document.querySelector('#slider'); s.value = {time};"
        " s.dispatchEvent(new Event('input', {bubbles: true})); })()"
    )


def test_slider_moves_the_vehicle_along_the_plan(opened: Browser, plan: sp.Plan) -> None:
    places = []
    for part in (0.0, 0.31, 0.5, 1.0):
        time = plan.start_time + part * plan.travel_time
        move_slider(opened, time)
        assert shown_time(opened) == pytest.approx(time, abs=0.006)
        assert shown_position(opened) == pytest.approx(plan.position(time), abs=0.008)
        places.append(opened.evaluate(VEHICLE))
    # On the map too: the same scale in both directions, and y upwards.
    pixels = np.diff(places, axis=0)
    metres = np.diff(plan.position(plan.start_time + np.array([0.0, 0.31, 0.5, 1.0]) * plan.travel_time), axis=0)
    scale = pixels[0, 0] / metres[0, 0]
    assert scale > 10.0
    assert pixels == pytest.approx(metres * [scale, -scale], abs=0.3)


def test_zones_are_drawn_where_they_are(opened: Browser, plan: sp.Plan, scenario: sp.Scenario) -> None:
    time = plan.start_time + 0.4 * plan.travel_time
    move_slider(opened, time)
    vehicle = np.array(opened.evaluate(VEHICLE))
    outlines = opened.evaluate("[...document.querySelectorAll('.zone')].map((zone) => zone.getAttribute('d'))")
    polygons = [np.array(re.findall(r"([-\d.]+) ([-\d.]+)", outline), dtype=float) for outline in outlines]
    radius = float(opened.evaluate("document.querySelector('#vehicle').getAttribute('r')"))
    scale = radius / scenario.vehicle.radius
    position = plan.position(time)
    for zone, polygon in zip(sp.zones(scenario), polygons, strict=True):
        assert len(polygon) > 40
        world = position + (polygon - vehicle) * [1.0, -1.0] / scale
        distances = zone.signed_distance(np.full(len(world), time), world)
        assert np.abs(distances).max() < 2.0 / scale  # two pixels


def test_play_and_pause(opened: Browser) -> None:
    opened.evaluate("document.querySelector('#pace').value = '0.25'")
    opened.press(" ")
    opened.wait_for("Number(document.querySelector('#slider').value) > 0.3")
    opened.evaluate("document.querySelector('#play').click()")
    assert opened.evaluate("document.querySelector('#play').textContent") == "Play"
    stopped = shown_time(opened)
    opened.evaluate("new Promise((done) => setTimeout(done, 150))")
    assert shown_time(opened) == stopped


@pytest.fixture(scope="module")
def run() -> sp.Run:
    """A closed loop past shapes of several kinds, one of them of several convex pieces."""
    obstacles = shaped(
        pocket=({"polygon": POCKET}, {"position": [6.0, 2.5]}),
        car=({"rectangle": [3.0, 1.0]}, {"position": [4.0, -4.0], "velocity": [1.0, 0.2]}),
        pond=({"ellipse": [2.0, 0.5], "heading": 0.4}, {"position": [3.0, -2.5]}),
        walker=({"disc": 0.4}, {"position": [9.0, -3.0], "velocity": [0.0, 0.8]}),
    )
    return sp.simulate(scene(*obstacles, goal={"position": [12.0, 0.0]}), noise=0.02, rate=5.0)


def test_slider_moves_the_vehicle_through_a_run(browser: Browser, run: sp.Run, tmp_path: Path) -> None:
    run.draw(tmp_path / "run.html")
    browser.open((tmp_path / "run.html").as_uri())
    assert browser.evaluate("document.querySelectorAll('.zone').length") == 4
    assert browser.evaluate("document.querySelectorAll('.chart').length") == 5
    plans = set()
    for part in (0.0, 0.4, 0.7, 1.0):
        time = float(run.time[0] + part * (run.time[-1] - run.time[0]))
        move_slider(browser, time)
        expected = [np.interp(time, run.time, run.position[:, axis]) for axis in (0, 1)]
        assert shown_time(browser) == pytest.approx(time, abs=0.006)
        # The page draws straight lines between its samples.
        assert shown_position(browser) == pytest.approx(expected, abs=0.02)
        plans.add(browser.evaluate("document.querySelector('path[stroke-width=\"3\"]').getAttribute('d')"))
        # What the replan came to that was the last at that time, and the legend of all that there were.
        now = [record for record in run.records if record.time <= time + 1e-9][-1]
        told = browser.evaluate("document.querySelector('#replan').textContent")
        assert told.startswith(f"{now.outcome}, {'safe' if now.safe else 'not safe'}") and told.endswith(now.reason)
    assert len(plans) == 4
    assert browser.evaluate("document.querySelectorAll('#ticks .replan').length") == len(run.records)
    legend = browser.evaluate("document.querySelector('#legend').textContent")
    assert all(f"replan: {record.outcome}" in legend for record in run.records)
    assert "NaN" not in browser.evaluate("document.body.innerHTML")
    assert browser.faults == []
    assert browser.requests == [(tmp_path / "run.html").as_uri()]


def test_hostile_names_run_nothing(browser: Browser, plan: sp.Plan, scenario: sp.Scenario, tmp_path: Path) -> None:
    evil = "</script><script>document.title = 'taken'</script><img src=x onerror=alert(1)>"
    obstacle = scenario.obstacles[0].model_copy(update={"id": evil})
    hostile = scenario.model_copy(update={"name": evil, "obstacles": (obstacle,)})
    save_recording(record_plan(plan, hostile, 20), tmp_path / "evil.html")
    browser.open((tmp_path / "evil.html").as_uri())
    assert browser.evaluate("document.title") == evil
    assert browser.evaluate("document.querySelector('h1').textContent") == evil
    assert browser.evaluate("document.querySelectorAll('img').length") == 0
    assert browser.faults == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_far_places_and_clocks(browser: Browser, scheme: str, tmp_path: Path) -> None:
    """Half a million kilometres from the origin and at a Unix time; a car, a polygon, a radius about the goal."""
    far = tall_scenario()
    plan = sp.plan(far)
    save_viewer(plan, far, tmp_path / "far.html")
    browser.emulate(prefers_color_scheme=scheme)
    browser.open((tmp_path / "far.html").as_uri())
    move_slider(browser, 0.5 * plan.travel_time)
    assert shown_position(browser) == pytest.approx(plan.position(plan.start_time + 0.5 * plan.travel_time), abs=0.008)
    assert all(math.isfinite(value) for value in browser.evaluate(VEHICLE))
    assert "NaN" not in browser.evaluate("document.body.innerHTML")
    assert browser.faults == []


def test_obstacle_that_comes_late(browser: Browser, plan: sp.Plan, scenario: sp.Scenario, tmp_path: Path) -> None:
    """A zone that is not known at first, of an obstacle that is never known to be anywhere."""
    recording = record_plan(plan, scenario, 5)
    first = recording.obstacles[0]
    center, boundary, clearance = first.center.copy(), first.boundary.copy(), first.clearance.copy()
    for array in (center, boundary, clearance):
        array[:3] = np.nan
    late = replace(first, center=center, boundary=boundary, clearance=clearance)
    save_recording(replace(recording, obstacles=(late,)), tmp_path / "late.html")
    browser.open((tmp_path / "late.html").as_uri())
    hidden = "document.querySelector('.zone').classList.contains('hidden')"
    assert browser.evaluate(hidden)
    assert "NaN" not in browser.evaluate("document.body.innerHTML")
    browser.press("End")
    assert not browser.evaluate(hidden)
    assert "NaN" not in browser.evaluate("document.body.innerHTML")
    assert browser.faults == []
