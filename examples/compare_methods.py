"""Sequential convex programming beside penalty descent, from the same starts: table, CSV and convergence curves.

python examples/compare_methods.py [SCENARIO ...] [--all] [-o comparison.png]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import scp_planner as sp
from scp_planner import builtin
from scp_planner.baseline.comparison import compare, save_trials, summary_table
from scp_planner.baseline.methods import Method
from scp_planner.studies.figures import plot_comparison


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenarios", metavar="SCENARIO", nargs="*", help="scenario files; default: the built-in ones")
    parser.add_argument("--all", action="store_true", help="also plain gradient descent and a Monte Carlo search")
    parser.add_argument("-o", "--output", type=Path, default=Path("comparison.png"), help="figure; the CSV lies beside")
    options = parser.parse_args(argv)

    scenarios = [sp.Scenario.load(file) for file in options.scenarios]
    scenarios = scenarios or [builtin.load(name) for name in builtin.names()]
    methods = tuple(Method) if options.all else (Method.SCP, Method.LBFGS)
    trials = compare(scenarios, starts_each=1, methods=methods)

    print(summary_table(trials))
    for trial in trials:
        if not trial.certified:
            print(f"{trial.scenario}, {trial.method}: not certified: {trial.violations}")
    save_trials(trials, options.output.with_suffix(".csv"))
    plot_comparison(trials, options.output)
    print(f"wrote {options.output} and {options.output.with_suffix('.csv')}")
    return 0 if any(trial.certified for trial in trials) else 3


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except ImportError as missing:
        raise SystemExit(f"{missing}: pip install 'scp-planner[plot]'") from None
