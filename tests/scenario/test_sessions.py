"""What sessions give in place of what is meant: arrays and tables, typing errors, values of other kinds."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scenes import scene

import scp_planner as sp


def test_arrays_and_tables_are_taken_wherever_lists_are() -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"t": [-1.0, -0.5, 0.0], "x": [9.0, 9.0, 9.0], "y": [9.0, 8.0, 7.0]})
    rows = [np.array([9.0, y]) for y in (9.0, 8.0, 7.0)]
    plain = sp.Observations(time=[-1.0, -0.5, 0.0], position=[[9.0, 9.0], [9.0, 8.0], [9.0, 7.0]])
    assert sp.Observations(time=table.t, position=table[["x", "y"]]) == plain
    assert sp.Observations(time=table.t.to_numpy(), position=rows) == plain


def test_a_part_is_changed_by_copying_it() -> None:
    vehicle = scene().vehicle
    with pytest.raises(ValueError, match=r"Vehicle.max_speed is frozen; model_copy\(update="):
        vehicle.max_speed = 2.0  # type: ignore[misc]
    with pytest.raises(sp.ScenarioError, match=r"max_sped = 2.0: unknown key; did you mean 'max_speed'"):
        vehicle.model_copy(update={"max_sped": 2.0})
    with pytest.raises(sp.ScenarioError, match=r"goal.position\[0\] = 'far': must be a number"):
        scene().model_copy(update={"goal": {"position": ["far", 0.0]}})
    assert scene().model_copy(update={"goal": {"position": [15.0, 1.0]}}).goal == sp.Goal(position=(15.0, 1.0))


@pytest.mark.parametrize("call", [sp.plan, sp.zones, sp.simulate, sp.Planner, lambda it: sp.certify(it, it)])
def test_what_is_no_scenario_is_refused_by_name(call: Callable[[Any], object]) -> None:
    for given in (dict[str, object](), "warehouse.yaml"):
        with pytest.raises(TypeError, match=r"scenario: must be a Scenario, not (dict|str); "):
            call(given)
    with pytest.raises(TypeError, match="plan: must be a Plan or a SampledTrajectory, not dict"):
        sp.certify(scene(), {})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="time_limit: -1"):
        sp.plan(scene(), time_limit=-1)


def test_headings_of_shapes_in_degrees_are_told_of(caplog: pytest.LogCaptureFixture) -> None:
    sp.Rectangle(rectangle=(4.0, 2.0), heading=45.0)
    assert "almost certainly degrees; 45 degrees are 0.7854 rad" in caplog.text


def test_a_planner_refuses_an_obstacle_in_the_same_words() -> None:
    with pytest.raises(sp.ScenarioError, match=r"shape.disk = 0.3: unknown key; did you mean 'disc'"):
        sp.Planner(scene()).add_obstacle("bob", {"disk": 0.3})
