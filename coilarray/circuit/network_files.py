"""Files of networks and current paths for other programs.

FastHenry (Kamon, Tsuk & White, IEEE Trans. MTT 42, 1750, 1994) takes nodes, and between them
straight segments of a width and a thickness, as `coilarray.geometry.Conductor` does. Its width also
lies in the x-y plane across the segment.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from coilarray.circuit.network import Network, SampledMatrix, checked_network, coil_impedance, floating_capacitance
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.extras import import_extra
from coilarray.compute.files import write_text
from coilarray.constants import RESISTIVITY_COPPER
from coilarray.design.scan_states import paper_plan
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.inductance import coupling_matrix
from coilarray.errors import GeometryError, OutputError, require_positive
from coilarray.geometry import Conductor

_POINTS = 201  # frequencies of a Touchstone file
_MM = 1e-3
_STEEP = 1e-9  # horizontal part of a direction below which a segment is vertical, as in electromagnetics.inductance
_STEP_TOLERANCE = 1e-6  # relative. FastHenry prints frequencies with six digits
_SMALLEST_STEP = 1.001  # FastHenry sweeps up to 1.001 fmax
_NAME_LENGTH = 60  # FastHenry reads names into buffers of 80 bytes
_CORNERS_A_DECADE = 4
_ABOVE = 30.0  # reach of the corners over the highest frequency. Eddy currents begin with the frequency squared


def export_network(
    network: Network, path: Path | str, frequencies: npt.ArrayLike | None = None, *, title: str = ""
) -> None:
    """Write the coils of a network, without its switches, to a `path`.

    The suffix names the format: ``.cir`` or ``.sub`` for a SPICE subcircuit whose first comment is
    the `title`, ``.sNp`` with N coils for a Touchstone file at 50 Ω, with one port per coil.
    `frequencies` (f,) in Hz of a Touchstone file come from `exchange_frequencies` by default.
    Another suffix, or a file that cannot be written, raises an OutputError, a coil without a
    resonance a NetworkError.

    A subcircuit has the inductance matrix and the capacitances across and between the coils. For
    every coil it has a ladder of positive elements fitted to its resistance at the network's own
    frequencies (`fit_ladder`), or one resistor if there is only one frequency. Its comments give
    the quality of the fit. A ladder loses inductance as its resistance grows, as eddy currents do
    and the package's L does not. The coil's own inductor is therefore less by the ladder's
    inductance at the coil's resonance, where both agree. The coils' eddy currents in each other
    (1 % of the resistance) are left out. A Touchstone file has all of it, every coil floating.

    >>> from coilarray.circuit.board_circuit import bare_network
    >>> from coilarray.design.scan_states import Switches
    >>> pair = bare_network(("A", "B"), np.array([[2e-6, 1e-6], [1e-6, 2e-6]]), np.ones(2), Switches())
    >>> export_network(pair, "array.txt")
    Traceback (most recent call last):
    coilarray.errors.OutputError: a network of 2 coils is written as .cir, .sub or .s2p; got array.txt.
    """
    target, names = Path(path), network.names
    suffix = target.suffix.lower()
    if suffix not in (".cir", ".sub") and not re.fullmatch(r"\.s\d+p", suffix):
        raise OutputError(
            f"a network of {len(names)} coil{'s' * (len(names) > 1)} is written as .cir, .sub or .s{len(names)}p; "
            f"got {target.name}."
        )
    if suffix in (".cir", ".sub"):
        write_text(target, _subcircuit(network, title))
        return
    f = exchange_frequencies(network) if frequencies is None else np.asarray(frequencies, dtype=np.float64)
    Z = coil_impedance(network, f)
    Y_C = np.diag(floating_capacitance(network))
    touchstone(names, np.linalg.solve(np.eye(len(names)) + 2j * np.pi * f[:, None, None] * Z @ Y_C, Z), f, target)


def exchange_frequencies(network: Network) -> FloatArray:
    """Return 201 frequencies in Hz, a decade around all resonances."""
    found = _grounded_resonances(network)
    return np.geomspace(found.min() / 10, found.max() * 10, _POINTS)


def _grounded_resonances(network: Network) -> FloatArray:
    """Resonances (n,) in Hz of each coil, all others grounded."""
    return np.array([one.frequency for one in resonances(network, paper_plan(network.names))])


def _subcircuit(network: Network, title: str) -> str:
    L, found = network.inductance, _grounded_resonances(network)
    middle = network.resistance(float(np.exp(np.log(found).mean())))
    if not isinstance(network.resistance, SampledMatrix) or len(network.resistance.frequencies) == 1:
        ladders, comments, direct, inductance = [], [], np.diag(middle), L
    else:
        f, R = network.resistance.frequencies, np.diagonal(network.resistance.matrices, axis1=1, axis2=2)
        ladders = [fit_ladder(f, own) for own in R.T]
        direct = np.array([ladder[0] for ladder in ladders])
        Z, at_rest = (
            np.array([ladder_impedance(*ladder, at) for ladder, at in zip(ladders, each, strict=True)]).T
            for each in ([f] * len(L), found)
        )
        extra = at_rest.imag / (2 * np.pi * found)
        inductance = L - np.diag(extra)
        misfit = np.abs(Z.real / R - 1).max()
        drift = (np.abs(Z.imag / (2 * np.pi * f[:, None]) - extra) / np.diag(L)).max()
        own = np.sqrt(np.diag(middle))
        others = np.abs(middle / np.outer(own, own) - np.eye(len(L))).max()
        comments = [
            f"R(f) of each coil is a ladder of positive elements: from {f[0] / 1e6:.4g} to {f[-1] / 1e6:.4g} MHz "
            f"within {100 * misfit:.2g} %; it changes L by at most {100 * drift:.2g} %, by nothing at the coil's "
            "resonance"
        ]
        if len(L) > 1:
            comments.append(
                f"without what the eddy currents make of each other's resistance, at most {100 * others:.2g} % of it"
            )
    if network.dispersion is not None:
        changes = np.diagonal(network.dispersion.matrices, axis1=1, axis2=2) / np.diag(L)
        span = network.dispersion.frequencies
        comments.append(
            f"L is that at the working frequency; the plates change it by up to {100 * np.abs(changes).max():.2g} % "
            f"from {span[0] / 1e6:.4g} to {span[-1] / 1e6:.4g} MHz"
        )
    comments += [f"without {part}" for part in network.left_out]
    return spice_subcircuit(
        network.names,
        inductance,
        direct,
        capacitance=network.winding_capacitance,
        mutual_capacitance=network.mutual_capacitance,
        sections=[sections.tolist() for _, sections in ladders],
        title=title,
        comments=comments,
    )


def plain_names(names: Sequence[str], count: int | None = None) -> tuple[str, ...]:
    """Return distinct names of letters, digits and underscores.

    They differ in more than case. Every other character becomes ``_``.
    """
    given = list(names)
    if not given or (count is not None and len(given) != count):
        raise ValueError(f"names must be {count or 'one or more'}; got {len(given)}.")
    taken: set[str] = set()
    result: list[str] = []
    for name in given:
        if not name.strip():
            raise ValueError("every coil needs a name; got an empty one.")
        if given.count(name) > 1:
            raise ValueError(f"names must be different; got {name!r} more than once.")
        stem = re.sub(r"[^A-Za-z0-9_]", "_", name.strip())[:_NAME_LENGTH]
        candidates = itertools.chain([stem], (f"{stem}_{k}" for k in itertools.count(2)))
        plain = next(candidate for candidate in candidates if candidate.lower() not in taken)
        taken.add(plain.lower())
        result.append(plain)
    return tuple(result)


def spice_subcircuit(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    *,
    capacitance: npt.ArrayLike | None = None,
    mutual_capacitance: npt.ArrayLike | None = None,
    sections: Sequence[Sequence[tuple[float, float]]] = (),
    title: str = "",
    comments: Sequence[str] = (),
) -> str:
    """Write coils as a SPICE subcircuit with two pins each.

    The inductance matrix (n, n) is in H, the resistance (n,) or scalar in Ω, the capacitance across
    each coil (n,) or scalar and between two coils (n, n) in F. For each coil, `sections` are pairs
    of a resistor in Ω and an inductor in H in parallel, in series with it (`ladder_impedance`).

    All couplings k_ij = M_ij/√(L_i L_j) are written with 17 digits, as a set without the small
    couplings need not be positive definite. A resistance or capacitance of zero is not an element,
    since SPICE replaces R = 0 by a default. Between two coils there are four capacitors C_ij/4,
    from each pin of the first to each pin of the second, and C_ij/6 less across each coil.

    A coil with both pins free has no path for direct current: ground one pin, through 1 GΩ if it
    floats. A coil of no resistance has no operating point across a voltage source or an ideal
    short: drive it by a current source, and short it through a resistance.
    """
    L, R = checked_network(inductance, resistance)
    coils = plain_names(names, len(L))
    between = np.broadcast_to(np.asarray(0.0 if mutual_capacitance is None else mutual_capacitance), L.shape)
    between = between - np.diag(np.diag(between))
    C = np.broadcast_to(0.0 if capacitance is None else capacitance, (len(L),)) - between.sum(axis=1) / 6
    k = coupling_matrix(L)
    heading = " ".join(title.split())
    subcircuit = plain_names([heading or "coilarray"])[0]
    lines = [
        f"* {heading or 'coilarray'}: {len(L)} coil{'s' * (len(L) > 1)}; H, ohm, F",
        *(f"* {' '.join(comment.split())}" for comment in comments),
        " ".join([".subckt", subcircuit, *(f"{coil}_{pin}" for coil in coils for pin in (1, 2))]),
    ]
    ladders = sections or [()] * len(L)
    stem = "s"  # of the sections' names. No coil's name begins with it
    while any(coil.lower().startswith(stem) for coil in coils):
        stem += "s"
    own = zip(coils, np.diag(L).tolist(), R.tolist(), C.tolist(), ladders, strict=True)
    for number, (coil, L_own, R_own, C_own, ladder) in enumerate(own, start=1):
        parts = [[(f"L{coil}", L_own)], *([(f"R{coil}", R_own)] for _ in range(bool(R_own)))]
        parts += [
            [(f"{letter}{stem}{number}_{k}", value) for letter, value in zip("RL", pair, strict=True)]
            for k, pair in enumerate(ladder, start=1)
        ]
        inner = [f"{coil}_m", *(f"{coil}_m{k}" for k in range(2, len(parts)))][: len(parts) - 1]
        for part, nodes in zip(parts, itertools.pairwise([f"{coil}_1", *inner, f"{coil}_2"]), strict=True):
            lines += [f"{name} {' '.join(nodes)} {value:.16e}" for name, value in part]
        if C_own:
            lines.append(f"C{coil} {coil}_1 {coil}_2 {C_own:.16e}")
    for i, j in itertools.combinations(range(len(L)), 2):
        lines.append(f"K{i + 1}_{j + 1} L{coils[i]} L{coils[j]} {k[i, j]:.16e}")
    for i, j in np.argwhere(np.triu(between)).tolist():
        for a, b in itertools.product((1, 2), (1, 2)):
            lines.append(f"C{i + 1}_{j + 1}_{a}{b} {coils[i]}_{a} {coils[j]}_{b} {between[i, j] / 4:.16e}")
    return "\n".join([*lines, f".ends {subcircuit}", ""])


def ladder_impedance(direct: float, sections: FloatArray, frequencies: npt.ArrayLike) -> ComplexArray:
    """Impedance (f,) in Ω of a resistor in series with sections (n, 2) of R in Ω and L in H in parallel."""
    jw, (R, L) = 2j * np.pi * np.asarray(frequencies, dtype=np.float64)[..., None], sections.T
    return np.asarray(direct + (jw * L * R / (R + jw * L)).sum(axis=-1))


def fit_ladder(frequencies: FloatArray, resistance: FloatArray) -> tuple[float, FloatArray]:
    """Fit `ladder_impedance` to resistances (f,) by relative least squares.

    Every mode of the eddy currents adds R (ωτ)²/(1 + (ωτ)²), which is a section of R and L = τR.
    With corners on a logarithmic grid the rest is a linear fit of numbers that are not negative
    (Lawson & Hanson, Solving Least Squares Problems, 1974, ch. 23).
    """
    low, high = frequencies[0], _ABOVE * frequencies[-1]
    corners = np.geomspace(low, high, 1 + round(_CORNERS_A_DECADE * np.log10(high / low)))
    square = (frequencies[:, None] / corners) ** 2
    columns = np.column_stack((np.ones_like(frequencies), square / (1 + square))) / resistance[:, None]
    scale = columns.max(axis=0)
    found = nnls(columns / scale, np.ones_like(resistance))[0] / scale
    used = found[1:] > 0
    R = found[1:][used]
    return float(found[0]), np.column_stack((R, R / (2 * np.pi * corners[used])))


def touchstone(
    names: Sequence[str],
    impedance: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    path: Path | str,
    reference_resistance: float = 50.0,
) -> None:
    """Write an impedance matrix as a Touchstone file, version 1.

    The impedance (f, n, n) is in Ω. S = (Z − R₀)(Z + R₀)⁻¹ (Kurokawa, IEEE Trans. MTT 13, 194,
    1965, for one real R₀). A port far from R₀ loses about max(|Z|/R₀, R₀/|Z|) in relative
    precision.
    """
    Z = np.asarray(impedance, dtype=np.complex128)
    f = np.asarray(frequencies, dtype=np.float64)
    if f.ndim != 1 or not f.size:
        raise ValueError(f"at least one frequency is needed, as one row; got shape {f.shape}.")
    if not (np.isfinite(f).all() and f[0] >= 0 and (np.diff(f) > 0).all()):
        raise ValueError("frequencies must be finite, not negative and rising.")
    ports = plain_names(names, Z.shape[1])
    target = Path(path)
    if target.suffix.lower() != f".s{len(ports)}p":
        raise OutputError(f"a Touchstone file of {len(ports)} ports must end in .s{len(ports)}p; got {target.name}.")
    skrf = import_extra("skrf", "Touchstone files", package="scikit-rf", extra="rf")
    network = skrf.Network(frequency=skrf.Frequency.from_f(f, unit="hz"), z=Z, z0=reference_resistance)
    network.port_names = list(ports)
    write_text(target, network.write_touchstone(target.name, return_string=True, form="ri"))


def fasthenry_input(
    source: Source,
    frequencies: npt.ArrayLike,
    *,
    title: str = "",
    resistivity: float = RESISTIVITY_COPPER,
    filaments_across: tuple[int, int] = (1, 1),
) -> str:
    """Write current paths as the text of a FastHenry input file (.inp).

    Every segment of the source needs a cross-section, else a GeometryError is raised. The names of
    the paths, in lower case, become the names of the ports. The frequencies in Hz rise by one
    factor, since FastHenry sweeps from fmin to fmax by a factor. The resistivity is in Ω·m.
    `filaments_across` the width and the thickness of every segment (nwinc, nhinc) show the skin and
    proximity effects. (1, 1) is direct current. The `title` is the first line. Lengths are in mm
    with 17 digits.

    A via is the square bar that `Array.conductors` makes of it. If the conducting area is not width
    × thickness, the segment gets its own resistivity ρ w h/A, so that its resistance at direct
    current is right.

    >>> square = [[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]]
    >>> text = fasthenry_input(Conductor(square, 0.15e-3, 35e-6, name="loop"), [1e5, 1e6])
    >>> text.splitlines()[-3:]
    ['.external N1_1 N1_5 loop', '.freq fmin=100000 fmax=1000000 ndec=1', '.end']
    """
    conductors = as_conductors(source)
    ports = plain_names([conductor.name for conductor in conductors])
    require_positive("resistivity", resistivity, " Ω·m", ValueError)
    if len(filaments_across) != 2 or any(int(count) != count or count < 1 for count in filaments_across):
        raise ValueError(f"filaments_across must be two positive integers; got {filaments_across}.")
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if f.ndim != 1 or not f.size:
        raise ValueError(f"at least one frequency is needed, as one row; got shape {np.shape(frequencies)}.")
    if not (np.isfinite(f).all() and (f > 0).all()):
        raise ValueError(f"frequencies must be positive and finite; got {f.min()} Hz.")
    factor = float(f[-1] / f[0]) ** (1 / (len(f) - 1)) if len(f) > 1 else 10.0  # one a decade
    if factor <= _SMALLEST_STEP or not np.allclose(f, f[0] * factor ** np.arange(len(f)), rtol=_STEP_TOLERANCE, atol=0):
        raise ValueError(
            f"FastHenry sweeps frequencies that rise by one factor above {_SMALLEST_STEP} (numpy.geomspace); "
            f"the {len(f)} given, {f[0]:g} to {f[-1]:g} Hz, do not: write one file for each."
        )
    sweep = f".freq fmin={f[0]:.17g} fmax={f[-1]:.17g} ndec={1 / math.log10(factor):.17g}"
    lines = [
        f"* {' '.join(title.split()) or 'coilarray'}",
        ".units mm",
        f".default rho={resistivity / _MM:.17g} nwinc={int(filaments_across[0])} nhinc={int(filaments_across[1])}",
    ]
    ends = []
    for number, (conductor, port) in enumerate(zip(conductors, ports, strict=True), start=1):
        lines += [f"* {port}", *_path_lines(conductor, number, resistivity)]
        ends.append(f".external N{number}_1 N{number}_{len(conductor.vertices)} {port}")
    return "\n".join([*lines, *ends, sweep, ".end", ""])


def _path_lines(conductor: Conductor, number: int, resistivity: float) -> Iterator[str]:
    if conductor.is_filament or not (conductor.areas > 0).all():
        raise GeometryError(f"{conductor.name} has segments without a cross-section; give widths and thicknesses.")
    for i, (x, y, z) in enumerate((conductor.vertices / _MM).tolist(), start=1):
        yield f"N{number}_{i} x={x:.17g} y={y:.17g} z={z:.17g}"
    steps = np.diff(conductor.vertices, axis=0)
    # without a direction FastHenry takes widths to be level, and for a vertical segment any
    stated = np.hypot(steps[:, 0], steps[:, 1]) < _STEEP * conductor.lengths
    stated |= np.abs(conductor.across[:, 2]) > _STEEP
    sections = zip(conductor.widths.tolist(), conductor.thicknesses.tolist(), conductor.areas.tolist(), strict=True)
    for i, (width, thickness, area) in enumerate(sections, start=1):
        line = f"E{number}_{i} N{number}_{i} N{number}_{i + 1} w={width / _MM:.17g} h={thickness / _MM:.17g}"
        if stated[i - 1]:
            line += "".join(f" w{axis}={part:.17g}" for axis, part in zip("xyz", conductor.across[i - 1], strict=True))
        if not math.isclose(area, width * thickness, rel_tol=1e-14):
            line += f" rho={resistivity * width * thickness / area / _MM:.17g}"
        yield line
