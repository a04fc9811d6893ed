"""Many scenarios: one row of a table each, worked off by processes of this machine or by a cluster.

`runner` says what is done, `jobs` does it for one scenario, `table` keeps the rows, and an `executor` brings the two
together: `local` processes, or a Dask cluster (`dask_cluster`).

May import planning, the baseline and all below. Begin with `runner`.
"""
