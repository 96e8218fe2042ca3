"""The decorators of kernels."""

import os
import subprocess
import sys

import pytest
from numba import config

from coilarray import inductance_matrix, load_design, magnetic_field
from coilarray.electromagnetics.ac_resistance import resistance_matrix
from coilarray.electromagnetics.kernels.beforehand import KERNELS, compile_kernels
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
        with pytest.raises(TypeError, match="double can only be called by other kernels"):
            double(1.0)
        assert fourfold(1.5) == 6.0


SUMS = """
from coilarray.electromagnetics.kernels.compiled import kernel
import numpy as np
@kernel
def total(n):
    return np.ones(n).sum()
if __name__ == "__main__":
    import sys
    print(total(3), "numba.np.npyimpl" in sys.modules)
"""


@pytest.mark.slow
@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_kept_machine_code_runs_without_what_compiling_needs(tmp_path):
    program = tmp_path / "sums.py"
    program.write_text(SUMS, encoding="utf-8")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    said = [subprocess.check_output([sys.executable, program], env=environment, text=True) for _ in range(2)]
    assert said == ["3.0 True\n", "3.0 False\n"]


@pytest.mark.slow
@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_what_is_compiled_beforehand_is_not_compiled_again_when_it_is_needed():
    compile_kernels()
    called = [kernel for kernel, _ in KERNELS if type(kernel).__name__ != "_Inner"]
    before = [len(kernel.signatures) for kernel in called]
    conductors = load_design("gast_fem").array.conductors()
    inductance_matrix(conductors)
    resistance_matrix(conductors, 1e6)
    magnetic_field(conductors, [[0.0, 0.0, 1e-3]])
    assert [len(kernel.signatures) for kernel in called] == before
