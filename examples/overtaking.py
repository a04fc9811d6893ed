"""Overtake two slow ones while a third comes the other way; draw distance and offset over time.

The figure shows why the trip is as it is: the vehicle's line passes between the regions that others take.

    python examples/overtaking.py [-o overtaking.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import plot_space_time


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("overtaking.png"), help="figure to write")
    output = parser.parse_args(argv).output

    scenario = builtin.load("overtaking")
    plan = sp.plan(scenario)

    print(f"{plan.status}: {plan.travel_time:.3f} s; no trip could take less than {plan.lower_bound:.3f} s")
    for name, use in plan.limits.items():
        print(f"  {name.replace('_', ' ')}: at most {use.worst:.3f} of {use.limit:.3f}, at {use.time:.2f} s")
    plot_space_time(plan, scenario, output)
    print(f"wrote {output}")
    return 0 if plan.certified else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
