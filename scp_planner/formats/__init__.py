"""Files of other benchmarks: read, planned for and answered, each format in a package of its own.

Imports `planning` and what lies below it. Start with `commonroad.planning`.
"""
