"""Controllers of everyday loops: the planner in several configurations, stop-and-go, MPPI, ORCA."""
