"""What is compiled before it is needed."""

import pytest
from numba import config

from coilarray import inductance_matrix, load_design, magnetic_field
from coilarray.electromagnetics.kernels import compile_kernels
from coilarray.electromagnetics.resistance import resistance_matrix


@pytest.mark.slow
@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_what_is_compiled_beforehand_is_not_compiled_again_when_it_is_needed():
    compiled = compile_kernels()
    before = [len(kernel.signatures) for kernel in compiled]
    conductors = load_design("gast_fem").array.conductors()
    inductance_matrix(conductors)
    resistance_matrix(conductors, 1e6)
    magnetic_field(conductors, [[0.0, 0.0, 1e-3]])
    assert [len(kernel.signatures) for kernel in compiled] == before
