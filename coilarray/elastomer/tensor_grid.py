"""Energies on a grid whose nodes couple only to their own and the next two columns.

The nodes of the columns are eliminated column by column, all rows at once: a block Cholesky decomposition A = L Lᵀ. For
a force f only the half L⁻¹f is needed, as fᵀA⁻¹f = |L⁻¹f|². With some hundred rows the blocks are so large that this
takes half the time of a sparse decomposition and its solutions.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf
from scipy.sparse import csr_matrix

from coilarray.compute.arrays import FloatArray
from coilarray.errors import ElastomerError

_REACH = 2  # columns that couple: the nodes of a quadratic element


class TensorGrid:
    """Nodes of a grid of columns and rows.

    They are at points (2, nodes), without the first and the last row. The columns are numbered from the outermost,
    which is left out too, to the column in the middle.
    """

    def __init__(self, nodes: FloatArray) -> None:
        (radii, self._column), (heights, self._row) = (np.unique(x.round(12), return_inverse=True) for x in nodes)
        self._column = len(radii) - 1 - self._column
        self.columns, self.rows = len(radii), len(heights)

    def blocks(self, matrix: csr_matrix) -> FloatArray:
        """Parts of a symmetric matrix by column, distance, and the rows of both."""
        entries = matrix.tocoo()
        distance = self._column[entries.row] - self._column[entries.col]
        at = distance >= 0
        blocks = np.zeros((self.columns, _REACH + 1, self.rows, self.rows))
        first, second = entries.row[at], entries.col[at]
        blocks[self._column[second], distance[at], self._row[first], self._row[second]] = entries.data[at]
        return blocks[1:, :, 1:-1, 1:-1]

    def forces(self, forces: FloatArray) -> FloatArray:
        """Parts of forces (nodes, n) by column, force and row."""
        parts = np.zeros((self.columns, forces.shape[1], self.rows))
        parts[self._column, :, self._row] = forces
        return parts[1:, :, 1:-1]


def energies(blocks: FloatArray, forces: FloatArray) -> FloatArray:
    """Return fᵀA⁻¹f (forces, forces) of a positive definite matrix A.

    Matrix and forces are in the parts of a `TensorGrid`. Nodes of columns that are left out at the end are held. Raises
    ElastomerError if the matrix is not positive definite.
    """
    columns, count, rows = forces.shape
    near, far = rows + rows, rows + rows + count
    # for every column: itself, its coupling to the next column, the forces, and its coupling to the column after that
    parts = np.concatenate((blocks[:columns, 0], blocks[:columns, 1], forces, blocks[:columns, 2]), axis=1)
    total = np.zeros((count, count))
    for k, part in enumerate(parts):
        half, bad = dpotrf(part[:rows].T, lower=True, overwrite_a=True)
        if bad:
            raise ElastomerError("a dent folds the sheets: it must be less deep.")
        end = len(part) if part[far:].any() else far
        solved = dtrsm(1.0, half, part[rows:end].T, lower=True, overwrite_b=True)
        met = solved.T @ solved
        total += met[rows:-rows, rows:-rows] if end > far else met[rows:, rows:]
        if k + 1 < columns:
            parts[k + 1, :rows] -= met[:rows, :rows]
            parts[k + 1, near:far] -= met[rows : rows + count, :rows]
        if k + 2 < columns and end > far:
            parts[k + 1, rows:near] -= met[-rows:, :rows]
            parts[k + 2, :rows] -= met[-rows:, -rows:]
            parts[k + 2, near:far] -= met[rows : rows + count, -rows:]
    return total
