"""Available memory, and an error before more is allocated."""

import gc
import math
import os
from contextlib import suppress
from pathlib import Path

from coilarray.errors import MemoryLimitError

LIMIT_VARIABLE = "COILARRAY_MEMORY_GB"
"""Environment variable that sets the allowed memory in GB."""
SHARE = 0.75
"""Share of the free memory that one array and its computation may use."""
_GB = 1e9
_SMALL = 50e6  # bytes. Less is never refused, so that small arrays cost no look at the system
_PROC, _CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")


def collect_seldom() -> None:
    """Search cycles of dead objects a hundred times less often.

    The search takes a tenth of a command's time, and a fifth of the compilation.
    """
    gc.set_threshold(100_000, 20, 20)


def require_memory(size: float, what: str, advice: str = "") -> None:
    """Refuse work that needs more bytes than `allowed_memory`."""
    if size <= _SMALL and LIMIT_VARIABLE not in os.environ:
        return
    allowed = allowed_memory()
    if not size <= allowed:  # also not a number
        ending = f": {advice}" if advice else ""
        raise MemoryLimitError(
            f"{what} needs about {size / _GB:.3g} GB of memory; {allowed / _GB:.3g} GB are allowed{ending}."
        )


def allowed_memory() -> float:
    """Memory in bytes that one piece of work may use."""
    said = os.environ.get(LIMIT_VARIABLE)
    if said is None:
        return SHARE * available_memory()
    try:
        value = float(said)
    except ValueError:
        value = 0.0
    if not value > 0:  # also not a number
        raise MemoryLimitError(f"{LIMIT_VARIABLE} must be a positive number of GB; got {said!r}.")
    return value * _GB


def available_memory() -> float:
    """Memory in bytes without swapping, infinite if unknown.

    It is the least of the free memory of the machine, of every control group of this process, as set by
    containers and batch systems, and of its own limit (``ulimit -v``).
    """
    free = _fields(_PROC / "meminfo").get("MemAvailable", math.inf) * 1024
    if math.isinf(free):
        with suppress(AttributeError, OSError, ValueError):  # Windows
            free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return min(free, _left_in_groups(), own_limit())


def _left_in_groups() -> float:
    """Memory in bytes left in control groups, caches as free."""
    left = math.inf
    for line in _text(_PROC / "self" / "cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        inner = _CGROUPS / path.lstrip("/")
        for group in () if controllers else (inner, *inner.parents):  # with controllers it is of version 1
            limit, used = (_text(group / f"memory.{name}").strip() for name in ("max", "current"))
            if limit.isdecimal() and used.isdecimal():  # "max" without a limit, empty without a group
                cache = _fields(group / "memory.stat").get("inactive_file", 0)
                left = min(left, float(max(int(limit) - int(used) + cache, 0)))
    return left


def own_limit() -> float:
    """Address space in bytes left to this process (``ulimit -v``)."""
    try:
        import resource
    except ImportError:  # Windows
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    used = _fields(_PROC / "self" / "status").get("VmSize", 0) * 1024
    return math.inf if limit == resource.RLIM_INFINITY else float(max(limit - used, 0))


def _fields(path: Path) -> dict[str, int]:
    words = [line.replace(":", " ").split() for line in _text(path).splitlines()]
    return {line[0]: int(line[1]) for line in words if len(line) > 1 and line[1].isdecimal()}


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""
