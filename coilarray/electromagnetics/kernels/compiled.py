"""The decorators of all kernels."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn, TypeVar, cast

from numba import njit
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys

Function = TypeVar("Function", bound=Callable[..., Any])
_OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "no_cfunc_wrapper": True,  # nobody calls a kernel through a pointer of C; compiling takes 5 % less time
}


def kernel(function: Function) -> Function:
    """Compile a kernel on first use and keep the machine code on disk.

    Division by zero gives an infinity as in NumPy, a·b + c may use one rounding, and the interpreter's lock is
    released. numba renews the stored code when the kernel's own file changes, not when a kernel it calls does:
    after editing one, delete ``coilarray/electromagnetics/kernels/__pycache__``.
    """
    return cast(Function, _compiled(function, _OPTIONS))


def inner_kernel(function: Function) -> Function:
    """Compile what other kernels call and Python does not: without a way in from there it takes a tenth less time.

    Called from Python it raises TypeError, but where numba is switched off.
    """
    made = _compiled(function, _OPTIONS | {"no_cpython_wrapper": True})
    if isinstance(made, CPUDispatcher):
        made.__class__ = _Inner
    return cast(Function, made)


def _compiled(function: Function, options: dict[str, Any]) -> Any:
    made: Any = njit(**options)(function)
    if isinstance(made, CPUDispatcher):  # else numba is switched off
        cache: Any = vars(made)["_cache"]
        cache.__class__ = _Disk
    return made


class _Disk(FunctionCache):
    """Machine code on a disk that may be full: what cannot be kept is compiled again by the next process."""

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Load machine code that is there; only what compiles needs numba's declarations, which take 0.3 s to load."""
        rtsys.initialize(target_context)  # memory of arrays that kernels make
        there: Any = self._load_overload  # numba has no types
        with suppress(OSError):
            found = there(signature, target_context)
            if found is not None:
                return found
        load: Any = super().load_overload
        return load(signature, target_context)

    def save_overload(self, *arguments: Any) -> None:
        keep: Any = super().save_overload  # numba has no types
        with suppress(OSError):
            keep(*arguments)


class _Inner(CPUDispatcher):
    def __call__(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(f"{self.py_func.__name__} can be called by other kernels only.")
