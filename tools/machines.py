"""Run the tests as on other machines: ``python tools/machines.py [--variant NAME]... [-- PYTEST ARGUMENTS]``.

Every variant is a whole run of the tests: with another kernel of OpenBLAS, with fewer instructions for numpy, on a busy
machine, with the oldest and the newest packages that pyproject.toml allows, and with other versions of Python. What
this machine has not got is skipped, and the table says so. The exit code is 1 if a test fails anywhere.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from time import perf_counter
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENTS = ROOT / ".venv-machines"
EXTRAS = ("plot", "docs", "dev")  # as in requirements-lock.txt

KERNEL_VARIABLE = "OPENBLAS_CORETYPE"
FEATURES_VARIABLE = "NPY_DISABLE_CPU_FEATURES"
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

FEATURES_CODE = """
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
print(*(name for name in __cpu_dispatch__ if __cpu_features__[name]))
"""
KERNEL_CODE = "import numpy, scipy.linalg"


class Packages(Enum):
    """Which versions of the packages that the project needs, as `uv --resolution` calls them; LOCKED: those here."""

    LOCKED = "locked"
    OLDEST = "lowest-direct"
    NEWEST = "highest"


@dataclass(frozen=True)
class Kernel:
    """A kernel of OpenBLAS.

    Attributes
    ----------
    name : str
        How one asks OpenBLAS for it.
    reported : str
        What OpenBLAS then calls it.
    needs : str
        What the processor must have for it, as Linux calls it.
    """

    name: str
    reported: str
    needs: str


KERNELS = (
    Kernel("Haswell", "Haswell", "avx2"),
    Kernel("Sandybridge", "Sandybridge", "avx"),
    Kernel("Prescott", "Katmai", "sse2"),
    Kernel("SkylakeX", "SkylakeX", "avx512f"),
)
PYTHONS = ("3.11", "3.12", "3.13", "3.14")


@dataclass(frozen=True)
class Variant:
    """One kind of machine.

    Attributes
    ----------
    name : str
    kernel : Kernel or None
        None: the one that OpenBLAS takes by itself.
    baseline : bool
        Whether numpy does without all instructions that not every processor has.
    load : int
        Busy processes beside the tests, for each core.
    packages : Packages
    python : str or None
        Name of the interpreter; None: the one that runs this.
    """

    name: str
    kernel: Kernel | None = None
    baseline: bool = False
    load: int = 0
    packages: Packages = Packages.LOCKED
    python: str | None = None


VARIANTS = (
    Variant("own"),
    *(Variant(f"kernel-{kernel.name.lower()}", kernel=kernel) for kernel in KERNELS),
    Variant("numpy-baseline", baseline=True),
    Variant("load", load=2),
    Variant("oldest", packages=Packages.OLDEST),
    Variant("newest", packages=Packages.NEWEST),
    *(Variant(f"python{number}", packages=Packages.NEWEST, python=f"python{number}") for number in PYTHONS),
)


class Skipped(Exception):
    """What a variant needs is not to be had on this machine."""


@dataclass(frozen=True)
class Outcome:
    """What became of a variant: counts of tests, and names of those that failed; or why it was skipped or broke."""

    variant: str
    passed: int = 0
    failed: int = 0
    seconds: float = 0.0
    names: tuple[str, ...] = field(default=())
    skipped: str = ""
    broken: str = ""

    @property
    def good(self) -> bool:
        """Whether nothing failed; what is skipped has not failed."""
        return not self.failed and not self.broken

    def __str__(self) -> str:
        """Its row of the table."""
        said = f"skipped: {self.skipped}" if self.skipped else f"broken: {self.broken}" if self.broken else ""
        return (
            f"{self.variant:<20}{said}"
            if said
            else f"{self.variant:<20}{self.passed:>8}{self.failed:>8}{self.seconds:>9.0f}"
        )


def chosen(names: Sequence[str]) -> tuple[Variant, ...]:
    """Give the variants of these names, all of them for none.

    Raises
    ------
    ValueError
        If there is no such variant.
    """
    known = {variant.name: variant for variant in VARIANTS}
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"no variant {', '.join(unknown)}; there are {', '.join(known)}")
    return tuple(known[name] for name in names) if names else VARIANTS


def processor_features(path: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """Give what the processor has, by Linux's names; nothing where Linux does not tell."""
    if not path.is_file():
        return frozenset()
    lines = (line.partition(":") for line in path.read_text(encoding="utf-8").splitlines())
    return frozenset(word for key, _, words in lines if key.strip() == "flags" for word in words.split())


