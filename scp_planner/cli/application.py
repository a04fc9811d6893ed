"""The program: how commands are registered, what their errors become, and how it starts and ends."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from enum import IntEnum
from io import StringIO
from typing import Annotated, Any, ParamSpec, TypeVar

import typer

from scp_planner.cli.groups import ungrouped
from scp_planner.cli.output import tell
from scp_planner.errors import ScpPlannerError

P = ParamSpec("P")
R = TypeVar("R")


class ExitCode(IntEnum):
    CERTIFIED = 0
    BAD_INPUT = 2
    NOT_CERTIFIED = 3
    CUT_SHORT = 4
    INTERRUPTED = 130


app = typer.Typer(
    help="Plan the fastest safe trip of an unmanned vehicle among moving obstacles.",
    epilog="Exit codes: 0 done and certified; 2 bad input, nothing written; 3 no certified plan exists or was found, "
    "the best attempt is written with its status and reason; 4 the workers of a batch have gone, what is done is kept; "
    "130 interrupted.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

study_app = typer.Typer(name="study", help="Measure the published claims.", no_args_is_help=True, rich_markup_mode=None)


@dataclass(frozen=True)
class Command:
    """A command as it was registered."""

    function: Callable[..., Any]  # Its parameters are the arguments and options, its docstring the help
    examples: tuple[str, ...]


COMMANDS: dict[str, Command] = {}
"""All commands, by their full names."""


COMPLETE_VARIABLE = "_SCP_PLANNER_COMPLETE"
"""Environment variable in which a shell's script asks for completions."""


WORD_BREAKS = (":", "=")


def main() -> None:
    """Run the command line."""
    if os.environ.get(COMPLETE_VARIABLE) == "complete_bash":
        _complete_in_bash()
    else:
        app(prog_name="scp-planner")


def _complete_in_bash() -> None:
    words, place = os.environ["COMP_WORDS"].split("\n"), int(os.environ["COMP_CWORD"])
    joined: list[str] = []
    for word in words[: place + 1]:
        goes_on = joined and joined[-1].endswith(WORD_BREAKS) and word and not word.startswith("-")
        if len(joined) > 1 and (goes_on or word.startswith(WORD_BREAKS)):
            joined[-1] += word
        else:
            joined.append(word)
    os.environ.update(COMP_WORDS="\n".join(joined), COMP_CWORD=str(len(joined) - 1))
    last = "" if words[place].startswith(WORD_BREAKS) else words[place]
    there = joined[-1].removesuffix(last)
    with redirect_stdout(StringIO()) as completions, suppress(SystemExit):
        app(prog_name="scp-planner")
    for completion in completions.getvalue().splitlines():
        typer.echo(completion.removeprefix(there))


def add_command(group: typer.Typer, name: str, command: Callable[..., Any], *examples: str) -> None:
    """Make a function a command, whose help ends with examples; its groups of options become options."""
    command = ungrouped(command)
    COMMANDS[name if group is app else f"{group.info.name} {name}"] = Command(command, examples)
    title = "Example:" if len(examples) == 1 else "Examples:"
    # Click lays out paragraphs anew, but for those that begin with this mark.
    epilog = "\b\n" + "\n".join([title, *(f"  {example}" for example in examples)])
    group.command(name, epilog=epilog)(_with_exit_codes(command))


def _with_exit_codes(command: Callable[P, R]) -> Callable[P, R]:
    """Turn what a command raises into a message on stderr and an exit code."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return command(*args, **kwargs)
        except ScpPlannerError as error:
            tell(str(error))
        except BrokenPipeError:
            raise  # the reader of stdout has seen enough
        except OSError as error:
            tell(f"{error.filename}: {error.strerror}" if error.filename else str(error))
        except KeyboardInterrupt as interrupt:
            raise _interrupted(str(interrupt)) from None
        except ImportError as error:
            if not _is_interrupt(error):
                raise
            raise _interrupted() from None
        raise typer.Exit(ExitCode.BAD_INPUT)

    return run


def _interrupted(message: str = "") -> typer.Exit:
    """Tell of an interrupt, and give what ends the program."""
    tell(message or "interrupted")
    # An interrupt while an extension module is imported leaves a mark in CPython, which then ends the process by the
    # signal, whatever its exit code. Running a string takes the mark away.
    exec("")
    return typer.Exit(ExitCode.INTERRUPTED)


def _is_interrupt(error: BaseException | None) -> bool:
    """True if an interrupt is behind an error: extension modules may fail to load because of one."""
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _print_version(wanted: bool) -> None:
    if wanted:
        from scp_planner import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass
