"""The page *From the paper to the code*: what it names is there."""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path

import pytest

import scp_planner as sp

PAGE = Path(__file__).resolve().parents[2] / "docs" / "explanation" / "paper-to-code.md"


def named() -> list[str]:
    """Dotted names of modules and what is in them, in the table of symbols."""
    table = PAGE.read_text(encoding="utf-8").split("## Symbols")[1].split("## The objective")[0]
    return sorted(set(re.findall(r"`([a-z_]+\.[A-Za-z_.]+)`", table)))


@pytest.mark.parametrize("name", named())
def test_every_name_in_the_table_of_symbols_is_there(name: str) -> None:
    found = pkgutil.resolve_name(f"scp_planner.{name}")
    assert found is not None


def test_the_table_names_what_it_should() -> None:
    assert len(named()) >= 15


def test_pictures_and_pages_that_it_links_to_are_there() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", PAGE.read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if not (PAGE.parent / link).is_file()] == []


def test_travel_time_is_written_as_the_page_says() -> None:
    """2 L / (v0 + sqrt(v0^2 + 4 A L)) is the root of v0 tau + A tau^2 = L, with all its digits where A is tiny."""
    from scp_planner.problem.build import build_problem

    scenario = sp.Scenario.model_validate(
        {
            "name": "straight",
            "vehicle": {"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0},
            "start": {"time": 0.0, "position": [0.0, 0.0], "speed": 1.0},
            "goal": {"position": [20.0, 0.0]},
            "obstacles": [],
        }
    )
    space = build_problem(scenario, (), sp.Settings()).space
    for acceleration in (1.0, 1e-3, 1e-14, -1e-14, -0.02):
        beta = space.acceleration_size * [acceleration]
        tau = space.travel_time(20.0, beta)  # type: ignore[arg-type]
        assert tau + 0.5 * acceleration * tau**2 == pytest.approx(20.0, rel=1e-14)
