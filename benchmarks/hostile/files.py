"""Damage one good file of each kind at random, and report what is raised besides the documented error of its reader.

``python -m benchmarks.hostile.files --count 5000`` damages bytes and, in files of JSON, values, types, lengths, nesting
and keys. A file is refused by an OSError or the error of its reader, which names the file. A file that is accepted is
used: a map is planned on, a plan is certified, a run is reported. None may take much time or memory.
"""

from __future__ import annotations

import argparse
import io
import json
import re
import resource
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import scp_planner as sp
from benchmarks import common
from benchmarks.hostile.damage import cut, damaged
from benchmarks.hostile.roads import ROAD
from scp_planner.errors import FaultyInputError, ScpPlannerError, TracksError
from scp_planner.formats.commonroad import load_commonroad
from scp_planner.mathematics.occupancy import OccupancyMap
from scp_planner.tracking.tracks import Tracks

Rng = np.random.Generator
NAME = "file"
PLAN_TIME = 0.1
"""s that a plan over a damaged map may take."""
MOST_TIME = 10.0
"""s of the processor that a file may take, with its use."""
MOST_MEMORY = 500 * 2**10
"""KiB that a file may take, with its use."""
MAP = (
    b"image: cells.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\nmode: trinary\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.25\n"
)
SPECIAL = (
    b"",
    b"\n",
    b"[" * 100_000,
    b'{"a":' * 50_000,
    b'"\\ud800"',
    b"9" * 6000,
    b"\xff\xfe\x00",
    b"null",
    b"[]",
    b"{}",
)
"""Contents of files, whatever the kind."""
VALUES: tuple[Any, ...] = ("\ud800", [[[[]]]], 10**30, "\u0000", {"": {"": {}}}, [1e308] * 3)
"""Values of JSON besides those of `damage`."""

NUMBERED = (".yaml", ".csv", ".xml")
"""Suffixes of files of text whose numbers are replaced."""
FACTORS = (-1.0, 0.0, 0.5, 1.0 + 1e-9, 1.01, 2.0, 1e-6, 1e3, 1e6, 1e8)
"""By which one number of a text is multiplied."""
_NUMBER = re.compile(rb"(?<![\w.+-])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")
NUMBERS = (
    b"0",
    b"-1",
    b"1",
    b"2.5",
    b"1e9",
    b"-1e308",
    b"1e400",
    b"nan",
    b"inf",
    b"",
    b"x",
    b"9" * 400,
    b"1_0",
    b"7.0",
)
"""Text that stands where numbers should."""


@dataclass(frozen=True)
class FileKind:
    """A kind of file: its suffix, a good one, what reads it, the error of that, and what uses what was read."""

    suffix: str
    good: Callable[[Path], bytes]
    load: Callable[[Path], Any]
    error: type[FaultyInputError]
    use: Callable[[Any, Path], object] = lambda _loaded, _file: None
    text: bool = False
    """JSON, or lines of JSON, whose values are damaged too."""


def _scenario() -> sp.Scenario:
    far = {"id": "far", "shape": {"disc": 0.5}, "motion": {"position": [6.0, 5.0]}}
    vehicle = {"radius": 0.3, "max_speed": 2.0, "max_acceleration": 1.5, "max_deceleration": 2.0}
    start = {"time": 0.0, "position": [0.5, 0.5], "speed": 0.0, "heading": 0.0}
    return sp.Scenario(vehicle=vehicle, start=start, goal={"position": [5.0, 0.5]}, obstacles=[far])


def _write_plan(file: Path) -> bytes:
    sp.plan(_scenario()).save(file)
    return file.read_bytes()


def _write_run(file: Path) -> bytes:
    sp.simulate(_scenario(), noise=0.05, rate=2.0, seed=0).save(file)
    return file.read_bytes()


def _write_recording(file: Path) -> bytes:
    planner = sp.Planner(_scenario())
    with planner.record(file):
        planner.add_obstacle("seen", {"rectangle": [0.6, 0.4]}, covariance=0.01 * np.eye(2))
        for time in (0.0, 0.1, 0.2):
            planner.observe("seen", time, (8.0, 2.0 - time))
            planner.replan(time, (0.5, 0.5), 0.0, 0.0)
    return file.read_bytes()


