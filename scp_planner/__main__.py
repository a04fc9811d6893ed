"""`python -m scp_planner`: the command line."""

from scp_planner.cli import main

if __name__ == "__main__":
    main()
