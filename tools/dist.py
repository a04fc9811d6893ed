"""Build what is published, and try it as those do who get it: ``make dist``.

Wheel and source distribution are installed into empty environments, each plans and certifies, and the tests of the
source distribution are run from where it was unpacked, nothing of this repository being near.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tarfile
import tempfile
import venv
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TRIP = (("plan", "builtin:crossing", "-o", "plan.json", "--quiet"), ("check", "builtin:crossing", "plan.json"))


def build(folder: Path) -> tuple[Path, Path]:
    """Build the wheel and the source distribution.

    Parameters
    ----------
    folder : Path
        To write them into.

    Returns
    -------
    (wheel, source distribution)
    """
    for old in [*folder.glob("*.whl"), *folder.glob("*.tar.gz")]:
        old.unlink()
    _run([sys.executable, "-m", "hatchling", "build", "--directory", str(folder)], ROOT)
    (wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, source


def try_out(distribution: Path, folder: Path) -> None:
    """Install a distribution into an empty environment in a folder, plan, and certify.

    Parameters
    ----------
    distribution, folder : Path
    """
    python = _environment(folder / "environment")
    _run([str(python), "-m", "pip", "install", "--quiet", str(distribution)], folder)
    _run([str(python), "-m", "pip", "check"], folder)
    for words in TRIP:
        _run([str(python.with_name("scp-planner")), *words], folder)
    packages = sum(file.stat().st_size for file in (folder / "environment").rglob("*") if file.is_file())
    print(f"{distribution.name}: installed, plans and certifies; its environment takes {packages / 1e6:.0f} MB")


def test(source: Path, folder: Path, arguments: Sequence[str]) -> None:
    """Run the tests of a source distribution from where it is unpacked, with what the lock pins.

    Parameters
    ----------
    source, folder : Path
    arguments : sequence of str
        For pytest.
    """
    with tarfile.open(source) as archive:
        archive.extractall(folder, filter="data")
    unpacked = folder / source.name.removesuffix(".tar.gz")
    python = _environment(folder / "environment")
    pip = [str(python), "-m", "pip", "install", "--quiet"]
    _run([*pip, "--require-hashes", "--requirement", "requirements-lock.txt"], unpacked)
    _run([*pip, "--no-deps", "--no-build-isolation", "--editable", "."], unpacked)
    _run([str(python), "-m", "pytest", *arguments], unpacked)


def _environment(folder: Path) -> Path:
    """Make an environment without any packages; return its Python."""
    venv.create(folder, with_pip=True)
    return folder / ("Scripts" if os.name == "nt" else "bin") / "python"


def _run(command: Sequence[str], folder: Path) -> None:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run(command, cwd=folder, env=clean, check=True)


def main() -> None:
    """Build, try and test."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where to write the distributions")
    parser.add_argument("pytest", nargs="*", default=["-n", "2"], help="arguments of pytest, after --")
    given = parser.parse_args()
    given.folder.mkdir(exist_ok=True)
    wheel, source = build(given.folder.resolve())
    for distribution in (wheel, source):
        with tempfile.TemporaryDirectory() as folder:
            try_out(distribution, Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        test(source, Path(folder), given.pytest)


if __name__ == "__main__":
    main()
