"""Response maps of arrays of 6 to 1024 coils: what a position costs, against taking all coils at every position.

Times are of the processor, all cores together: that of a difference of two maps would be lost in what else runs.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import xarray as xr
from speed import Speed

from coilarray.design import Design, parse_design
from coilarray.designs import read
from coilarray.elastomer.contact import indent
from coilarray.elastomer.dent import dent_of
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.inductance import inductance_matrix
from coilarray.local_response import dense_response, local_response
from coilarray.resistance import dc_resistance
from coilarray.state_sensitivity import state_sensitivity

FloatArray = npt.NDArray[np.float64]

_LAYERS = {
    'lattice = "linear"': 'lattice = "hexagonal"',
    'layers = [["L1", "L2"], ["L3", "L4"]]': 'layers = [["L1", "L2"], ["L3", "L4"], ["L5", "L6"]]',
    'layers = ["L1", "L2", "L3", "L4"]': 'layers = ["L1", "L2", "L3", "L4", "L5", "L6"]',
    "[35, 35, 35, 35]": "[35, 35, 35, 35, 35, 35]",
    "[0.215, 0.215, 0.215]": "[0.215, 0.215, 0.215, 0.215, 0.215]",
    "[4.5, 4.5, 4.5]": "[4.5, 4.5, 4.5, 4.5, 4.5]",
}
_FEW, _MANY = 120, 360  # positions along x of two maps, whose difference is what positions cost
_ACROSS = 40
_ALL = 6  # positions along x and y where all coils are taken


def lattice(columns: int) -> Design:
    """Return a design of columns² coils of gast2020, on three pairs of layers in a hexagonal lattice."""
    lines = [line for line in read("gast2020").splitlines() if not line.startswith(('"indentation.origin"', "origin"))]
    text = "\n".join(lines).replace("columns = 6", f"columns = {columns}\nrows = {columns}")
    for old, new in _LAYERS.items():
        text = text.replace(old, new)
    return parse_design(text)


def figures() -> Iterator[Speed]:
    """Time a position of boards of four sizes, its growth, and how far it is from taking all coils."""
    boards = {6: parse_design(read("gast2020")), **{columns**2: lattice(columns) for columns in (8, 16, 32)}}
    times = {}
    for count, design in boards.items():
        x, y = _places(design)
        _respond(design, x[:1], y[:1])
        begun = time.process_time()
        first = _respond(design, x[:_FEW], y)
        between = time.process_time()
        _respond(design, x, y)
        times[count] = (time.process_time() - between - (between - begun)) / ((len(x) - _FEW) * len(y))
        note = (
            f"{first.sizes['near']} states within {first.attrs['state_reach_m'] * 1e3:.0f} mm, coils within "
            f"{first.attrs['coil_reach_m'] * 1e3:.0f} mm; {between - begun:.1f} s for the first {_FEW * len(y)}"
        )
        yield Speed(f"response of {count} coils, one more position", 1e3 * times[count], "ms", note)
    growth = times[1024] / times[256]
    yield Speed("response, a position of 1024 coils over one of 256", growth, "×", "", "≤ 1.5 ×", growth <= 1.5)
    for count in (6, 64, 256):
        yield _against_all(boards[count], times[count])


def _respond(design: Design, x: FloatArray, y: FloatArray) -> xr.Dataset:
    """Take the matrix of the bare board: the sheets' part of it costs the same with any method."""
    return local_response(design, x=x, y=y, inductance=lambda: inductance_matrix(design.array))


def _places(design: Design) -> tuple[FloatArray, FloatArray]:
    """Positions over the middle of the board, 0.15 mm apart."""
    low, high = design.array.centres.min(axis=0), design.array.centres.max(axis=0)
    middle = (low + high) / 2 - (0.0 if design.indentation is None else design.indentation.origin_point)
    return middle[0] + 1.5e-4 * (np.arange(_MANY) - _MANY / 2), middle[1] + 1.5e-4 * (np.arange(_ACROSS) - _ACROSS / 2)


def _against_all(design: Design, ours: float) -> Speed:
    """Compare with the inductance changes of all coils, without what the circuit would take."""
    setup = design.indentation
    assert setup is not None
    contact = indent(design.sheets, setup.indenter, setup.depths[:1], base=setup.base)
    dent = dent_of(contact.isel(depth=0), design.sheets)
    matrix = inductance_matrix(design.array)
    R = dc_resistance(design.array.conductors(), design.circuit.resistivity)
    states = state_sensitivity(design.array.names, matrix, R, design.circuit.switches, design.circuit.plan)
    x, y = (axis[:: len(axis) // _ALL][:_ALL] for axis in _places(design))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + setup.origin_point
    begun = time.process_time()
    dent_inductance(design.array, [dent], places[: len(places) // 4])
    between = time.process_time()
    full = states.delta(dent_inductance(design.array, [dent], places)[0])
    theirs = ((time.process_time() - between) - (between - begun)) / (len(places) * 3 / 4)
    local = dense_response(_respond(design, x, y))
    found = local.delta.values[0].reshape(full.shape)
    error = float(np.abs(found - full).max() / np.abs(full).max())
    note = f"{1e3 * theirs:.0f} ms with all coils; δ differs by {error:.0e} of the largest"
    return Speed(f"response of {len(matrix)} coils against all coils", theirs / ours, "×", note)
