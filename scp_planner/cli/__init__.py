"""The command line: parse, call, print. Results go to files and stdout, messages and progress to stderr.

Exit codes: 0 done and certified; 2 bad input, and nothing has been written; 3 no certified plan exists or was
found, and the best attempt has been written with its status and the reason; 4 the workers of a batch have gone, and
the rows that were done are kept; 130 interrupted.

May import everything. Begin with `application`, then the commands: `trips`, `made`, `many`,
`studies`, `listings`.
"""

from __future__ import annotations

from scp_planner.cli import listings, made, many, replays, studies, trips
from scp_planner.cli.application import ExitCode, add_command, app, main, study_app

__all__ = ["ExitCode", "app", "main"]

add_command(app, "demo", trips.demo, "scp-planner demo", "scp-planner demo crossing -o crossing-demo")
add_command(
    app,
    "plan",
    trips.plan,
    "scp-planner plan crossing.yaml -o plan.json --plot plan.html",
    "scp-planner plan builtin:headon --plot why.png --view space-time",
    "scp-planner plan builtin:crossing --json --set path_span=1 --set max_runs=12",
)
add_command(
    app,
    "check",
    made.check,
    "scp-planner check crossing.yaml plan.json",
    "scp-planner check crossing.yaml plan.json mine.csv theirs.csv --slack 0.02",
)
add_command(
    app,
    "simulate",
    trips.simulate,
    "scp-planner simulate crossing.yaml --noise 0.05 --rate 20 -o run.json --animate run.html",
)
add_command(
    app,
    "compare",
    many.compare,
    "scp-planner compare crossing.yaml builtin:headon --starts 1",
    "scp-planner compare crossing.yaml --starts 1 --method scp --method gradient-descent -o trials.csv",
)
add_command(
    app,
    "batch",
    many.batch,
    "scp-planner batch scenarios -o results.csv --plans plans",
    "scp-planner batch scenarios --workers 4 --timings -o timed.csv",
    "scp-planner batch scenarios --dask tcp://10.0.0.1:8786 -o results.csv",
)
app.add_typer(study_app)
add_command(study_app, "consistency", studies.consistency, "scp-planner study consistency --quick -o consistency")
add_command(study_app, "coverage", studies.coverage, "scp-planner study coverage --runs 2000 -o coverage")
add_command(app, "fit-motion", studies.fit_motion, "scp-planner fit-motion tracks.csv -o people.yaml")
add_command(app, "fit-tracking", studies.fit_tracking, "scp-planner fit-tracking drives.csv --probability 0.95")
add_command(
    app,
    "export",
    made.export,
    "scp-planner export plan.json -o plan.csv",
    "scp-planner export plan.json -o plan.mcap --frame odom",
)
add_command(
    app,
    "replay",
    replays.replay,
    "scp-planner replay drive.mcap --goal 12,0",
    "scp-planner replay drive --goal 12,0 --scenario robot.yaml --deadline 0.05 -o run.json --plot run.html",
)
add_command(app, "schema", listings.schema, "scp-planner schema > scenario.schema.json")
add_command(app, "settings", listings.settings, "scp-planner settings", "scp-planner settings path_span")
