"""Among people, by the protocols that others publish.

    python -m benchmarks.crowds circle      across a circle of 4 m radius among 5 people (CrowdNav)
    python -m benchmarks.crowds square      across a square of 10 m among 10 people
    python -m benchmarks.crowds crowdnav    20 restless people in an arena of 12 m, seen 5 m far (CrowdNav++)
    python -m benchmarks.crowds recorded    through ETH, HOTEL and the university in the manner of ECP-MPC

People give way to each other by ORCA, and to the robot if they see it. Each writes a CSV file, a row an episode, as it
goes on; called again it goes on from there. ``--fresh`` begins anew, ``--json`` writes the summary.
"""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.crowds import protocols, recorded
from benchmarks.crowds.policies import POLICIES
from benchmarks.crowds.profiles import PROFILES
from benchmarks.online import Ledger
from benchmarks.online_crowds import recordings

KEYS = ("protocol", "people", "robot", "policy", "profile", "seed")


def crossing(options: argparse.Namespace) -> int:
    """Episodes of one protocol."""
    ledger = Ledger(options.output / "crowds.csv", KEYS, options.fresh)
    people = options.people or protocols.PEOPLE[options.command]
    profile = options.profile if options.policy == "scp" else ""
    wanted = [
        dict(zip(KEYS, (options.command, people, options.robot, options.policy, profile, seed), strict=True))
        for seed in range(options.seed, options.seed + options.count)
    ]
    rows = ledger.fill_in_processes(wanted, protocols.run, options.workers)
    name = (options.command, str(people), options.robot, " ".join((options.policy, profile)).strip())
    sys.stdout.write(protocols.table({name: rows}) + "\n")
    published = protocols.PUBLISHED.get((options.command, options.robot))
    if published:
        sys.stdout.write(f"{published}\n")
    if options.json:
        facts = {**dict(zip(KEYS[:5], wanted[0].values(), strict=False)), **protocols.summary(rows)}
        common.write_text(options.json, json.dumps(facts, indent=1) + "\n")
    common.write_environment(options.output / "crowds-environment.csv", common.environment())
    return 0


def through_recordings(options: argparse.Namespace) -> int:
    """Scenes of recorded people."""
    keys = ("place", "number", "profile", "beginning", "times")
    ledger = Ledger(options.output / "crowds-recorded.csv", keys, options.fresh)
    times, tracks = recorded.Times(options.times), recordings(options.tracks, options.places)
    there = {place: recorded.scenes(some, place, times) for place, some in tracks.items()}
    wanted = [
        dict(zip(keys, (place, number, options.profile, options.beginning, options.times), strict=True))
        for number in range(options.seed, options.seed + options.count)
        for place in options.places
        if number < there[place]
    ]
    for place, most in there.items():
        if options.seed + options.count > most:
            common.say(f"{place}: {most} scenes were recorded")
    if not wanted:
        raise common.MissingDataError(f"no scenes from {options.seed} on")
    rows = ledger.fill_in_processes(wanted, partial(recorded.run, folder=options.tracks), options.workers)
    sys.stdout.write(f"{recorded.table(rows)}\n{recorded.PUBLISHED[times]}\n")
    if options.json:
        asked = {"protocol": "recorded", **{key: wanted[0][key] for key in keys[2:]}}
        facts = {**asked, **recorded.summary(rows)}
        common.write_text(options.json, json.dumps(facts, indent=1) + "\n")
    common.write_environment(options.output / "crowds-environment.csv", common.environment())
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.crowds",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name in protocols.MAKERS:
        sub = commands.add_parser(name)
        sub.set_defaults(run=crossing)
        sub.add_argument("--people", type=int, help=f"default: {protocols.PEOPLE[name]}")
        sub.add_argument("--robot", choices=("seen", "unseen"), default="unseen", help="by the people")
        sub.add_argument("--policy", choices=("scp", *POLICIES), default="scp", help="that the robot has")
    sub = commands.add_parser("recorded")
    sub.set_defaults(run=through_recordings)
    sub.add_argument("--tracks", help="folder of recorded motions; default: SCP_PLANNER_DATA")
    places = tuple(recorded.PLACES)
    beginnings = tuple(str(each) for each in recorded.Beginning)
    sub.add_argument("--beginning", choices=beginnings, default=beginnings[0], help="whether people walk in first")
    whose = tuple(str(each) for each in recorded.Times)
    sub.add_argument("--times", choices=whose, default=whose[0], help="at which their scenes begin")
    sub.add_argument("--places", nargs="+", choices=places, default=places, help="default: all")
    for name, sub in commands.choices.items():
        count, what = (3, "scenes of each place") if name == "recorded" else (500, "episodes")
        sub.add_argument("--profile", choices=tuple(PROFILES), default="crowd", help="settings of the planner")
        sub.add_argument("--count", type=int, default=count, help=f"{what}; default: {count}")
        sub.add_argument("--seed", type=int, default=0, help="of the first")
        sub.add_argument("--workers", type=int, default=1, help="processes; default: 1")
        sub.add_argument("--output", type=Path, default=common.DEFAULT_OUTPUT, help="folder of the CSV files")
        sub.add_argument("--json", type=Path, help="file for the summary")
        sub.add_argument("--fresh", action="store_true", help="forget what an earlier call wrote")
    return common.run_command(parser, argv)


if __name__ == "__main__":
    raise SystemExit(main())
