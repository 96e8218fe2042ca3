"""FastHenry input files and impedances.

FastHenry (Kamon, Tsuk & White, IEEE Trans. MTT 42, 1750, 1994) takes nodes, and between them straight segments of a
width and a thickness, as `coilarray.geometry.Conductor` does. Its width also lies in the x-y plane across the segment.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from coilarray.circuit.network_files import plain_names
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.constants import RESISTIVITY_COPPER
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import GeometryError, require_positive
from coilarray.geometry import Conductor

_MM = 1e-3
_STEEP = 1e-9  # horizontal part of a direction below which a segment is vertical, as in electromagnetics.inductance
_STEP_TOLERANCE = 1e-6  # relative; FastHenry prints frequencies with six digits
_SMALLEST_STEP = 1.001  # FastHenry sweeps up to 1.001 fmax
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"


def fasthenry_input(
    source: Source,
    frequencies: npt.ArrayLike,
    *,
    title: str = "",
    resistivity: float = RESISTIVITY_COPPER,
    filaments_across: tuple[int, int] = (1, 1),
) -> str:
    """Write current paths as a FastHenry input file (.inp).

    Every segment of the source needs a cross-section, else a GeometryError is raised. The names of the paths become the
    names of the ports. The frequencies in Hz rise by one factor, since FastHenry sweeps from fmin to fmax by a factor.
    The resistivity is in Ω·m. `filaments_across` the width and the thickness of every segment (nwinc, nhinc) show the
    skin and proximity effects. (1, 1) is direct current. The `title` is the first line.

    A via is the square bar that `Array.conductors` makes of it. If the conducting area is not width × thickness,
    the segment gets its own resistivity ρ w h/A, so that its resistance at direct current is right. FastHenry turns all
    names to lower case.

    Returns
    -------
    str
        Text of the file, with lengths in mm of 17 digits.

    Examples
    --------
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
    sweep = _sweep(frequencies)
    lines = [
        f"* {' '.join(title.split()) or 'coilarray'}",
        ".units mm",
        f".default rho={_digits(resistivity / _MM)} nwinc={int(filaments_across[0])} nhinc={int(filaments_across[1])}",
    ]
    for number, (conductor, port) in enumerate(zip(conductors, ports, strict=True), start=1):
        lines += [f"* {port}", *_path_lines(conductor, number, resistivity)]
    for number, (conductor, port) in enumerate(zip(conductors, ports, strict=True), start=1):
        lines.append(f".external N{number}_1 N{number}_{len(conductor.vertices)} {port}")
    return "\n".join([*lines, sweep, ".end", ""])


def _digits(value: float) -> str:
    return format(value, ".17g")


def _sweep(frequencies: npt.ArrayLike) -> str:
    """Write the frequency line of a sweep."""
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if f.ndim != 1 or not f.size:
        raise ValueError(f"at least one frequency is needed, as one row; got shape {np.shape(frequencies)}.")
    if not (np.isfinite(f).all() and (f > 0).all()):
        raise ValueError(f"frequencies must be positive and finite; got {f.min()} Hz.")
    if len(f) == 1:
        return f".freq fmin={_digits(f[0])} fmax={_digits(f[0])} ndec=1"
    factor = float(f[-1] / f[0]) ** (1 / (len(f) - 1))
    if factor <= _SMALLEST_STEP or not np.allclose(f, f[0] * factor ** np.arange(len(f)), rtol=_STEP_TOLERANCE, atol=0):
        raise ValueError(
            f"FastHenry sweeps frequencies that rise by one factor above {_SMALLEST_STEP} (numpy.geomspace); "
            f"the {len(f)} given, {f[0]:g} to {f[-1]:g} Hz, do not: write one file for each."
        )
    return f".freq fmin={_digits(f[0])} fmax={_digits(f[-1])} ndec={_digits(1 / math.log10(factor))}"


