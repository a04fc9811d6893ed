"""What comes of a scene: planned, refused by name, or wrong."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from benchmarks.pairs.scene import Feature
from scp_planner.errors import ScenarioError


class Verdict(StrEnum):
    """What may come of a scene."""

    PLANNED = "planned"
    """Certified, or arrived in time, and no independent check finds a fault."""
    REFUSED = "refused"
    """By an error that names two of the features."""
    WRONG = "wrong"
    """All else, since each scene can be driven by construction."""


@dataclass(frozen=True)
class Result:
    """What came of one scene, and why."""

    verdict: Verdict
    detail: str = ""


def judge(features: Sequence[Feature], attempt: Callable[[], str]) -> Result:
    """Make an attempt, which returns what is wrong with its answer, or nothing."""
    try:
        wrong = attempt()
    except ScenarioError as error:
        named = names_two(features, str(error))
        return Result(Verdict.REFUSED if named else Verdict.WRONG, f"ScenarioError: {error}")
    except Exception as error:  # whatever else is raised is a finding
        last = traceback.extract_tb(error.__traceback__)[-1]
        return Result(Verdict.WRONG, f"{type(error).__name__} in {Path(last.filename).name}, {last.name}: {error}")
    return Result(Verdict.WRONG if wrong else Verdict.PLANNED, wrong)


def names_two(features: Sequence[Feature], text: str) -> bool:
    """Tell if a message names two of the features that make up a scene."""
    return sum(any(word in text for word in feature.words) for feature in features) >= 2
