"""Circuit of a design and the coupling of its coils.

The circuit consists of the inductance matrix and the network with all losses and strays.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from importlib import metadata

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.active_coil import Termination, checked_network, checked_terminations
from coilarray.circuit.network import Network, Resonance, SampledMatrix
from coilarray.circuit.plates import PlateEffect, plate_effect, plate_errors_by_name
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.compute.recent import Recent
from coilarray.compute.store import kept_dataset
from coilarray.compute.threads import Progress, serial_algebra
from coilarray.design.digest import digest_of
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.design.scan_states import ScanState, Switches
from coilarray.electromagnetics.ac_resistance import resistance_matrix, shape_key
from coilarray.electromagnetics.capacitance import coil_capacitance
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix, inductance_matrix
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import GeometryError, NetworkError
from coilarray.geometry import CoilArray
from coilarray.metal.finite_plates import worst_attributes

LEFT_OUT = ("alternating-current resistance of the copper", "stray capacitances and inductances")
"""Effects that an ideal network leaves out."""
_RESISTANCE_POINTS = 9
_MARGIN = 0.05  # relative margin of a frequency; alternating-current resistance shifts a resonance by far less
_MOST_TOGETHER = 24  # coils whose currents heat each other's copper; the work grows with their square
_OTHERS_COPPER = "losses in the copper of other coils"
_PLATES_LEFT_OUT = ("change of the losses in the copper by the plates", "capacitance of the plates")
_KEPT = 4  # designs whose circuit is kept in memory
_PLATES_MARGIN = 0.2  # relative margin of a frequency; strays seldom lower a resonance by more
_STEP = 0.0125  # of log f, between samples of the plates' effect and of resistance beyond the resonances
_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class CircuitParts:
    """Network of a design with all losses, and its parts.

    The network includes all strays. `direct` is the network with direct-current resistances. `capacitance` is the
    result of `coilarray.electromagnetics.capacitance.coil_capacitance`, or None if a coil has no capacitance model.
    `resistance` is the result of `coilarray.electromagnetics.ac_resistance.resistance_matrix` at the network's
    frequencies.
    """

    network: Network
    direct: Network
    capacitance: xr.Dataset | None
    resistance: xr.Dataset


@dataclass(frozen=True, eq=False)
class Plates:
    """Effect of a design's plates over frequency.

    `working` is the frequency in Hz at which the coils work.
    """

    effect: PlateEffect
    working: float

    @property
    def inductance(self) -> FloatArray:
        """Change of the inductance matrix in H at working frequency."""
        return np.asarray(self.effect.at(np.array([self.working]))[0].real)

    @property
    def grid(self) -> FloatArray:
        """Frequencies in Hz between which the effect is nearly linear."""
        return _close_together(self.effect.band.low, self.effect.band.high)

    @property
    def resistance(self) -> FloatArray:
        """Resistance matrix in Ω of the plates at working frequency."""
        return np.asarray(self.effect.resistance(np.array([self.working]))[0])


# Keyed by their inputs, so designs that differ only in their circuit share them.
_INDUCTANCES: Recent[tuple[FloatArray, FloatArray]] = Recent(_KEPT)
_CAPACITANCES: Recent[xr.Dataset] = Recent(_KEPT)
_PARTS: Recent[CircuitParts] = Recent(_KEPT)
_PLATES: Recent[Plates] = Recent(_KEPT)


def design_circuit(
    design: Design | DesignFile, *, ideal: bool = False, accuracy: Accuracy = "full", progress: Progress | None = None
) -> Network:
    """Make the network of a design.

    It consists of the coils, the switches and the tank.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board, for example from `coilarray.load_design`.
    ideal : bool
        Leave out the alternating-current resistance of the copper, the capacitance of the windings and all strays of
        the switches. The effect of plates remains, including their losses.
    accuracy : {"full", "screen"}
        Accuracy of the inductance matrix, see `coilarray.inductance_matrix`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    Network
        Its ``left_out`` lists the effects that it lacks. The resistance matrix is interpolated around the resonances of
        the design's scan plan. The network is kept in memory, so a second call for the same design costs nothing.

    Raises
    ------
    NetworkError
        A state of the design's scan plan without a resonance.

    Notes
    -----
    A coil without turns beside each other has no capacitance model. The network then has no winding capacitance at all.
    In an array of more than 24 coils the losses of a coil's field in the copper of other coils (1 % of its resistance
    in gast2020) are left out.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.circuit.network import resonate
    >>> design = load_design("gast2020")
    >>> ideal = resonate(design_circuit(design, ideal=True), design.plan[0])
    >>> round(ideal.effective_inductance * 1e6, 2), round(ideal.frequency / 1e6, 3)
    (92.5, 1.511)
    """
    design = design_of(design)
    if not ideal:
        return circuit_parts(design, accuracy=accuracy, progress=progress).network
    R = dc_resistance(design.array.conductors(), design.circuit.resistivity)
    inductance = design_inductance(design, accuracy=accuracy, progress=progress)[0]
    network = bare_network(design.array.names, inductance, R, design.circuit.switches)
    plates = design_plates(design, accuracy=accuracy)
    return network if plates is None else _sampled(network, plates.grid, np.diag(R)[None], plates)


def bare_network(names: Sequence[str], inductance: FloatArray, resistance: FloatArray, switches: Switches) -> Network:
    """Make a network of coils, closed switches and tank only.

    The tank lies across the converter. The inductance matrix (n, n) is in H. The resistance of each coil (n,) in Ω is
    the same at all frequencies. The strays of the switches are left out.
    """
    none = np.zeros_like(inductance)
    plain = Switches(on_resistance=switches.on_resistance, tank_capacitance=switches.tank_capacitance)
    constant = SampledMatrix(np.ones(1), np.diag(resistance)[None])
    return Network(tuple(names), inductance, constant, none[0], none, plain, LEFT_OUT)


def circuit_parts(design: Design, *, accuracy: Accuracy = "full", progress: Progress | None = None) -> CircuitParts:
    """Return the network of `design_circuit` with its parts.

    Parameters
    ----------
    design, accuracy, progress
        See `design_circuit`.
    """
    return _PARTS.get((design.digest, accuracy), lambda: _circuit_parts(design, accuracy, progress))


@serial_algebra()
def _circuit_parts(design: Design, accuracy: Accuracy, progress: Progress | None) -> CircuitParts:
    """Compute the network of a design and its parts."""
    names, circuit = design.array.names, design.circuit
    winding, between = np.zeros(len(names)), np.zeros((len(names), len(names)))
    capacitance, problem = design_capacitance(design)
    if capacitance is not None:
        winding, between = capacitance.coil_capacitance.values, -capacitance.capacitance.values
        between = np.maximum(0.5 * (between + between.T), 0.0)  # removes rounding
    R = dc_resistance(design.array.conductors(), circuit.resistivity)
    plates = design_plates(design, accuracy=accuracy)
    counted = None if progress is None else lambda done, total: progress(done, 2 * total)
    direct = Network(
        names,
        design_inductance(design, accuracy=accuracy, progress=counted)[0],
        SampledMatrix(np.ones(1), np.diag(R)[None]),
        winding,
        between,
        circuit.switches,
        (
            LEFT_OUT[0],
            *([problem] if problem else []),
            *(_PLATES_LEFT_OUT if plates else ()),
        ),
    )
    if plates is not None:
        effect, direct = _followed(
            design,
            replace(direct, inductance=_without_plates(design, accuracy)[0]),
            plates.effect,
            accuracy,
            plates.working,
        )
        plates = replace(plates, effect=effect)
    low, high = _band(direct, design.plan)
    apart = {_key_of(state): state for state in design.coils_in_turn}
    for state in design.plan:
        apart.pop(_key_of(state), None)
    if apart:
        lowest, highest = _band(direct, tuple(apart.values()), 0.0)
        if lowest < low or highest > high:  # coils by themselves far from the states of the plan
            low, high = min(low, (1 - _MARGIN) * lowest), max(high, (1 + _MARGIN) * highest)
    grid = np.geomspace(low, high, _RESISTANCE_POINTS)
    resistance = _circuit_resistance(design, grid)
    if progress is not None:
        progress(2, 2)
    left_out = () if len(names) <= _MOST_TOGETHER else (_OTHERS_COPPER,)
    network = _sampled(
        replace(direct, left_out=(*left_out, *direct.left_out[1:])), grid, resistance.resistance.values, plates
    )
    return CircuitParts(network, direct, capacitance, resistance)


def design_capacitance(design: Design) -> tuple[xr.Dataset | None, str]:
    """Return the result of `coil_capacitance` for a design.

    If it has no model, return None and the reason.
    """
    try:
        above = permittivity_above(design)
        digest = digest_of(design.array, design.sheets, above)
        return _CAPACITANCES.get(
            digest,
            lambda: kept_dataset(
                ("capacitance", digest),
                lambda: coil_capacitance(design.array, design.sheets, relative_permittivity=above),
            ),
        ), ""
    except GeometryError as error:
        return None, f"capacitance of the windings: {error}"


def _sampled(network: Network, frequencies: FloatArray, R: FloatArray, plates: Plates | None) -> Network:
    """Return a network with sampled resistance and plate effect.

    The resistance R (f, n, n) of its coils is in Ω, at the given frequencies.
    """
    resistance, dispersion = _samples(frequencies, R, plates)
    return replace(network, resistance=resistance, dispersion=dispersion)


def _samples(
    frequencies: FloatArray, R: FloatArray, plates: Plates | None
) -> tuple[SampledMatrix, SampledMatrix | None]:
    """Resistance and dispersion of a network.

    See `_sampled`.
    """
    if plates is None:
        return SampledMatrix(frequencies, R), None
    resistance = SampledMatrix(frequencies, R + plates.effect.resistance(frequencies))
    return resistance, plates.effect.dispersion(frequencies, plates.working)


def _band(network: Network, states: Sequence[ScanState], margin: float = _MARGIN) -> tuple[float, float]:
    """Frequency band in Hz of states, with a margin.

    It reaches from the lowest to the highest frequency at which the states oscillate.
    """
    found = [one.frequency for one in resonances(network, states)]
    return (1 - margin) * min(found), (1 + margin) * max(found)


def _close_together(low: float, high: float) -> FloatArray:
    """Frequencies in Hz a `_STEP` apart or less.

    A quantity linear between them errs by 2e-5 of its curvature.
    """
    return np.geomspace(low, high, math.ceil(math.log(high / low) / _STEP) + 1)


def swept_circuit(design: Design, frequencies: FloatArray, accuracy: Accuracy = "full") -> Network:
    """Return the network of `design_circuit` at given frequencies.

    Its resistance matrix is computed at rising frequencies (f,) in Hz. It is linear between them and constant beyond.
    """
    R = _circuit_resistance(design, frequencies).resistance.values
    plates = design_plates(design, accuracy=accuracy)
    if plates is not None:
        plates = _plates_at(design, plates, frequencies, accuracy)
    return _sampled(design_circuit(design, accuracy=accuracy), frequencies, R, plates)


def _plates_at(design: Design, plates: Plates, frequencies: FloatArray, accuracy: Accuracy = "full") -> Plates:
    """Return the plates' effect at rising frequencies (f,) in Hz.

    The band includes the working frequency.
    """
    low, high = (extreme(*frequencies[[0, -1]].tolist(), plates.working) for extreme in (min, max))
    return replace(plates, effect=plate_effect(design, low, high, accuracy))


def widened(design: Design, network: Network, low: float, high: float, accuracy: Accuracy = "full") -> Network:
    """Return a network of a design with more samples.

    The samples reach from a frequency `low` to a frequency `high` in Hz. The network's own samples remain. An ideal
    network without plates is the same at all frequencies. The `accuracy` is the accuracy of the network's inductance.
    """
    own = network.resistance
    if not isinstance(own, SampledMatrix) or len(own.frequencies) == 1:
        return network
    ends = own.frequencies[[0, -1]].tolist()
    below = _close_together(low, ends[0])[:-1] if low < ends[0] else np.zeros(0)
    above = _close_together(ends[1], high)[1:] if high > ends[1] else np.zeros(0)
    more = np.concatenate((below, above))
    if not len(more):
        return network
    if LEFT_OUT[0] in network.left_out:
        R = np.diag(dc_resistance(design.array.conductors(), design.circuit.resistivity))[None]
    else:
        R = _circuit_resistance(design, more).resistance.values
    plates = design_plates(design, accuracy=accuracy)
    resistance, dispersion = _samples(more, R, None if plates is None else _plates_at(design, plates, more, accuracy))
    if dispersion is not None and network.dispersion is not None:
        dispersion = _joined(network.dispersion, dispersion)
    return replace(network, resistance=_joined(own, resistance), dispersion=dispersion)


def _joined(one: SampledMatrix, other: SampledMatrix) -> SampledMatrix:
    """Join the samples of two matrices at different frequencies."""
    frequencies = np.concatenate((one.frequencies, other.frequencies))
    order = frequencies.argsort()
    return SampledMatrix(frequencies[order], np.concatenate((one.matrices, other.matrices))[order])


def _circuit_resistance(design: Design, frequencies: FloatArray) -> xr.Dataset:
    """Resistance matrix of a design's coils.

    In an array of more than `_MOST_TOGETHER` coils, each coil is computed alone.
    """
    every = len(design.array.names) <= _MOST_TOGETHER
    return (resistance_matrix if every else _own_resistance)(design.array, frequencies, design.circuit.resistivity)


def _own_resistance(array: CoilArray, grid: FloatArray, resistivity: float) -> xr.Dataset:
    """Resistance matrix without losses in the copper of others.

    The format is as in `resistance_matrix`. Equal coils are computed once.
    """
    conductors = array.conductors()
    known: dict[bytes, xr.Dataset] = {}
    own = []
    for conductor in conductors:
        key = shape_key(conductor)
        if key not in known:
            known[key] = resistance_matrix([conductor], grid, resistivity)
        own.append(known[key])
    R = np.zeros((len(grid), len(own), len(own)))
    number = np.arange(len(own))
    R[:, number, number] = np.concatenate([one.resistance.values[:, 0] for one in own], axis=1)
    model = np.concatenate([one.model.values for one in own], axis=1)
    names = list(array.names)
    return xr.Dataset(
        {"resistance": (("frequency", "coil", "other"), R), "model": (("frequency", "coil"), model)},
        coords={"frequency": grid, "coil": names, "other": names},
    )


def _key_of(state: ScanState) -> Hashable:
    """Return a key of a state without its name."""
    exceptions = frozenset((name, passive) for name, passive in state.exceptions.items() if passive != state.others)
    return state.measured, state.connection, state.others, exceptions, state.load_resistance


def permittivity_above(design: Design) -> float:
    """Relative permittivity above the board.

    It is the permittivity of air if the board has no elastomer.
    """
    return design.circuit.elastomer_permittivity if design.sheets else 1.0


def couple_design(design: Design | DesignFile, *, ideal: bool = False, progress: Progress | None = None) -> xr.Dataset:
    """Compute the coupling of a design.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board, for example from `coilarray.load_design`.
    ideal : bool
        Leave out alternating-current resistance of the copper and all strays, see `design_circuit`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        The variables of `couple`, under the flat sheets and as the converter sees them, and

        - ``ideal_effective_inductance`` in H and ``ideal_frequency`` in Hz (coil): the same with the direct-current
          resistance of the copper and without strays,
        - ``sheet_inductance`` (coil, other): in H, the part of the inductance due to the magnetic sheets,
        - ``x`` and ``y`` (coil): centres in m,
        - with plates, ``plate_inductance`` in H and ``plate_resistance`` in Ω (coil, other): the contribution of the
          plates at the attribute ``working_frequency_Hz``, for which inductance and coupling then hold,
        - with plates that have an outline, the attributes ``plate_error_inductance`` and ``plate_error_resistance``,
          relative errors of ΔL and ΔR by mesh and model, and ``plate_skin_depths``, the thickness in skin depths,
        - the attributes of `provenance`.

    Raises
    ------
    NetworkError
        A coil or a state of the scan plan without a resonance.

    Examples
    --------
    >>> from coilarray import load_design
    >>> result = couple_design(load_design("gast2020"), ideal=True)
    >>> round(float(result.open_inductance[0]) * 1e6, 1), round(float(result.coupling[0, 1]), 3)
    (93.1, 0.08)
    """
    design = design_of(design)
    network = design_circuit(design, ideal=ideal, progress=progress)
    bare = design_circuit(design, ideal=True)
    R = dc_resistance(design.array.conductors(), design.circuit.resistivity)
    result = _coupled(network, design.coils_in_turn, terminations_of(design), R)
    without = resonances(bare, design.coils_in_turn)
    single, centres = ("coil",), design.array.centres
    rows = (
        ("ideal_effective_inductance", single, [one.effective_inductance for one in without], "H",
         "effective inductance, ideal: direct-current copper, no strays"),
        ("ideal_frequency", single, [one.frequency for one in without], "Hz",
         "resonance frequency, ideal: direct-current copper, no strays"),
        ("sheet_inductance", ("coil", "other"), design_inductance(design)[1], "H", "inductance due to the sheets"),
    )  # fmt: skip
    places = (
        ("x", single, centres[:, 0], "m", "centre of the coil, x"),
        ("y", single, centres[:, 1], "m", "centre of the coil, y"),
    )
    plates = design_plates(design)
    if plates is not None:
        metal = (
            ("plate_inductance", ("coil", "other"), plates.inductance, "H", "inductance due to the plates"),
            ("plate_resistance", ("coil", "other"), plates.resistance, "ohm", "resistance due to the plates"),
        )
        result = result.assign(variables(*metal)).assign_attrs(working_frequency_Hz=plates.working)
    result = result.assign(variables(*rows)).assign_coords(variables(*places))
    return result.assign_attrs({**provenance(design), **plate_errors(design)})


def plate_errors(design: Design) -> dict[str, float]:
    """Return the attributes for errors of plates with outline.

    They are empty if there is no such plate. ``plate_error_inductance`` and ``plate_error_resistance`` are relative
    estimates at the working frequency. There the plate with the largest errors is ``plate_skin_depths`` thick.
    """
    plates = design_plates(design)
    errors = {} if plates is None else plate_errors_by_name(design, plates.working)
    return worst_attributes(list(errors.values()))


def design_inductance(
    design: Design, *, accuracy: Accuracy = "full", progress: Progress | None = None
) -> tuple[FloatArray, FloatArray]:
    """Inductance matrix in H of a design under flat sheets.

    The part due to the magnetic sheets is returned with it. With plates, the matrix holds for the working frequency of
    the coils, see `design_plates`.
    """
    inductance, by_sheets = _without_plates(design, accuracy, progress)
    plates = design_plates(design, accuracy=accuracy)
    return inductance.copy() if plates is None else inductance + plates.inductance, by_sheets.copy()


def _without_plates(
    design: Design, accuracy: Accuracy, progress: Progress | None = None
) -> tuple[FloatArray, FloatArray]:
    return _INDUCTANCES.get(
        (digest_of(design.array, design.sheets), accuracy), lambda: _design_inductance(design, accuracy, progress)
    )


def _design_inductance(design: Design, accuracy: Accuracy, progress: Progress | None) -> tuple[FloatArray, FloatArray]:
    conductors = design.array.conductors()
    by_sheets = layer_inductance(conductors, design.sheets, accuracy=accuracy)
    # Overlapping copper is a rule that a search breaks on its way and that a command may allow.
    L = inductance_matrix(conductors, accuracy=accuracy, allow_overlaps=True, progress=progress)
    return L + by_sheets, by_sheets


def design_plates(design: Design, *, accuracy: Accuracy = "full") -> Plates | None:
    """Return the effect of a design's plates on its coils.

    It is computed around the frequencies at which the coils oscillate. The result is None without plates. The working
    frequency is the geometric mean of the resonances of the scan plan without strays. The errors are as in
    `plate_effect`, and a NetworkError for a state without a resonance.
    """
    if not design.plates:
        return None
    return _PLATES.get((design.digest, accuracy), lambda: _design_plates(design, accuracy))


@serial_algebra()
def _design_plates(design: Design, accuracy: Accuracy) -> Plates:
    """Compute the plates around the resonances without strays."""
    names, switches = design.array.names, design.circuit.switches
    R = dc_resistance(design.array.conductors(), design.circuit.resistivity)
    L = _without_plates(design, accuracy)[0]
    low, high = _band(bare_network(names, L, R, switches), design.plan, 0.0)
    middle = math.sqrt(low * high)
    effect, network = _followed(
        design, bare_network(names, L, R, switches), plate_effect(design, middle, middle, "screen"), accuracy
    )
    found = [one.frequency for one in resonances(network, design.plan)]
    return Plates(effect, float(np.exp(np.log(found).mean())))


def _followed(
    design: Design, network: Network, effect: PlateEffect, accuracy: Accuracy, working: float | None = None
) -> tuple[PlateEffect, Network]:
    """Compute plates around the resonances of a network.

    The resonances include the plates. The search begins with a known effect of the plates. The network is returned with
    the plates' part in the inductance, at the working frequency in Hz if given. A NetworkError is raised if there are
    no such resonances.
    """
    states = (*design.plan, *design.coils_in_turn)
    for _ in range(_ROUNDS):
        plates = Plates(effect, math.sqrt(effect.band.low * effect.band.high) if working is None else working)
        dispersion = effect.dispersion(plates.grid, plates.working)
        beside = replace(network, inductance=network.inductance + plates.inductance, dispersion=dispersion)
        low, high = _band(beside, states)
        if working is not None:
            low, high = min(low, working), max(high, working)
        if effect.band.holds(np.array([low, high])):
            return effect, beside
        effect = plate_effect(design, (1 - _PLATES_MARGIN) * low, (1 + _PLATES_MARGIN) * high, accuracy)
    raise NetworkError(
        f"beside the plates the coils oscillate at {low:.6g} to {high:.6g} Hz, outside the {_ROUNDS} bands of "
        "frequency in which the plates were computed."
    )


def terminations_of(design: Design) -> list[str]:
    """Return the termination of each coil while another is measured.

    It is "short" if both ends are grounded, else as designed.
    """
    return ["short" if passive == "ground" else passive for passive in design.terminations.values()]


def provenance(design: Design) -> dict[str, str]:
    """Return the attributes that identify the source of a result.

    These are the design, its hash and the package's version.
    """
    return {"design": design.name, "design_hash": design.digest, "coilarray_version": metadata.version("coilarray")}


def couple(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    capacitance: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> xr.Dataset:
    """Solve the network with each coil active in turn.

    The other coils are closed by their terminations.

    Parameters
    ----------
    names : sequence of str, length n
        Names of the coils.
    inductance : array_like, shape (n, n)
        Inductance matrix in H.
    resistance : array_like, shape (n,) or scalar
        Resistance of each coil in Ω, the same at all frequencies.
    capacitance : float
        Capacitance of the tank in F.
    terminations : sequence of {"short", "open"}, length n, optional
        Termination of each coil while it is passive. By default all are shorted (the plan of Gast & Zimmermann 2020).
    short_resistance : float
        Resistance in Ω of the two switches that ground a coil. The measured coil has two of them as well.

    Returns
    -------
    xarray.Dataset
        Dimensions ``coil`` (the active coil) and ``other``, in SI units, which are in the attributes. Over (coil,
        other)

        - ``inductance`` and ``coupling``,
        - ``current_real`` and ``current_imag``: in A per A of the active coil,
        - ``contribution``: the part of each other coil in the inductance of the active coil, Re(M i).

        Over (coil)

        - ``resistance``: at direct current,
        - ``open_inductance``: with all others open,
        - ``effective_inductance``: 1/(ω²C),
        - ``open_effective_inductance``: the same with all others open,
        - ``inductance_change``: the change by the other coils,
        - ``effective_resistance``: Re Z,
        - ``quality_factor``: Im Z/Re Z,
        - ``frequency`` and ``open_frequency``,
        - ``termination`` of the coil while another coil is active.

        The attribute ``left_out`` lists the effects of the circuit that are not in these numbers.

    Raises
    ------
    NetworkError
        Shapes that do not fit, a matrix of no real coils, a value that is not allowed, or a coil without a resonance.

    Notes
    -----
    Every coil is solved where its Im Y = 0, see `coilarray.circuit.network.Resonance`. Without losses and strays the
    contributions add up to L_eff − L.
    """
    L, R = checked_network(inductance, resistance)
    if L.shape != (len(names), len(names)):
        raise NetworkError(f"{len(names)} names need an inductance matrix of that many rows; got shape {L.shape}.")
    ends = checked_terminations(len(names), terminations)
    network = bare_network(names, L, R, Switches(short_resistance / 2, tank_capacitance=capacitance))
    opened = [name for name, end in zip(names, ends, strict=True) if end == "open"]
    states = [
        ScanState(name, ((name, 1),), exceptions={other: "open" for other in opened if other != name}) for name in names
    ]
    return _coupled(network, states, ends, R)


def _coupled(network: Network, states: Sequence[ScanState], terminations: Sequence[str], R: FloatArray) -> xr.Dataset:
    """Solve a network in the states that measure each coil.

    The result is the dataset of `couple`.
    """
    names, L = network.names, network.inductance
    solved = resonances(network, states)
    alone = resonances(network, [ScanState(name, ((name, 1),), others="open") for name in names])
    currents = np.array([state.currents for state in solved])
    contributions = np.real(L * currents) * (1 - np.eye(len(L)))

    def each(name: str, states: Sequence[Resonance] = solved) -> FloatArray:
        return np.array([getattr(state, name) for state in states])

    effective, unchanged = each("effective_inductance"), each("effective_inductance", alone)
    pair, single = ("coil", "other"), ("coil",)
    rows = (
        ("inductance", pair, L, "H", "inductance matrix"),
        ("coupling", pair, coupling_matrix(L), "1", "coupling coefficient"),
        ("resistance", single, R, "ohm", "DC resistance"),
        (
            "open_inductance",
            single,
            np.diag(L).copy(),
            "H",
            "inductance, all other coils open" if len(L) > 1 else "inductance",
        ),
        ("effective_inductance", single, effective, "H", "effective inductance"),
        ("open_effective_inductance", single, unchanged, "H", "effective inductance, others open"),
        ("inductance_change", single, effective / unchanged - 1, "1", "change by the others"),
        ("effective_resistance", single, each("effective_resistance"), "ohm", "effective resistance"),
        ("quality_factor", single, each("quality_factor"), "1", f"quality factor{network.switches.beside_q}"),
        ("open_frequency", single, each("frequency", alone), "Hz", "resonance frequency, others open"),
        ("frequency", single, each("frequency"), "Hz", "resonance frequency"),
        ("current_real", pair, currents.real, "A/A", "in-phase current"),
        ("current_imag", pair, currents.imag, "A/A", "quadrature current"),
        ("contribution", pair, contributions, "H", "part in L_eff − L"),
        ("termination", single, np.array(terminations, dtype=object), "", "state while passive"),
    )
    return xr.Dataset(
        variables(*rows),
        coords={"coil": list(names), "other": list(names)},
        attrs={
            "capacitance_F": network.switches.tank_capacitance,
            "short_resistance_ohm": 2 * network.switches.on_resistance,
            "left_out": "; ".join(network.left_out),
        },
    )
