"""Response maps of arrays of 6 to 1024 coils: what a position costs, against taking all coils at every position.

Times are of the processor, all cores together: that of a difference of two maps would be lost in what else runs. Every
board has a process of its own, so that the peak of memory is the board's.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from speed import Speed, peak_memory

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.first_assumed import first_assumed, hexagonal

from coilarray.circuit.board_circuit import bare_network
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.state_sensitivity import state_sensitivity
from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design, Indentation
from coilarray.elastomer.dent import dent_of
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.electromagnetics.flat_stack import coil_segments, segment_centres
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import contact_at

# Positions along x of two maps, whose difference is what positions cost; both are large enough that the amplitudes
# come from tables, also with six coils, whose positions cost so little that it takes more of them.
_FEW = 300
_MANY = {6: 9000, 64: 750, 256: 750, 1024: 750}
_ACROSS = 40
_SPAN_X, _SPAN_Y = 54e-3, 6e-3  # m
_ALL = {6: 48, 64: 20, 256: 6}  # positions along x and along y where all coils are taken, some seconds of work
_GROWTH = 1.5  # at most, from 256 to 1024 coils, which have as many near them
_BOARD = "import sys; sys.path.insert(0, {folder!r}); import large_response; large_response.measure({count})"


@dataclass(frozen=True)
class Cost:
    """What a board costs.

    Parameters
    ----------
    position, first, matrix, circuit : float
        Processor time in s: of one more position, of the first `_FEW` × `_ACROSS` with all that comes before, and of
        the inductance matrix and the circuit, which are not counted in them.
    states, coils : int
        Largest number of states and of coils near a position.
    memory : float
        Peak of the process in MB with the first map.
    all_coils, error : float or None
        Processor time in s of a position with all coils, and the largest difference of δ in parts of the map's peak.
    """

    position: float
    first: float
    matrix: float
    circuit: float
    states: int
    coils: int
    memory: float
    all_coils: float | None
    error: float | None


def figures() -> Iterator[Speed]:
    """Time a position of boards of four sizes, its growth, and how far it is from taking all coils; 3 minutes."""
    costs = {count: _cost(count) for count in _MANY}
    for count, cost in costs.items():
        note = (
            f"{cost.states} states and {cost.coils} coils near; {cost.first:.1f} s for the first "
            f"{_FEW * _ACROSS}, {cost.matrix:.1f} s for the matrix, {cost.circuit:.1f} s for the circuit; peak memory "
            f"{cost.memory:.0f} MB"
        )
        yield Speed(f"response of {count} coils, one more position", 1e3 * cost.position, "ms", note)
    growth = costs[1024].position / costs[256].position
    yield Speed(
        "response, a position of 1024 coils over one of 256", growth, "×", "", f"≤ {_GROWTH:g} ×", growth <= _GROWTH
    )
    for count, cost in costs.items():
        if cost.all_coils is not None and cost.error is not None:
            note = f"{1e3 * cost.all_coils:.1f} ms with all coils; δ differs by {cost.error:.1e} of the peak"
            yield Speed(
                f"response of {count} coils against all coils", cost.all_coils / cost.position, "×", note,
                "δ to 1e-3", cost.error <= 1e-3,
            )  # fmt: skip


def measure(count: int) -> None:
    """Measure one board, and print its `Cost` as JSON."""
    columns = round(count**0.5)
    design = first_assumed() if count == 6 else hexagonal(columns, columns)
    begun = time.process_time()
    matrix = inductance_matrix(design.array, allow_overlaps=True)  # corners two rows apart meet, by 0.1 mm
    taken = time.process_time() - begun
    begun = time.process_time()
    design_circuit(design)  # kept in memory: the maps below find it
    circuit = time.process_time() - begun
    _warm_up()
    few, first = _timed(design, _FEW, matrix)
    memory = peak_memory()
    many, _ = _timed(design, _MANY[count], matrix)
    position = (many - few) / ((_MANY[count] - _FEW) * _ACROSS)
    peak = float(np.abs(first.delta).max())
    everything, error = _against_all(design, matrix, peak, _ALL[count]) if count in _ALL else (None, None)
    states, coils = (_most_within(design, first, first.attrs[f"{what}_cutoff_m"]) for what in ("state", "coil"))
    print(json.dumps(asdict(Cost(position, few, taken, circuit, states, coils, memory, everything, error))))


def _warm_up() -> None:
    """Load what is loaded on first use, with the smallest board."""
    design = first_assumed()
    _respond(design, *_places(design, 2, 1), inductance_matrix(design.array))


def _cost(count: int) -> Cost:
    """Measure one board in a process of its own."""
    code = _BOARD.format(folder=str(Path(__file__).parent), count=count)
    done = subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.PIPE, text=True)
    return Cost(**json.loads(done.stdout))


def _timed(design: Design, along: int, matrix: FloatArray) -> tuple[float, xr.Dataset]:
    begun = time.process_time()
    response = _respond(design, *_places(design, along, _ACROSS), matrix)
    return time.process_time() - begun, response


def _respond(design: Design, x: FloatArray, y: FloatArray, matrix: FloatArray) -> xr.Dataset:
    """Take the matrix of the bare board: the sheets' part of it costs the same with any method."""
    board = Imperfections(network=replace(design_circuit(design), inductance=matrix))
    return response_map(design, accuracy=1e-3, x=x, y=y, imperfections=board)


