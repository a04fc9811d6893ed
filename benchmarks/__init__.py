"""Timed comparisons of the planner, with an independent check of every answer.

- ``python -m benchmarks.planning``: the reference scenarios, stage by stage; scaling; random scenarios.
- ``python -m benchmarks.peers``: other methods and solvers on the same scenarios, in the same process.
- ``python -m benchmarks.corridors``: what a corridor costs beside the same trip without it.
- ``python -m benchmarks.everyday``: closed loops among people, carts, cars and boats, beside three baselines.
- ``python -m benchmarks.pairs``: which features work together, in scenes that can be driven by construction.
- ``python -m benchmarks.prediction``: how sharp predicted regions are, and how often they hold.
- ``python -m benchmarks.report``: the results page ``docs/benchmarks.md`` from the CSV files of the two.

Whatever is timed runs on one thread: the entry points import :mod:`benchmarks.common` first, which says so to
the numerical libraries before they are loaded.
"""
