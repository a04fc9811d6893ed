"""Keep a constraint of one's own: through a gate half way, slowly, and otherwise as fast as may be.

Any convex constraint that CVXPY takes goes into every subproblem, and the plan is certified only if it keeps it.

    python examples/own_constraint.py [-o own_constraint.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import cvxpy as cp
import numpy as np

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import plot_plan

GATE, WIDTH = np.array([10.0, -1.2]), 0.4  # m
SLOW = 2.0  # m/s
MIDDLE = np.linspace(0.4, 0.6, 41)  # of the travel time


def through_the_gate(trip: sp.TripVariables) -> list[cp.Constraint]:
    halfway = trip.position(trip.length / 2)[0]
    slow = trip.speed_times_travel_time(MIDDLE) <= SLOW * trip.travel_time
    return [cp.norm(halfway - GATE) <= WIDTH / 2, slow]


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("own_constraint.png"), help="figure to write")
    output = parser.parse_args(argv).output

    scenario = builtin.load("crossing")
    plan = sp.plan(scenario, constraints=through_the_gate)

    print(f"{plan.status}: {plan.travel_time:.3f} s, and without the gate {sp.plan(scenario).travel_time:.3f} s")
    times = np.linspace(plan.start_time, plan.arrival_time, 1001)
    print(f"{100 * np.linalg.norm(plan.position(times) - GATE, axis=1).min():.0f} cm from the gate's middle")
    plot_plan(plan, scenario, output)
    print(f"wrote {output}")
    return 0 if plan.certified else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
