"""Keys of TOML files, declared once for reading and writing.

A key is a field of a `Table`. Its annotation has the type and the range, its assignment the
default, the end of its name the unit, and the text beneath it the meaning.
"""

from __future__ import annotations

import ast
import difflib
import inspect
import json
import math
import sys
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError, PydanticUndefined

from coilarray.errors import listed, shown

MM, UM, DEG, PF = 1e-3, 1e-6, math.pi / 180, 1e-12  # units of entries in SI
_UNITS: Mapping[str, tuple[str, float]] = {
    "mm": ("mm", MM), "per_mm": ("1/mm", 1e3), "mm_per_mm": ("mm/mm", 1.0), "um": ("µm", UM),
    "deg": ("deg", DEG), "mrad": ("mrad", 1e-3), "pF": ("pF", PF), "nH": ("nH", 1e-9), "uH": ("µH", 1e-6),
    "MHz": ("MHz", 1e6), "kPa": ("kPa", 1e3), "kPa_per_mm": ("kPa/mm", 1e6), "MS_per_m": ("MS/m", 1e6),
    "ohm": ("ohm", 1.0), "ohm_m": ("ohm m", 1.0), "percent": ("%", 1e-2), "ppm": ("ppm", 1e-6),
    "ppm_per_K": ("ppm/K", 1e-6), "ppm_per_V": ("ppm/V", 1e-6), "ps": ("ps", 1e-12), "mV": ("mV", 1e-3),
    "V": ("V", 1.0), "K": ("K", 1.0), "Hz": ("Hz", 1.0), "F": ("F", 1.0), "H": ("H", 1.0), "s": ("s", 1.0),
    "Pa": ("Pa", 1.0),
}  # fmt: skip
"""Units at the end of a key, each as tables show it, and in SI."""
# Bounds far beyond any board, which refuse a typo at once instead of running for hours.
Millimetres = Annotated[float, Field(gt=0, le=10_000)]
Micrometres = Annotated[float, Field(gt=0, le=100_000)]
LimitMillimetres = Annotated[float, Field(ge=0, le=10_000)]
Position = Annotated[float, Field(ge=-100_000, le=100_000)]
Point = Annotated[list[Position], Field(min_length=2, max_length=2)]
Range = Annotated[list[Position], Field(min_length=2, max_length=2)]
Degrees = Annotated[float, Field(ge=-36_000, le=36_000)]
Relative = Annotated[float, Field(ge=1, le=1e6)]
Name = Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_.+][A-Za-z0-9_.+-]*$")]
REQUIRED = "none, required"  # default of a key that must be given
_WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}


def _parts(key: str) -> tuple[str, str, float]:
    """Split a key into name, unit ("1" without unit) and SI factor."""
    end = max((end for end in _UNITS if key.endswith(f"_{end}")), key=len, default="")
    return (key.removesuffix(f"_{end}"), *_UNITS[end]) if end else (key, "1", 1.0)


def entry_unit(key: str) -> str:
    """Return the unit of a dotted key, "1" without unit.

    >>> entry_unit("array.pitch_mm"), entry_unit("stackup.dielectric_thickness_mm.1"), entry_unit("array.columns")
    ('mm', 'mm', '1')
    >>> entry_unit("seat_stiffness_slope_x_per_mm"), entry_unit("seat_gap_slope_x_mm_per_mm")
    ('1/mm', 'mm/mm')
    """
    last = next((part for part in reversed(key.split(".")) if not part.isdecimal()), "")  # the key of the list
    return _parts(last)[1]


def key_in_si(key: str) -> tuple[str, float]:
    """Return a key without unit, and its SI factor."""
    name, _, scale = _parts(key)
    return name, scale


