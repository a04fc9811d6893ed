"""What plans and runs are drawn and handed on by: all of it is there, and nothing of it is loaded before."""

from __future__ import annotations

import subprocess
import sys

import pytest

import scp_planner as sp
from scp_planner.planning.outputs import OUTPUTS, output_named


@pytest.mark.parametrize("name", OUTPUTS)
def test_every_output_is_a_function_that_its_owner_has_a_method_for(name: str) -> None:
    owner, method = name.split(" ")
    assert callable(getattr({"plan": sp.Plan, "run": sp.Run}[owner], method))
    module, function = OUTPUTS[name].split(":")
    found = output_named(name)
    assert (found.__module__, found.__name__) == (module, function)


def test_plans_and_runs_load_nothing_that_draws_or_exports() -> None:
    code = "import sys, scp_planner as sp; sp.Plan, sp.Run; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.split()
    assert "scp_planner.simulation.run" in loaded
    assert [
        name for name in loaded if name.startswith(("scp_planner.plotting", "scp_planner.export", "matplotlib"))
    ] == []
