"""Runs of the protocols, a row each, and what is said of many."""

from __future__ import annotations

# The first import sets one thread, before numpy is loaded.
from benchmarks import common  # isort: skip

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.crowds.policies import PLAN_OUTCOMES, POLICIES, Outcome, planned, stepped
from scp_planner.simulation.crowds import Episode, circle_crossing, restless_arena, square_crossing

Row = dict[str, Any]

MAKERS: dict[str, Callable[[int, int, bool], Episode]] = {
    "circle": circle_crossing,
    "square": square_crossing,
    "crowdnav": restless_arena,
}
PEOPLE = {"circle": 5, "square": 10, "crowdnav": 20}
"""Unless another number is given."""
PUBLISHED = {
    ("circle", "unseen"): "published: up to 1.00 at 10.46 s, .99 at 10.55 s; ORCA .43 at 10.86 s",
    ("circle", "seen"): "published for ORCA: 1.00 at 10.02 s",
    ("crowdnav", "unseen"): "published: .92 at 15.42 s; ORCA .69",
}


def run(row: Row) -> Row:
    """One episode; the row says which."""
    from benchmarks.crowds.profiles import profile

    protocol, seed = str(row["protocol"]), int(row["seed"])
    episode = MAKERS[protocol](seed, int(row["people"]), row["robot"] == "seen")
    if row["policy"] == "scp":
        online, model = profile(str(row["profile"]))
        outcome, _ = planned(episode, seed, online, model)
    else:
        outcome = stepped(episode, POLICIES[row["policy"]])
    return written(outcome)


def written(outcome: Outcome) -> Row:
    """The columns of an outcome."""
    wall = np.array(outcome.replans.get("wall_ms", ()))
    return {
        "success": int(outcome.success),
        "contact": int(outcome.contact),
        "contact_standing": int(outcome.contact_standing),
        "late": int(not outcome.arrived),
        "time": outcome.time,
        "least_distance": outcome.least_distance,
        "median_ms": float(np.median(wall)) if wall.size else math.nan,
        "slow_ms": float(np.quantile(wall, 0.99)) if wall.size else math.nan,
        **{name: int(outcome.replans.get(name, 0)) for name in PLAN_OUTCOMES},
    }


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """What is said of many episodes: shares, times in s of those that succeed, distances in m, replans."""

    def column(key: str) -> np.ndarray:
        return np.array([float(row[key]) for row in rows])

    won = column("success") > 0
    times = column("time")[won]
    replans = sum(column(name).sum() for name in PLAN_OUTCOMES)
    facts = {
        "episodes": float(len(rows)),
        "success": float(won.mean()),
        "contact": float(column("contact").mean()),
        "contact_standing": float(column("contact_standing").mean()),
        "late": float(column("late").mean()),
        "mean_time": float(times.mean()) if times.size else math.nan,
        "time_95": float(np.quantile(times, 0.95)) if times.size else math.nan,
        "least_distance": float(column("least_distance").min()),
        "median_ms": common.median(column("median_ms")),
        "slow_ms": common.median(column("slow_ms")),
    }
    return facts | {name: float(column(name).sum() / replans) if replans else math.nan for name in PLAN_OUTCOMES}


HEADINGS = [
    "protocol",
    "people",
    "robot",
    "by",
    "episodes",
    "success",
    "hit driving",
    "hit standing",
    "too late",
    "mean s",
    "95 % s",
    "least m",
    "replan ms",
    "99 %",
    "braking, %",
    "evading, %",
]


def table(groups: Mapping[tuple[str, ...], Sequence[Mapping[str, Any]]]) -> str:
    """A line for each group of episodes, (protocol, people, robot, how)."""
    lines = []
    for name, rows in groups.items():
        facts = summary(rows)
        lines.append(
            [
                *name,
                len(rows),
                *(common.number(facts[key], 3) for key in ("success", "contact", "contact_standing", "late")),
                *(common.number(facts[key], 2) for key in ("mean_time", "time_95", "least_distance")),
                *(common.number(facts[key], 1) for key in ("median_ms", "slow_ms")),
                *(common.number(100.0 * facts[key], 1) for key in ("braking", "evading")),
            ]
        )
    return common.table(HEADINGS, lines)


def section(rows: Sequence[Mapping[str, Any]], title: str) -> list[str]:
    """The section of the page of benchmarks."""
    groups: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        how = " ".join(part for part in (str(row["policy"]), str(row["profile"])) if part)
        groups.setdefault((str(row["protocol"]), str(row["people"]), str(row["robot"]), how), []).append(row)
    published = "\n".join(f"- {protocol}, robot {robot}: {text}." for (protocol, robot), text in PUBLISHED.items())
    text = (
        "Published test episodes; see [among people](howto/among-people.md). Success: at the goal in time, without "
        "contact. Times are those of successful episodes, in whole steps of 0.25 s."
    )
    return [f"## {title.capitalize()}", text, table(groups), f"Published results:\n\n{published}"]
