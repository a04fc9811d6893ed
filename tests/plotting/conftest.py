"""Plans and a drive that several files of tests draw."""

from __future__ import annotations

import pytest
from figure_parts import Case, case_of
from matplotlib.figure import Figure
from scenes import POCKET, disc, scene, shaped

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import plot_plan


@pytest.fixture(scope="session")
def scenario() -> sp.Scenario:
    return builtin.load("radar")


@pytest.fixture(scope="session")
def plan(scenario: sp.Scenario) -> sp.Plan:
    return sp.plan(scenario)


@pytest.fixture(scope="session")
def radar() -> Case:
    return case_of("radar")


@pytest.fixture(scope="session")
def figure(radar: Case) -> Figure:
    return plot_plan(*radar)


def _pocket() -> sp.Scenario:
    (pocket,) = shaped(pocket=({"polygon": POCKET}, {"position": [9.0, 1.0]}))
    return scene({**pocket, "margin": 0.2})


@pytest.fixture(scope="session")
def pocket() -> Case:
    return sp.plan(_pocket()), _pocket()


@pytest.fixture(scope="session")
def drive() -> sp.Run:
    """A vehicle that waits for a convoy to pass."""
    convoy = [disc(f"truck-{k}", (8.0, -2.0 - 3.0 * k), (0.0, 1.0), radius=1.2) for k in range(2)]
    bounds = {"min": [-1.0, -0.6], "max": [17.0, 0.6]}
    return sp.simulate(scene(*convoy, goal={"position": [16.0, 0.0]}, bounds=bounds), noise=0.01, rate=4.0)
