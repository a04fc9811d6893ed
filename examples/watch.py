"""Watch a plan: an animation, and a page for the browser with a time slider that can be sent to others.

    python examples/watch.py [NAME] [-o FOLDER]

NAME is a built-in scenario or a scenario file.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner import builtin
from scp_planner.plotting import animate_plan
from scp_planner.plotting.viewer import save_viewer


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenario", nargs="?", default="headon", help=f"{', '.join(builtin.names())}, or a file")
    parser.add_argument("-o", "--output", type=Path, default=Path("."), help="folder to write into")
    options = parser.parse_args(argv)

    name = options.scenario
    scenario = builtin.load(name) if name in builtin.names() else sp.Scenario.load(name)
    plan = sp.plan(scenario)

    options.output.mkdir(exist_ok=True)
    page, film = options.output / f"{scenario.name}.html", options.output / f"{scenario.name}.gif"
    save_viewer(plan, scenario, page)
    animate_plan(plan, scenario, film)
    print(f"{plan.status}: {plan.travel_time:.3f} s")
    print(f"wrote {page} and {film}")
    return 0 if plan.certified else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
