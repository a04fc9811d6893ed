"""The results page: ``python -m benchmarks.report`` writes ``docs/benchmarks.md`` and its figures from the CSV files.

Every number on the page comes from the files that ``benchmarks.planning``, ``benchmarks.peers`` and
``benchmarks.online`` wrote; parts whose file is missing are left out.
"""