def _cells() -> np.ndarray:
    cells = np.full((20, 60), 254, dtype=np.uint8)
    cells[12:, 30] = 0
    cells[0, 0] = 205
    return cells


def _write_pgm(_: Path) -> bytes:
    return b"P5\n60 20\n255\n" + _cells().tobytes()


def _write_plain_pgm(_: Path) -> bytes:
    return b"P2\n# cells\n60 20\n255\n" + "\n".join(" ".join(map(str, row)) for row in _cells().tolist()).encode()


def _write_png(_: Path) -> bytes:
    from PIL import Image

    packed = io.BytesIO()
    Image.fromarray(_cells()).save(packed, format="PNG")
    return packed.getvalue()


def _write_geojson(_: Path) -> bytes:
    rings = [
        [[3.0, 1.5], [4.0, 1.5], [4.0, 4.0], [3.5, 2.0], [3.0, 1.5]],
        [[7.0, 7.0], [8.0, 7.0], [8.0, 8.0], [7.0, 7.0]],
    ]
    parts = [
        {"type": "Polygon", "coordinates": [rings[0]]},
        {"type": "GeometryCollection", "geometries": [{"type": "MultiPolygon", "coordinates": [[rings[1]]]}]},
    ]
    features = [{"type": "Feature", "properties": {"a": 1}, "geometry": part} for part in parts]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def _write_tracks(_: Path) -> bytes:
    rows = [
        f"{name},{0.1 * k:.1f},{0.3 * k + at:.2f},{at:.2f}" for name, at in (("a", 1.0), ("b", 4.0)) for k in range(9)
    ]
    return "\n".join(["id,time,x,y", *rows, ""]).encode()


def _write_scenario(_: Path) -> bytes:
    return json.dumps(_scenario().to_dict()).encode()


def _write_samples(_: Path) -> bytes:
    rows = [f"{0.1 * k:.1f},{0.5 + 0.15 * k:.3f},0.5,0.0,1.5" for k in range(31)]
    return "\n".join(["t,x,y,heading,speed", *rows, ""]).encode()


def _write_arrays(file: Path) -> bytes:
    time = np.linspace(0.0, 3.0, 31)
    np.savez_compressed(file, time=time, x=0.5 + 1.5 * time, y=np.full(31, 0.5))
    return file.read_bytes()


def _use_plan(plan: sp.Plan, file: Path) -> None:
    sp.certify(_scenario(), plan)
    plan.save(file.with_name("again.json"))
    sp.Plan.load(file.with_name("again.json"))
    plan.export(file.with_name("plan.csv"))


def _use_run(run: sp.Run, file: Path) -> None:
    _ = repr(run), run.outcomes, run.wall_times, run.table(), run.recording()
    run.save(file.with_name("again.json"))
    if sp.Run.load(file.with_name("again.json")) != run:
        raise AssertionError("what is saved is not what is loaded")


def _load_picture(file: Path) -> OccupancyMap:
    described = file.with_name("map.yaml")
    described.write_text(f"image: {file.name}\nresolution: 0.1\norigin: [0, 0, 0]\n")
    return sp.load_map(described)


def _load_map(file: Path) -> OccupancyMap:
    file.with_name("cells.pgm").write_bytes(_write_pgm(file))
    return sp.load_map(file)


def _use_map(ground: OccupancyMap, file: Path) -> None:
    sp.plan(sp.Scenario(**_scenario().to_dict() | {"ground": {"map": ground}}), time_limit=PLAN_TIME)
    sp.save_map(ground, file.with_name("again.yaml"))
    if not np.array_equal(sp.load_map(file.with_name("again.yaml")).occupied, ground.occupied):
        raise AssertionError("what is saved is not what is loaded")


def _load_geojson(file: Path) -> sp.Scenario:
    scene = file.with_name("scene.json")
    scene.write_text(json.dumps(_scenario().to_dict() | {"ground": {"map": file.name}}))
    return sp.Scenario.load(scene)


