"""What every benchmark needs: one thread, the environment, medians, CSV files that are never half written.

Import this module before numpy: libraries read their thread counts from the environment when they are loaded.
"""

from __future__ import annotations

import os

ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "NUMEXPR_NUM_THREADS": "1",
    # JAX, for the peers that use it: no thread pool for one operation, and the processor only.
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
}
os.environ.update(ONE_THREAD)

import argparse  # noqa: E402
import csv  # noqa: E402
import json  # noqa: E402
import platform  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
from collections.abc import Callable, Iterable, Mapping, Sequence  # noqa: E402
from importlib import metadata  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

REFERENCE_FAMILIES = ("crossing3", "crossing5", "crossing10", "crossing20", "headon", "crowd60")
DEFAULT_OUTPUT = Path("benchmark-results")
DATA_VARIABLE = "SCP_PLANNER_DATA"


class MissingDataError(RuntimeError):
    """The folder of reference scenarios is not there; the message says how to name it."""


def scenario_folder(given: str | os.PathLike[str] | None = None) -> Path:
    """Folder of the reference scenarios: the given one, else ``scenarios`` beside ``$SCP_PLANNER_DATA``.

    Raises
    ------
    MissingDataError
        If neither names an existing folder.
    """
    if given is not None:
        folder = Path(given)
    elif os.environ.get(DATA_VARIABLE):
        folder = Path(os.environ[DATA_VARIABLE]).parent / "scenarios"
    else:
        raise MissingDataError(f"no reference scenarios: set {DATA_VARIABLE} or give --data FOLDER")
    if not folder.is_dir():
        raise MissingDataError(f"no reference scenarios: {folder} is not a folder")
    return folder


def load_family(folder: Path, family: str, count: int | None = None) -> list[dict[str, Any]]:
    """The first ``count`` scenarios (None: all) of ``family-0.json``, ``family-1.json``, ... as dicts.

    Each dict's ``name`` becomes the file's stem, which is the key of ``best_known.json``.
    """
    paths = sorted(folder.glob(f"{family}-*.json"), key=lambda path: int(path.stem.rsplit("-", 1)[1]))
    if not paths:
        raise MissingDataError(f"no scenario {family}-*.json in {folder}")
    scenarios = []
    for path in paths[:count]:
        scenario = json.loads(path.read_text(encoding="utf-8"))
        scenario["name"] = path.stem
        scenarios.append(scenario)
    return scenarios


def load_scenario(folder: Path, name: str) -> dict[str, Any]:
    """One scenario of a folder as a dict, under the name of its file."""
    path = folder / f"{name}.json"
    if not path.is_file():
        raise MissingDataError(f"no scenario {path.name} in {folder}")
    scenario: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    scenario["name"] = name
    return scenario


def best_known(folder: Path) -> dict[str, float]:
    """Shortest travel time known of each reference scenario, s (upper bounds); empty without the file."""
    path = folder / "best_known.json"
    if not path.is_file():
        return {}
    times: Mapping[str, float | None] = json.loads(path.read_text(encoding="utf-8"))
    return {name: time for name, time in times.items() if time is not None}


def family_of(name: str) -> str:
    """Family of a scenario's name: ``crossing5-3`` belongs to ``crossing5``."""
    return name.rsplit("-", 1)[0]


def environment(packages: Iterable[str] = ("numpy", "scipy", "daqp")) -> dict[str, str]:
    """Machine and versions that a timing depends on."""
    import scp_planner

    facts = {
        "scp_planner": scp_planner.__version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor_name(),
        "threads": "1",
    }
    for package in packages:
        try:
            facts[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            facts[package] = "missing"
    return facts


def _processor_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"


def write_environment(path: Path, facts: Mapping[str, str]) -> None:
    """Write what :func:`environment` found beside the results that depend on it."""
    write_csv(path, [{"what": what, "value": value} for what, value in facts.items()])


def median(values: Iterable[float]) -> float:
    """Median of the finite values; NaN without any."""
    return quantile(values, 0.5)


def quantile(values: Iterable[float], level: float) -> float:
    """Quantile of the finite values; NaN without any."""
    array = np.asarray(list(values), dtype=float)
    array = array[np.isfinite(array)]
    return float(np.quantile(array, level)) if array.size else float("nan")


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]], columns: Sequence[str] | None = None) -> None:
    """Write rows as CSV, atomically: readers see the old file or the whole new one."""
    if columns is None:
        columns = list(dict.fromkeys(key for row in rows for key in row))
    path.parent.mkdir(parents=True, exist_ok=True)
    with _replacing(path) as stream:
        writer = csv.DictWriter(stream, fieldnames=columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def write_text(path: Path, text: str) -> None:
    """Write text, atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _replacing(path) as stream:
        stream.write(text)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file as dicts of strings."""
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


class _replacing:
    """Text stream to a temporary file beside ``path``, renamed onto it only when the block ends well."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Any:
        self._stream = tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", newline="", dir=self._path.parent, prefix=self._path.name, delete=False
        )
        return self._stream

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._stream.close()
        if kind is None:
            os.chmod(self._stream.name, 0o644)
            os.replace(self._stream.name, self._path)
        else:
            os.unlink(self._stream.name)


def table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Markdown table, padded so that it also reads well in a terminal; numbers are aligned right."""
    cells = [[_cell(value) for value in row] for row in rows]
    widths = [max([len(heading)] + [len(row[i]) for row in cells]) for i, heading in enumerate(headings)]
    lines = [" | ".join(heading.ljust(width) for heading, width in zip(headings, widths, strict=True))]
    lines.append(" | ".join("-" * width for width in widths))
    for row in cells:
        aligned = [
            value.rjust(width) if value[:1].isdigit() or value[:1] == "-" else value.ljust(width)
            for value, width in zip(row, widths, strict=True)
        ]
        lines.append(" | ".join(aligned))
    return "\n".join(f"| {line} |" for line in lines)


def number(value: float, digits: int) -> str:
    """Fixed-point text; a dash where there is no number."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def _cell(value: object) -> str:
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def names_among(known: Sequence[str]) -> Callable[[str], list[str]]:
    """Type of an argument that lists some of the known names, separated by commas, or is ``all``."""

    def read(text: str) -> list[str]:
        names = list(known) if text == "all" else text.split(",")
        unknown = [name for name in names if name not in known]
        if unknown:
            raise argparse.ArgumentTypeError(f"{', '.join(unknown)}: not one of {', '.join(known)}")
        return names

    return read


def run_command(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> int:
    """Run the command that a line names, which its ``run`` says; return the exit code, 2 where data are missing."""
    options = parser.parse_args(argv)
    try:
        return int(options.run(options))
    except MissingDataError as error:
        say(str(error))
        return 2


def say(text: str = "") -> None:
    """Progress goes to stderr, so that stdout holds results only."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
