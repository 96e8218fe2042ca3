"""Change single entries of a design.

An entry is a dotted key as in `DesignFile.values`, in the unit of its name, such as
``coils.hexagon.turns_per_layer``, ``elastomer.0.thickness_mm`` or ``circuit.terminations.coil2``.
The name of a table stands for its number in a list, as in ``boards.receiver.z_mm``, and so does
the coil of a port, as in ``circuit.ports.coil1.load_ohm``. Its value is
any that the file can have, tables excepted. The document is checked like a file.
"""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from coilarray.design.model import Design, DesignFile, build_design
from coilarray.design.write import as_file
from coilarray.errors import DesignError

_NO_ENTRIES = {
    "assumed": "[assumed] says why values are as they are",
    "name": "it names the design and changes no number",
    "title": "it names the design and changes no number",
    "source": "it says where the design is from and changes no number",
    "author": "it says who made the design and changes no number",
    "revision": "it names a state of the design and changes no number",
    "schema": "it says how the file is to be read",
}
_LARGEST_WHOLE = 1e15  # floats beyond are not exact to the unit


def vary(design: Design | DesignFile, changes: Mapping[str, Any]) -> Design:
    """Change entries of a design.

    Parameters
    ----------
    design : Design or DesignFile
        The design, which stays as it is. If it has no file, its entries come from
        `coilarray.design.write.design_document`.
    changes : mapping of str to object
        New values by dotted key, in the units of the keys. Entries that the file does not give may
        be set too.

    Returns
    -------
    Design
        The changed design, with all checks. It has the same name.

    Raises
    ------
    DesignError
        An unknown entry, a wrong type or value, or an impossible geometry, as
        `coilarray.load_design`.

    Examples
    --------
    >>> from coilarray import load_design
    >>> wider = vary(load_design("gast2020"), {"array.pitch_mm": 14.0, "array.columns": 3})
    >>> [round(float(x) * 1e3, 6) for x in wider.array.centres[:, 0]]
    [-14.0, 0.0, 14.0]
    """
    file = as_file(design)
    name = file.design.name
    try:
        document = vary_document(file.document, changes)
    except DesignError as error:
        raise DesignError(f"{name}: {error}") from None
    return build_design(document, name)


def vary_document(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a design file with changed entries, as plain tables that share the rest.

    A whole number like 3.0 becomes the integer 3, which every numeric entry takes. Raises
    DesignError for a key that cannot be an entry; `coilarray.design.model.build_design` finds other
    faults.
    """
    varied: Any = dict(document)
    for key, value in changes.items():
        coils = document.get("coils")
        parts = key.split(".")
        if parts[0] == "coils" and parts[1:] and isinstance(coils, Mapping) and not _longest_key(coils, parts[1:]):
            close = difflib.get_close_matches(".".join(parts[1:2]), list(coils), n=1)
            hint = f"did you mean coils.{close[0]}? " if close else ""
            raise DesignError(f"{key} names no coil shape; {hint}[coils] has {', '.join(coils) or 'none'}.")
        if parts[0] in _NO_ENTRIES:
            raise DesignError(f"{key} cannot be varied: {_NO_ENTRIES[parts[0]]}.")
        varied = _with_entry(varied, parts, plain(value), key)
    return dict(varied)


def vary_chosen(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change a document's values, which are no longer assumed."""
    return no_longer_assumed(vary_document(document, changes), changes)


def no_longer_assumed(document: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    """Return a document in which some keys are not assumed."""
    chosen = tuple(keys)
    assumed = {
        name: reason
        for name, reason in document.get("assumed", {}).items()
        # The dots keep array.pitch apart from array.pitch_mm.
        if not any(f"{key}.".startswith(f"{name}.") or f"{name}.".startswith(f"{key}.") for key in chosen)
    }
    rest = {key: value for key, value in document.items() if key != "assumed"}
    return rest | ({"assumed": assumed} if assumed else {})


def _with_entry(table: Any, parts: Sequence[str], value: Any, key: str) -> Any:
    """Copy a table or list with one entry set."""
    if isinstance(table, list):
        named_by = [item if isinstance(item, Mapping) else {} for item in table]
        names = [str(item.get("name", item.get("coil", ""))) for item in named_by]  # a port has the name of its coil
        named = [k for k, name in enumerate(names) if name == parts[0]]
        parts = [str(named[0]), *parts[1:]] if len(named) == 1 else parts
        if not parts[0].isdecimal() or int(parts[0]) >= len(table):
            numbers = "0" if len(table) == 1 else f"a number from 0 to {len(table) - 1}"
            named_too = f" or a name ({', '.join(filter(None, names))})" if any(names) else ""
            raise DesignError(f"{key} must have {numbers}{named_too} for {parts[0]!r}.")
        place = int(parts[0])
        return [*table[:place], _set(table[place], parts[1:], value, key), *table[place + 1 :]]
    if not isinstance(table, Mapping):
        raise DesignError(f"{key} goes beyond an entry whose value is {table!r}.")
    taken = _longest_key(table, parts) or 1
    name = ".".join(parts[:taken])
    return {**table, name: _set(table.get(name), parts[taken:], value, key)}


def _set(present: Any, parts: Sequence[str], value: Any, key: str) -> Any:
    """Return the new value of an entry, or inside it."""
    if parts:
        return _with_entry({} if present is None else present, parts, value, key)
    tables = present if isinstance(present, list) else [present]
    if any(isinstance(entry, Mapping) for entry in tables):
        first = f"{'0.' if isinstance(present, list) else ''}{next(iter(tables[0]), '…')}"
        raise DesignError(f"{key} is a table; name one of its entries, such as {key}.{first}.")
    return value


def _longest_key(table: Mapping[str, Any], parts: Sequence[str]) -> int:
    """Count the parts of a table's longest key with dots."""
    return next((count for count in range(len(parts), 0, -1) if ".".join(parts[:count]) in table), 0)


def plain(value: Any) -> Any:
    """Return a value without numpy, tuples and whole floats."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and value.is_integer() and abs(value) < _LARGEST_WHOLE:
        return int(value)
    return value
