"""FastHenry input files and impedances.

FastHenry (Kamon, Tsuk & White, IEEE Trans. MTT 42, 1750, 1994) takes nodes, and between them straight segments of a
width and a thickness, as `coilarray.geometry.Conductor` does. Its width also lies in the x-y plane across the segment.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

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
_OFF_AXIS = 1e-6  # sine of the angle up to which a given width direction is the package's own
_STEP_TOLERANCE = 1e-6  # relative; FastHenry prints frequencies with six digits
_SMALLEST_STEP = 1.001  # FastHenry sweeps up to 1.001 fmax
_UNITS = {"km": 1e3, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "mil": 2.54e-5, "mils": 2.54e-5}
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
    skin and proximity effects. (1, 1) is direct current. Lengths are in mm, with 17 digits.

    A via is the square bar that `Array.conductors` makes of it. If the conducting area is not width × thickness,
    the segment gets its own resistivity ρ w h/A, so that its resistance at direct current is right. FastHenry turns all
    names to lower case.

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


@dataclass(frozen=True)
class _Segment:
    """Segment line with lengths in m, and the conducting area in m²."""

    line: int
    nodes: tuple[str, str]
    width: float
    thickness: float
    area: float


def read_fasthenry_input(text: str) -> tuple[Conductor, ...]:
    """Read the current paths of a FastHenry input file, one per port.

    The paths are in the order of the ``.external`` lines, named as the port or ``NODE to NODE``. A resistivity of a
    segment other than the default becomes a conducting area. Nodes, segments, ``.units``, ``.default``, ``.external``,
    ``.freq`` and ``.end`` are known. A line that cannot be read or is not known (planes, ``.equiv``), a width direction
    out of the x-y plane, ports that are not a single unbranched path, a segment on no path, or no port raises a
    ValueError that names the line.

    >>> wire = Conductor([[0, 0, 0], [1e-2, 0, 0]], 0.15e-3, 35e-6, name="wire")
    >>> (again,) = read_fasthenry_input(fasthenry_input(wire, 1e6))
    >>> again.name, again.lengths
    ('wire', array([0.01]))
    """
    unit, resistivity = 1.0, 1 / 5.8e7  # FastHenry's own defaults
    defaults: dict[str, float] = {}
    nodes: dict[str, FloatArray] = {}
    segments: list[_Segment] = []
    ports: list[tuple[int, str, str, str]] = []
    for number, line in _logical_lines(text):
        words = line.split()
        command = words[0].lower()
        if command.startswith(".end"):
            break
        if command.startswith(".uni"):
            if len(words) != 2 or words[1].lower() not in _UNITS:
                raise ValueError(f"line {number}: units must be one of {', '.join(_UNITS)}; got {line!r}.")
            unit = _UNITS[words[1].lower()]
        elif command.startswith(".def"):
            given = _assignments(number, " ".join(words[1:]), "x y z w h rho sigma nwinc nhinc rw rh")
            resistivity = _resistivity(given, unit, resistivity)
            defaults |= {key: value * unit for key, value in given.items() if key in set("xyzwh")}
        elif command.startswith(".fre"):
            continue
        elif command.startswith(".ext"):
            if not 3 <= len(words) <= 4:
                raise ValueError(f"line {number}: a port needs two nodes and may have a name; got {line!r}.")
            ports.append((number, words[1].lower(), words[2].lower(), " ".join(words[3:])))
        elif command.startswith("n"):
            given = defaults | {k: v * unit for k, v in _assignments(number, " ".join(words[1:]), "x y z").items()}
            missing = [key for key in "xyz" if key not in given]
            if missing or command in nodes:
                raise ValueError(
                    f"line {number}: node {words[0]} " + (f"has no {missing[0]}." if missing else "again.")
                )
            nodes[command] = np.array([given[key] for key in "xyz"])
        elif command.startswith("e"):
            segments.append(_segment(number, words, unit, resistivity, defaults, nodes))
        else:
            raise ValueError(f"line {number}: {words[0]!r} is not known to this reader.")
    if not ports:
        raise ValueError("a FastHenry file needs at least one .external port; got none.")
    return _paths(nodes, segments, ports)


def _logical_lines(text: str) -> list[tuple[int, str]]:
    """Return number and text of every logical line, without title, comments and blank lines."""
    lines: list[tuple[int, str]] = []
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if number == 1 or not line or line.startswith("*"):
            continue
        if line.startswith("+"):
            if not lines:
                raise ValueError(f"line {number}: nothing to continue.")
            lines[-1] = (lines[-1][0], f"{lines[-1][1]} {line[1:]}")
        else:
            lines.append((number, line))
    return lines


def _assignments(number: int, text: str, known: str) -> dict[str, float]:
    """Read the assignments of a line, key = number."""
    pairs = re.findall(rf"(\w+)\s*=\s*({_NUMBER})(?=\s|$)", text)
    rest = re.sub(rf"(\w+)\s*=\s*({_NUMBER})(?=\s|$)", "", text).strip()
    values = {key.lower(): float(value) for key, value in pairs}
    unknown = [key for key in values if key not in known.split()]
    if rest or unknown:
        raise ValueError(f"line {number}: cannot read {rest or unknown[0]!r}; known are {known}, each = a number.")
    if not all(map(math.isfinite, values.values())):
        raise ValueError(f"line {number}: numbers must be finite; got {text!r}.")
    return values


def _resistivity(given: dict[str, float], unit: float, default: float) -> float:
    """Resistivity in Ω·m from a value per unit of length."""
    if "rho" in given:
        return given["rho"] * unit
    return unit / given["sigma"] if given.get("sigma") else default


def _segment(
    number: int,
    words: Sequence[str],
    unit: float,
    resistivity: float,
    defaults: dict[str, float],
    nodes: dict[str, FloatArray],
) -> _Segment:
    """Read a segment line."""
    ends = [word.lower() for word in words[1:3]]
    unknown = [end for end in ends if end not in nodes]
    if len(ends) < 2 or unknown:
        raise ValueError(f"line {number}: a segment needs two nodes given before it; got {' '.join(words[:3])!r}.")
    given = _assignments(number, " ".join(words[3:]), "w h rho sigma nwinc nhinc rw rh wx wy wz")
    size = defaults | {key: given[key] * unit for key in "wh" if key in given}
    if not all(size.get(key, 0) > 0 for key in "wh"):
        raise ValueError(f"line {number}: segment {words[0]} needs a positive w and h.")
    own = _resistivity(given, unit, resistivity)
    if not own > 0:
        raise ValueError(f"line {number}: a resistivity must be positive; got {own} Ω·m.")
    step = nodes[ends[1]] - nodes[ends[0]]
    if any(key in given for key in ("wx", "wy", "wz")):
        direction = np.array([given.get(key, 0.0) for key in ("wx", "wy", "wz")])
        across = np.array([-step[1], step[0], 0.0])
        if np.linalg.norm(across) < _STEEP * np.linalg.norm(step):
            across = np.array([1.0, 0.0, 0.0])
        off_axis = np.linalg.norm(np.cross(direction, across))
        if not 0 < np.linalg.norm(direction) or off_axis > _OFF_AXIS * np.linalg.norm(direction) * np.linalg.norm(
            across
        ):
            raise ValueError(
                f"line {number}: the width of segment {words[0]} must lie in the x-y plane across it, "
                f"or along x for a vertical one; got {direction.tolist()}."
            )
    return _Segment(number, (ends[0], ends[1]), size["w"], size["h"], size["w"] * size["h"] * resistivity / own)


def _paths(
    nodes: dict[str, FloatArray], segments: list[_Segment], ports: list[tuple[int, str, str, str]]
) -> tuple[Conductor, ...]:
    """Follow the segments between the two nodes of every port."""
    at: dict[str, list[_Segment]] = {}
    for segment in segments:
        for node in segment.nodes:
            at.setdefault(node, []).append(segment)
    used: set[int] = set()
    conductors = []
    for number, first, last, name in ports:
        path: list[_Segment] = []
        vertices, node = [first], first
        while node != last or not path:
            onward = [segment for segment in at.get(node, []) if segment.line not in used]
            if len(onward) != 1:
                raise ValueError(
                    f"line {number}: a port needs its own unbranched path from {first} to {last}; "
                    f"{len(onward) or 'no'} segments continue from {node}."
                )
            (segment,) = onward
            used.add(segment.line)
            path.append(segment)
            node = segment.nodes[1] if segment.nodes[0] == node else segment.nodes[0]
            vertices.append(node)
        conductors.append(
            Conductor(
                np.array([nodes[vertex] for vertex in vertices]),
                [segment.width for segment in path],
                [segment.thickness for segment in path],
                [segment.area for segment in path],
                name or f"{first} to {last}",
            )
        )
    idle = [segment for segment in segments if segment.line not in used]
    if idle:
        raise ValueError(f"line {idle[0].line}: the segment is not on the path of any port.")
    return tuple(conductors)


def read_zc_matrix(text: str) -> tuple[FloatArray, tuple[str, ...], ComplexArray]:
    """Read the impedance matrices that FastHenry writes (Zc.mat).

    The file has a line ``Row k:  node  to  node, port name: name`` for every port, then for every frequency ``Impedance
    matrix for frequency = f n x n`` and n rows of ``real +imagj``. The result is the frequencies (f,) in Hz, the names
    of the ports, or ``node to node`` without a name, and the impedances (f, n, n) in Ω. A file without a matrix, with
    an admittance matrix, or with rows that are missing or cannot be read raises a ValueError. FastHenry prints six
    digits.

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
