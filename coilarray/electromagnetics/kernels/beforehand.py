"""Compile kernels in a separate process before they are needed.

A process compiles one kernel at a time, as numba holds the interpreter. Most kernels are nested
from `paths._between` to `paths._rows_sum`. The kernels here are needed last, or after these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numba import boolean, float64, int64
from numba.core.registry import CPUDispatcher
from numba.core.types import Array

from coilarray.electromagnetics.kernels import bars, far_pairs, paths, sections, segments

_ROW, _TABLE, _INDICES = float64[::1], float64[:, ::1], int64[::1]
_CONSTANTS = Array(float64, 1, "C", readonly=True)
KERNELS: tuple[tuple[Any, Sequence[Any]], ...] = (
    (paths._corner_rule, (_ROW, _ROW, boolean, int64, _TABLE)),
    (paths._angled_rule, (_ROW, _ROW, float64, boolean, int64, _TABLE)),
    (bars.filament_pair, (float64,) * 14),
    (bars.parallel_bars, (float64,) * 9),
    (paths._touching_parallel_bars, (_ROW, _ROW, *(float64,) * 4)),
    (far_pairs.batch_sum, (_ROW, int64, _TABLE)),
    (sections.transverse_fields, (_TABLE, _INDICES, *(_TABLE,) * 4)),
    (far_pairs.add_node_sums, (*(_TABLE,) * 5, _ROW)),
    (segments.add_magnetic_field, (_ROW, _ROW, _ROW, _TABLE, _INDICES, *(_ROW,) * 5)),
    (bars.bar_self, (float64,) * 3),
    (paths._parallel_rule, (_ROW, _ROW, *(float64,) * 3, boolean, int64, _TABLE)),
    (bars.filament_pair_far, (*(float64,) * 14, _CONSTANTS, _CONSTANTS)),
    (sections.pair_logs, (_TABLE, _TABLE, float64, float64, _TABLE)),
)
"""Kernels and the types of their arguments."""


def compile_kernels() -> None:
    """Compile each kernel for the argument types of a report."""
    for made, arguments in KERNELS:
        if isinstance(made, CPUDispatcher):
            made.compile(tuple(arguments))


if __name__ == "__main__":
    compile_kernels()
