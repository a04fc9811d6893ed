"""Plans and runs as tables: columns of equal length, each with its unit in its name."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scp_planner.arrays import Array
from scp_planner.files import check_suffix, replacing, write_csv

if TYPE_CHECKING:
    from scp_planner.planning.plan import Plan
    from scp_planner.simulation.run import Run

Table = dict[str, NDArray[Any]]

SAMPLES = 200
TABLE_SUFFIXES = (".csv", ".npz")


def plan_table(plan: Plan, times: ArrayLike | int = SAMPLES) -> Table:
    """Sample a plan.

    Parameters
    ----------
    plan : Plan
    times : (n,) array or int
        Absolute times, s, or how many, spread equally over the trip.

    Returns
    -------
    dict of str to (n,) array
        ``time_s`` (absolute), ``x_m``, ``y_m``, ``heading_rad``, ``speed_m_per_s``, ``velocity_x_m_per_s``,
        ``velocity_y_m_per_s``, ``acceleration_m_per_s2`` (along the path), ``lateral_acceleration_m_per_s2`` and
        ``curvature_per_m`` (positive to the left), ``distance_m`` (along the path).

    Raises
    ------
    ValueError
        If `times` are no row of finite numbers, or fewer than 2 are asked for.
    """
    time = _times(plan.start_time, plan.arrival_time, times)
    position, velocity = plan.position(time), plan.velocity(time)
    speed, curvature = plan.speed(time), plan.curvature(time)
    return {
        "time_s": time,
        "x_m": position[:, 0],
        "y_m": position[:, 1],
        "heading_rad": plan.heading(time),
        "speed_m_per_s": speed,
        "velocity_x_m_per_s": velocity[:, 0],
        "velocity_y_m_per_s": velocity[:, 1],
        "acceleration_m_per_s2": plan.acceleration(time),
        "lateral_acceleration_m_per_s2": speed**2 * curvature,
        "curvature_per_m": curvature,
        "distance_m": plan.distance(time),
    }


def run_table(run: Run) -> Table:
    """Give what vehicle and obstacles did in a closed loop.

    Parameters
    ----------
    run : Run

    Returns
    -------
    dict of str to (n,) array
        ``time_s``, ``x_m``, ``y_m``, ``heading_rad``, ``speed_m_per_s`` of the vehicle, and for each obstacle
        ``ID.x_m`` and ``ID.y_m``: its true centre, NaN where it was not there.
    """
    table: Table = {
        "time_s": run.time,
        "x_m": run.position[:, 0],
        "y_m": run.position[:, 1],
        "heading_rad": run.heading,
        "speed_m_per_s": run.speed,
    }
    for name, center in run.obstacles.items():
        table[f"{name}.x_m"], table[f"{name}.y_m"] = center.T
    return table


def cycle_table(run: Run) -> Table:
    """Give what came of each cycle of a closed loop.

    Parameters
    ----------
    run : Run

    Returns
    -------
    dict of str to (n,) array
        ``time_s``, ``x_m``, ``y_m``, ``heading_rad``, ``speed_m_per_s``, ``outcome``, ``status``, ``certified``,
        ``safe``, ``arrival_time_s`` (by the plan), ``iterations``, ``observations`` (how many came in),
        ``clearance_m`` (to true obstacles, up to the next cycle).
    """
    records = run.records
    position = np.array([record.position for record in records]).reshape(-1, 2)
    return {
        "time_s": np.array([record.time for record in records]),
        "x_m": position[:, 0],
        "y_m": position[:, 1],
        "heading_rad": np.array([record.heading for record in records]),
        "speed_m_per_s": np.array([record.speed for record in records]),
        "outcome": np.array([record.outcome for record in records]),
        "status": np.array([record.status for record in records]),
        "certified": np.array([record.certified for record in records]),
        "safe": np.array([record.safe for record in records]),
        "arrival_time_s": np.array([record.arrival_time for record in records]),
        "iterations": np.array([record.iterations for record in records]),
        "observations": np.array([len(record.observations) for record in records]),
        "clearance_m": np.array([record.clearance for record in records]),
    }


def save_table(table: Mapping[str, NDArray[Any]], path: str | PathLike[str]) -> None:
    """Write a table: numbers keep every bit.

    Parameters
    ----------
    table : mapping of str to (n,) array
        Columns, with units in their names.
    path : path
        .csv: one row of names, then one row a time; or .npz: one array a column.

    Raises
    ------
    ValueError
        If the suffix is another one.
    """
    if check_suffix(path, TABLE_SUFFIXES) == ".csv":
        write_csv(path, [list(table), *zip(*(column.tolist() for column in table.values()), strict=True)])
    else:
        columns: Any = dict(table)
        with replacing(path) as temporary:
            np.savez(temporary, **columns)


def _times(start: float, end: float, times: ArrayLike | int) -> Array:
    if isinstance(times, int):
        if times < 2:
            raise ValueError(f"times: must be 2 or more, not {times}")
        return np.linspace(start, end, times)
    given = np.asarray(times, dtype=float)
    if given.ndim != 1 or not len(given) or not np.isfinite(given).all():
        raise ValueError(f"times: must be a row of finite numbers, not an array of shape {given.shape}")
    return given
