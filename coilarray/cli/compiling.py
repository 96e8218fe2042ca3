"""A process beside a command that compiles half of the kernels, where none has been compiled yet."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_MODULE = "coilarray.electromagnetics.kernels.beforehand"
_LAST = "paths._rows_sum-*.nbi"  # of the kernels that every command compiles: the index of its code on disk


@contextmanager
def compiling_beside() -> Iterator[None]:
    """Compile kernels in another process while the block runs, and end it with the block.

    Nothing happens where there is one core only, numba is switched off, or the kernels are on disk; nor where numba may
    not write beside them, since it then keeps them in the user's cache.
    """
    kept = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1] / "electromagnetics/kernels/__pycache__")
    off = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
    there = next((folder for folder in (kept, *kept.parents) if os.access(folder, os.F_OK)), kept)
    if off or (os.cpu_count() or 1) < 2 or any(kept.rglob(_LAST)) or not os.access(there, os.W_OK):
        yield
        return
    quiet = subprocess.DEVNULL
    # what goes wrong there goes wrong here too, and is said here
    child = subprocess.Popen([sys.executable, "-P", "-m", _MODULE], stdin=quiet, stdout=quiet, stderr=quiet)
    try:
        yield
    finally:
        child.kill()
        child.wait()
