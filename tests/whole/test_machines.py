"""The runs of the tests as on other machines: which there are, what they set, and what their table says."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def machines() -> ModuleType:
    spec = importlib.util.spec_from_file_location("machines", ROOT / "tools" / "machines.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_all_kinds_of_machines_are_among_the_variants(machines: ModuleType) -> None:
    names = [variant.name for variant in machines.chosen([])]
    assert names == [
        *("own", "kernel-haswell", "kernel-sandybridge", "kernel-prescott", "kernel-skylakex"),
        *("numpy-baseline", "load", "oldest", "newest", "python3.11", "python3.12", "python3.13", "python3.14"),
    ]
    (load,) = machines.chosen(["load"])
    assert load.load == 2
    assert [variant.name for variant in machines.chosen(["newest", "own"])] == ["newest", "own"]


@pytest.mark.parametrize(("features", "can"), [({"sse2", "avx"}, True), ({"sse2"}, False), (set(), False)])
def test_a_kernel_is_asked_for_where_the_processor_can_run_it(
    machines: ModuleType, features: set[str], can: bool
) -> None:
    (kernel,) = (each for each in machines.KERNELS if each.name == "Sandybridge")
    if can:
        assert machines.kernel_settings(kernel, frozenset(features), {}) == {"OPENBLAS_CORETYPE": "Sandybridge"}
    else:
        with pytest.raises(machines.Skipped, match="has no avx"):
            machines.kernel_settings(kernel, frozenset(features), {})


def test_numpy_does_without_the_features_that_it_has(machines: ModuleType) -> None:
    """Names that this numpy has for what this processor has: of others it would warn."""
    try:
        settings = machines.without_extra_features(Path(sys.executable))
    except machines.Skipped as reason:
        pytest.skip(str(reason))
    code = "from numpy._core._multiarray_umath import __cpu_features__ as f; print(*(n for n in {!r}.split() if f[n]))"
    words = settings["NPY_DISABLE_CPU_FEATURES"]
    command = [sys.executable, "-W", "error", "-c", code.format(words)]
    with_all = subprocess.run(command, capture_output=True, text=True, check=True)
    without = subprocess.run(command, capture_output=True, text=True, check=True, env=settings)
    assert with_all.stdout.split() == words.split()
    assert without.stdout.split() == []
