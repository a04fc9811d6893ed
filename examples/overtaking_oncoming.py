"""Overtake two slow ones while another comes the other way, all seen by a sensor on the vehicle as it drives.

The sensor looks ahead, not far, and tells with a delay; the vehicle needs a moment to react and does not follow its
plan exactly. All of that is in the margin that the planner keeps.

    python examples/overtaking_oncoming.py [-o overtaking_oncoming.png] [--seed 0] [--animate overtaking.gif]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import animate, plot_run_space_time
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.setup import Follower

SENSOR = Sensor(rate=10.0, noise=0.1, range=40.0, field_of_view=3.0, latency=0.05)
FOLLOWER = Follower(tracking_error=0.05, reaction_time=0.02)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("overtaking_oncoming.png"), help="figure to write")
    parser.add_argument("--animate", type=Path, help="animation to write, .gif or .mp4")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    options = parser.parse_args(argv)

    scenario = builtin.load("overtaking")
    run = sp.simulate(scenario, sensors=[SENSOR], follower=FOLLOWER, seed=options.seed)

    print(f"{'arrived' if run.arrived else 'did not arrive'} after {run.travel_time:.2f} s")
    print(f"  knowing the truth, and following exactly: {sp.plan(scenario).travel_time:.2f} s")
    print(f"  least distance to a true obstacle: {run.least_clearance:.2f} m")
    print("  " + ", ".join(f"{count} {outcome}" for outcome, count in run.outcomes.items() if count))
    plot_run_space_time(run, options.output)
    print(f"wrote {options.output}")
    if options.animate is not None:
        animate(run.recording(), options.animate)
        print(f"wrote {options.animate}")
    return 0 if run.arrived and not run.contact else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
