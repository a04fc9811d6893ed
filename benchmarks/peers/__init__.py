"""Other methods on the same scenarios, each set up as somebody who knows it well would.

``python -m benchmarks.peers`` runs them in one process, scenario by scenario and method by method, each from
the same starts, and has every answer judged by :mod:`verification.dense_check`.
"""
