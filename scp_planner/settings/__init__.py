"""Settings, with units and ranges.

May import solvers, whose names are a setting, and errors. Begin with `planning`; `knobs` is how a setting is
declared and checked.
"""
