"""Coupling of a design's coils, its network, and fields."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import bare_network, board_circuit
from coilarray.circuit.network import Network, Resonance, checked_network
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Progress, part_of
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.design.scan_states import ScanState, Switches
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.errors import GeometryError, MetalError, NetworkError, require_finite
from coilarray.geometry import FinitePlate, Plate
from coilarray.geometry.answers import CurrentPaths
from coilarray.metal.plate_field import plate_field

Termination = Literal["short", "open"]
"""Termination of a passive coil: ``"short"`` to ground, or ``"open"``."""


def design_circuit(
    design: Design | DesignFile, *, ideal: bool = False, accuracy: Accuracy = "full", progress: Progress | None = None
) -> Network:
    """Make the network of a design's coils, switches and tank.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board, for example from `coilarray.load_design`.
    ideal : bool
        Leave out the alternating-current resistance of the copper, the capacitance of the windings
        and all strays of the switches. The effect of plates remains, including their losses.
    accuracy : {"full", "screen"}
        Accuracy of the inductance matrix, see `coilarray.inductance_matrix`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    Network
        Its ``left_out`` lists the effects that it lacks. The resistance matrix is interpolated
        around the resonances of the design's scan plan, and a state of it without a resonance
        raises a NetworkError. A second call for the same design costs nothing.

    Notes
    -----
    A coil without turns beside each other has no capacitance model. The network then has no winding
    capacitance at all. In an array of more than 24 coils the losses of a coil's field in the copper
    of other coils (1 % of its resistance in gast2020) are left out.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.circuit.network import resonate
    >>> design = load_design("gast2020")
    >>> ideal = resonate(design_circuit(design, ideal=True), design.plan[0])
    >>> round(ideal.effective_inductance * 1e6, 2), round(ideal.frequency / 1e6, 3)
    (92.5, 1.511)
    """
    circuit = board_circuit(design, accuracy=accuracy, progress=progress)
    return circuit.ideal if ideal else circuit.network


def design_inductance(
    design: Design | DesignFile, *, accuracy: Accuracy = "full", progress: Progress | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the inductance matrix and its sheets' part in H.

    With plates the matrix holds at the working frequency of the coils.
    """
    circuit = board_circuit(design, accuracy=accuracy, progress=progress)
    return circuit.inductance.copy(), circuit.sheet_inductance.copy()