def _places(design: Design, along: int, across: int) -> tuple[FloatArray, FloatArray]:
    """Positions over the middle of the board."""
    low, high = design.array.centres.min(axis=0), design.array.centres.max(axis=0)
    middle = (low + high) / 2 - _setup(design).origin_point
    spans = ((_SPAN_X, along), (_SPAN_Y, across))
    x, y = (centre + span * ((np.arange(n) + 0.5) / n - 0.5) for centre, (span, n) in zip(middle, spans, strict=True))
    return x, y


def _setup(design: Design) -> Indentation:
    if design.indentation is None:
        raise RuntimeError(f"{design.name} has no indentation")
    return design.indentation


def _most_within(design: Design, response: xr.Dataset, distance: float) -> int:
    """Most coils within a distance in m of a position."""
    centres, _ = segment_centres(coil_segments(design.array))
    places = np.stack(np.meshgrid(response.x, response.y), axis=-1).reshape(-1, 1, 2) + _setup(design).origin_point
    within = np.hypot(*np.moveaxis(places - centres, -1, 0)) <= distance
    return int(within.sum(axis=1).max())


def _against_all(design: Design, matrix: FloatArray, peak: float, along: int) -> tuple[float, float]:
    """Compare with the inductance changes of all coils, without what the circuit would take: time and error of δ.

    The error is relative to the peak of the whole map, which few positions may miss.
    """
    setup = _setup(design)
    contact = contact_at(setup, design.sheets, setup.depths[:1])
    dent = dent_of(contact.isel(depth=0), design.sheets)
    R = dc_resistance(design.array.conductors(), design.circuit.resistivity)
    states = state_sensitivity(bare_network(design.array.names, matrix, R, design.circuit.switches), design.plan)
    x, y = _places(design, along, along)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + setup.origin_point
    begun = time.process_time()
    dent_inductance(design.array, [dent], places[: len(places) // 4])
    between = time.process_time()
    full = states.delta(dent_inductance(design.array, [dent], places)[0])
    taken = ((time.process_time() - between) - (between - begun)) / (len(places) * 3 / 4)
    found = _respond(design, x, y, matrix).delta.values[0].reshape(full.shape)
    return taken, float(np.abs(found - full).max()) / peak


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.value:.3g} {figure.unit} ({figure.note}) {figure.goal} {figure.kept}")
