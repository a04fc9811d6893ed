"""Representations of plans, runs and scenarios: a line each, and a picture in notebooks."""

from __future__ import annotations

import base64
import re
import sys
from dataclasses import replace
from operator import methodcaller
from pathlib import Path

import pytest
from scenes import CROSSERS, disc, scene

import scp_planner as sp

LONGEST = 200  # letters of a line
in_a_notebook = methodcaller("_repr_html_")


@pytest.fixture(scope="module")
def plan() -> sp.Plan:
    return sp.plan(scene(*CROSSERS))


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return sp.simulate(scene(disc("far", (10.0, 8.0))), noise=0.05, rate=5.0, seed=0)


def test_a_line_says_what_it_is(plan: sp.Plan, run: sp.Run) -> None:
    assert re.fullmatch(r"Plan\('scene', certified, \d\.\d+ s, \S+ m clear of (slow|oncoming|fast)\)", repr(plan))
    assert re.fullmatch(r"Run\('scene', arrived after \S+ s, \S+ m clear, \d+ replans\)", repr(run))
    assert repr(scene(*CROSSERS)) == "Scenario('scene', 20 m, 3 obstacles)"
    assert repr(scene()) == "Scenario('scene', 20 m, 0 obstacles)"
    certificate = sp.certify(scene(*CROSSERS), plan)
    assert repr(certificate).startswith("Certificate(holds, ")
    narrow = sp.certify(scene(*CROSSERS, vehicle={"radius": 0.4, "max_speed": 2.0}), plan)
    assert re.fullmatch(r"Certificate\(does not hold: .* allowed .*, and \d more\)", repr(narrow))
    assert repr(sp.zones(scene(*CROSSERS))[0]) == "ThreatZone('slow', disc of 0.55 m, known motion)"
    for each in (plan, plan.trip, run, certificate, narrow, run.plans[0], *sp.zones(scene(*CROSSERS))):
        assert len(repr(each)) <= LONGEST, type(each)


def test_long_rows_are_cut() -> None:
    times = [0.1 * k for k in range(-500, 0)]
    seen = sp.Observations(time=times, position=[(t, 0.0) for t in times])
    assert (
        repr(seen)
        == "Observations(time=(-50.0, ... 500 in all), position=((-50.0, 0.0), ... 500 in all), covariance=None)"
    )
    assert repr(sp.Disc(disc=0.5)) == "Disc(disc=0.5)"


def test_an_online_plan_tells_its_outcome() -> None:
    found = sp.Planner(scene(disc("far", (10.0, 8.0)))).replan(time=0.0, position=(0.0, 0.0), heading=0.0, speed=1.0)
    assert repr(found).startswith("OnlinePlan('scene', improved, safe, ")


@pytest.fixture(scope="module")
def scenario() -> sp.Scenario:
    return scene(*CROSSERS, guide=[[0, 0], [10, 1], [20, 0]], speed_limits=[{"from": 2.0, "to": 4.0, "speed": 1.0}])


@pytest.mark.parametrize("which", ["plan", "run", "scenario"])
def test_notebooks_show_a_picture(which: str, request: pytest.FixtureRequest) -> None:
    pytest.importorskip("matplotlib")
    shown = request.getfixturevalue(which)
    page = in_a_notebook(shown)
    found = re.search(r'src="data:image/png;base64,([^"]+)"', page)
    assert found is not None
    assert base64.b64decode(found[1]).startswith(b"\x89PNG")
    assert "<pre>" in page and page.count("<pre>") == 1


def test_sketches_name_their_obstacles(plan: sp.Plan, scenario: sp.Scenario) -> None:
    pytest.importorskip("matplotlib")
    for figure in (plan.sketch(scene(*CROSSERS)), scenario.sketch()):
        assert {text.get_text() for text in figure.axes[0].texts} >= {"slow", "fast"}
    assert not any(text.get_text() == "slow" for text in plan.sketch().axes[0].texts)


def test_without_matplotlib_notebooks_show_the_line(plan: sp.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert in_a_notebook(plan) == f"<pre>{repr(plan).replace(chr(39), '&#x27;')}</pre>"


def test_plans_compare_and_hash_by_what_they_are(plan: sp.Plan, tmp_path: Path) -> None:
    same = sp.plan(scene(*CROSSERS))
    assert same == plan and hash(same) == hash(plan) and len({same, plan}) == 1
    plan.save(tmp_path / "plan.json")
    loaded = sp.Plan.load(tmp_path / "plan.json")
    again = sp.Plan.load(tmp_path / "plan.json")
    assert loaded == again and hash(loaded) == hash(again)
    assert loaded != plan and replace(loaded, status=plan.status, stated_status=None) == plan
    assert replace(plan, wall_time=7.0) == plan
    assert replace(plan, lower_bound=7.0) != plan
    other = sp.plan(scene(*CROSSERS[:2]))
    assert other != plan and other.trip != plan.trip
    assert plan != "a plan"
