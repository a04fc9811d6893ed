"""What can be set, with units and ranges.

May import errors alone. Begin with `planning`; `knobs` is how a setting is declared and checked.
"""