def _use_scenario(scenario: sp.Scenario, file: Path) -> None:
    scenario.save(file.with_name("again.yaml"))
    if sp.Scenario.load(file.with_name("again.yaml")) != scenario:
        raise AssertionError("what is saved is not what is loaded")
    sp.plan(scenario, time_limit=PLAN_TIME)


def _use_tracks(tracks: Tracks, file: Path) -> None:
    tracks.save(file.with_name("again.csv"))
    Tracks.load(file.with_name("again.csv"))
    ends: dict[str, Any] = {
        "start": {"position": [0.0, -9.0], "heading": 0.0, "speed": 0.0},
        "goal": {"position": [9.0, -9.0]},
    }
    tracks.scenario_at(tracks.stop, vehicle=_scenario().vehicle, **ends)


def _use_samples(samples: sp.SampledTrajectory, _: Path) -> None:
    sp.certify(_scenario(), samples)


KINDS = {
    "plan": FileKind(".json", _write_plan, sp.Plan.load, sp.PlanError, _use_plan, text=True),
    "run": FileKind(".json", _write_run, sp.Run.load, sp.PlanError, _use_run, text=True),
    "recording": FileKind(".jsonl", _write_recording, sp.Run.load, sp.PlanError, _use_run, text=True),
    "map": FileKind(".yaml", lambda _: MAP, _load_map, sp.ScenarioError, _use_map),
    "pgm": FileKind(".pgm", _write_pgm, _load_picture, sp.ScenarioError, _use_map),
    "plain pgm": FileKind(".pgm", _write_plain_pgm, _load_picture, sp.ScenarioError, _use_map),
    "png": FileKind(".png", _write_png, _load_picture, sp.ScenarioError, _use_map),
    "geojson": FileKind(".geojson", _write_geojson, _load_geojson, sp.ScenarioError, _use_scenario, text=True),
    "tracks": FileKind(".csv", _write_tracks, Tracks.load, TracksError, _use_tracks),
    "samples": FileKind(".csv", _write_samples, sp.SampledTrajectory.load, sp.SamplesError, _use_samples),
    "arrays": FileKind(".npz", _write_arrays, sp.SampledTrajectory.load, sp.SamplesError, _use_samples),
    "scenario": FileKind(".json", _write_scenario, sp.Scenario.load, sp.ScenarioError, _use_scenario, text=True),
    "commonroad": FileKind(".xml", lambda _: ROAD.encode(), load_commonroad, sp.ScenarioError),
}


def damage(good: bytes, kind: FileKind, rng: Rng) -> bytes:
    """Give the contents of a file with some damage."""
    if rng.random() < 0.02:
        return SPECIAL[int(rng.integers(len(SPECIAL)))]
    numbered = kind.text or kind.suffix in NUMBERED
    if numbered and rng.random() < 0.25:
        return _scaled(good, rng)
    if kind.suffix == ".xml" and rng.random() < 0.4:
        return _elements_changed(good, rng)
    if numbered and not kind.text and rng.random() < 0.5:
        return _numbers_changed(good, rng)
    if not kind.text or rng.random() < 0.3:
        return cut(good, rng)
    lines = good.decode().splitlines()
    place = int(rng.integers(len(lines)))
    data = damaged(json.loads(lines[place]) if len(lines) > 1 and kind.suffix == ".jsonl" else json.loads(good), rng)
    if rng.random() < 0.2 and isinstance(data, dict) and data:
        key = list(data)[int(rng.integers(len(data)))]
        data[key] = VALUES[int(rng.integers(len(VALUES)))]
    if kind.suffix != ".jsonl":
        return json.dumps(data).encode()
    return ("\n".join([*lines[:place], json.dumps(data), *lines[place + 1 :]]) + "\n").encode()


def _numbers_changed(good: bytes, rng: Rng) -> bytes:
    """Replace up to three numbers of a text."""
    for _ in range(int(rng.integers(1, 4))):
        good = _replaced(good, lambda _: NUMBERS[int(rng.integers(len(NUMBERS)))], rng)
    return good


