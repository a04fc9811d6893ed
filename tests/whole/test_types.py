"""Code of users passes mypy and pyright as they come, without plugins: the first pages' code, and lists for rows."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/tutorial.md")
BLOCK = re.compile(r"^```python[^\n]*\n(.*?)^```", flags=re.M | re.S)

NATURAL = """
import numpy as np

import scp_planner as sp

sp.SpeedLimit(from_=2.0, to=4.0, speed=1.0, line=[(0.0, 0.0), (20.0, 0.0)])
sp.Course(time=[0.0, 1.0], position=[(0.0, 0.0), (1.0, 0.0)], covariance=[[0.1, 0.0], [0.0, 0.1]])
sp.PolygonShape(polygon=[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
sp.Vehicle(radius=0.3, max_speed=3.0, max_acceleration=1.5, max_deceleration=2.0, discs=[0.0, 1.0])
scenario = sp.Scenario(
    name="lists",
    vehicle=sp.Vehicle(radius=0.3, max_speed=3.0, max_acceleration=1.5, max_deceleration=2.0),
    start=sp.Start(time=0.0, position=(0.0, 0.0), speed=1.0),
    goal=sp.Goal(position=(20.0, 0.0), heading=0.0),
    guide=[(0.0, 0.0), (10.0, 1.0), (20.0, 0.0)],
    corridor=[[(-2.0, -9.0), (22.0, -9.0), (22.0, 9.0), (-2.0, 9.0)]],
    obstacles=[],
)
dictionaries = sp.Scenario(
    vehicle={"radius": 0.3, "max_speed": 3.0, "max_acceleration": 1.5, "max_deceleration": 2.0, "steering": "any"},
    start={"time": 0.0, "position": [0, 0], "speed": 1.0},
    goal={"position": [20, 0]},
    guide=np.array([[0.0, 0.0], [20.0, 0.0]]),
    bounds={"min": [-5.0, -5.0], "max": [25.0, 5.0]},
    confidence={"probability": 0.9, "level": "per_time"},
    walls=[np.array([[5.0, 3.0], [6.0, 3.0], [6.0, 4.0]])],
    speed_limits=[{"from": 2.0, "to": 4.0, "speed": 1.0}],
    obstacles=[
        {"id": "mapping", "shape": {"disc": 0.3}, "motion": {"position": [10, 3]}},
        sp.Obstacle(
            id="both",
            shape={"rectangle": [1.0, 2.0]},
            motion={"futures": [{"weight": 1.0, "motion": {"position": [12, 3]}}]},
            model={"order": 1},
        ),
    ],
)
arrays = np.zeros((5, 2))
sp.Confidence(probability=0.9, level="joint")
sp.Model(process="pedestrian")
sp.Rectangle(rectangle=np.array([1.0, 2.0]))
sp.PolygonShape(polygon=np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
sp.Observations(time=np.arange(5.0), position=arrays, covariance=np.eye(2))
sp.Motion(position=np.array([1.0, 2.0]))
sp.Course(time=np.arange(3.0), position=np.zeros((3, 2)), covariance=np.tile(np.eye(2), (3, 1, 1)))
estimate = sp.Estimate(time=0.0, position=arrays[0], velocity=arrays[1], covariance=np.eye(4))
sp.Obstacle(id="named", shape=sp.Disc(disc=0.3), estimate=estimate, model="pedestrian")
sp.OnlineSettings(safety="trip", give_way="early", regions="model")
aim: float | None = dictionaries.goal.heading
shape: sp.Disc | sp.Rectangle | sp.PolygonShape | sp.Ellipse = dictionaries.obstacles[0].shape
first: float = scenario.start.position[0]
samples = sp.SampledTrajectory([0.0, 10.0], [[0.0, 0.0], [20.0, 0.0]], speed=np.array([1.0, 3.0]))
holds: bool = sp.certify(scenario, samples).holds
"""
WRONG = {
    "a radius in words": "sp.Disc(disc='large')",
    "a key that is not there": "sp.Goal(position=(20.0, 0.0), hading=0.0)",
    "a shape in words": "sp.Obstacle(id='a', shape='disc', motion={'position': [0, 0]})",
    "no radius": "sp.Vehicle(max_speed=3.0, max_acceleration=1.5, max_deceleration=2.0)",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages' code and what is wrong, each in a file; nothing of this project's own settings is near."""
    there = tmp_path_factory.mktemp("typed")
    for page in PAGES:
        code = BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))
        assert code, page
        (there / f"{Path(page).stem.lower()}.py").write_text("\n".join(code), encoding="utf-8")
    (there / "natural.py").write_text(NATURAL, encoding="utf-8")
    for number, line in enumerate(WRONG.values()):
        (there / f"wrong_{number}.py").write_text(f"import scp_planner as sp\n\n{line}\n", encoding="utf-8")
    return there


def told_of(command: list[str], folder: Path) -> dict[str, list[str]]:
    """The errors that a type checker tells, by the names of the files."""
    files = sorted(path.name for path in folder.glob("*.py"))
    done = subprocess.run([*command, *files], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode in (0, 1), done.stderr
    errors = [line for line in done.stdout.splitlines() if "error:" in line or " - error" in line]
    return {name: [line for line in errors if name in line] for name in files}


def check(errors: dict[str, list[str]]) -> None:
    for name, lines in errors.items():
        assert bool(lines) is name.startswith("wrong_"), (name, lines)


@pytest.mark.slow
def test_mypy_takes_what_users_write(folder: Path, pytestconfig: pytest.Config) -> None:
    """Most of its time is for NumPy and the package: what it found out of them is kept from run to run."""
    pytest.importorskip("mypy")
    cache = getattr(pytestconfig, "cache", None)
    kept = folder / ".cache" if cache is None else cache.mkdir("mypy-of-users")
    check(told_of([sys.executable, "-m", "mypy", "--strict", "--config-file=", f"--cache-dir={kept}"], folder))


def test_pyright_takes_what_users_write(folder: Path) -> None:
    if importlib.util.find_spec("pyright") is None or shutil.which("node") is None:
        pytest.skip("needs pyright and node: pip install pyright")
    check(told_of([sys.executable, "-m", "pyright", "--pythonpath", sys.executable], folder))


def test_natural_arguments_become_tuples() -> None:
    """Lists are taken, and what is kept can be hashed."""
    names: dict[str, object] = {}
    exec(compile(NATURAL, "natural", "exec"), names)
    scenario = names["scenario"]
    assert isinstance(hash(scenario), int)
    assert names["holds"] is True
