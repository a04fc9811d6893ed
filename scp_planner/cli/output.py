"""Output of commands: summaries on stdout, messages and progress on stderr."""

from __future__ import annotations

import json
import logging
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import typer

from scp_planner.cli.groups import Printing

if TYPE_CHECKING:
    from tqdm import tqdm


_UNITS = {
    "arrival_time": "s",
    "travel_time": "s",
    "lower_bound": "s",
    "least_clearance": "m",
    "time_of_least_clearance": "s",
    "wall_time": "s",
    "times_of_passing": "s",
    "meeting_x": "m",
    "meeting_y": "m",
    "relative_speed": "m/s",
    "distance_at_meeting": "m",
    "median_replan_time": "s",
    "longest_replan_time": "s",
    "diffusion": "m2/s3",
    "time_constant": "s",
    "deviation": "m/s2",
    "velocity_deviation": "m/s",
    "noise_deviation": "m",
}
_NOT_LISTED = ("reason", "violations", "limits", "file")
"""Told elsewhere, or known."""


def start_logging(printing: Printing) -> None:
    """Let the package's messages through to stderr, as many as are wanted."""
    level = logging.DEBUG if printing.verbose else logging.ERROR if printing.quiet else logging.WARNING
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("scp_planner").setLevel(level)


def tell(message: str) -> None:
    """Print a message on stderr."""
    typer.echo(message, err=True)


@contextmanager
def progress_bar(total: int | None, unit: str, quiet: bool, **options: Any) -> Iterator[tqdm[Any]]:
    """Show a bar on stderr; none where that is not a terminal, or nothing is to be printed."""
    from tqdm import tqdm
    from tqdm.contrib.logging import logging_redirect_tqdm

    # Messages go above the bar.
    with (
        logging_redirect_tqdm(),
        tqdm(total=total, unit=unit, disable=True if quiet else None, leave=False, **options) as bar,
    ):
        yield bar


def report(summary: dict[str, Any], printing: Printing) -> None:
    """Print a summary on stdout: as JSON, or one line a figure with its unit."""
    if printing.as_json:
        print_json(summary)
    elif not printing.quiet:
        for key, value in summary.items():
            if value is not None and key not in _NOT_LISTED:
                unit = _UNITS.get(key.removeprefix("simulated_"), "")
                typer.echo(f"{key.replace('_', ' ') + ':':<24} {_shown(value)} {unit}".rstrip())


def tabulate(data: Any, table: str, printing: Printing) -> None:
    """Print figures on stdout: as JSON, or the table of them."""
    if printing.as_json:
        print_json(data)
    elif not printing.quiet:
        typer.echo(table)


@contextmanager
def waiting(what: str, quiet: bool, patience: float = 1.0) -> Iterator[None]:
    """Show on stderr, if that is a terminal, that something is being done that takes longer than some seconds."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    done = Event()
    teller = Thread(target=_tell_that_it_goes_on, args=(what, patience, done), daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def _tell_that_it_goes_on(what: str, patience: float, done: Event) -> None:
    if done.wait(patience):
        return
    from tqdm import tqdm

    # Some terminals say that they have no width.
    with tqdm(bar_format=f"{what}: {{elapsed}}", leave=False, ncols=len(what) + 12) as bar:
        bar.start_t -= patience
        bar.refresh()
        while not done.wait(0.25):
            bar.refresh()


def print_json(data: Any) -> None:
    """Print as JSON; numbers that JSON has no word for become null, such as the clearance without obstacles."""

    def known(value: Any) -> Any:
        match value:
            case dict():
                return {key: known(item) for key, item in value.items()}
            case list():
                return [known(item) for item in value]
            case float():
                return value if math.isfinite(value) else None
            case _:
                return value

    typer.echo(json.dumps(known(data), indent=1, allow_nan=False))


def _shown(value: object) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.4f}"
        case list():
            return ", ".join(map(_shown, value))
        case _:
            return str(value)