class Table(BaseModel):
    """Table of a file."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, validate_default=True)

    ATTRIBUTES: ClassVar[Mapping[str, str]] = {}
    """Attributes of the value in SI, for keys whose attribute is not the key without its unit."""

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, table: object) -> object:
        """Name the allowed keys beside an unknown key."""
        known = sorted(field.alias or name for name, field in cls.model_fields.items())
        for key in table if isinstance(table, Mapping) else ():
            if key not in known:
                close = difflib.get_close_matches(str(key), known, n=1) or [
                    name for name in known if len(str(key)) > 3 and str(key) in name
                ]
                hint = f"did you mean {close[0]}? Allowed" if close else "allowed"
                raise PydanticCustomError(
                    "unknown_key", "{hint}", {"hint": f"has no key {shown(key)}; {hint} are {listed(known)}"}
                )
        return table

    @classmethod
    def attribute(cls, key: str) -> tuple[str, float]:
        """Attribute and SI factor of a key."""
        name, scale = key_in_si(key)
        return cls.ATTRIBUTES.get(key, name), scale

    def in_si(self, *keys: str, without: Sequence[str] = ()) -> dict[str, Any]:
        """Values in SI by their attributes, lists as tuples."""
        found: dict[str, Any] = {}
        for key in keys or [key for key in type(self).model_fields if key not in without]:
            name, scale = self.attribute(key)
            found[name] = _times(getattr(self, key), scale)
        return found

    @classmethod
    def entries_of(cls, value: object, *keys: str, without: Sequence[str] = ()) -> dict[str, Any]:
        """Entries of a value in SI for `in_si`, arrays as lists, without None."""
        found: dict[str, Any] = {}
        for key in keys or [key for key in cls.model_fields if key not in without]:
            annotation: Any = cls.model_fields[key].annotation
            name, scale = cls.attribute(key)
            entry = _entry(getattr(value, name), scale, whole=not _is_float(annotation))
            if entry is not None:
                found[key] = entry
        return found

    @classmethod
    def not_by_default(cls, entries: Mapping[str, Any]) -> dict[str, Any]:
        """Entries that differ from their defaults."""
        default = cls().model_dump()
        return {key: entries[key] for key in default if key in entries and entries[key] != default[key]}


def _times(value: Any, scale: float) -> Any:
    if isinstance(value, list):
        return tuple(_times(item, scale) for item in value)
    return value if scale == 1 or value is None else value * scale


def _entry(value: Any, scale: float, *, whole: bool) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, tuple | list):
        return [_entry(item, scale, whole=whole) for item in value]
    if value is None or whole or isinstance(value, bool | str):
        return value
    return float(value) if scale == 1 else entry_of(value, scale)


@cache
def _is_float(annotation: Any) -> bool:
    return annotation is float or any(map(_is_float, typing.get_args(annotation)))


def entry_of(value: float, scale: float) -> float:
    """Return the entry whose `scale`-fold is a value."""
    return nearest_entry(value / scale, value, lambda entry: entry * scale)


def nearest_entry(guess: float, value: float, read: Callable[[float], float]) -> float:
    """Return a value's shortest exact entry, or the nearest.

    About every fortieth value has no exact entry, as numbers in mm lie less densely than in m. The
    nearest entry agrees to all digits of `Design.digest`.
    """
    for digits in (12, 15, 16, 17):
        entry = float(f"{guess:.{digits}g}")
        if read(entry) == value:
            return entry + 0.0  # no minus zero
    for entry in (math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf)):
        if read(entry) == value:
            return entry
    return guess * (float(f"{value:.14g}") / value) if value else guess


class Bounds(Table):
    """Bounds of what a table names: at least one, and the lower one not above the upper one."""

    at_least: float | None = None
    """Least value, in the unit of the quantity, as the largest."""
    at_most: float | None = None
    """Largest value."""

    @model_validator(mode="after")
    def _some_room(self) -> Bounds:
        if self.at_least is None and self.at_most is None:
            raise ValueError("needs at_least, at_most or both")
        if self.at_least is not None and self.at_most is not None and not self.at_least <= self.at_most:
            raise ValueError(f"needs at_least up to at_most; got {self.at_least:g} and {self.at_most:g}")
        return self


def require_rising(key: str, values: Sequence[float]) -> None:
    """Refuse values that do not rise."""
    if not all(low < high for low, high in pairwise(values)):
        raise ValueError(f"needs {key} that rise from each to the next; got {values}")


@dataclass(frozen=True)
class Key:
    """Key of a table, of `kinds` of shapes or lattices if not all.

    `path` has NAME for any name and N for any number in a list.
    """

    path: str
    name: str
    kinds: tuple[str, ...]
    unit: str
    allowed: str
    default: str
    meaning: str

    @property
    def dotted(self) -> str:
        """Key with its tables, such as array.pitch_mm."""
        return f"{self.path}.{self.name}".removeprefix(".")


@dataclass(frozen=True)
class Section:
    """Table with its keys, and the meaning of its holder."""

    table: type[Table]
    path: str
    kinds: tuple[str, ...]
    keys: tuple[Key, ...]
    holder: str


def sections_of(
    table: type[Table], path: str = "", holder: str = "", seen: set[tuple[type[Table], str]] | None = None
) -> Iterator[Section]:
    """Go through a table and the tables within it once."""
    seen = set() if seen is None else seen
    seen.add((table, path))
    kinds = tuple(
        str(value)
        for key in ("shape", "lattice")
        if key in table.model_fields and typing.get_origin(table.model_fields[key].annotation) is typing.Literal
        for value in typing.get_args(table.model_fields[key].annotation)
    )
    keys, inner = [], []
    for field_name, field in table.model_fields.items():
        name, meaning = field.alias or field_name, _meanings(table).get(field_name, "")
        if held := list(_tables(field.annotation)):
            origin: Any = typing.get_origin(field.annotation)
            end = ".NAME" if origin is dict else ".N" if origin is list else ""
            inner += [(each, f"{path}.{name}{end}".removeprefix("."), meaning) for each in held]
            continue
        unit = entry_unit(name)
        annotation = Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
        keys.append(Key(path, name, kinds, "" if unit == "1" else unit, _allowed(annotation), _default(field), meaning))
    yield Section(table, path, kinds, tuple(keys), holder)
    for each, where, meaning in inner:
        if (each, where) not in seen:
            yield from sections_of(each, where, meaning, seen)


def keys_of(table: type[Table]) -> list[Key]:
    """List the keys of a file, each once."""
    found: dict[Key, tuple[str, ...]] = {}
    for section in sections_of(table):
        for key in section.keys:
            plain = replace(key, kinds=())
            found[plain] = (*found.get(plain, ()), *key.kinds)
    every: dict[str, set[str]] = {}
    for key, kinds in found.items():
        every.setdefault(key.path, set()).update(kinds)
    order = list(every)
    return [
        replace(key, kinds=() if set(kinds) == every[key.path] else tuple(dict.fromkeys(kinds)))
        for key, kinds in sorted(found.items(), key=lambda item: order.index(item[0].path))
    ]


def tags_of(table: type[BaseModel], key: str, tag: str) -> list[str]:
    """Shapes or lattices by which a key's `tag` chooses tables."""
    held = _tables(table.model_fields[key].annotation)
    return [value for one in held for value in typing.get_args(one.model_fields[tag].annotation)]


