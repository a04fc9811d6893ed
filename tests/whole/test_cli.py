"""The command line: exit codes, what is written, and what goes to stdout and stderr."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner, Result

import scp_planner as sp
from scp_planner import builtin
from scp_planner.batch.jobs import Options
from scp_planner.cli import app
from scp_planner.planning.plan import Plan
from scp_planner.scenario.models import Scenario
from scp_planner.settings.knobs import knobs
from scp_planner.settings.online import OnlineSettings
from scp_planner.settings.planning import Settings
from scp_planner.simulation.run import Run

PLAN_KEYS = {
    "schema",
    "scenario",
    "status",
    "reason",
    "start_time",
    "arrival_time",
    "travel_time",
    "method",
    "solver",
    "iterations",
    "wall_time",
    "path",
    "acceleration",
    "clearance",
    "limits",
    "samples",
}


COARSE = ("--set", "path_span=2.5", "--set", "acceleration_spans=8", "--set", "samples=80")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def easy(scenario_data: dict[str, Any], tmp_path: Path) -> Path:
    """A scenario whose one obstacle stays out of the way."""
    scenario_data |= {
        "name": "easy",
        "guide": None,
        "bounds": None,
        "obstacles": [{"id": "far", "shape": {"disc": 1.0}, "motion": {"position": [10, 50]}}],
    }
    file = tmp_path / "easy.yaml"
    file.write_text(yaml.safe_dump(scenario_data))
    return file


@pytest.fixture
def hopeless(easy: Path, scenario_data: dict[str, Any], tmp_path: Path) -> Path:
    """A scenario whose goal lies under an obstacle that never moves."""
    scenario_data["name"] = "hopeless"
    scenario_data["obstacles"] = [{"id": "on-goal", "shape": {"disc": 2.0}, "motion": {"position": [20, 0.5]}}]
    file = tmp_path / "hopeless.yaml"
    file.write_text(yaml.safe_dump(scenario_data))
    return file


# plan


def test_every_seed_gives_the_same_plan_and_the_help_says_so(easy: Path, tmp_path: Path) -> None:
    for seed in ("0", "7"):
        assert run("plan", easy, "-o", tmp_path / f"{seed}.json", "--seed", seed, "-q").exit_code == 0
    plans = [json.loads((tmp_path / f"{seed}.json").read_text()) for seed in ("0", "7")]
    for plan in plans:
        del plan["wall_time"]
        plan.pop("timings", None)
    assert plans[0] == plans[1]
    for command in ("plan", "batch"):
        said = " ".join(run(command, "--help").stdout.split())
        assert "draws nothing at random, every seed gives the same plan" in said.replace("│ ", "")
    assert "seed" not in inspect.signature(sp.plan).parameters
    assert "seed" not in {each.name for each in fields(Options)}


def test_plan_tells_of_shapes_that_became_discs(easy: Path) -> None:
    data = yaml.safe_load(easy.read_text())
    jitter = {"time": [0, 1, 2, 3], "position": [[10, 50], [10.01, 50.01], [10, 50.02], [9.99, 50]]}
    data["obstacles"] = [{"id": "pallet", "shape": {"rectangle": [3.0, 1.0]}, "motion": jitter}]
    easy.write_text(yaml.safe_dump(data))
    told = "pallet: taken for a disc of 1.58 m, the heading of its rectangle is not known: give shape.heading"
    assert run("plan", easy, *COARSE, "--no-bound").stderr.startswith(told)
    assert run("plan", easy, *COARSE, "--no-bound", "--quiet").stderr == ""


def test_a_plan_is_no_scenario_and_says_so(easy: Path, tmp_path: Path) -> None:
    assert run("plan", easy, "-o", tmp_path / "plan.json", *COARSE, "--no-bound", "-q").exit_code == 0
    result = run("compare", tmp_path / "plan.json", easy)
    assert result.exit_code == 2
    assert result.stderr.splitlines()[1:] == ["  (the whole file): this is a plan or a run, not a scenario"]


def test_plan_writes_a_certified_plan(easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--samples", "50")
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert "status:                  certified" in result.stdout
    data = json.loads((tmp_path / "plan.json").read_text())
    assert set(data) >= PLAN_KEYS
    assert (data["schema"], data["scenario"], data["status"], data["reason"]) == (
        1,
        "easy",
        "certified",
        None,
    )
    assert data["clearance"]["obstacle"] == "far"
    assert {len(values) for values in data["samples"].values()} == {50}
    assert f"travel time:             {data['travel_time']:.4f} s" in result.stdout


def test_plan_summary_as_json(easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--json")
    summary, plan = json.loads(result.stdout), Plan.load(tmp_path / "plan.json")
    assert result.exit_code == 0
    assert summary["certified"] is True
    assert summary["scenario"] == "easy"
    assert summary["arrival_time"] == pytest.approx(plan.arrival_time)
    assert summary["least_clearance"] == pytest.approx(plan.clearance.minimum)


def test_plan_without_obstacles_has_a_summary_in_json(easy: Path) -> None:
    """An infinite clearance has no number in JSON."""
    easy.write_text(yaml.safe_dump(yaml.safe_load(easy.read_text()) | {"obstacles": []}))
    result = run("plan", easy, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["least_clearance"] is None


def test_quiet_prints_nothing(easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--quiet")
    assert (result.exit_code, result.output) == (0, "")
    assert Plan.load(tmp_path / "plan.json").certified


@pytest.mark.parametrize("solver", ["daqp", "clarabel", "osqp", "cvxpy"])
def test_plan_with_each_solver(solver: str, easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--solver", solver, "--seed", "3")
    assert result.exit_code == 0, result.output
    assert json.loads((tmp_path / "plan.json").read_text())["solver"] == solver


def test_a_plan_that_is_not_certified_is_written_with_its_reason(hopeless: Path, tmp_path: Path) -> None:
    result = run("plan", hopeless, "-o", tmp_path / "plan.json")
    assert result.exit_code == 3
    assert f"{hopeless}: not certified: " in result.stderr
    assert "relative gap" not in result.stdout  # to a bound, of what does not hold
    data = json.loads((tmp_path / "plan.json").read_text())
    assert data["status"] != "certified"
    assert "on-goal" in data["reason"]
    assert data["reason"] in result.stderr


def test_a_drive_that_does_not_arrive_is_written_and_the_last_reason_told(
    scenario_data: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario_data["start"]["speed"] = 0.0
    scenario_data["goal"] = {"position": [3.0, 0.0]}
    scenario_data["guide"] = None
    scenario_data["obstacles"] = [{"id": "on-goal", "shape": {"disc": 0.6}, "motion": {"position": [3.0, 0.2]}}]
    (tmp_path / "lid.yaml").write_text(yaml.safe_dump(scenario_data))
    monkeypatch.setattr("scp_planner.simulation.loop.TIME_LIMIT", 1.0)
    result = run("simulate", tmp_path / "lid.yaml", "-o", tmp_path / "run.json", "--rate", "4")
    assert result.exit_code == 3, result.stderr
    loaded = Run.load(tmp_path / "run.json")
    assert not loaded.arrived and not loaded.contact
    assert f"did not arrive in {loaded.travel_time:g} s: {loaded.records[-1].reason}" in result.stderr


@pytest.mark.usefixtures("unsettled")
@pytest.mark.parametrize(
    ("suffix", "begins"), [(".html", b"<!DOCTYPE html>"), (".gif", b"GIF89a"), (".png", b"\x89PNG")]
)
def test_plan_draws_what_the_suffix_says(suffix: str, begins: bytes, easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "--plot", tmp_path / f"plan{suffix}")
    assert result.exit_code == 0, result.output
    assert (tmp_path / f"plan{suffix}").read_bytes().startswith(begins)


@pytest.mark.usefixtures("unsettled")
def test_plan_draws_the_view_that_is_asked_for(easy: Path, tmp_path: Path) -> None:
    says = {"map": "x (m)", "space-time": "distance along the path (m)", "profiles": "lateral acceleration (m/s²)"}
    for view, text in says.items():
        result = run("plan", easy, "--plot", tmp_path / f"{view}.svg", "--view", view)
        assert result.exit_code == 0, result.output
        drawn = (tmp_path / f"{view}.svg").read_text(encoding="utf-8")
        assert text in drawn
        assert ("x (m)" in drawn) == (view == "map")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--view", "space-time"], "needs --plot"),
        (["--view", "profiles", "--plot", "plan.html"], "--plot must end in one of .pdf, .png, .svg"),
        (["--view", "globe", "--plot", "plan.png"], "'globe' is not one of"),
    ],
)
def test_a_view_that_cannot_be_had_is_refused(
    arguments: list[str], said: str, easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = set(tmp_path.iterdir())
    result = run("plan", easy, *arguments)
    assert result.exit_code == 2 and said in " ".join(result.stderr.split())
    assert set(tmp_path.iterdir()) == before


@pytest.mark.usefixtures("unsettled")
def test_page_needs_no_matplotlib(easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scp_planner.cli.pictures.can_plot", lambda: False)
    assert run("plan", easy, "--plot", tmp_path / "plan.html").exit_code == 0
    refused = run("plan", easy, "--plot", tmp_path / "plan.png")
    assert refused.exit_code == 2 and "needs matplotlib" in refused.stderr
    short = sp.simulate(Scenario.load(easy), noise=0.05, rate=2.0)  # how the demo drives is tested with its pictures
    monkeypatch.setattr("scp_planner.cli.trips._drive", lambda *_: short)
    result = run("demo", "headon", "-o", tmp_path / "demo")
    assert result.exit_code == 0 and "no figures: matplotlib is not installed" in result.stderr
    assert {file.name for file in (tmp_path / "demo").iterdir()} == {
        "scenario.yaml",
        "plan.json",
        "plan.html",
        "run.json",
        "run.html",
    }


def test_video_without_ffmpeg_is_refused_before_planning(
    easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--plot", tmp_path / "plan.mp4")
    assert result.exit_code == 2 and "needs ffmpeg" in result.stderr
    assert not (tmp_path / "plan.json").exists()


def test_a_built_in_scenario_is_planned_by_name(tmp_path: Path) -> None:
    result = run("plan", "builtin:crossing", "-o", tmp_path / "plan.json")
    assert result.exit_code == 0, result.output
    assert Plan.load(tmp_path / "plan.json").scenario == "crossing"


def test_an_interrupt_that_an_extension_module_hides_is_one(easy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise ImportError("initialization failed") from interrupt

    monkeypatch.setattr("scp_planner.planning.offline.plan", fail)
    result = run("plan", easy)
    assert (result.exit_code, result.output) == (130, "interrupted\n")


def test_an_interrupt_while_the_program_is_loaded_is_quiet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from scp_planner.__main__ import main

    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("scp_planner.cli.main", interrupt)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    assert capsys.readouterr() == ("", "")


def test_an_interrupted_plan_exits_with_130(easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("scp_planner.planning.offline.plan", interrupt)
    result = run("plan", easy, "-o", tmp_path / "plan.json")
    assert (result.exit_code, result.stdout, result.stderr) == (130, "", "interrupted\n")
    assert not (tmp_path / "plan.json").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--solver", "gurobi"], ["--solver", "gurobi", "daqp, "]),
        (["--method", "magic"], ["--method", "magic", "scp", "penalty-descent"]),
        (["--method", "penalty-descent", "--solver", "osqp"], ["--solver", "osqp", "solves no subproblems"]),
        (["--time-limit", "0"], ["--time-limit", "0", "greater than 0"]),
        (["--time-limit", "nan"], ["--time-limit", "nan", "finite"]),
        (["--time-limit", "soon"], ["Invalid value for", "--time-limit"]),
        (["--seed", "-1"], ["--seed", "-1: must be at least 0"]),
        (["--samples", "1"], ["--samples", "1: must be at least 2"]),
        (["-o", "no/such/folder/plan.json"], ["--output", "no/such/folder/plan.json", "must exist"]),
        (["-o", "."], ["--output", ".", "must not be a folder"]),
        (["-o", "easy.yaml"], ["--output", "easy.yaml", "must not be the scenario file"]),
        (["--plot", "plan.doc"], ["--plot", "plan.doc", ".png"]),
        (["--plot", "plan"], ["--plot", ".html"]),
        (["--plot", "no/such/plan.png"], ["--plot", "no/such/plan.png", "must exist"]),
        (["--colour"], ["--colour"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_bad_options_are_refused_before_planning(
    options: list[str], said: list[str], easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = easy.read_bytes()
    result = run("plan", easy.name, "-o", "plan.json", *options)
    assert result.exit_code == 2
    assert result.stdout == ""
    for words in said:
        assert words in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["easy.yaml"]
    assert easy.read_bytes() == before


def test_an_unknown_built_in_scenario_is_refused() -> None:
    result = run("plan", "builtin:crosing")
    assert result.exit_code == 2
    assert "'crosing'" in result.stderr
    assert "'crossing'" in result.stderr


def test_settings_are_changed_by_name(easy: Path, tmp_path: Path) -> None:
    changes = ("--set", "acceleration_degree=2", "--set", "path_degree=5")
    assert run("plan", easy, "-o", tmp_path / "plan.json", *changes).exit_code == 0
    data = json.loads((tmp_path / "plan.json").read_text())
    assert (data["acceleration"]["degree"], data["path"]["degree"]) == (2, 5)
    simulated = run("simulate", easy, "--set", "iterations=1", "--set", "path_span=3", "-o", tmp_path / "run.json")
    assert simulated.exit_code == 0, simulated.output
    compared = run("compare", easy, "--starts", "1", "--set", "samples=60", "--method", "scp")
    assert compared.exit_code == 0, compared.output


@pytest.mark.parametrize(
    ("command", "assignment", "said"),
    [
        ("plan", "path_spam=2", "path_spam = '2': there is no such setting; did you mean 'path_span'?"),
        ("plan", "path_span=0", "path_span = 0.0: must be a number, above 0, up to 1e+12 m"),
        ("plan", "iterations=2", "there is no such setting; did you mean 'max_iterations'?"),
        ("plan", "path_span", "path_span: must be NAME=VALUE"),
        ("compare", "path_spam=2", "did you mean 'path_span'?"),
        ("simulate", "period=1", "period: --rate gives the period"),
        ("simulate", "foresigt=2", "did you mean 'foresight'?"),
        ("simulate", "iterations=0", "iterations = 0: must be a whole number, 1 to 1000"),
    ],
)
def test_wrong_settings_are_refused(command: str, assignment: str, said: str, easy: Path, tmp_path: Path) -> None:
    result = run(command, easy, "-o", tmp_path / "out", "--set", assignment)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert not (tmp_path / "out").exists()


def test_settings_are_listed(tmp_path: Path) -> None:
    result = run("settings")
    assert result.exit_code == 0
    for each in (*knobs(Settings).values(), *knobs(OnlineSettings).values()):
        if each.allowed is not None:
            assert f"\n  {each.name} = {each.default_text}  ({each.allowed_text})\n" in result.stdout
    one = json.loads(run("settings", "path_span", "--json").stdout)
    assert [(entry["name"], entry["default"], entry["allowed"]) for entry in one] == [
        ("path_span", "none", "a number, above 0, up to 1e+12 m, or none")
    ]
    wrong = run("settings", "path_spam")
    assert (wrong.exit_code, wrong.stdout) == (2, "")
    assert "did you mean 'path_span'?" in wrong.stderr


def test_plan_by_penalty_descent(easy: Path, tmp_path: Path) -> None:
    result = run("plan", easy, "-o", tmp_path / "plan.json", "--method", "penalty-descent")
    assert result.exit_code == 0, result.output
    data = json.loads((tmp_path / "plan.json").read_text())
    assert (data["method"], data["solver"], data["status"]) == ("penalty-descent", "l-bfgs", "certified")
    assert run("check", easy, tmp_path / "plan.json").exit_code == 0


# compare


@pytest.mark.usefixtures("unsettled")
def test_compare_tables_writes_and_draws(easy: Path, tmp_path: Path) -> None:
    table, figure = tmp_path / "trials.csv", tmp_path / "comparison.png"
    result = run("compare", easy, "builtin:headon", "--starts", "1", "-o", table, "--plot", figure, *COARSE)
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert [line.split()[:2] for line in result.stdout.splitlines()] == [
        ["method", "trials"],
        ["scp", "2"],
        ["l-bfgs", "2"],
    ]
    assert len(table.read_text().splitlines()) == 5
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_compare_as_json_with_chosen_methods(easy: Path) -> None:
    methods = ("--method", "l-bfgs", "--method", "scp")
    result = run("compare", easy, "--starts", "1", *methods, "--json", *COARSE)
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert [row["method"] for row in data["summary"]] == ["l-bfgs", "scp"]
    assert [trial["certified"] for trial in data["trials"]] == [True, True]


def test_compare_names_scenarios_that_no_method_solves(hopeless: Path, easy: Path) -> None:
    result = run("compare", hopeless, easy, "--starts", "1", "--method", "scp", *COARSE)
    assert result.exit_code == 3
    assert result.stderr == "no certified plan by any method: hopeless\n"
    assert "1 (50%)" in result.stdout
    assert run("compare", hopeless, "--starts", "1", "--method", "scp", "--quiet").stdout == ""


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--starts", "0"], ["--starts", "0: must be at least 1"]),
        (["--method", "magic"], ["--method", "magic", "l-bfgs"]),
        (["--plot", "trials.html"], ["--plot", "trials.html", ".svg"]),
        (["-o", "no/such/trials.csv"], ["--output", "no/such/trials.csv", "must exist"]),
        (["none.yaml"], ["none.yaml: No such file or directory"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_bad_options_of_compare_are_refused(
    options: list[str], said: list[str], easy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("compare", easy.name, *options)
    assert (result.exit_code, result.stdout) == (2, "")
    for words in said:
        assert words in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["easy.yaml"]


# study


@pytest.mark.slow
def test_study_consistency_writes_tables_and_figures_and_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    options = ("study", "consistency", "--quick", "--repetitions", "2", "--workers", "1", "-o", folder)
    result = run(*options)
    assert result.exit_code == 0, result.output
    assert "Slopes over n" in result.stdout
    assert {file.name for file in folder.iterdir()} == {
        "results.jsonl",
        "summary.csv",
        "slopes.csv",
        "border.csv",
        "consistency.png",
        "border.png",
    }
    kept = (folder / "results.jsonl").read_bytes()
    again = run(*options, "--json")
    assert again.exit_code == 0
    assert {slope["kind"] for slope in json.loads(again.stdout)["slopes"]} == {"estimate", "region"}
    assert (folder / "results.jsonl").read_bytes() == kept


def test_study_consistency_refuses_a_folder_of_something_else(tmp_path: Path) -> None:
    (tmp_path / "results.jsonl").write_text("mine\n")
    result = run("study", "consistency", "--quick", "-o", tmp_path)
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"{tmp_path / 'results.jsonl'}: line 1" in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["results.jsonl"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--repetitions", "1"], "1: must be at least 2"),
        (["--workers", "0"], "0: must be at least 1"),
        (["-o", "no/such/folder"], "must exist"),
    ],
    ids=lambda value: str(value),
)
def test_bad_options_of_a_study_are_refused(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("study", "consistency", *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert said in result.stderr
    assert list(tmp_path.iterdir()) == []


# check


def test_check_certifies_a_plan(easy: Path, tmp_path: Path) -> None:
    run("plan", easy, "-o", tmp_path / "plan.json")
    result = run("check", easy, tmp_path / "plan.json")
    assert result.exit_code == 0, result.output
    assert "certified:               yes" in result.stdout
    assert run("check", easy, tmp_path / "plan.json", "--quiet").output == ""


def test_check_refuses_a_plan_that_meets_an_obstacle(easy: Path, scenario_data: dict[str, Any], tmp_path: Path) -> None:
    """The plan says of itself that it is certified; that was for another scenario."""
    run("plan", easy, "-o", tmp_path / "plan.json")
    scenario_data["obstacles"][0]["motion"]["position"] = [10, 0]
    easy.write_text(yaml.safe_dump(scenario_data))
    result = run("check", easy, tmp_path / "plan.json", "--json")
    assert result.exit_code == 3
    assert "not certified: clearance to far" in result.stderr
    summary = json.loads(result.stdout)
    assert summary["certified"] is False
    assert summary["least_clearance"] < 0
    assert summary["nearest_obstacle"] == "far"
    assert any("clearance to far" in violation for violation in summary["violations"])


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": 2}', "{nonsense"])
def test_check_refuses_what_is_no_plan(text: str, easy: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(text)
    result = run("check", easy, tmp_path / "plan.json")
    assert result.exit_code == 2
    assert str(tmp_path / "plan.json") in result.stderr
    assert result.stdout == ""


def test_check_names_a_plan_that_is_missing(easy: Path, tmp_path: Path) -> None:
    result = run("check", easy, tmp_path / "none.json")
    assert result.exit_code == 2
    assert f"{tmp_path / 'none.json'}: No such file or directory" in result.stderr


# schema, demo, and the program as a whole


def test_schema_prints_the_json_schema() -> None:
    result = run("schema")
    assert result.exit_code == 0
    schema = json.loads(result.stdout)
    assert schema == Scenario.json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.usefixtures("unsettled")
@pytest.mark.parametrize("arguments", [pytest.param([], marks=pytest.mark.slow, id="radar"), ["headon"]])
def test_demo_writes_scenario_plan_and_figure(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The film, which takes its time, is drawn in tests of films."""
    draw = Run.draw

    def drawn(run: Run, path: Path) -> None:
        path.write_text("film") if path.suffix == ".gif" else draw(run, path)

    monkeypatch.setattr(Run, "draw", drawn)
    monkeypatch.chdir(tmp_path)
    result = run("demo", *arguments)
    assert result.exit_code == 0, result.output
    for words in ("status:", "arrival time:", "least clearance:", "iterations:", "wall time:"):
        assert words in result.stdout
    written = {
        "scenario.yaml",
        "plan.json",
        "run.json",
        "plan.html",
        "run.html",
        "plan.png",
        "space_time.png",
        "run.gif",
    }
    assert {file.name for file in (tmp_path / "demo").iterdir()} == written
    assert all(f"demo/{name}" in result.stderr for name in written)
    assert "simulated arrived:       yes" in result.stdout
    assert Run.load(tmp_path / "demo" / "run.json").arrived
    scenario = Scenario.load(tmp_path / "demo" / "scenario.yaml")
    assert scenario == builtin.load(scenario.name)
    assert Plan.load(tmp_path / "demo" / "plan.json").certified


