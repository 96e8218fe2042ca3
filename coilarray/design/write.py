"""Write an array as a design file: free placements of path coils, which `coilarray.load_design` reads back."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from coilarray.design.tables import SCHEMA
from coilarray.geometry import Coil, CoilArray, PlatedHole, Stackup

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.+-]+")
# a list of plain values as tomli-w writes it, one a line
_FLAT_LIST = re.compile(r"\[\n\s*([^\[\]\n]+(?:,\n\s*[^\[\]\n]+)*),\n\s*\]")
_LONGEST_LINE = 120


def design_text(name: str, array: CoilArray, *, source: str, assumed: Mapping[str, str]) -> str:
    """Return the text of a design file.

    Parameters
    ----------
    name : str
        Of the design.
    array : CoilArray
        Placements that share a `Coil` share its table, see `shape_names`.
    source : str
        Where the design comes from, for the reader.
    assumed : mapping of str to str
        Dotted keys of the design whose values are assumed, with the reason. ``coils.*.KEY`` stands for every shape,
        ``coils.NAME.KEY`` for that of the coil NAME.

    Returns
    -------
    str
        TOML. Places are rounded to 1 nm. Names that a design cannot have are changed as `design_names` says.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.design.model import parse_design
    >>> text = design_text("copy", load_design("gast2020").array, source="a test", assumed={})
    >>> parse_design(text).array.names[:2]
    ('coil1', 'coil2')
    """
    import tomli_w

    names, layers = design_names(array.names), design_names(array.stackup.names)
    shapes = shape_names(array)
    coils = {shape: placement.coil for shape, placement in zip(shapes, array.placements, strict=True)}
    document = {
        "schema": SCHEMA,
        "name": design_names([name])[name],
        "source": source,
        "stackup": _stackup_table(array.stackup, layers),
        "coils": {shape: _coil_table(coil) for shape, coil in coils.items()},
        "array": {
            "lattice": "free",
            "placements": [
                {
                    "name": names[placement.name],
                    "coil": shape,
                    "layers": [layers[layer] for layer in placement.layers],
                    "x_mm": _mm(placement.x),
                    "y_mm": _mm(placement.y),
                    "rotation_deg": _digits(math.degrees(placement.rotation)),
                }
                for shape, placement in zip(shapes, array.placements, strict=True)
            ],
        },
        "board": {"margin_mm": _mm(array.board_margin), "through_holes": array.through_holes},
    }
    reasons = _assumed_table(assumed, dict(zip(array.names, shapes, strict=True)), list(coils))
    text = tomli_w.dumps(document | ({"assumed": reasons} if reasons else {}))
    return _FLAT_LIST.sub(_on_one_line, text)


def shape_names(array: CoilArray) -> list[str]:
    """Return for each placement the name of its coil's table: shape1, shape2, …, in the order of first use."""
    numbers: dict[int, int] = {}
    return [f"shape{numbers.setdefault(id(place.coil), len(numbers) + 1)}" for place in array.placements]


def design_names(names: Iterable[str]) -> dict[str, str]:
    """Return for each name one that a design can have: letters, digits, _ . + and, not first, -; all different.

    Examples
    --------
    >>> design_names(["/coil 1", "coil_1", "Top"])
    {'/coil 1': 'coil_1', 'coil_1': 'coil_1_2', 'Top': 'Top'}
    """
    found: dict[str, str] = {}
    for name in names:
        allowed = _NOT_IN_NAMES.sub("_", name.lstrip("/")).lstrip("-") or "_"
        different, n = allowed, 1
        while different in found.values():
            n += 1
            different = f"{allowed}_{n}"
        found[name] = different
    return found


def _stackup_table(stackup: Stackup, layers: Mapping[str, str]) -> dict[str, Any]:
    return {
        "layers": [layers[name] for name in stackup.names],
        "copper_thickness_um": [_digits(value * 1e6) for value in stackup.copper_thickness],
        "dielectric_thickness_mm": [_digits(value * 1e3) for value in stackup.dielectric_thickness],
        "dielectric_epsilon_r": [_digits(value) for value in stackup.epsilon_r],
    }


def _coil_table(coil: Coil) -> dict[str, Any]:
    widths = [[_mm(width) for width in line] for line in coil.widths]
    uniform = {width for line in widths for width in line}
    table: dict[str, Any] = {
        "shape": "path",
        "lines_mm": [[[_mm(x), _mm(y)] for x, y in line.tolist()] for line in coil.lines],
        "trace_width_mm": uniform.pop() if len(uniform) == 1 else widths,
        "gap_mm": _mm(coil.gap),
        "terminals": coil.terminal is not None,
    }
    if coil.terminal is not None:
        table |= {"terminal_pad_mm": _mm(coil.terminal.pad), "terminal_drill_mm": _mm(coil.terminal.drill)}
    return table | {"via": _via_table(coil.via)}


def _via_table(via: PlatedHole) -> dict[str, float]:
    return {"drill_mm": _mm(via.drill), "pad_mm": _mm(via.pad), "plating_um": _digits(via.plating * 1e6)}


def _assumed_table(assumed: Mapping[str, str], of_coil: Mapping[str, str], shapes: list[str]) -> dict[str, str]:
    table: dict[str, str] = {}
    for key, reason in assumed.items():
        owners = [name for name in of_coil if key.startswith(f"coils.{name}.")]
        if key.startswith("coils.*."):
            table |= {f"coils.{shape}.{key.removeprefix('coils.*.')}": reason for shape in shapes}
        elif owners:
            name = max(owners, key=len)
            table[f"coils.{of_coil[name]}.{key.removeprefix(f'coils.{name}.')}"] = reason
        else:
            table[key] = reason
    return table


def _mm(value: float) -> float:
    """Return a length in mm, to 1 nm."""
    return round(value * 1e3, 6) + 0.0  # no minus zero


def _digits(value: float) -> float:
    """Return a number without the rounding noise of its unit."""
    return float(f"{value:.12g}")


def _on_one_line(match: re.Match[str]) -> str:
    text = "[" + ", ".join(item.strip() for item in match[1].split(",\n")) + "]"
    return text if len(text) <= _LONGEST_LINE else "\n".join(textwrap.wrap(text, _LONGEST_LINE))
