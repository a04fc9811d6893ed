"""Damage one good file of each kind at random, and report what is raised besides the documented errors.

``python -m benchmarks.hostile.files --count 5000`` damages bytes and, in files of JSON, values, types, lengths, nesting
and keys. A file that is accepted is used: a map is planned on, a plan is certified, a run is reported.
"""

from __future__ import annotations

import argparse
import io
import json
import re
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import scp_planner as sp
from benchmarks import common
from benchmarks.hostile.damage import cut, damaged
from benchmarks.hostile.roads import ROAD
from scp_planner.errors import ScpPlannerError
from scp_planner.formats.commonroad import load_commonroad
from scp_planner.tracking.tracks import Tracks

Rng = np.random.Generator
NAME = "file"
PLAN_TIME = 0.1
"""s that a plan over a damaged map may take."""
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
    """A kind of file: its suffix, a good one, and what reads and uses it."""

    suffix: str
    good: Callable[[Path], bytes]
    use: Callable[[Path], None]
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


def _write_samples(_: Path) -> bytes:
    rows = [f"{0.1 * k:.1f},{0.5 + 0.15 * k:.3f},0.5,0.0,1.5" for k in range(31)]
    return "\n".join(["t,x,y,heading,speed", *rows, ""]).encode()


def _write_arrays(file: Path) -> bytes:
    time = np.linspace(0.0, 3.0, 31)
    np.savez_compressed(file, time=time, x=0.5 + 1.5 * time, y=np.full(31, 0.5))
    return file.read_bytes()


def _use_plan(file: Path) -> None:
    plan = sp.Plan.load(file)
    sp.certify(_scenario(), plan)
    plan.save(file.with_name("again.json"))
    sp.Plan.load(file.with_name("again.json"))
    plan.export(file.with_name("plan.csv"))


def _use_run(file: Path) -> None:
    run = sp.Run.load(file)
    _ = repr(run), run.outcomes, run.wall_times, run.table(), run.recording()
    run.save(file.with_name("again.json"))
    if sp.Run.load(file.with_name("again.json")) != run:
        raise AssertionError("what is saved is not what is loaded")


def _use_map(file: Path) -> None:
    sp.load_map(file)
    data = _scenario().to_dict() | {"ground": {"map": file.name}}
    _use_scenario(file, data)


def _use_scenario(file: Path, data: dict[str, Any]) -> None:
    scene = file.with_name("scene.json")
    scene.write_text(json.dumps(data))
    sp.plan(sp.Scenario.load(scene), time_limit=PLAN_TIME)


def _use_picture(file: Path) -> None:
    described = file.with_name("map.yaml")
    described.write_text(f"image: {file.name}\nresolution: 0.1\norigin: [0, 0, 0]\n")
    _use_map(described)


def _use_map_file(file: Path) -> None:
    file.with_name("cells.pgm").write_bytes(_write_pgm(file))
    _use_map(file)


def _use_geojson(file: Path) -> None:
    _use_scenario(file, _scenario().to_dict() | {"ground": {"map": file.name}})


def _use_tracks(file: Path) -> None:
    tracks = Tracks.load(file)
    tracks.save(file.with_name("again.csv"))
    Tracks.load(file.with_name("again.csv"))
    ends: dict[str, Any] = {
        "start": {"position": [0.0, -9.0], "heading": 0.0, "speed": 0.0},
        "goal": {"position": [9.0, -9.0]},
    }
    tracks.scenario_at(tracks.stop, vehicle=_scenario().vehicle, **ends)


def _use_samples(file: Path) -> None:
    sp.certify(_scenario(), sp.SampledTrajectory.load(file))


def _use_road(file: Path) -> None:
    load_commonroad(file)


def _use_scenario_file(file: Path) -> None:
    sp.Scenario.load(file).save(file.with_name("again.yaml"))


KINDS = {
    "plan": FileKind(".json", _write_plan, _use_plan, text=True),
    "run": FileKind(".json", _write_run, _use_run, text=True),
    "recording": FileKind(".jsonl", _write_recording, _use_run, text=True),
    "map": FileKind(
        ".yaml",
        lambda _: (
            b"image: cells.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\nmode: trinary\n"
            b"occupied_thresh: 0.65\nfree_thresh: 0.25\n"
        ),
        _use_map_file,
    ),
    "pgm": FileKind(".pgm", _write_pgm, _use_picture),
    "plain pgm": FileKind(".pgm", _write_plain_pgm, _use_picture),
    "png": FileKind(".png", _write_png, _use_picture),
    "geojson": FileKind(".geojson", _write_geojson, _use_geojson, text=True),
    "tracks": FileKind(".csv", _write_tracks, _use_tracks),
    "samples": FileKind(".csv", _write_samples, _use_samples),
    "arrays": FileKind(".npz", _write_arrays, _use_samples),
    "scenario": FileKind(".json", lambda _: json.dumps(_scenario().to_dict()).encode(), _use_scenario_file, text=True),
    "commonroad": FileKind(".xml", lambda _: ROAD.encode(), _use_road),
}


def damage(good: bytes, kind: FileKind, rng: Rng) -> bytes:
    """Give the contents of a file with some damage."""
    if rng.random() < 0.02:
        return SPECIAL[int(rng.integers(len(SPECIAL)))]
    if kind.suffix in NUMBERED and rng.random() < 0.6:
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
        places = list(re.finditer(rb"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])", good))
        if not places:
            break
        one = places[int(rng.integers(len(places)))]
        good = good[: one.start()] + NUMBERS[int(rng.integers(len(NUMBERS)))] + good[one.end() :]
    return good


def hunt(name: str, count: int, seed: int = 0) -> Iterator[tuple[int, str, str]]:
    """Yield the seed, the result and, of what is found, the traceback of each damaged file."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{NAME}{kind.suffix}"
        good = kind.good(file)
        file.write_bytes(good)
        kind.use(file)
        for number in range(seed, seed + count):
            file.write_bytes(damage(good, kind, np.random.default_rng([number, list(KINDS).index(name)])))
            try:
                kind.use(file)
                yield number, "used", ""
            except (ScpPlannerError, OSError) as error:
                str(error).encode("utf-8", "backslashreplace")
                yield number, "refused", ""
            except Exception:
                yield number, "found", traceback.format_exc()


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
