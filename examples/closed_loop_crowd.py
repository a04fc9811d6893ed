"""Drive a robot through a recorded crowd: people are seen as they come, and replanned around ten times a second.

The people walked in front of ETH Zurich in 2009 (S. Pellegrini et al., ICCV 2009) and do not know of the robot. How
people change their minds is fitted to those who had left before the robot sets off.

    python examples/closed_loop_crowd.py [FOLDER] [-o closed_loop_crowd.png] [--moment 288] [--animate crowd.gif]

FOLDER, or the environment variable SCP_PLANNER_DATA, holds pedestrians/eth_obsmat.txt.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner.plotting import animate, plot_run
from scp_planner.simulation.sensors import Sensor
from scp_planner.simulation.worlds import track_courses
from scp_planner.tracking.motion_fitting import fit_motion_model
from scp_planner.tracking.tracks import Tracks

FILE = Path("pedestrians") / "eth_obsmat.txt"
SOURCE = "https://github.com/crowdbotp/OpenTraj (datasets/ETH/seq_eth/obsmat.txt)"
SENSOR = Sensor(rate=10.0, noise=0.05, range=12.0)
ROBOT = sp.Vehicle(
    radius=0.3,
    max_speed=1.5,
    max_acceleration=1.0,
    max_deceleration=1.5,
    max_lateral_acceleration=1.5,
    max_curvature=2.0,
)


def data_file(folder: Path | None) -> Path | None:
    """The recorded tracks; None, and one line on stderr, if they are not there."""
    root = folder or (Path(os.environ["SCP_PLANNER_DATA"]) if os.environ.get("SCP_PLANNER_DATA") else None)
    if root is not None and (root / FILE).is_file():
        return root / FILE
    where = f"there is no {root / FILE}" if root else "name a folder, or set SCP_PLANNER_DATA"
    print(f"{where}; save it as {FILE.as_posix()} in a folder of yours from {SOURCE}", file=sys.stderr)
    return None


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", help="of recorded data; default: SCP_PLANNER_DATA")
    parser.add_argument("-o", "--output", type=Path, default=Path("closed_loop_crowd.png"), help="figure to write")
    parser.add_argument("--animate", type=Path, help="animation to write, .gif or .mp4")
    parser.add_argument("--moment", type=float, default=288.0, help="when the robot sets off, s in the recording")
    options = parser.parse_args(argv)
    file = data_file(options.folder)
    if file is None:
        return 2

    tracks = Tracks.load(file)
    left = Tracks([track for track in tracks if track.times[-1] < options.moment])
    near = Tracks([t for t in tracks if t.times[-1] > options.moment - 5.0 and t.times[0] < options.moment + 60.0])
    scenario = sp.Scenario(
        name=f"ETH from {options.moment:g} s on",
        vehicle=ROBOT,
        start=sp.Start(time=options.moment, position=(3.0, 0.0), heading=math.pi / 2, speed=0.0),
        goal=sp.Goal(position=(3.0, 10.5), radius=0.3),
        confidence=sp.Confidence(probability=0.95, level="per_time"),
    )
    run = sp.simulate(
        scenario,
        world=track_courses(near),
        sensors=[SENSOR],
        model=sp.Model(order=1, process=fit_motion_model(left)),
    )

    print(f"{'arrived' if run.arrived else 'did not arrive'} after {run.travel_time:.2f} s among {len(near)} people")
    print(f"  least distance to anybody while moving: {run.least_clearance:.2f} m")
    print("  " + ", ".join(f"{count} {outcome}" for outcome, count in run.outcomes.items() if count))
    plot_run(run, options.output)
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
