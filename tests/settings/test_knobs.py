"""Settings: every knob has a unit, an effect and a range, which is checked and can be planned with."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np
import pytest
from scenes import CROSSERS, VEHICLE, scene

import scp_planner as sp
from scp_planner.baseline.descent_run import DescentSettings, Variant
from scp_planner.batch import jobs
from scp_planner.errors import SettingsError
from scp_planner.scenario.models import ConfidenceLevel, Steering
from scp_planner.scenario.units import NaturalUnits
from scp_planner.settings.knobs import Choice, Knob, Knobs, Range, knobs, parse_assignments
from scp_planner.settings.online import GiveWay, Newcomers, Regions, Safety
from scp_planner.settings.planning import SceneSettings, for_scene
from scp_planner.tracking.maximum_likelihood import Noise

CLASSES: tuple[type[Knobs], ...] = (sp.Settings, sp.OnlineSettings, Newcomers)
EVERY = [
    pytest.param(each, knob, id=f"{each.__name__}.{knob.name}") for each in CLASSES for knob in knobs(each).values()
]
ENDS = [  # in a scene whose units are 1 m and 1 s
    pytest.param(knob.name, knob.kind(end), id=f"{knob.name}={end:g}")
    for knob in knobs(SceneSettings).values()
    if isinstance(knob.allowed, Range)
    for end in (knob.allowed.least, knob.allowed.most)
]


@pytest.mark.parametrize(("settings", "knob"), EVERY)
def test_every_setting_says_what_it_does_and_has_a_default_in_its_range(settings: type[Knobs], knob: Knob) -> None:
    assert knob.effect.endswith(".")
    assert len(knob.effect.split()) >= 5
    if knob.kind is not Newcomers:
        assert knob.allowed is not None
        assert knob.fault(knob.default) is None
        assert knob.fault("neither a number nor a word of it") is not None
    if knob.kind is float and isinstance(knob.allowed, Range):
        assert knob.unit or knob.name in {
            "limit_margin",
            "gate_probability",
            "alarm_probability",
            "changes",
            "manoeuvre",
            "effort",
        }, "a float has a unit or is a ratio"


@pytest.mark.parametrize(("name", "value"), ENDS)
def test_the_ends_of_every_range_can_be_planned_with(name: str, value: float) -> None:
    change: dict[str, Any] = {name: value}
    settings = replace(sp.Settings(), **change)
    plan = sp.plan(scene(CROSSERS[0]), settings, time_limit=0.5)
    assert 6.0 < plan.travel_time < 60.0
    assert plan.certified or plan.reason


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"path_degree": 2}, "path_degree = 2: must be a whole number, 3 to 5"),
        ({"path_degree": 3.5}, "path_degree = 3.5: must be a whole number"),
        ({"samples": True}, "samples = true: must be a whole number, 10 to 5000"),
        ({"tolerance": math.nan}, "tolerance = nan: must be a number, above 0, up to 1e+12 s, or none"),
        ({"max_offset": math.inf}, "max_offset = inf: must be a number, above 0, up to 1e+12 m"),
        ({"path_span": "2"}, "path_span = '2': must be a number"),
        ({"solver": "gurobi"}, "solver = 'gurobi': must be one of daqp, clarabel"),
        ({"path_spam": 2.0}, "path_spam = 2.0: there is no such setting; did you mean 'path_span'?"),
        ({"xyzzy": 2.0}, "xyzzy = 2.0: there is no such setting"),
    ],
    ids=str,
)
def test_what_is_not_allowed_is_refused_with_what_is(value: dict[str, Any], said: str) -> None:
    with pytest.raises(SettingsError) as refused:
        sp.Settings(**value)
    assert said in str(refused.value)
    assert isinstance(refused.value, ValueError)


def test_all_faults_are_told_at_once() -> None:
    with pytest.raises(SettingsError) as refused:
        sp.Settings(samples=1, path_span=-1.0)
    assert [fault.path for fault in refused.value.faults] == ["path_span", "samples"]
    with pytest.raises(SettingsError) as unknown:
        sp.Settings(sample=1, span=2.0)  # type: ignore[call-arg]
    assert [fault.path for fault in unknown.value.faults] == ["sample", "span"]


def test_the_scene_decides_what_is_left_open_and_what_is_too_much() -> None:
    units = NaturalUnits(length=0.1, time=0.5)
    assert for_scene(sp.Settings(), units) == SceneSettings()
    decided = for_scene(sp.Settings(path_span=0.3, tolerance=0.01, samples=80), units)
    assert decided == SceneSettings(path_span=0.3 / 0.1, tolerance=0.02, samples=80)
    assert for_scene(decided, units) is decided
    with pytest.raises(SettingsError) as refused:
        for_scene(sp.Settings(path_span=0.001, clearance_margin=2.0), units)
    assert [fault.path for fault in refused.value.faults] == ["path_span", "clearance_margin"]
    assert "path_span = 0.001: must be 0.01 to 100 m in this scene" in str(refused.value)
    with pytest.raises(SettingsError, match="in this scene"):
        sp.plan(scene(), sp.Settings(max_offset=1e-3))


def test_numbers_of_numpy_are_numbers() -> None:
    twenty: Any = np.int64(20)
    assert sp.Settings(samples=twenty, path_span=np.float64(2.0)) == sp.Settings(samples=20, path_span=2.0)


def test_settings_survive_pickling_and_replacing() -> None:
    settings = sp.Settings(path_span=2.0, solver="osqp")
    assert pickle.loads(pickle.dumps(settings)) == settings
    assert replace(settings, path_span=None) == sp.Settings(solver="osqp")
    with pytest.raises(SettingsError):
        replace(settings, path_span=0.0)


def test_settings_are_read_from_text() -> None:
    base = sp.Settings(samples=80)
    read = sp.Settings.from_text(["path_span = 2", "max_runs=3", "solver=osqp"], base)
    assert read == sp.Settings(samples=80, path_span=2.0, max_runs=3, solver="osqp")
    online = sp.OnlineSettings.from_text(["safety=trip", "foresight=none", "forget_after=2"])
    assert online == sp.OnlineSettings(safety=sp.Safety.TRIP, foresight=None, forget_after=2.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("path_span", "path_span: must be NAME=VALUE"),
        ("path_spam=2", "did you mean 'path_span'?"),
        ("path_span=wide", "path_span = 'wide': must be a number, above 0, up to 1e+12 m"),
        ("path_span=nan", "path_span = nan: must be a number"),
        ("samples=1.5", "samples = '1.5': must be a whole number"),
    ],
)
def test_text_that_is_no_setting_is_refused(text: str, said: str) -> None:
    with pytest.raises(SettingsError) as refused:
        sp.Settings.from_text([text])
    assert said in str(refused.value)


def test_assignments_of_two_classes_are_told_apart_by_name() -> None:
    assert not set(knobs(sp.Settings)) & set(knobs(sp.OnlineSettings))
    values = parse_assignments(["path_span=2", "iterations=5"], sp.Settings, sp.OnlineSettings)
    assert values == {"path_span": 2.0, "iterations": 5}
    with pytest.raises(SettingsError, match="did you mean 'iterations'"):
        parse_assignments(["iteration=5"], sp.Settings, sp.OnlineSettings)


def test_a_choice_lists_the_solvers_that_users_add(monkeypatch: pytest.MonkeyPatch) -> None:
    from scp_planner.solvers.interface import SOLVERS

    monkeypatch.setitem(SOLVERS, "mine", "scp_planner.solvers.daqp_solver:DaqpSolver")
    assert sp.Settings(solver="mine").solver == "mine"
    allowed = knobs(sp.Settings)["solver"].allowed
    assert isinstance(allowed, Choice)
    assert str(allowed).endswith("mine")


# Words

TAKERS: dict[type[Enum], tuple[str, Callable[[Any], Any]]] = {
    Safety: ("safety", lambda word: sp.OnlineSettings(safety=word).safety),
    GiveWay: ("give_way", lambda word: sp.OnlineSettings(give_way=word).give_way),
    Regions: ("regions", lambda word: sp.OnlineSettings(regions=word).regions),
    Noise: ("noise", lambda word: _noise_taken(word)),
    Steering: ("steering", lambda word: sp.Vehicle(**VEHICLE, steering=word).steering),
    ConfidenceLevel: ("level", lambda word: sp.Confidence(level=word).level),
    Variant: ("variant", lambda word: DescentSettings(variant=word).variant),
    jobs.PlanningMethod: ("method", lambda word: jobs.Options(method=word).method),
}
"""What takes the words of users, by its enum: the name in its messages, and what it makes of a word."""


def _noise_taken(word: Any) -> Noise:
    """Tell by the estimate which noise was taken: one that is the same in all directions, or any."""
    times = np.arange(8.0)
    positions = np.stack([times, np.array([0.0, 3.0, -2.0, 1.0, 4.0, -1.0, 2.0, 0.5])], axis=-1)
    sigma = sp.estimate_motion(times, positions, order=1, noise=word).noise_covariance
    return Noise.ISOTROPIC if sigma[0, 0] == pytest.approx(sigma[1, 1]) else Noise.GENERAL


@pytest.mark.parametrize("kind", TAKERS, ids=lambda kind: f"{kind.__module__}.{kind.__name__}")
def test_words_become_members_and_others_are_refused(kind: type[Enum]) -> None:
    name, take = TAKERS[kind]
    for member in kind:
        assert take(member) is member
        assert take(member.value) is member
    wrong: Any
    left_open = () if kind is GiveWay else (None,)
    for wrong in ("sideways", kind.__members__.__iter__().__next__() + "?", 3, [], *left_open):
        with pytest.raises(ValueError, match=rf"{name} = .*: must be one of"):
            take(wrong)


def test_settings_within_settings_are_of_their_kind() -> None:
    with pytest.raises(SettingsError, match=r"newcomers = .*: must be an instance of Newcomers"):
        sp.OnlineSettings(newcomers={"noise_deviation": 0.2})  # type: ignore[arg-type]


def test_settings_of_another_kind_are_refused_by_name() -> None:
    scenario = scene()
    with pytest.raises(SettingsError, match="OnlineSettings': must be Settings"):
        sp.plan(scenario, sp.OnlineSettings())  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="OnlineSettings': must be Settings"):
        sp.simulate(scenario, settings=sp.OnlineSettings())  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="Settings': must be OnlineSettings"):
        sp.Planner(scenario, online=sp.Settings())  # type: ignore[arg-type]
