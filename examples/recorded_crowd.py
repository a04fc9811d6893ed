"""Send a robot through a recorded crowd: plan from what was seen up to a moment, draw what people then really did.

The people walked in front of ETH Zurich in 2009 (S. Pellegrini et al., ICCV 2009). How people change their minds is
fitted to those who had left before the moment; each of the others is kept clear of with the given probability at
each time. Nothing that happens after the moment is known to the planner.

    python examples/recorded_crowd.py [FOLDER] [-o recorded_crowd.png] [--moment 288]

FOLDER, or the environment variable SCP_PLANNER_DATA, holds pedestrians/eth_obsmat.txt.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import scp_planner as sp
from scp_planner.plotting import plot_plan
from scp_planner.tracking.motion_fitting import fit_motion_model
from scp_planner.tracking.tracks import Track, Tracks

FILE = Path("pedestrians") / "eth_obsmat.txt"
SOURCE = "https://github.com/crowdbotp/OpenTraj (datasets/ETH/seq_eth/obsmat.txt)"
PERSON_RADIUS = 0.3  # m
ROBOT = sp.Vehicle(
    radius=0.3,
    max_speed=2.0,
    max_acceleration=1.0,
    max_deceleration=1.5,
    max_lateral_acceleration=1.5,
    max_curvature=2.0,
)
START, GOAL = (3.0, 0.0), (3.0, 10.5)  # across the way that people take


def data_file(folder: Path | None) -> Path | None:
    """The recorded tracks; None, and one line on stderr, if they are not there."""
    root = folder or (Path(os.environ["SCP_PLANNER_DATA"]) if os.environ.get("SCP_PLANNER_DATA") else None)
    if root is not None and (root / FILE).is_file():
        return root / FILE
    where = f"there is no {root / FILE}" if root else "name a folder, or set SCP_PLANNER_DATA"
    print(f"{where}; save it as {FILE.as_posix()} in a folder of yours from {SOURCE}", file=sys.stderr)
    return None


def gap(plan: sp.Plan, person: Track) -> float:
    """How near the robot really came to a person, m; inf if they never met in time."""
    times = np.linspace(plan.start_time, plan.arrival_time, 1000)
    times = times[(times >= person.times[0]) & (times <= person.times[-1])]
    if not len(times):
        return math.inf
    really = np.stack([np.interp(times, person.times, person.positions[:, axis]) for axis in (0, 1)], axis=-1)
    distance = float(np.linalg.norm(plan.position(times) - really, axis=1).min())
    return distance - ROBOT.radius - PERSON_RADIUS


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", help="of recorded data; default: SCP_PLANNER_DATA")
    parser.add_argument("-o", "--output", type=Path, default=Path("recorded_crowd.png"), help="figure to write")
    parser.add_argument("--moment", type=float, default=288.0, help="when the robot sets off, s in the recording")
    parser.add_argument("--probability", type=float, default=0.95, help="that a person is in its zone")
    options = parser.parse_args(argv)
    file = data_file(options.folder)
    if file is None:
        return 2

    tracks = Tracks.load(file)
    left = Tracks([track for track in tracks if track.times[-1] < options.moment])
    scenario = tracks.scenario_at(
        options.moment,
        start={"position": START, "heading": math.pi / 2, "speed": 1.0},
        goal={"position": GOAL, "radius": 0.3},
        vehicle=ROBOT,
        radius=PERSON_RADIUS,
        noise=None,
        process=fit_motion_model(left),
        confidence={"probability": options.probability, "level": "per_time"},
        name=f"ETH at {options.moment:g} s",
    )
    plan = sp.plan(scenario)

    people = [tracks.of(obstacle.id) for obstacle in scenario.obstacles]
    print(f"{len(people)} people in sight; {plan.status}: {plan.travel_time:.2f} s")
    nearest = min(people, key=lambda person: gap(plan, person), default=None)
    if nearest is not None:
        print(f"nearest in truth: person {nearest.id}, at {gap(plan, nearest):.2f} m")
    truth = {person.id: (person.times, person.positions) for person in people}
    plot_plan(plan, scenario, options.output, truth=truth)
    print(f"wrote {options.output}")
    return 0 if plan.certified else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