@cache
def _meanings(table: type[Table]) -> dict[str, str]:
    """Return the texts beneath the keys of a class and its bases."""
    found: dict[str, str] = {}
    for base in reversed(table.__bases__):
        found |= _meanings(base) if issubclass(base, Table) else {}
    for statement, following in pairwise(_classes(table.__module__)[table.__name__].body):
        match statement, following:
            case ast.AnnAssign(target=ast.Name(id=key)), ast.Expr(value=ast.Constant(value=str(text))):
                found[key] = " ".join(text.split())
    return found


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    body = ast.parse(inspect.getsource(sys.modules[module])).body
    return {node.name: node for node in body if isinstance(node, ast.ClassDef)}


def _tables(annotation: Any) -> Iterator[type[Table]]:
    """Every table that an annotation may hold."""
    if isinstance(annotation, type) and issubclass(annotation, Table) and annotation is not Table:
        yield annotation
    for part in typing.get_args(annotation):
        yield from _tables(part)


def _allowed(annotation: Any) -> str:
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        base, *metadata = parts
        bounds = bounds_text(metadata).replace("of them", "characters" if base is str else "of them")
        return ", ".join(filter(None, (_allowed(base), bounds)))
    if origin is typing.Literal:
        return ", ".join(f'"{value}"' for value in parts)
    if origin in (typing.Union, types.UnionType):
        return ", or ".join(dict.fromkeys(_allowed(part) for part in parts if part is not type(None)))
    if origin is list:
        return f"list: {_allowed(parts[0])}"
    if origin is dict:
        return f"table: {_allowed(parts[1])} by name"
    return _WORDS.get(annotation, "any value")


def bounds_text(metadata: Sequence[Any]) -> str:
    """Bounds of an annotation in words.

    >>> bounds_text([Gt(0), Le(0.5)]), bounds_text([Ge(-5), Le(7)])
    ('above 0, at most 0.5', '−5 to 7')
    """
    match [rule for rule in metadata if isinstance(rule, Ge | Le)]:
        case [Ge(ge=low), Le(le=high)]:
            first, last = _number(low), _number(high)
            return f"always {first}" if first == last else f"{first} to {last}"
    match [rule for rule in metadata if isinstance(rule, MinLen | MaxLen)]:
        case [MinLen(min_length=least), MaxLen(max_length=most)] if least == most:
            return f"{most} of them"
    words = []
    for rule in metadata:
        match rule:
            case Ge(ge=bound):
                words.append(f"at least {_number(bound)}")
            case Gt(gt=bound):
                words.append(f"above {_number(bound)}")
            case Le(le=bound):
                words.append(f"at most {_number(bound)}")
            case Lt(lt=bound):
                words.append(f"below {_number(bound)}")
            case MinLen(min_length=count) if count > 1:
                words.append(f"at least {count} of them")
            case MaxLen(max_length=count):
                words.append(f"at most {count} of them")
            case FieldInfo(metadata=inner):
                words.append(bounds_text(inner))
    return ", ".join(word for word in words if word)


def _number(bound: Any) -> str:
    """Write a bound with all digits and a minus sign."""
    whole = float(bound).is_integer()
    return (f"{int(bound):,}".replace(",", "\u202f") if whole else f"{bound:g}").replace("-", "−")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return REQUIRED
    value = field.default_factory() if field.default_factory is not None else field.default  # type: ignore[call-arg]
    return "" if value in (None, PydanticUndefined) or value == [] or value == {} else _toml(value)


def _toml(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
