"""`python -m scp_planner`, and the program `scp-planner`: the command line."""

import sys


def main() -> None:
    """Run the command line; an interrupt ends it quietly, also one while it is still being loaded."""
    try:
        from scp_planner.cli import main as run

        run()
    except KeyboardInterrupt:
        exec("")  # see scp_planner.cli.application
        sys.exit(130)


if __name__ == "__main__":
    main()
