"""Elimination column by column against a dense solution of the same equations."""

import numpy as np
import pytest
from skfem import Basis, BilinearForm, ElementQuad2, MeshQuad

from coilarray.elastomer.scattering import TensorGrid, energies
from coilarray.errors import ElastomerError

BASIS = Basis(MeshQuad.init_tensor(np.array([0.0, 1.0, 2.0, 4.0]), np.array([0.0, 0.5, 2.0])), ElementQuad2())
X, Z = BASIS.doflocs


@BilinearForm
def energy(u, v, w):
    """A symmetric matrix without any order among its entries that the elimination could profit from."""
    return (1 + w.x[0] + w.x[1] ** 2) * (u.grad[0] * v.grad[0] + u.grad[1] * v.grad[1]) + u * v


@pytest.mark.parametrize("held", [0, 1])
def test_energies_are_those_of_a_dense_solution(held):
    matrix, grid = energy.assemble(BASIS), TensorGrid(BASIS.doflocs)
    forces = np.random.default_rng(1).standard_normal((len(X), 4))
    free = (X < 4) & (Z > 0) & (Z < 2) & (X >= (0.0, 0.1)[held])
    f = forces[free]
    expected = f.T @ np.linalg.solve(matrix.toarray()[np.ix_(free, free)], f)
    found = energies(grid.blocks(matrix), grid.forces(forces)[: grid.columns - 1 - held])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())  # rounding


def test_a_matrix_that_is_not_positive_definite_is_refused():
    grid = TensorGrid(BASIS.doflocs)
    with pytest.raises(ElastomerError, match="a dent folds the sheets"):
        energies(grid.blocks(-energy.assemble(BASIS)), grid.forces(np.ones((len(X), 1))))