@pytest.mark.slow
def test_demo_runs_twice_into_the_same_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scp_planner.simulation.run.Run.draw", lambda run, path: path.write_text("film"))
    monkeypatch.setattr("scp_planner.cli.pictures.can_plot", lambda: False)
    for _ in range(2):
        result = run("demo", "headon", "-o", tmp_path / "demo", "--quiet")
        assert (result.exit_code, result.output) == (0, "")


def test_demo_refuses_a_file_for_a_folder(tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("mine")
    result = run("demo", "-o", tmp_path / "demo")
    assert result.exit_code == 2
    assert "must be a folder" in result.stderr
    assert (tmp_path / "demo").read_text() == "mine"


@pytest.mark.parametrize("name", builtin.names())
def test_every_built_in_scenario_has_a_certified_plan(name: str) -> None:
    result = run("plan", f"builtin:{name}")
    assert result.exit_code == 0, result.output


def test_the_module_runs_as_a_program() -> None:
    command = [sys.executable, "-m", "scp_planner"]
    version = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.strip() == __import__("scp_planner").__version__
    refused = subprocess.run([*command, "plan", "none.yaml"], capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "none.yaml: No such file or directory\n"
    unfinished = subprocess.run([*command, "plan"], capture_output=True, text=True, check=False)
    assert unfinished.returncode == 2


@pytest.mark.usefixtures("unsettled")
def test_study_coverage_writes_table_and_figure(tmp_path: Path) -> None:
    result = run("study", "coverage", "--runs", "200", "-o", tmp_path / "coverage")
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "coverage" / "coverage.png").stat().st_size > 10_000
    rows = (tmp_path / "coverage" / "coverage.csv").read_text().splitlines()
    assert len(rows) > 20 and "per_obstacle" in result.stdout


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--probability", "1.5"), "1.5"),
        (("--runs", "0"), "0: must be at least 1"),
        (("nothing.csv",), "nothing.csv"),
    ],
)
def test_bad_options_of_the_coverage_study_are_refused(tmp_path: Path, options: tuple[str, ...], expected: str) -> None:
    result = run("study", "coverage", "-o", tmp_path / "coverage", *options)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert not (tmp_path / "coverage").exists()


