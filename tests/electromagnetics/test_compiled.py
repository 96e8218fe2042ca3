"""The decorators of kernels."""

import pytest
from numba import config

from coilarray.electromagnetics.kernels.compiled import inner_kernel, kernel


@inner_kernel
def double(x):
    return 2.0 * x


@kernel
def fourfold(x):
    return double(double(x))


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_an_inner_kernel_is_called_by_kernels_alone():
    for _ in range(2):  # before and after it is compiled
        with pytest.raises(TypeError, match="double can be called by other kernels only"):
            double(1.0)
        assert fourfold(1.5) == 6.0