def _elements_changed(good: bytes, rng: Rng) -> bytes:
    """Take away, double, rename, move or empty up to three elements of an XML file."""
    root = ElementTree.fromstring(good)
    for _ in range(int(rng.integers(1, 4))):
        parents = [each for each in root.iter() if len(each)]
        parent = parents[int(rng.integers(len(parents)))]
        child = parent[int(rng.integers(len(parent)))]
        match int(rng.integers(0, 6)):
            case 0:
                parent.remove(child)
            case 1:
                parent.append(deepcopy(child))
            case 2:
                child.tag = parents[int(rng.integers(len(parents)))].tag
            case 3:
                parents[int(rng.integers(len(parents)))].append(deepcopy(child))
            case 4:
                child.clear()
            case _:
                child.attrib.update(dict.fromkeys(child.attrib, NUMBERS[int(rng.integers(len(NUMBERS)))].decode()))
        if not len(root):
            break
    return ElementTree.tostring(root)


def _scaled(good: bytes, rng: Rng) -> bytes:
    """Multiply one number of a text."""
    factor = FACTORS[int(rng.integers(len(FACTORS)))]
    return _replaced(good, lambda found: repr(type(found)(found * factor)).encode(), rng)


def _replaced(good: bytes, new: Callable[[float], bytes], rng: Rng) -> bytes:
    """Replace one number of a text, if there is any."""
    places = list(_NUMBER.finditer(good))
    if not places:
        return good
    one = places[int(rng.integers(len(places)))]
    found: float = json.loads(one[0]) if re.fullmatch(rb"-?(0|[1-9].*|0\..*)", one[0]) else float(one[0])
    return good[: one.start()] + new(found) + good[one.end() :]


def hunt(name: str, count: int, seed: int = 0) -> Iterator[tuple[int, str, str]]:
    """Yield the seed, the result and, of what is found, the traceback of each damaged file."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{NAME}{kind.suffix}"
        good = kind.good(file)
        file.write_bytes(good)
        kind.use(kind.load(file), file)
        for number in range(seed, seed + count):
            file.write_bytes(damage(good, kind, np.random.default_rng([number, list(KINDS).index(name)])))
            before, began = _peak(), time.process_time()
            result, detail = _result(kind, file)
            taken, grown = time.process_time() - began, _peak() - before
            if taken > MOST_TIME or grown > MOST_MEMORY:
                result, detail = "found", f"{result} with {taken:.1f} s and {grown / 2**10:.0f} MiB more\n{detail}"
            yield number, result, detail


def _result(kind: FileKind, file: Path) -> tuple[str, str]:
    """Give the result of a damaged file and, of what is found, the traceback."""
    try:
        loaded = kind.load(file)
    except (kind.error, OSError) as error:
        text = str(error).encode("utf-8", "backslashreplace").decode()
        return ("refused", "") if str(file.parent) in text else ("found", f"without the name of the file: {text}")
    except Exception:
        return "found", traceback.format_exc()
    try:
        kind.use(loaded, file)
    except ScpPlannerError as error:
        str(error).encode("utf-8", "backslashreplace")
    except Exception:
        return "found", traceback.format_exc()
    return "used", ""


def _peak() -> int:
    """Return the most memory that the process has taken so far, KiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return 1 if anything was found."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hostile.files", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--count", type=int, default=5000, help="files of each kind (default: 5000)")
    parser.add_argument("--seed", type=int, default=0, help="of the first file of each kind (default: 0)")
    parser.add_argument("--only", choices=KINDS, action="append", help="repeatable")
    options = parser.parse_args(argv)
    rows, found = [], 0
    for name in options.only or KINDS:
        results: Counter[str] = Counter()
        for seed, result, detail in hunt(name, options.count, options.seed):
            results[result] += 1
            if detail:
                common.say(f"{name} {seed}: {detail}")
        found += results["found"]
        rows.append([name, sum(results.values()), results["used"], results["refused"], results["found"]])
    print(common.table(["kind", "files", "used", "refused", "found"], rows))
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
