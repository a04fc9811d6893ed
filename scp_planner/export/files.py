"""One call for every form: the name of the file says which."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from scp_planner.export.ros import BODY, FRAME, MCAP_SUFFIX, plan_messages, run_messages, save_messages
from scp_planner.export.tables import SAMPLES, TABLE_SUFFIXES, plan_table, run_table, save_table

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.simulation.run import Run

EXPORT_SUFFIXES = (*TABLE_SUFFIXES, MCAP_SUFFIX)
"""Suffixes of files; a name without one is the folder of a bag."""


def export_plan(
    plan: Plan,
    path: str | PathLike[str],
    *,
    samples: int = SAMPLES,
    frame: str = FRAME,
    body: str = BODY,
    epoch: float = 0.0,
) -> None:
    """Write a plan for other programs.

    Parameters
    ----------
    plan : Plan
    path : path
        .csv or .npz: a table, see `plan_table`; .mcap, or without suffix a bag's folder: messages, see `plan_messages`.
    samples : int
        At least 2.
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
    if _is_table(path):
        save_table(plan_table(plan, samples), path)
    else:
        save_messages(plan_messages(plan, samples, frame=frame, body=body, epoch=epoch), path)


def export_run(
    run: Run, path: str | PathLike[str], *, frame: str = FRAME, body: str = BODY, epoch: float = 0.0
) -> None:
    """Write a run, at its own times, for other programs.

    Parameters
    ----------
    run : Run
    path : path
        .csv or .npz: a table, see `run_table`; .mcap, or without suffix a bag's folder: messages, see `run_messages`.
    frame, body : str
        Of messages: names of the frame that positions are in and of the vehicle.
    epoch : float
        Of messages: ROS time at time 0 of the run, s.

    Raises
    ------
    ImportError
        If messages are asked for and `rosbags` is not installed.
    ValueError
        If the suffix is another one, or a time is none of ROS.
    """
    if _is_table(path):
        save_table(run_table(run), path)
    else:
        save_messages(run_messages(run, frame=frame, body=body, epoch=epoch), path)


def _is_table(path: str | PathLike[str]) -> bool:
    suffix = Path(path).suffix.lower()
    if suffix not in (*EXPORT_SUFFIXES, ""):
        raise ValueError(f"{path}: must end in one of {', '.join(EXPORT_SUFFIXES)}, or have no suffix for a bag")
    return suffix in TABLE_SUFFIXES
