"""Circuit of a design, with all its parts, made once.

The working frequency of the coils needs the plates, and the plates need the frequencies of the
coils. Both are found together, see `BoardCircuit.plates`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from threading import RLock
from typing import Any, Generic, TypeVar

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from coilarray.circuit.network import Network, SampledMatrix
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.store import kept_dataset
from coilarray.compute.threads import Progress, Recent, serial_algebra
from coilarray.design.model import Board, Design, DesignFile, design_of, digest_of
from coilarray.design.scan_states import ScanState, Switches
from coilarray.electromagnetics.capacitance import coil_capacitance
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.electromagnetics.inductance import Accuracy, inductance_matrix
from coilarray.electromagnetics.motion import moved_inductance
from coilarray.electromagnetics.resistance import dc_resistance, resistance_matrix
from coilarray.errors import GeometryError, NetworkError
from coilarray.geometry import Array, Conductor, FinitePlate, Plate, Pose, Sheet
from coilarray.metal.finite_plates import PlateError, moving_plate, outlined_inductance, worst_attributes
from coilarray.metal.flat_plates import plate_inductance
from coilarray.metal.frequencies import FrequencyBand

LEFT_OUT = ("alternating-current resistance of the copper", "stray capacitances and inductances")
"""Effects that an ideal network leaves out."""
_OTHERS_COPPER = "losses in the copper of other coils"
_BEND_LEFT_OUT = "change of the resistance and capacitance of the windings by the bend of the board"
_PLATES_LEFT_OUT = ("change of the losses in the copper by the plates", "capacitance of the plates")
_BETWEEN_BOARDS = ("capacitance between boards", "losses in the copper of other boards")
_RESISTANCE_POINTS = 9
_MARGIN = 0.05  # relative margin of a frequency. Alternating-current resistance shifts a resonance by far less
_PLATES_MARGIN = 0.2  # relative margin of a frequency. Strays seldom lower a resonance by more
_MOST_TOGETHER = 24  # coils whose currents heat each other's copper, and of which results are kept on disk
_STEP = 0.0125  # of log f, between samples of the plates' effect and of resistance beyond the resonances
_ROUNDS = 8

_KEPT: Recent[Any] = Recent(8)  # circuits of the last designs, and windings of many coils
_BOARDS: Recent[Any] = Recent(128)  # windings of few coils, as a design may have many boards
Result = TypeVar("Result")


def board_circuit(
    design: Design | DesignFile, *, accuracy: Accuracy = "full", progress: Progress | None = None
) -> BoardCircuit:
    """Return the circuit of a design, always the same object."""
    design = design_of(design)

    def make() -> BoardCircuit:
        each = [_windings(board.design, accuracy, progress) for board in design.placed]
        return BoardCircuit(design, each[0] if len(each) == 1 else _joined_windings(design, each, accuracy, progress))

    circuit: BoardCircuit = _KEPT.get((design.digest, accuracy), make)
    return circuit


def _windings(design: Design, accuracy: Accuracy, progress: Progress | None) -> Windings:
    """Return the windings of an array under its flat sheets, always the same object."""
    above = design.circuit.elastomer_permittivity if design.sheets else 1.0
    key = (digest_of(design.array, design.sheets, above), accuracy)
    kept = _BOARDS if len(design.array.names) <= _MOST_TOGETHER else _KEPT
    windings: Windings = kept.get(key, lambda: _new_windings(design.array, design.sheets, above, accuracy, progress))
    return windings


def _new_windings(
    array: Array, sheets: tuple[Sheet, ...], above: float, accuracy: Accuracy, progress: Progress | None
) -> Windings:

    def compute() -> xr.Dataset:
        by_sheets = layer_inductance(array.conductors(), sheets, accuracy=accuracy)
        # Overlapping copper is a rule that a search breaks on its way and that a command may allow.
        L = inductance_matrix(array.conductors(), accuracy=accuracy, allow_overlaps=True, progress=progress)
        pair = ("coil", "other")
        return xr.Dataset({"inductance": (pair, L + by_sheets), "by_sheets": (pair, by_sheets)})

    found = _kept(array, accuracy, ("inductance", digest_of(array, sheets)), compute)
    L, by_sheets = found.inductance.values, found.by_sheets.values
    return Windings(array=array, sheets=sheets, above=above, accuracy=accuracy, inductance=L, by_sheets=by_sheets)


def _joined_windings(
    design: Design, each: Sequence[Windings], accuracy: Accuracy, progress: Progress | None
) -> JoinedWindings:
    placed, paths = design.placed, design.conductors()

    def compute() -> xr.Dataset:
        L = block_diag(*(one.inductance - one.by_sheets for one in each))
        ends = np.cumsum([0, *(len(board.array.names) for board in placed)]).tolist()
        for number, (start, end) in enumerate(pairwise(ends[:-1]), start=1):
            (M,) = moved_inductance(paths[start:end], paths[end:], Pose())
            L[start:end, end:], L[end:, start:end] = M, M.T
            if progress is not None:
                progress(number, len(placed) - 1)
        by_sheets = layer_inductance(paths, design.sheets, accuracy=accuracy)
        pair = ("coil", "other")
        return xr.Dataset({"inductance": (pair, L + by_sheets), "by_sheets": (pair, by_sheets)})

    parts = (
        "boards",
        [digest_of(one.array) for one in each],
        digest_of([board.pose for board in placed], design.sheets),
    )
    found = kept_dataset(parts, compute) if accuracy == "full" else compute()
    L, by_sheets = found.inductance.values, found.by_sheets.values
    return JoinedWindings(
        boards=placed, each=tuple(each), sheets=design.sheets, accuracy=accuracy, inductance=L, by_sheets=by_sheets
    )


def _kept(array: Array, accuracy: Accuracy, parts: Sequence[Any], compute: Callable[[], xr.Dataset]) -> xr.Dataset:
    few = accuracy == "full" and len(array.names) <= _MOST_TOGETHER
    return kept_dataset(parts, compute) if few else compute()


class _computed_once(Generic[Result]):  # noqa: N801
    """Property that one thread computes while the others wait."""

    def __init__(self, compute: Callable[[Any], Result]) -> None:
        self._compute, self.__doc__ = compute, compute.__doc__

    def __get__(self, instance: _Locked, owner: type[_Locked]) -> Result:
        with instance.lock:
            known, name = instance.__dict__, self._compute.__name__
            if name not in known:
                with serial_algebra():
                    known[name] = self._compute(instance)
            return known[name]  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Locked:
    lock: Any = field(default_factory=RLock, repr=False)


@dataclass(frozen=True, eq=False, kw_only=True)
class _AllWindings(_Locked):
    """Coils under flat sheets.

    `inductance` (n, n) in H is without plates. `by_sheets` is its part due to the magnetic sheets.
    """

    sheets: tuple[Sheet, ...]
    accuracy: Accuracy
    inductance: FloatArray
    by_sheets: FloatArray

    @property
    @abstractmethod
    def paths(self) -> tuple[Conductor, ...]:
        """Current paths in space, in m."""

    def plate_effect(self, plates: Sequence[Plate | FinitePlate], low: float, high: float) -> Plates:
        """Effect of plates between two frequencies in Hz, working in their middle."""
        band, paths = FrequencyBand(low, high), self.paths
        infinite = [plate for plate in plates if isinstance(plate, Plate)]
        change = plate_inductance(paths, infinite, band.nodes, self.sheets, accuracy=self.accuracy)
        if len(infinite) < len(plates):
            change = change + outlined_inductance(paths, plates, band.nodes, self.sheets)
        return Plates(band, change, math.sqrt(low * high))


@dataclass(frozen=True, eq=False, kw_only=True)
class Windings(_AllWindings):
    """Coils of one board, which several circuits share.

    `above` is the relative permittivity above the board.
    """

    array: Array
    above: float

    @property
    def paths(self) -> tuple[Conductor, ...]:
        """Current paths in m."""
        return self.array.conductors()

    @_computed_once
    def capacitance(self) -> tuple[xr.Dataset | None, str]:
        """Return `coil_capacitance`, or the reason why there is none."""
        try:
            return kept_dataset(
                ("capacitance", digest_of(self.array.flat, self.sheets, self.above)),
                lambda: coil_capacitance(self.array, self.sheets, relative_permittivity=self.above),
            ), ""
        except GeometryError as error:
            return None, f"capacitance of the windings: {error}"

    def resistance(self, frequencies: FloatArray, resistivity: float) -> xr.Dataset:
        """Resistance matrix (f, n, n) in Ω, of more than 24 coils without losses in others."""
        alone = len(self.array.names) > _MOST_TOGETHER
        parts = ("resistance", digest_of(self.array.flat, frequencies.tolist(), resistivity))
        work = partial(resistance_matrix, self.array, frequencies, resistivity, alone=alone)
        return _kept(self.array, self.accuracy, parts, work)


@dataclass(frozen=True, eq=False, kw_only=True)
class JoinedWindings(_AllWindings):
    """Coils of several boards.

    Capacitances and losses of each board's copper are the same as alone.
    """

    boards: tuple[Board, ...]
    each: tuple[Windings, ...]

    @property
    def paths(self) -> tuple[Conductor, ...]:
        """Current paths of all boards in space, in m."""
        return tuple(path for board in self.boards for path in board.conductors())

    @_computed_once
    def capacitance(self) -> tuple[xr.Dataset | None, str]:
        """Join `coil_capacitance` of the boards, or return the reason why there is none."""
        found = []
        for one, board in zip(self.each, self.boards, strict=True):
            dataset, problem = one.capacitance
            if dataset is None:
                return None, f"{problem} ({board.prefix}{'' if board.name else 'own board'})"
            found.append(dataset)
        single = np.concatenate([one.coil_capacitance.values for one in found])
        whole = block_diag(*(one.capacitance.values for one in found))
        return xr.Dataset({"coil_capacitance": ("coil", single), "capacitance": (("coil", "other"), whole)}), ""

    def resistance(self, frequencies: FloatArray, resistivity: float) -> xr.Dataset:
        """Join the resistance matrices (f, n, n) in Ω, each with the resistivity of its board."""
        pairs = zip(self.each, self.boards, strict=True)
        found = [one.resistance(frequencies, board.design.circuit.resistivity) for one, board in pairs]
        whole = np.array([block_diag(*(one.resistance.values[k] for one in found)) for k in range(len(frequencies))])
        model = np.concatenate([one.model.values for one in found], axis=1)
        return xr.Dataset(
            {"resistance": (("frequency", "coil", "other"), whole), "model": (("frequency", "coil"), model)},
            {"frequency": frequencies},
        )


@dataclass(frozen=True, eq=False)
class Plates:
    """Change of the impedance over jω by plates in H, and the frequency that L holds for."""

    band: FrequencyBand
    samples: ComplexArray
    working: float

    def at(self, frequencies: FloatArray) -> ComplexArray:
        """Change (f, n, n) in H at frequencies in Hz."""
        return np.asarray(np.tensordot(self.band.shares(frequencies), self.samples, axes=1))

    def losses(self, frequencies: FloatArray) -> FloatArray:
        """Resistance matrices (f, n, n) in Ω at frequencies in Hz."""
        return -2 * np.pi * frequencies[:, None, None] * self.at(frequencies).imag

    def dispersion(self, frequencies: FloatArray) -> SampledMatrix:
        """Inductance less its value at the working frequency, in H."""
        return SampledMatrix(frequencies, self.at(frequencies).real - self.inductance)

    @property
    def inductance(self) -> FloatArray:
        """Change of the inductance in H at the working frequency."""
        return np.asarray(self.at(np.array([self.working]))[0].real)

    @property
    def resistance(self) -> FloatArray:
        """Resistance matrix in Ω at the working frequency."""
        return np.asarray(self.losses(np.array([self.working]))[0])

    @property
    def grid(self) -> FloatArray:
        """Frequencies in Hz between which the effect is nearly linear."""
        return _close_together(self.band.low, self.band.high)


@dataclass(frozen=True, eq=False)
class BoardCircuit(_Locked):
    """Circuit of a design, its parts computed when needed."""

    design: Design
    windings: Windings | JoinedWindings
    _errors: dict[float, dict[str, PlateError]] = field(default_factory=dict, repr=False)

    @property
    def inductance(self) -> FloatArray:
        """Inductance matrix in H, with plates at the working frequency."""
        own = self.windings.inductance
        return own if self.plates is None else own + self.plates.inductance

    @_computed_once
    def direct_resistance(self) -> FloatArray:
        """Direct-current resistance (n,) of each coil in Ω."""
        each = [dc_resistance(board.array, board.design.circuit.resistivity) for board in self.design.placed]
        return np.concatenate(each)

    @_computed_once
    def plates(self) -> Plates | None:
        """Effect of the plates around the resonances, if any.

        The working frequency is the geometric mean of the resonances of the scan plan without
        strays.
        """
        if not self.design.plates:
            return None
        bare, plan = self._bare(self.windings.inductance), self.design.plan
        middle = math.sqrt(math.prod(_band(bare, plan, 0.0)))
        # a guess needs no more than screening
        guess = replace(self.windings, accuracy="screen").plate_effect(self.design.plates, middle, middle)
        plates, network = self._followed(bare, guess)
        logarithms = np.log([one.frequency for one in resonances(network, plan)])
        return replace(plates, working=float(np.exp(logarithms.mean())))

    @_computed_once
    def ideal(self) -> Network:
        """Network of direct-current copper and plates without strays."""
        network = self._bare(self.inductance)
        if self.plates is None:
            return network
        return _sampled(network, self.plates.grid, np.diag(self.direct_resistance)[None], self.plates)

    def _bare(self, inductance: FloatArray) -> Network:
        switches = self.design.circuit.switches
        return bare_network(self.design.coil_names, inductance, self.direct_resistance, switches)

    @_computed_once
    def _direct(self) -> tuple[Network, Plates | None]:
        """Network of direct-current copper with strays, and its plates."""
        capacitance, problem = self.windings.capacitance
        left_out = (LEFT_OUT[0], *([problem] if problem else []), *(_PLATES_LEFT_OUT if self.plates else ()))
        left_out += () if all(board.array.form is None for board in self.design.placed) else (_BEND_LEFT_OUT,)
        left_out += _BETWEEN_BOARDS if self.design.boards else ()
        network = replace(
            self._bare(self.windings.inductance), switches=self.design.circuit.switches, left_out=left_out
        )
        if capacitance is not None:
            winding, between = capacitance.coil_capacitance.values, -capacitance.capacitance.values
            between = np.maximum(0.5 * (between + between.T), 0.0)  # removes rounding
            network = replace(network, winding_capacitance=winding, mutual_capacitance=between)
        if self.plates is None:
            return network, None
        plates, network = self._followed(network, self.plates, self.plates.working)
        return network, plates

    @property
    def direct(self) -> Network:
        """Network with all strays and direct-current copper."""
        return self._direct[0]

    @_computed_once
    def resistance(self) -> xr.Dataset:
        """Return `resistance_matrix` at the frequencies of the network."""
        design, direct = self.design, self.direct
        low, high = _band(direct, design.plan)
        apart = {_key_of(state): state for state in design.coils_in_turn}
        for state in design.plan:
            apart.pop(_key_of(state), None)
        if apart:
            lowest, highest = _band(direct, tuple(apart.values()), 0.0)
            if lowest < low or highest > high:  # coils by themselves far from the states of the plan
                low, high = min(low, (1 - _MARGIN) * lowest), max(high, (1 + _MARGIN) * highest)
        return self.windings.resistance(np.geomspace(low, high, _RESISTANCE_POINTS), design.circuit.resistivity)

    @_computed_once
    def network(self) -> Network:
        """Network with all losses, sampled around the resonances, and strays."""
        direct, plates = self._direct
        others = (_OTHERS_COPPER,) if len(direct.names) > _MOST_TOGETHER else ()
        network = replace(direct, left_out=(*others, *direct.left_out[1:]))
        return _sampled(network, self.resistance.frequency.values, self.resistance.resistance.values, plates)

    def swept(self, frequencies: FloatArray, network: Network | None = None) -> Network:
        """Network, by default `network`, sampled at rising frequencies (f,) in Hz."""
        network = network or self.network
        R, plates = np.diag(self.direct_resistance)[None], self.plates
        if LEFT_OUT[0] not in network.left_out:
            R = self.windings.resistance(frequencies, self.design.circuit.resistivity).resistance.values
        if plates is not None:
            low, high = (extreme(*frequencies[[0, -1]].tolist(), plates.working) for extreme in (min, max))
            plates = replace(self.windings.plate_effect(self.design.plates, low, high), working=plates.working)
        return _sampled(network, frequencies, R, plates)

    def widened(self, network: Network, low: float, high: float) -> Network:
        """Add samples of resistance and plates between frequencies in Hz."""
        own = network.resistance
        if not isinstance(own, SampledMatrix) or len(own.frequencies) == 1:
            return network
        ends = own.frequencies[[0, -1]].tolist()
        below = _close_together(low, ends[0])[:-1] if low < ends[0] else np.zeros(0)
        above = _close_together(ends[1], high)[1:] if high > ends[1] else np.zeros(0)
        more = np.concatenate((below, above))
        if not len(more):
            return network
        beyond = self.swept(more, network)
        assert isinstance(beyond.resistance, SampledMatrix)
        dispersion = beyond.dispersion
        if dispersion is not None and network.dispersion is not None:
            dispersion = _joined(network.dispersion, dispersion)
        return replace(network, resistance=_joined(own, beyond.resistance), dispersion=dispersion)

    def _followed(self, network: Network, plates: Plates, working: float | None = None) -> tuple[Plates, Network]:
        """Compute the plates around the resonances beside them.

        `plates` are a first guess. The network gets their inductance at the working frequency in
        Hz, by default in the middle of the band.
        """
        states = (*self.design.plan, *self.design.coils_in_turn)
        for _ in range(_ROUNDS):
            dispersion = plates.dispersion(plates.grid)
            beside = replace(network, inductance=network.inductance + plates.inductance, dispersion=dispersion)
            low, high = _band(beside, states)
            if working is not None:
                low, high = min(low, working), max(high, working)
            if plates.band.holds(np.array([low, high])):
                return plates, beside
            low, high = (1 - _PLATES_MARGIN) * low, (1 + _PLATES_MARGIN) * high
            plates = self.windings.plate_effect(self.design.plates, low, high)
            plates = plates if working is None else replace(plates, working=working)
        raise NetworkError(
            f"beside the plates the coils oscillate at {low:.6g} to {high:.6g} Hz, outside the {_ROUNDS} bands of "
            "frequency in which the plates were computed."
        )

    def plate_errors(self, frequency: float) -> dict[str, PlateError]:
        """Errors of every plate with an outline, each alone."""
        design = self.design
        with self.lock:
            if frequency not in self._errors:
                self._errors[frequency] = {
                    one.name: moving_plate(self.windings.paths, one, [one.centre], [frequency], design.sheets)
                    for one in design.plates
                    if isinstance(one, FinitePlate)
                }
            return self._errors[frequency]

    @property
    def plate_error_attributes(self) -> dict[str, float]:
        """Attributes for the errors of plates with an outline."""
        return worst_attributes([] if self.plates is None else list(self.plate_errors(self.plates.working).values()))


def bare_network(names: Sequence[str], inductance: FloatArray, resistance: FloatArray, switches: Switches) -> Network:
    """Make a network of coils, closed switches and a tank.

    The tank lies across the converter. The inductance matrix (n, n) in H and the resistance (n,) in
    Ω are the same at all frequencies.
    """
    none = np.zeros_like(inductance)
    plain = Switches(on_resistance=switches.on_resistance, tank_capacitance=switches.tank_capacitance)
    constant = SampledMatrix(np.ones(1), np.diag(resistance)[None])
    return Network(tuple(names), inductance, constant, none[0], none, plain, LEFT_OUT)


def _sampled(network: Network, frequencies: FloatArray, R: FloatArray, plates: Plates | None) -> Network:
    """Replace the resistance by R (f, n, n), with plates."""
    if plates is None:
        return replace(network, resistance=SampledMatrix(frequencies, R), dispersion=None)
    return replace(
        network,
        resistance=SampledMatrix(frequencies, R + plates.losses(frequencies)),
        dispersion=plates.dispersion(frequencies),
    )


def _band(network: Network, states: Sequence[ScanState], margin: float = _MARGIN) -> tuple[float, float]:
    """Frequencies in Hz at which states oscillate, with a margin."""
    found = [one.frequency for one in resonances(network, states)]
    return (1 - margin) * min(found), (1 + margin) * max(found)


def _close_together(low: float, high: float) -> FloatArray:
    """Frequencies in Hz between which linear quantities err by 2e-5 of their curvature."""
    return np.geomspace(low, high, math.ceil(math.log(high / low) / _STEP) + 1)


def _joined(one: SampledMatrix, other: SampledMatrix) -> SampledMatrix:
    frequencies = np.concatenate((one.frequencies, other.frequencies))
    order = frequencies.argsort()
    return SampledMatrix(frequencies[order], np.concatenate((one.matrices, other.matrices))[order])


def _key_of(state: ScanState) -> Hashable:
    exceptions = frozenset((name, passive) for name, passive in state.exceptions.items() if passive != state.others)
    return state.measured, state.connection, state.others, exceptions, state.load_resistance
