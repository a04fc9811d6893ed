"""The published claims, and this package's own promises, measured.

May import everything but the command line. Begin with `consistency` or `coverage`.
"""