def kernel_settings(kernel: Kernel, features: frozenset[str], given: Mapping[str, str]) -> dict[str, str]:
    """Give the environment that asks for a kernel.

    Raises
    ------
    Skipped
        If the processor cannot run it, or somebody has asked for another one: that may be the only one that works.
    """
    if KERNEL_VARIABLE in given:
        raise Skipped(f"{KERNEL_VARIABLE}={given[KERNEL_VARIABLE]} is set here, and is left as it is")
    if kernel.needs not in features:
        raise Skipped(f"this processor ({platform.machine()}) has no {kernel.needs}")
    return {KERNEL_VARIABLE: kernel.name}


def without_extra_features(python: Path) -> dict[str, str]:
    """Give the environment in which numpy uses no instruction that not every processor has."""
    names = _printed(python, FEATURES_CODE).split()
    if not names:
        raise Skipped("numpy uses none of this processor's extra instructions anyway")
    return {FEATURES_VARIABLE: " ".join(names)}


def check_kernel(python: Path, kernel: Kernel, settings: Mapping[str, str]) -> None:
    """Make sure that numpy's and scipy's OpenBLAS take the kernel; a run with another one would show nothing."""
    done = subprocess.run(
        [str(python), "-c", KERNEL_CODE],
        env={**os.environ, **settings, "OPENBLAS_VERBOSE": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = (done.stdout + done.stderr).splitlines()
    taken = {line.partition(":")[2].strip() for line in lines if line.startswith("Core:")}
    if taken != {kernel.reported}:
        raise Skipped(f"OpenBLAS takes {', '.join(sorted(taken)) or 'no kernel that it names'} instead")


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep processes busy beside what is done meanwhile."""
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def found(name: str) -> Path | None:
    """Give an interpreter that works: from the path, or of pyenv, whose commands on the path need not work."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    first = shutil.which(name)
    candidates = [Path(first)] if first else []
    candidates += sorted(pyenv.glob(f"versions/*/bin/{name}"))
    return next((each for each in candidates if _runs(each)), None)


def environment_of(variant: Variant) -> Path:
    """Make the environment of a variant anew where it needs one of its own; return its Python.

    Raises
    ------
    Skipped
        If there is no such interpreter.
    """
    if variant.packages is Packages.LOCKED:
        return Path(sys.executable)
    interpreter = found(variant.python) if variant.python else Path(sys.executable)
    if interpreter is None:
        raise Skipped(f"no {variant.python} found")
    uv = _uv()
    folder = ENVIRONMENTS / variant.name
    _quietly(interpreter, "-m", "venv", "--clear", folder)
    python = folder / "bin" / "python"
    listed = folder / "requirements.txt"
    extras = [word for extra in EXTRAS for word in ("--extra", extra)]
    resolution = ("--resolution", variant.packages.value)
    _quietly(uv, "pip", "compile", ROOT / "pyproject.toml", *extras, *resolution, "--python", python, "-o", listed)
    _quietly(uv, "pip", "install", "--python", python, "--requirement", listed)
    _quietly(uv, "pip", "install", "--python", python, "--no-deps", "--no-build-isolation", "--editable", ROOT)
    return python


def run(variant: Variant, arguments: Sequence[str]) -> Outcome:
    """Run the tests in a variant.

    Parameters
    ----------
    variant : Variant
    arguments : sequence of str
        For pytest.

    Returns
    -------
    Outcome
    """
    try:
        python = environment_of(variant)
        settings = dict(THREADS)
        if variant.kernel is not None:
            settings |= kernel_settings(variant.kernel, processor_features(), os.environ)
            check_kernel(python, variant.kernel, settings)
        if variant.baseline:
            settings |= without_extra_features(python)
    except Skipped as reason:
        return Outcome(variant.name, skipped=str(reason))
    except subprocess.CalledProcessError as error:
        return Outcome(variant.name, broken=f"{' '.join(map(str, error.cmd))}\n{error.stderr}")
    cores = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder, busy(variant.load * cores):
        report = Path(folder) / "report.xml"
        command = [str(python), "-m", "pytest", "-n", str(cores), f"--junitxml={report}", *arguments]
        print(f"== {variant.name}: {' '.join(f'{name}={value!r}' for name, value in settings.items())}", flush=True)
        began = perf_counter()
        code = subprocess.run(command, cwd=ROOT, env={**os.environ, **settings}).returncode
        return outcome(variant.name, code, report, perf_counter() - began)


def outcome(name: str, code: int, report: Path, seconds: float) -> Outcome:
    """Read what pytest reported.

    Parameters
    ----------
    name : str
        Of the variant.
    code : int
        With which pytest ended.
    report : Path
        In the form of JUnit.
    seconds : float

    Returns
    -------
    Outcome
        Broken if pytest ended otherwise than with tests that passed or failed, or if there was none.
    """
    if code not in (0, 1) or not report.is_file():
        return Outcome(name, seconds=seconds, broken=f"pytest ended with exit code {code}")
    cases = list(ElementTree.parse(report).iter("testcase"))
    failed = [case for case in cases if case.find("failure") is not None or case.find("error") is not None]
    unseen = [case for case in cases if case.find("skipped") is not None and case not in failed]
    names = tuple(f"{case.get('classname')}::{case.get('name')}" for case in failed)
    passed = len(cases) - len(failed) - len(unseen)
    if bool(failed) != bool(code):
        return Outcome(name, passed, len(failed), seconds, names, broken=f"pytest ended with exit code {code}")
    return Outcome(name, passed, len(failed), seconds, names)


def table(outcomes: Sequence[Outcome]) -> str:
    """Lay the outcomes out as a table, and name below it what failed where."""
    lines = [f"{'variant':<20}{'passed':>8}{'failed':>8}{'seconds':>9}", *map(str, outcomes)]
    lines += [f"{each.variant}: {name}" for each in outcomes for name in each.names]
    return "\n".join(lines)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = argparse.ArgumentParser(description="Run the tests as on other machines.", allow_abbrev=False)
    parser.add_argument("--variant", action="append", default=[], metavar="NAME", help="may be given several times")
    parser.add_argument("--list", action="store_true", help="list the variants, and run nothing")
    parser.add_argument("arguments", nargs="*", metavar="-- ARGUMENT", help="passed on to pytest")
    given = parser.parse_args(words)
    try:
        variants = chosen(given.variant)
    except ValueError as error:
        parser.error(str(error))
    if given.list:
        print("\n".join(variant.name for variant in variants))
        return 0
    outcomes = []
    for variant in variants:
        outcomes.append(run(variant, given.arguments))
        print(outcomes[-1], flush=True)
    print(f"\n{table(outcomes)}")
    return 0 if all(each.good for each in outcomes) else 1


def _uv() -> Path:
    """Give uv, which resolves to the oldest versions as pip cannot, in an environment of its own."""
    folder = ENVIRONMENTS / "uv"
    if not (folder / "bin" / "uv").is_file():
        _quietly(sys.executable, "-m", "venv", "--clear", folder)
        _quietly(folder / "bin" / "pip", "install", "--quiet", "uv")
    return folder / "bin" / "uv"


def _printed(python: Path, code: str) -> str:
    return subprocess.run([str(python), "-c", code], check=True, capture_output=True, text=True).stdout


def _runs(python: Path) -> bool:
    return subprocess.run([str(python), "-c", ""], capture_output=True).returncode == 0


def _quietly(*command: str | Path) -> None:
    subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True, cwd=ROOT)


if __name__ == "__main__":
    sys.exit(main())