def _path_lines(conductor: Conductor, number: int, resistivity: float) -> Iterator[str]:
    """Write the nodes and segments of a current path."""
    if conductor.is_filament or not (conductor.areas > 0).all():
        raise GeometryError(f"{conductor.name} has segments without a cross-section; give widths and thicknesses.")
    for i, (x, y, z) in enumerate((conductor.vertices / _MM).tolist(), start=1):
        yield f"N{number}_{i} x={_digits(x)} y={_digits(y)} z={_digits(z)}"
    steps = np.diff(conductor.vertices, axis=0)
    vertical = np.hypot(steps[:, 0], steps[:, 1]) < _STEEP * conductor.lengths
    sections = zip(conductor.widths.tolist(), conductor.thicknesses.tolist(), conductor.areas.tolist(), strict=True)
    for i, (width, thickness, area) in enumerate(sections, start=1):
        line = f"E{number}_{i} N{number}_{i} N{number}_{i + 1} w={_digits(width / _MM)} h={_digits(thickness / _MM)}"
        if vertical[i - 1]:  # every direction in the x-y plane is across it, so state one
            line += " wx=1 wy=0 wz=0"
        if not math.isclose(area, width * thickness, rel_tol=1e-14):
            line += f" rho={_digits(resistivity * width * thickness / area / _MM)}"
        yield line


def read_zc_matrix(text: str) -> tuple[FloatArray, tuple[str, ...], ComplexArray]:
    """Read the impedance matrices in the text that FastHenry writes (Zc.mat).

    The file has a line ``Row k:  node  to  node, port name: name`` for every port, then for every frequency ``Impedance
    matrix for frequency = f n x n`` and n rows of ``real +imagj``. The result is the frequencies (f,) in Hz, the names
    of the ports, or ``node to node`` without a name, and the impedances (f, n, n) in Ω. A file without a matrix, with
    an admittance matrix, or with rows that are missing or cannot be read raises a ValueError. FastHenry prints six
    digits.

    Returns
    -------
    tuple
        Frequencies in Hz, shape (f,), names, and impedances in Ω, shape (f, n, n).

    Examples
    --------
    >>> f, names, Z = read_zc_matrix(
    ...     '''Row 1:  n1_1  to  n1_5, port name: loop
    ... Impedance matrix for frequency = 1e+06 1 x 1
    ...      0.00123     +0.236j
    ... ''')
    >>> names, float(f[0]), complex(Z[0, 0, 0])
    (('loop',), 1000000.0, (0.00123+0.236j))
    """
    names: dict[int, str] = {}
    frequencies: list[float] = []
    matrices: list[list[list[complex]]] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        row = re.fullmatch(r"Row\s+(\d+)\s*:\s*(\S+)\s+to\s+([^\s,]+)(?:,\s*port name:\s*(\S+))?", line)
        heading = re.fullmatch(rf"Impedance matrix for frequency\s*=\s*({_NUMBER})\s+(\d+)\s*x\s*(\d+)", line)
        if not line:
            continue
        if row:
            names[int(row[1])] = row[4] or f"{row[2]} to {row[3]}"
        elif heading:
            size = (int(heading[2]), int(heading[3]))
            if size != (len(names), len(names)) or sorted(names) != list(range(1, len(names) + 1)):
                raise ValueError(
                    f"line {number}: {len(names)} named rows do not fit a matrix of {size[0]} x {size[1]}."
                )
            frequencies.append(float(heading[1]))
            matrices.append([])
        elif re.match("admittance", line, re.IGNORECASE):
            raise ValueError(
                f"line {number}: an admittance matrix (FastHenry -x) is not supported; run FastHenry for all ports."
            )
        elif matrices:
            entries = re.findall(rf"({_NUMBER})\s*([+-]\s*{_NUMBER})j", line)
            rest = re.sub(rf"({_NUMBER})\s*([+-]\s*{_NUMBER})j", "", line).strip()
            if rest or len(entries) != len(names) or len(matrices[-1]) == len(names):
                raise ValueError(
                    f"line {number}: a matrix must have {len(names)} rows of {len(names)} impedances; got {line!r}."
                )
            matrices[-1].append([complex(float(real), float(imag.replace(" ", ""))) for real, imag in entries])
        else:
            raise ValueError(f"line {number}: not a line of FastHenry's Zc.mat; got {line!r}.")
    if not matrices or any(len(matrix) != len(names) for matrix in matrices):
        raise ValueError(
            f"each impedance matrix must have {len(names)} rows; got {[len(matrix) for matrix in matrices]}."
        )
    return np.array(frequencies), tuple(names[k] for k in sorted(names)), np.array(matrices, dtype=np.complex128)
