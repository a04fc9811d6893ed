"""Bounds and rows of a program as one sparse matrix, for solvers that take them alike."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_matrix, csr_array

from scp_planner.arrays import Array, Index

_NONE = np.zeros(0, dtype=np.intp)


def stacked(
    matrix: Array | csr_array, fixed: Index, kept: Index, below: Index = _NONE, above: Index = _NONE
) -> csc_matrix:
    """Rows of the identity, of a matrix, of the identity and of the negative identity; no dense copy is made."""
    entries = coo_array(matrix)
    place = np.full(matrix.shape[0], -1)
    place[kept] = len(fixed) + np.arange(len(kept))
    row, column = entries.coords
    used = place[row] >= 0
    row, column = row[used], column[used]
    values = [np.ones(len(fixed)), entries.data[used], np.ones(len(below)), -np.ones(len(above))]
    bounds = len(fixed) + len(kept) + np.arange(len(below) + len(above))
    rows = np.concatenate([np.arange(len(fixed)), place[row], bounds])
    columns = np.concatenate([fixed, column, below, above])
    return csc_matrix(
        (np.concatenate(values), (rows, columns)), shape=(len(fixed) + len(kept) + len(bounds), matrix.shape[1])
    )
