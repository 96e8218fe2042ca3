"""The GPU's kernel, run by numba's simulator in a process of its own; a real GPU where there is one."""

import os
import subprocess
import sys

import numpy as np
import pytest

from coilarray import magnetic_field
from coilarray.errors import GeometryError, MissingDependencyError

SIMULATED = """
import numpy as np
from coilarray import load_design, magnetic_field
rng = np.random.default_rng(2)
paths = [rng.normal(size=(6, 3)), rng.normal(size=(3, 3)), [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0]]]
points = np.concatenate((rng.normal(size=(30, 3)), [[0.5, 0, 0], [1, 0, 0], [0, 0, 0], [2, 0, 0], [0.5, 1e-9, 0]]))
currents = [1.0, -2.0, 0.5]
there = magnetic_field(paths, points, currents, backend="cuda")
here = magnetic_field(paths, points, currents)
assert np.isfinite(there).all()
# a dozen roundings of each segment, in another order
np.testing.assert_allclose(there, here, rtol=1e-11, atol=1e-13 * np.abs(here[:30]).max())
grid = magnetic_field(paths, points[:6].reshape(2, 3, 3), backend="cuda")
np.testing.assert_allclose(grid, magnetic_field(paths, points[:6].reshape(2, 3, 3)), rtol=1e-11)
assert magnetic_field(paths, points[:2], 0.0, backend="cuda").tolist() == [[0, 0, 0], [0, 0, 0]]
print("same")
"""


@pytest.mark.slow
def test_kernel_in_the_simulator():
    command, env = [sys.executable, "-W", "ignore", "-c", SIMULATED], {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(command, check=False, env=env, capture_output=True, text=True)
    assert done.stdout.strip() == "same", done.stderr


def _gpu():
    from numba import cuda

    return cuda.is_available()


@pytest.mark.skipif(not _gpu(), reason="no GPU that numba can use")
def test_on_a_real_gpu():
    exec(SIMULATED, {})


@pytest.mark.skipif(_gpu(), reason="there is a GPU")
def test_without_a_gpu():
    with pytest.raises(MissingDependencyError, match="backend='cuda' needs an NVIDIA GPU"):
        magnetic_field([[[0, 0, 0], [1, 0, 0]]], [[0, 0, 1]], backend="cuda")


def test_another_backend():
    with pytest.raises(GeometryError, match="backend must be one of cpu, cuda; got 'opencl'"):
        magnetic_field([[[0, 0, 0], [1, 0, 0]]], np.zeros((1, 3)), backend="opencl")