def couple_design(
    design: Design | DesignFile | CurrentPaths, *, ideal: bool = False, progress: Progress | None = None
) -> xr.Dataset:
    """Compute the coupling of a design.

    Parameters
    ----------
    design : Design, DesignFile, Array, Coil or Spiral
        Design of the board, for example from `coilarray.load_design`. Coils alone have the usual
        circuit.
    ideal : bool
        Leave out alternating-current resistance of the copper and all strays, see `design_circuit`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        The variables of `couple`, under the flat sheets and as the converter sees them, and

        - ``ideal_effective_inductance`` in H and ``ideal_frequency`` in Hz (coil): the same with
          the direct-current resistance of the copper and without strays,
        - ``sheet_inductance`` (coil, other): in H, the part of the inductance due to the magnetic
          sheets,
        - ``x`` and ``y`` (coil): centres in m,
        - with plates, ``plate_inductance`` in H and ``plate_resistance`` in Ω (coil, other): the
          contribution of the plates at the attribute ``working_frequency_Hz``, for which inductance
          and coupling then hold,
        - with plates that have an outline, the attributes ``plate_error_inductance`` and
          ``plate_error_resistance``, relative errors of ΔL and ΔR by mesh and model, and
          ``plate_skin_depths``, the thickness in skin depths,
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
    circuit = board_circuit(design, progress=progress)
    network = circuit.ideal if ideal else circuit.network
    result = _coupled(network, design.coils_in_turn, terminations_of(design), circuit.direct_resistance)
    without = resonances(circuit.ideal, design.coils_in_turn)
    single, centres = ("coil",), design.array.centres
    rows = [
        ("ideal_effective_inductance", single, [one.effective_inductance for one in without], "H",
         "effective inductance, ideal: direct-current copper, no strays"),
        ("ideal_frequency", single, [one.frequency for one in without], "Hz",
         "resonance frequency, ideal: direct-current copper, no strays"),
        ("sheet_inductance", ("coil", "other"), circuit.sheet_inductance, "H", "inductance due to the sheets"),
    ]  # fmt: skip
    places = (
        ("x", single, centres[:, 0], "m", "centre of the coil, x"),
        ("y", single, centres[:, 1], "m", "centre of the coil, y"),
    )
    plates = circuit.plates
    if plates is not None:
        rows += [
            ("plate_inductance", ("coil", "other"), plates.inductance, "H", "inductance due to the plates"),
            ("plate_resistance", ("coil", "other"), plates.resistance, "ohm", "resistance due to the plates"),
        ]
        result = result.assign_attrs(working_frequency_Hz=plates.working)
    result = result.assign(variables(*rows)).assign_coords(variables(*places))
    return result.assign_attrs({**provenance(design), **circuit.plate_error_attributes})


def terminations_of(design: Design) -> list[str]:
    """Return the termination of each coil that is not measured."""
    return ["short" if passive == "ground" else passive for passive in design.terminations.values()]


def provenance(design: Design) -> dict[str, str]:
    """Return the design, hash and version of a result."""
    return {"design": design.name, "design_hash": design.digest, "coilarray_version": metadata.version("coilarray")}


def couple(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    capacitance: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> xr.Dataset:
    """Solve R and L matrices, each coil active in turn.

    The coils have `names`. The inductance matrix (n, n) is in H, the resistance (n,) or scalar in Ω
    at all frequencies, the capacitance of the tank in F. The `terminations` are "short", by
    default, or "open". `short_resistance` in Ω is of the two switches that ground a coil. The
    measured coil has two of them as well. Every coil is solved where its Im Y = 0.

    In the result, over (coil, other), ``current_real`` and ``current_imag`` are in A per A of the
    active coil, and ``contribution`` is the part of each other coil in its inductance, Re(M i).
    Without losses and strays the contributions add up to L_eff − L. Over (coil),
    ``open_inductance`` is with all others open, ``effective_inductance`` is 1/(ω²C), and
    ``inductance_change`` is by the other coils.
    """
    L, R = checked_network(inductance, resistance)
    if L.shape != (len(names), len(names)):
        raise NetworkError(f"{len(names)} names need an inductance matrix of that many rows; got shape {L.shape}.")
    ends: list[Termination] = ["short"] * len(L) if terminations is None else list(terminations)
    if len(ends) != len(L) or not set(ends) <= {"short", "open"}:
        raise NetworkError(f"terminations must be {len(L)} of 'short' or 'open'; got {ends}.")
    network = bare_network(names, L, R, Switches(short_resistance / 2, tank_capacitance=capacitance))
    opened = [name for name, end in zip(names, ends, strict=True) if end == "open"]
    states = [
        ScanState(name, ((name, 1),), exceptions={other: "open" for other in opened if other != name}) for name in names
    ]
    return _coupled(network, states, ends, R)


def _coupled(network: Network, states: Sequence[ScanState], terminations: Sequence[str], R: FloatArray) -> xr.Dataset:
    """Solve the states that measure each coil, as in `couple`."""
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


def operating_currents(
    design: Design | DesignFile, coupling: xr.Dataset, active: str, *, terminated: bool = True
) -> ComplexArray:
    """Compute the currents per ampere of the measured coil.

    Parameters
    ----------
    design : Design or DesignFile
        The array.
    coupling : xarray.Dataset
        Its coupling, from `coilarray.circuit.coupling.couple_design`.
    active : str
        Name of the measured coil.
    terminated : bool
        If False, all other coils are open.

    Returns
    -------
    ndarray of complex, shape (coils,)
        Currents in A per A: 1 for the active coil.

    Raises
    ------
    GeometryError
        No coil of that name.
    """
    design = design_of(design)
    names = design.array.names
    if active not in names:
        raise GeometryError(f"there is no coil {active!r}; there are {', '.join(names)}.")
    if not terminated:
        return np.asarray(np.eye(len(names), dtype=np.complex128)[names.index(active)])
    mine = coupling.sel(coil=active)
    parts = mine.current_real.values, mine.current_imag.values
    require_finite("the currents of the coupling", *np.concatenate(parts).tolist())
    return np.asarray(parts[0] + 1j * parts[1])


def require_endless(design: Design) -> tuple[Plate, ...]:
    """Return the plates of a design, which must be infinite."""
    for plate in design.plates:
        if isinstance(plate, FinitePlate):
            raise MetalError(
                f"B beside a plate with an outline is not computed; {design.name} has {plate.name!r}: leave it out, or "
                'make it infinite with shape = "plate".'
            )
    return tuple(plate for plate in design.plates if isinstance(plate, Plate))


def operating_field(
    design: Design | DesignFile,
    coupling: xr.Dataset,
    active: str,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    z: npt.ArrayLike,
    *,
    current: float = 1.0,
    terminated: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the flux density of an active coil in T.

    Parameters
    ----------
    design, coupling, active, terminated
        Design, coupling, measured coil and whether the others are terminated. See
        `operating_currents`.
    x, y, z : array_like, shape (nx,), (ny,), (nz,) or scalar
        Grid in m. z = 0 is the top of the board.
    current : float
        Current of the active coil in A.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        ``B`` and ``B_quadrature`` in T with the dimensions (x, y, z, component): in phase with the
        active coil's current and 90° ahead of it. The field is in free space, or beside the
        design's plates at the active coil's frequency. Magnetic sheets change the currents only,
        with and without plates.

    Raises
    ------
    GeometryError
        No coil of that name, or points or a current that are not finite.
    MetalError
        Plates with an outline, whose field is not computed, or a height beside the copper of a
        design with plates.
    """
    design = design_of(design)
    require_finite("current", current)
    endless = require_endless(design)
    currents = current * operating_currents(design, coupling, active, terminated=terminated)
    points = grid_points(x, y, z)
    conductors = design.array.conductors()
    if endless:
        frequency = float(coupling.frequency.sel(coil=active))
        along, across, up = (np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z))
        beside = plate_field(conductors, currents, endless, frequency, along, across, up)
        in_phase, quadrature = beside.real, beside.imag
    else:
        in_phase, quadrature = (
            magnetic_field(conductors, points, part, progress=part_of(progress, k, 2))
            for k, part in enumerate((currents.real, currents.imag))
        )
    dims = ("x", "y", "z", "component")
    axes = {
        name: (name, np.atleast_1d(np.asarray(axis, dtype=np.float64)), {"units": "m"})
        for name, axis in zip("xyz", (x, y, z), strict=True)
    }
    rows = (
        ("B", dims, in_phase, "T", "flux density in phase with the active current"),
        ("B_quadrature", dims, quadrature, "T", "flux density 90 degrees ahead"),
    )
    return xr.Dataset(
        variables(*rows),
        coords={**axes, "component": ["x", "y", "z"]},
        attrs={
            **provenance(design),
            "active_coil": active,
            "other_coils": "none" if len(design.array.names) == 1 else "as terminated" if terminated else "open",
            "active_current_A": current,
        },
    )
