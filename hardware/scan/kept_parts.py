"""Parts of a design's model on disk that a board's program needs at every start, computed once and kept."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import xarray as xr

from coilarray.compute.code_version import code_version
from coilarray.compute.files import make_folder
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.design.model import Design

_FOLDER_VARIABLE = "COILARRAY_CACHE"


def keep_folder(folder: Path | None = None) -> Path:
    """Return the folder where parts of emulated boards are kept, made where there is none.

    Parameters
    ----------
    folder : Path, optional
        Folder to use; by default ``emulator`` in the folder that the environment variable ``COILARRAY_CACHE`` names,
        else in the user's cache folder. It may be deleted at any time.

    Raises
    ------
    OutputError
        The folder cannot be made.
    """
    import platformdirs

    if folder is None:
        named = os.environ.get(_FOLDER_VARIABLE)
        folder = (
            Path(named) if named else Path(platformdirs.user_cache_dir("coilarray", appauthor=False))
        ) / "emulator"
    make_folder(folder)
    return folder


def kept(folder: Path, kind: str, design: Design, what: str, compute: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Return what an earlier run computed, or compute and keep it.

    Parameters
    ----------
    folder : Path
        Folder of the file, as `keep_folder` returns it.
    kind : str
        First word of the name of the file.
    design : Design
        Design of the board.
    what : str
        Everything that determines the result besides the design and the code.
    compute : callable
        Function that computes the dataset if no file of it can be read.

    Returns
    -------
    xarray.Dataset
    """
    name = hashlib.sha256(f"{design.digest} {what}".encode()).hexdigest()[:24]
    where = folder / f"{kind}-{name}.nc"
    found = load_part(where)
    if found is None or found.attrs.get("code") != code_version():  # other code may compute other numbers
        found = compute().assign_attrs(code=code_version())
        save_dataset(found, where)
    return found
