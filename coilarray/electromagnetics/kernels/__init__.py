"""Arithmetic on arrays in SI units by numba kernels and NumPy.

There is no validation, no units and no coils, which belong to the public functions of the package.
Every numba kernel is serial and releases the interpreter's lock. `coilarray.compute.threads` runs
several at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a kernel on first use and keep it on disk.

    Division by zero gives an infinity as in NumPy. After editing a kernel that others call, delete
    ``kernels/__pycache__``: numba renews code only for a kernel's own file.
    """
    compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
    return cast(Function, compiled(function))
