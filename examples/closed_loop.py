"""Close the loop: a noisy sensor sees five discs ten times a second, and the vehicle replans and drives as it sees.

python examples/closed_loop.py [-o closed_loop.png] [--noise 0.05] [--seed 0]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner import builtin


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("closed_loop.png"), help="figure to write")
    parser.add_argument("--noise", type=float, default=0.05, help="standard deviation of a coordinate, m")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    options = parser.parse_args(argv)

    scenario = builtin.load("crossing")
    run = sp.simulate(scenario, noise=options.noise, rate=10.0, seed=options.seed)

    known = sp.plan(scenario).travel_time
    print(f"arrived: {run.arrived}, after {run.travel_time:.2f} s; if all motions were known {known:.2f} s")
    print(f"nearest to an obstacle: {run.least_clearance:.2f} m; {len(run.records)} replans: {dict(run.outcomes)}")
    run.plot(options.output)
    print(f"wrote {options.output}")
    return 0 if run.arrived and not run.contact else 3


if __name__ == "__main__":
    raise SystemExit(main())
