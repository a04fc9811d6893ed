"""Every example runs, says what it found, and ends in what it promises."""

from __future__ import annotations

import ast
import importlib.util
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import scripts
from PIL import Image

from scp_planner import builtin

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str) -> ModuleType:
    return scripts.load(f"examples/{name}.py")


def run_script(name: str, figure: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "-o", str(figure)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.py") if path.stem != "ros2_node"))
def test_without_its_extra_an_example_names_it(name: str, tmp_path: Path) -> None:
    """Packages that come with extras cannot be imported, and there are no data."""
    hidden = "import sys; sys.modules.update(dict.fromkeys(('matplotlib', 'rosbags', 'irsim'), None)); "
    script, target = str(EXAMPLES / f"{name}.py"), str(tmp_path / "x.png")
    start = f"import runpy; sys.argv = ['x', '-o', {target!r}]; runpy.run_path({script!r}, run_name='__main__')"
    environment = {key: value for key, value in os.environ.items() if key != "SCP_PLANNER_DATA"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, "-c", hidden + start], env=environment, capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode in (0, 1, 2) and "Traceback" not in done.stderr, done.stderr
    assert done.returncode == 0 or "pip install 'scp-planner[" in done.stderr or "save it as" in done.stderr


def test_without_ros_the_node_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert load("ros2_node").main([]) == 2
    assert "source a workspace of ROS 2" in capsys.readouterr().err


def test_the_node_drives_to_its_goal_past_a_walker() -> None:
    """By the messages that it takes, of a robot that does what it is commanded."""
    pytest.importorskip("rosbags")
    from tracked_messages import autoware, odometry

    node = load("ros2_node")
    loop = node.Loop((6.0, 0.0), deadline=None)
    assert loop.replan() is None
    x, y, heading, speed, time, step = 0.0, 0.0, 0.0, 0.0, 0.0, 0.1
    nearest = math.inf
    while time < 20.0:
        walker = (3.0, -2.0 + 0.8 * time)
        loop.take_odometry(odometry(time, (x, y), heading, speed))
        loop.take_objects(autoware(time, walker, (0.0, 0.8)))
        plan = loop.replan()
        assert plan is not None and loop.replan() is None
        if plan.arrived:
            break
        speed, turning = node.command(plan, time, step)
        heading += step * turning
        x, y, time = x + step * speed * math.cos(heading), y + step * speed * math.sin(heading), time + step
        nearest = min(nearest, math.dist((x, y), walker))
    assert math.dist((x, y), (6.0, 0.0)) < 0.3
    assert nearest > 0.8


def assert_is_picture(path: Path) -> None:
    with Image.open(path) as picture:
        assert min(picture.size) > 400
        colours = picture.convert("RGB").getcolors(1 << 24)
        assert colours is not None and len(colours) > 100


def test_every_example_is_tested_here() -> None:
    here = Path(__file__).read_text(encoding="utf-8")
    assert [path.stem for path in EXAMPLES.glob("*.py") if f'"{path.stem}"' not in here] == []


def test_compare_methods_ends_in_a_table_and_a_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """On one of the scenarios that it would take."""
    builtin.load("headon").save(tmp_path / "headon.yaml")
    figure, table = tmp_path / "figure.png", tmp_path / "figure.csv"
    assert load("compare_methods").main([str(tmp_path / "headon.yaml"), "-o", str(figure)]) == 0
    told = capsys.readouterr()
    assert [line.split()[0] for line in told.out.splitlines()[:3]] == ["method", "scp", "l-bfgs"]
    assert told.out.endswith(f"wrote {figure} and {table}\n")
    assert told.err == ""
    assert_is_picture(figure)
    assert len(table.read_text().splitlines()) == 3


@pytest.mark.parametrize(
    ("name", "says"),
    [
        *((name, "certified: ") for name in ("crossing", "overtaking", "noisy_radar", "own_constraint")),
        *((name, "arrived after ") for name in ("closed_loop_radar", "overtaking_oncoming")),
    ],
)
def test_example_ends_in_a_figure(name: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "figure.png"
    assert load(name).main(["-o", str(figure)]) == 0
    told = capsys.readouterr()
    assert told.out.startswith(says) and told.out.endswith(f"wrote {figure}\n")
    assert told.err == ""
    assert_is_picture(figure)
    assert list(tmp_path.iterdir()) == [figure]


def test_the_robot_is_at_its_three_goals_in_turn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = tmp_path / "robot.png"
    options = ["--record", str(tmp_path / "robot.jsonl"), "--deadline", "5"]  # long enough on any machine
    assert load("robot_loop").main(["-o", str(figure), *options]) == 0
    assert capsys.readouterr().out.startswith("3 goals in ")
    assert_is_picture(figure)


def test_recorded_crowd(recorded_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = load("recorded_crowd")
    figure = tmp_path / "crowd.png"
    assert module.main([str(recorded_data), "-o", str(figure)]) == 0
    told = capsys.readouterr().out
    assert told.startswith("9 people in sight; certified: ")
    assert "nearest in truth: person " in told
    assert_is_picture(figure)


@pytest.mark.slow
def test_closed_loop_through_a_recorded_crowd(
    recorded_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure, film = tmp_path / "crowd.png", tmp_path / "crowd.gif"
    assert load("closed_loop_crowd").main([str(recorded_data), "-o", str(figure), "--animate", str(film)]) == 0
    told = capsys.readouterr().out
    assert told.startswith("arrived after ") and "least distance to anybody while moving: " in told
    assert_is_picture(figure)
    with Image.open(film) as pictures:
        assert pictures.n_frames > 50  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["recorded_crowd", "closed_loop_crowd"])
@pytest.mark.parametrize("given", [True, False])
def test_recorded_crowd_says_where_data_can_be_had(
    given: bool, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SCP_PLANNER_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    assert load(name).main([str(tmp_path)] if given else []) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1
    assert "https://github.com/crowdbotp/OpenTraj" in told.err
    assert list(tmp_path.iterdir()) == []


def test_watch(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.yaml"
    builtin.load("headon").save(mine)
    assert load("watch").main([str(mine), "-o", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("certified: ")
    with Image.open(tmp_path / "headon.gif") as film:
        assert film.n_frames > 50  # type: ignore[attr-defined]
    assert (tmp_path / "headon.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_export_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags", reason="needs rosbags, which is not installed")
    assert load("export_messages").main(["-o", str(tmp_path)]) == 0
    told = capsys.readouterr()
    assert told.out.startswith("certified: ") and told.err == ""
    assert "200 rows of 11 columns, 11 arrays, 200 poses\nthe table and the messages are 0 m apart" in told.out
    assert {path.name for path in tmp_path.iterdir()} == {"plan.csv", "plan.npz", "plan.mcap", "plan.png"}
    assert_is_picture(tmp_path / "plan.png")


@pytest.mark.skipif(importlib.util.find_spec("irsim") is None, reason="needs ir-sim, which is not installed")
def test_ir_sim_planner(tmp_path: Path) -> None:
    """In a process of its own: the simulator chooses matplotlib's backend for the whole process."""
    done = run_script("ir_sim_planner", tmp_path / "figure.png")
    told = re.fullmatch(
        r"arrived after (\d+\.\d) s; nearest to a moving obstacle: (\d\.\d+) m\nwrote .*\n", done.stdout
    )
    assert told, done.stdout + done.stderr
    # 20 m at 2 m/s and 1.5 m/s2 take 10.7 s; and it touches nobody.
    assert 10.6 < float(told[1]) < 14.0
    assert float(told[2]) > 0.0
    assert_is_picture(tmp_path / "figure.png")


# The notebook: what its cells do from top to bottom, as Jupyter would run them

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_trip.ipynb"


def run_cell(source: str, names: dict[str, Any]) -> Any:
    """Run a cell; what its last line is worth, if it is an expression."""
    tree = ast.parse(source)
    last = tree.body[-1]
    if isinstance(last, ast.Expr):
        tree.body.pop()
    exec(compile(tree, "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names) if isinstance(last, ast.Expr) else None


def test_the_notebook_is_one_without_outputs() -> None:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in notebook["cells"]:
        assert cell["cell_type"] in ("markdown", "code")
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)


def test_the_notebook_runs_from_top_to_bottom(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    cells = [cell for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    names: dict[str, Any] = {}
    shown = [run_cell("".join(cell["source"]), names) for cell in cells]
    assert names["plan"].certified and names["run"].arrived and not names["run"].contact
    pictures = [value for value in shown if "image/png" in getattr(value, "_repr_html_", str)()]
    assert pictures == [names["scenario"], names["plan"], names["run"]]
    near, far, later = map(float, re.findall(r"-?\d+\.\d+", capsys.readouterr().out.splitlines()[-1]))
    assert near < 0.05 and far >= 0.2 and later >= 0.0
    # Close to its limits all along: the interpolation between samples loses a little of them, and no clearance.
    samples = next(value for value in shown if repr(value).startswith("Certificate("))
    assert {violation.what for violation in samples.violations} <= {"acceleration", "speed", "lateral_acceleration"}
