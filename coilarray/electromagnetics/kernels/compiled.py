"""The decorators of all kernels."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NoReturn, TypeVar, cast

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys

from coilarray.compute.checksum import check_seal, sealed
from coilarray.errors import DamagedError

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
        vars(cache)["_cache_file"].__class__ = SealedFile
    return made


class _Disk(FunctionCache):
    """Machine code on a disk that may be full: what cannot be kept is compiled again by the next process."""

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Load machine code that is there; only what compiles needs numba's declarations, which take 0.3 s to load."""
        memory: Any = rtsys  # numba has no types
        memory.initialize(target_context)  # of arrays that kernels make
        kept: Any = self._load_overload
        with suppress(OSError):
            found = kept(signature, target_context)
            if found is not None:
                return found
        load: Any = super().load_overload
        return load(signature, target_context)

    def save_overload(self, *arguments: Any) -> None:
        keep: Any = super().save_overload
        with suppress(OSError):
            keep(*arguments)


class SealedFile(IndexDataCacheFile):
    """The two files of a kernel, sealed: a flipped bit in machine code would be a wrong number, or a crash."""

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[IO[bytes]]:
        opened: Any = super()._open_for_write
        with io.BytesIO() as content, opened(filepath) as file:
            yield content
            file.write(sealed(content.getvalue()))

    def _load_index(self) -> Any:
        load: Any = super()._load_index
        return load() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        load: Any = super()._load_data
        if not _is_whole(Path(self._cache_path, name)):
            raise FileNotFoundError(name)  # as which `load` takes it
        return load(name)


def _is_whole(path: str | Path) -> bool:
    """Whether a file is there and as its seal says; what numba reads ends before the seal."""
    with suppress(OSError, DamagedError):
        return check_seal(Path(path))
    return False


class _Inner(CPUDispatcher):
    def __call__(self, *_: object, **__: object) -> NoReturn:
        raise TypeError(f"{self.py_func.__name__} can only be called by other kernels.")
