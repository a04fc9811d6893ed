"""One call for every form: the name of the file says which."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path

from scp_planner.errors import MISSING, Fault, PlanError
from scp_planner.export.ros import BODY, FRAME, MCAP_SUFFIX, plan_messages, run_messages, save_messages
from scp_planner.export.tables import SAMPLES, TABLE_SUFFIXES, plan_table, run_table, save_table
from scp_planner.plan import Plan
from scp_planner.run import Run

EXPORT_SUFFIXES = (*TABLE_SUFFIXES, MCAP_SUFFIX)
"""Of files; a name without suffix is the folder of a bag."""


def export(
    subject: Plan | Run,
    path: str | PathLike[str],
    *,
    samples: int = SAMPLES,
    frame: str = FRAME,
    body: str = BODY,
    epoch: float = 0.0,
) -> None:
    """Write a plan or a run for other programs.

    Parameters
    ----------
    subject : Plan or Run
    path : path
        .csv or .npz: a table, see `plan_table` and `run_table`; .mcap, or without suffix a bag's folder: messages,
        see `plan_messages` and `run_messages`.
    samples : int
        Of a plan, at least 2; a run has its own times.
    frame, body : str
        Of messages: names of the frame that positions are in and of the vehicle.
    epoch : float
        Of messages: ROS time at time 0 of the plan, s.

    Raises
    ------
    ImportError
        If messages are asked for and `rosbags` is not installed.
    ValueError
        If the suffix is another one, there are too few samples, or a time is none of ROS.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (*EXPORT_SUFFIXES, ""):
        raise ValueError(f"{path}: must end in one of {', '.join(EXPORT_SUFFIXES)}, or have no suffix for a bag")
    if suffix in TABLE_SUFFIXES:
        save_table(run_table(subject) if isinstance(subject, Run) else plan_table(subject, samples), path)
    elif isinstance(subject, Run):
        save_messages(run_messages(subject, frame=frame, body=body, epoch=epoch), path)
    else:
        save_messages(plan_messages(subject, samples, frame=frame, body=body, epoch=epoch), path)


def load_plan_or_run(path: str | PathLike[str]) -> Plan | Run:
    """Read a plan file or a run file, whichever it is.

    Parameters
    ----------
    path : path

    Returns
    -------
    Plan or Run

    Raises
    ------
    PlanError
        If it is neither.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise PlanError(str(path), [Fault("", MISSING, f"not a JSON file: {error}")]) from None
    return Run.load(path) if isinstance(data, dict) and "course" in data else Plan.load(path)
