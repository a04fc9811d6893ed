"""Five discs cross the way: plan the fastest trip between them and draw it.

python examples/crossing.py [-o crossing.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import plot_plan


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("crossing.png"), help="figure to write")
    output = parser.parse_args(argv).output

    scenario = builtin.load("crossing")  # or sp.Scenario.load("my_scene.yaml")
    plan = sp.plan(scenario)

    print(f"{plan.status}: {plan.travel_time:.3f} s; no trip could take less than {plan.lower_bound:.3f} s")
    print(f"nearest to {plan.clearance.obstacle}: {1e3 * plan.clearance.minimum:.2f} mm at {plan.clearance.time:.2f} s")
    plot_plan(plan, scenario, output)
    print(f"wrote {output}")
    return 0 if plan.certified else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
