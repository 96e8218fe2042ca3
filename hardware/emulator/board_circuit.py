"""The circuit of a design that an emulated board needs at every start: computed once and kept."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.ac_resistance import resistance_matrix
from coilarray.code_version import code_version
from coilarray.design import Design
from coilarray.files import make_folder
from coilarray.impedance import design_network
from coilarray.network import Network, resonate
from coilarray.storage import load_part, save_dataset

FloatArray = npt.NDArray[np.float64]

_FOLDER_VARIABLE = "COILARRAY_CACHE"
_RESISTANCE_POINTS = 9  # frequencies, as coilarray.impedance.scan_states has them
_RESISTANCE_REACH = 0.05  # relative, below the lowest resonance and above the highest


def keep_folder(folder: Path | None = None) -> Path:
    """Return the folder where parts of emulated boards are kept, made where there is none.

    Parameters
    ----------
    folder : Path, optional
        By default ``emulator`` in the folder that the environment variable ``COILARRAY_CACHE`` names, else in the
        user's cache folder. It may be deleted at any time.

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
        As `keep_folder` returns it.
    kind : str
        Begins the name of the file.
    design : Design
        Of the board.
    what : str
        All that decides the result besides the design and the code.
    compute : callable
        Called where nothing is kept that can be read.

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


def board_network(design: Design, folder: Path) -> Network:
    """Return the network of `coilarray.impedance.scan_design`: alternating-current resistances and all strays.

    Parameters
    ----------
    design : Design
        Of the board.
    folder : Path
        Where the parts are kept: 4 s of work for the six coils of gast2020.

    Raises
    ------
    NetworkError
        A state of the design's plan without a resonance.
    GeometryError
        As `coilarray.impedance.design_network`.
    """
    parts = kept(folder, "circuit", design, "", lambda: _circuit(design))
    return Network(
        design.array.names,
        parts.inductance.values,
        _interpolated(parts.frequency.values, parts.resistance.values),
        parts.winding_capacitance.values,
        parts.mutual_capacitance.values,
        design.circuit.switches,
    )


def _circuit(design: Design) -> xr.Dataset:
    network = design_network(design).network
    found = [resonate(network, state).frequency for state in design.circuit.plan]
    low, high = (1 - _RESISTANCE_REACH) * min(found), (1 + _RESISTANCE_REACH) * max(found)
    frequency = np.geomspace(low, high, _RESISTANCE_POINTS)
    resistance = resistance_matrix(design.array, frequency, design.circuit.resistivity).resistance.values
    pair = ("coil", "other")
    return xr.Dataset(
        {
            "inductance": (pair, network.inductance, {"units": "H"}),
            "resistance": (("frequency", *pair), resistance, {"units": "ohm"}),
            "winding_capacitance": ("coil", network.winding_capacitance, {"units": "F"}),
            "mutual_capacitance": (pair, network.mutual_capacitance, {"units": "F"}),
        },
        coords={"frequency": ("frequency", frequency, {"units": "Hz"})},
    )


def _interpolated(frequencies: FloatArray, resistances: FloatArray) -> Callable[[float], FloatArray]:
    """Resistance matrix at any frequency: linear between those computed, constant beyond."""
    places = np.arange(len(frequencies))

    def at(frequency: float) -> FloatArray:
        place = float(np.interp(frequency, frequencies, places))
        k = min(int(place), len(frequencies) - 2)
        return np.asarray((1 - (place - k)) * resistances[k] + (place - k) * resistances[k + 1])

    return at