def test_fit_motion_writes_a_model_that_a_scenario_can_refer_to(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = ["id,time,x,y"]
    for person in range(30):
        velocity, position = rng.normal(size=2), rng.normal(size=2)
        for step in range(24):
            rows.append(f"{person},{0.4 * step:.1f},{position[0]:.4f},{position[1]:.4f}")
            velocity = velocity + 0.2 * rng.normal(size=2)
            position = position + 0.4 * velocity
    (tmp_path / "tracks.csv").write_text("\n".join(rows) + "\n")
    result = run("fit-motion", tmp_path / "tracks.csv", "-o", tmp_path / "people.yaml")
    assert result.exit_code == 0, result.stderr
    assert "random_walk" in result.stdout and "m2/s3" in result.stdout
    printed = run("fit-motion", tmp_path / "tracks.csv", "-o", tmp_path / "people.json", "--json", "--quiet")
    assert json.loads(printed.stdout) == json.loads((tmp_path / "people.json").read_text())
    assert printed.stderr == ""
    scenario = {
        "schema": 1,
        "vehicle": {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        "start": {"time": 0.0, "position": [0, 0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [10, 0]},
        "obstacles": [
            {
                "id": "walker",
                "shape": {"disc": 0.3},
                "observations": {"time": [-0.8, -0.4, 0.0], "position": [[5, 6], [5, 6.4], [5, 6.8]]},
                "model": {"process": "people.yaml"},
            }
        ],
    }
    (tmp_path / "scene.json").write_text(json.dumps(scenario))
    planned = run("plan", tmp_path / "scene.json", "-o", tmp_path / "plan.json")
    assert planned.exit_code == 0, planned.stderr


def watched(folder: Path, model: object = None) -> Path:
    """A scenario of one person who is seen beside the way."""
    person = {
        "id": "walker",
        "shape": {"disc": 0.3},
        "observations": {
            "time": [-0.8, -0.4, 0.0],
            "position": [[5, 5.0], [5, 5.01], [5, 5.0]],
            "covariance": [[0.0025, 0.0], [0.0, 0.0025]],
        },
    }
    scenario = {
        "schema": 1,
        "vehicle": {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.0, "max_deceleration": 1.0},
        "start": {"time": 0.0, "position": [0, 0], "heading": 0.0, "speed": 1.0},
        "goal": {"position": [10, 0]},
        "obstacles": [person if model is None else {**person, "model": model}],
    }
    (folder / "scene.json").write_text(json.dumps(scenario))
    return folder / "scene.json"


def test_a_motion_model_can_be_named_on_the_command_line(tmp_path: Path) -> None:
    """Plan and check see the zones of the model that is named, whatever the file says."""
    seen, plan = watched(tmp_path), tmp_path / "plan.json"
    planned = run("plan", seen, "--model", "pedestrian", "-o", plan, "--no-bound")
    assert planned.exit_code == 0, planned.stderr
    checked = {
        model: json.loads(run("check", seen, plan, *(["--model", model] if model else []), "--json").stdout)
        for model in ("", "pedestrian", "car")
    }
    clearance = {model: each["least_clearance"] for model, each in checked.items()}
    assert clearance["pedestrian"] > clearance["car"] and clearance["pedestrian"] > clearance[""]
    named = json.loads(run("check", watched(tmp_path, "pedestrian"), plan, "--json").stdout)
    assert named == checked["pedestrian"]


@pytest.mark.parametrize("command", ["plan", "check", "simulate"])
def test_a_motion_model_that_is_none_is_refused(tmp_path: Path, command: str) -> None:
    plan = [tmp_path / "plan.json"] if command == "check" else []
    refused = run(command, watched(tmp_path), *plan, "--model", "pedestrain")
    assert refused.exit_code == 2 and "did you mean 'pedestrian'" in refused.stderr
    known = run(command, "builtin:crossing", *plan, "--model", "pedestrian")
    assert known.exit_code == 2 and "no obstacle whose motion is to be estimated" in known.stderr


def test_a_model_fitted_to_half_of_the_tracks_is_tested_on_the_rest(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    rows = ["id,time,x,y"]
    for person in range(60):
        course = np.cumsum(0.4 * (rng.normal(size=2) + np.cumsum(0.2 * rng.normal(size=(24, 2)), axis=0)), axis=0)
        rows += [f"{person},{0.4 * step:.1f},{x:.4f},{y:.4f}" for step, (x, y) in enumerate(course)]
    (tmp_path / "tracks.csv").write_text("\n".join(rows) + "\n")
    options = ("--half", "--noise", "0.02", "--source", "made up", "-o", tmp_path / "half.yaml", "--json")
    fitted = json.loads(run("fit-motion", tmp_path / "tracks.csv", *options).stdout)
    assert fitted["fitted_to"]["tracks"] == 30 and fitted["fitted_to"]["source"] == "made up"
    assert fitted["noise_deviation"] == 0.02
    coverage = ("study", "coverage", tmp_path / "tracks.csv", "--model", tmp_path / "half.yaml", "-o", tmp_path / "out")
    measured = json.loads(run(*coverage, "--json").stdout)["recorded"]
    pointwise = {row["lead_time"]: row for row in measured if row["level"] == "per_time"}
    assert list(pointwise) == [1.0, 2.0, 4.0]
    assert all(row["tracks"] == 30 and row["coverage"] > 0.88 for row in pointwise.values())
    refused = run("study", "coverage", "--model", "pedestrian", "-o", tmp_path / "out")
    assert refused.exit_code == 2 and "TRACKS" in refused.stderr


def test_fit_motion_makes_split_conformal_regions(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = ["id,time,x,y"]
    for person in range(50):
        course = np.cumsum(0.4 * (rng.normal(size=2) + np.cumsum(0.2 * rng.normal(size=(20, 2)), axis=0)), axis=0)
        rows += [f"{person},{0.4 * step:.1f},{x:.4f},{y:.4f}" for step, (x, y) in enumerate(course)]
    (tmp_path / "tracks.csv").write_text("\n".join(rows) + "\n")
    inflations = {}
    for level in ("0.8", "0.95"):
        result = run("fit-motion", tmp_path / "tracks.csv", "--conformal", level, "-o", tmp_path / "m.json", "--json")
        assert result.exit_code == 0, result.stderr
        inflations[level] = json.loads(result.stdout)["tails"]["inflation"]
    assert inflations["0.8"] != inflations["0.95"]
    refused = run("fit-motion", tmp_path / "tracks.csv", "--conformal", "2", "-o", tmp_path / "m.json")
    assert refused.exit_code == 2 and "--conformal" in refused.stderr


def test_fit_motion_says_what_to_do_with_a_few_tracks(tmp_path: Path) -> None:
    rows = [f"{name},{0.4 * k},{k + 0.1 * (-1) ** k},{name}" for name in range(3) for k in range(12)]
    (tmp_path / "tracks.csv").write_text("\n".join(["id,time,x,y", *rows]))
    refused = run("fit-motion", tmp_path / "tracks.csv", "-o", tmp_path / "m.json")
    assert refused.exit_code == 2 and "--no-tails" in refused.stderr and "WARNING" not in refused.stderr
    assert run("fit-motion", tmp_path / "tracks.csv", "--no-tails", "-o", tmp_path / "m.json").exit_code == 0
    assert json.loads((tmp_path / "m.json").read_text())["tails"] is None


def test_fit_motion_refuses_an_unknown_kind(tmp_path: Path) -> None:
    (tmp_path / "tracks.csv").write_text("id,time,x,y\n1,0,0,0\n1,1,1,0\n")
    result = run("fit-motion", tmp_path / "tracks.csv", "--kind", "brownian", "-o", tmp_path / "m.yaml")
    assert result.exit_code == 2
    assert "brownian" in result.stderr
    assert not (tmp_path / "m.yaml").exists()


def test_plan_says_what_no_trip_is_shorter_than(tmp_path: Path) -> None:
    suite = Path(__file__).parents[1] / "suite" / "wait-for-a-convoy.yaml"
    summaries = {}
    for option in ("--bound", "--no-bound"):
        file = tmp_path / f"{option}.json"
        result = run("plan", suite, option, "-o", file, "--json")
        assert result.exit_code == 0
        summaries[option] = json.loads(result.stdout)
        plan = Plan.load(file)
        assert plan.lower_bound == summaries[option]["lower_bound"]
        assert plan.gap == pytest.approx(plan.travel_time / plan.lower_bound - 1.0)
        assert plan.gap == pytest.approx(summaries[option]["relative_gap"])
    assert summaries["--no-bound"]["relative_gap"] > 1.0
    assert 0.0 <= summaries["--bound"]["relative_gap"] < 0.01
