"""Axes are in units of what they show."""

from __future__ import annotations

from matplotlib.figure import Figure
from scenes import scene

import scp_planner as sp
from scp_planner.plotting.scales import unit_of_rate
from scp_planner.plotting.style import label_lengths


def test_rates_are_in_units_of_their_size() -> None:
    names = {most: unit_of_rate("m/s", most).name for most in (7.8e3, 30.0, 1.5, 0.05, 0.02)}
    assert names == {7.8e3: "km/s", 30.0: "m/s", 1.5: "m/s", 0.05: "m/s", 0.02: "mm/s"}
    assert unit_of_rate("m/s²", 0.01).name == "mm/s²"
    curvatures = {most: unit_of_rate("1/m", most).name for most in (1e-4, 0.5, 100.0, 0.0)}
    assert curvatures == {1e-4: "1/km", 0.5: "1/m", 100.0: "1/mm", 0.0: "1/m"}


def test_ticks_say_what_is_shown() -> None:
    for name, most, value, text in (
        ("m/s", 0.02, 0.005, "5"),
        ("m/s", 7.8e3, 2.5e3, "2.5"),
        ("1/m", 1e-4, 5e-5, "0.05"),
        ("1/m", 100.0, 50.0, "0.05"),
        ("m/s", 3.0, 1.5, "1.5"),
    ):
        unit = unit_of_rate(name, most)
        figure = Figure()
        axes = figure.subplots()
        axes.set_ylim(0.0, most)
        label_lengths(axes.yaxis, "speed", unit)
        axes.set_yticks([value])
        figure.draw_without_rendering()
        assert [label.get_text() for label in axes.get_yticklabels()] == [text]
        assert axes.get_ylabel() == f"speed ({unit.name})"


def test_the_sketch_of_a_small_robots_plan_is_in_millimetres_each_second() -> None:
    plan = sp.plan(
        scene(
            vehicle={
                "radius": 1e-3,
                "max_speed": 0.01,
                "max_acceleration": 0.005,
                "max_deceleration": 0.005,
                "max_lateral_acceleration": 0.005,
                "max_curvature": 300.0,
            },
            start={"speed": 0.0},
            goal={"position": [0.1, 0.0]},
        )
    )
    labels = {axes.get_ylabel() for axes in plan.sketch().axes}
    assert {"y (mm)", "speed (mm/s)"} <= labels
