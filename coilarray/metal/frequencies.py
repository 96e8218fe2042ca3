"""Frequencies at which metal is computed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.errors import MetalError


def checked_frequencies(frequencies: npt.ArrayLike) -> FloatArray:
    """Return frequencies (f,) in Hz of at least 0, or raise MetalError."""
    found = np.asarray(frequencies, dtype=np.float64)
    if found.ndim != 1 or not found.size or not (np.isfinite(found) & (found >= 0)).all():
        raise MetalError(f"frequencies must be one row of finite numbers of at least 0; got {found} Hz.")
    return found
