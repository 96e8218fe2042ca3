"""Arithmetic on arrays in SI units by numba kernels and NumPy.

There is no validation, no units and no coils, which belong to the public functions of the package.
Every numba kernel is serial and releases the interpreter's lock. `coilarray.compute.threads` runs
several at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import boolean, float64, int64, njit
from numba.core.registry import CPUDispatcher
from numba.core.types import Array, UniTuple

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a kernel on first use and keep it on disk.

    Division by zero gives an infinity as in NumPy. After editing a kernel that others call, delete
    ``kernels/__pycache__``: numba renews code only for a kernel's own file.
    """
    compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
    return cast(Function, compiled(function))


def compile_kernels() -> list[Any]:
    """Compile each kernel that a report needs late, and return them.

    A separate process does it beforehand, as a process compiles one kernel at a time. Most kernels
    are nested from `paths._between` to `paths._rows_sum`. Those here are needed last, or after.
    """
    from coilarray.electromagnetics.kernels import bars, paths, sections, segments

    row, table, indices = float64[::1], float64[:, ::1], int64[::1]
    vector = UniTuple(float64, 3)  # type: ignore[no-untyped-call]
    pair = (vector, float64, vector, vector, float64)
    constants = Array(float64, 1, "C", readonly=True)
    kernels: tuple[tuple[Any, tuple[Any, ...]], ...] = (
        (paths._corner_rule, (row, row, float64, boolean, boolean, int64, table)),
        (paths._angled_rule, (row, row, float64, boolean, int64, table)),
        (bars.filament_pair, pair),
        (bars.parallel_bars, (float64,) * 9),
        (paths._touching_parallel_bars, (row, row, vector, float64)),
        (paths.batch_sum, (row, int64, table)),
        (sections.transverse_fields, (table, indices, *(table,) * 4)),
        (paths.add_node_sums, (*(table,) * 5, row)),
        (segments.add_magnetic_field, (row, row, row, table, indices, *(row,) * 5)),
        (bars.bar_self, (float64,) * 3),
        (paths._parallel_rule, (row, row, vector, boolean, int64, table)),
        (bars.filament_pair_far, (*pair, constants, constants)),
        (sections.pair_logs, (table, table, float64, float64, table)),
    )
    for made, arguments in kernels:
        if isinstance(made, CPUDispatcher):
            made.compile(arguments)
    return [made for made, _ in kernels]
