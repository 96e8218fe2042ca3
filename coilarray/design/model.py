"""Design files: TOML with units in the key names, read into frozen values in SI."""

from __future__ import annotations

import difflib
import hashlib
import json
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from coilarray.design import bundled
from coilarray.design.fab_limits import load_profile
from coilarray.design.scan_states import Passive, ScanState, Switches, check_state
from coilarray.design.tables import Document, StateTable, first_error
from coilarray.errors import DesignError, GeometryError, NetworkError
from coilarray.geometry import Coil, CoilArray, FabRules, Indenter, Sheet

_LONGEST_NAME = 200  # characters shown of a file name


@dataclass(frozen=True)
class Circuit:
    """What the coils are connected to.

    Parameters
    ----------
    capacitance : float
        Of the tank in F.
    short_resistance : float
        Of the path that grounds a passive coil in Ω.
    resistivity : float
        Of the copper in Ω·m.
    terminations : tuple of {"short", "open"}
        State of each coil while another one is measured.
    switches : Switches
        The same with every parasitic part, for the network: each end of a coil goes through a switch of half the
        short resistance.
    plan : tuple of ScanState
        The states of a scan; each coil in turn with the others as in `terminations` where the file names none.
    elastomer_permittivity : float
        Relative permittivity of all sheets.
    """

    capacitance: float
    short_resistance: float
    resistivity: float
    terminations: tuple[Literal["short", "open"], ...]
    switches: Switches
    plan: tuple[ScanState, ...]
    elastomer_permittivity: float


@dataclass(frozen=True)
class Indentation:
    """What presses on the elastomer, how deep and where.

    Parameters
    ----------
    indenter : Indenter
        The rigid body.
    base : {"bonded", "frictionless"}
        How the lowest sheet lies on the board.
    depths : tuple of float
        In m, rising.
    x, y : tuple of float
        Positions of the map in m, relative to `origin_point`.
    origin : str or None
        Name of the coil whose centre is the origin; None for the origin of the board.
    origin_point : tuple of float
        x and y in m of that origin on the board.
    sample_radius : float or None
        Of a finite sample around the indenter in m, half the width under a cylinder; None for a wide one.
    sample_bounds : tuple of float or None
        Edges (x_min, y_min, x_max, y_max) in m of the sample relative to `origin_point`; None where it covers
        everything.
    """

    indenter: Indenter
    base: Literal["bonded", "frictionless"]
    depths: tuple[float, ...]
    x: tuple[float, ...]
    y: tuple[float, ...]
    origin: str | None = None
    origin_point: tuple[float, float] = (0.0, 0.0)
    sample_radius: float | None = None
    sample_bounds: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Design:
    """A design file, read and checked.

    Parameters
    ----------
    name, title, source : str
        As in the file.
    array : CoilArray
        The coils on their board.
    sheets : tuple of Sheet
        Elastomer on top of the board, upwards.
    indentation : Indentation or None
        How the elastomer is pressed; None where the file says nothing of it.
    circuit : Circuit
        Terminations and tank.
    rules : FabRules
        Limits of the board house, of a bundled profile where the file names one.
    field_height : float
        Height in m of the plane on which reports show the field.
    values : mapping of str to object
        Every value by its dotted key, defaults included, in the units of the keys.
    given : frozenset of str
        Keys that stand in the file; the others have their default.
    assumed : mapping of str to str
        Keys whose values are assumed, with the reason.
    digest : str
        SHA-256 of all values that enter a result, hexadecimal: equal for equal designs whatever their comments.
    document : mapping of str to object
        The file as TOML reads it, nothing added: plain tables, lists and values. `coilarray.design.vary.vary` changes
        its entries, and `build_design` makes the design of it again.
    """

    name: str
    title: str
    source: str
    array: CoilArray
    sheets: tuple[Sheet, ...]
    indentation: Indentation | None
    circuit: Circuit
    rules: FabRules
    field_height: float
    values: Mapping[str, object]
    given: frozenset[str]
    assumed: Mapping[str, str]
    digest: str
    document: Mapping[str, Any]


def load_design(name_or_path: str | Path | None = None) -> Design:
    """Read a design.

    Parameters
    ----------
    name_or_path : str or Path, optional
        A TOML file, or the name of a bundled design; the bundled ``gast2020`` by default.

    Returns
    -------
    Design

    Raises
    ------
    DesignError
        An unreadable file, wrong TOML, an unknown key, a value that is not allowed, or an impossible geometry: one
        line that names the file, the key, what was given and what is allowed.

    Examples
    --------
    >>> load_design("gast2020").array.names
    ('coil1', 'coil2', 'coil3', 'coil4', 'coil5', 'coil6')
    """
    given = bundled.STARTER if name_or_path is None else str(name_or_path)
    if not given:
        raise DesignError("the name of a design file must not be empty.")
    path = Path(given)
    if given in bundled.names() and not path.is_file():
        return parse_design(bundled.read(given), origin=given)
    try:
        text = path.read_text(encoding="utf-8-sig")  # some editors put a byte order mark first
    except FileNotFoundError:
        raise DesignError(
            f"there is no design file {given[:_LONGEST_NAME]}, nor a bundled design of that name "
            f"({', '.join(bundled.names())})."
        ) from None
    except UnicodeDecodeError:
        raise DesignError(f"{given} is no text file in UTF-8.") from None
    except OSError as error:
        raise DesignError(f"cannot read {given[:_LONGEST_NAME]}: {error.strerror}.") from None
    except ValueError as error:  # a name with a zero byte
        raise DesignError(f"cannot read {given!r}: {error}.") from None
    return parse_design(text, origin=given)


def parse_design(text: str, origin: str = "design") -> Design:
    """Read a design from the text of a TOML file; `origin` names it in messages. See `load_design`."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DesignError(f"{origin}: not valid TOML: {error}.") from None
    except RecursionError:
        raise DesignError(f"{origin}: not valid TOML: nested too deeply.") from None
    return build_design(document, origin)


def build_design(document: Mapping[str, Any], origin: str = "design") -> Design:
    """Check a document and make the design of it.

    Parameters
    ----------
    document : mapping of str to object
        A design file as TOML reads it.
    origin : str
        Names it in messages.

    Returns
    -------
    Design

    Raises
    ------
    DesignError
        As `load_design`.
    """
    try:
        parsed = Document.model_validate(document)
    except ValidationError as error:
        raise DesignError(f"{origin}: {first_error(error, document)}") from None
    try:
        return _build(parsed, document)
    except (DesignError, GeometryError, NetworkError) as error:
        raise DesignError(f"{origin}: {error}") from None


def _build(parsed: Document, document: Mapping[str, Any]) -> Design:
    coils: dict[str, Coil] = {}
    for name, table in parsed.coils.items():
        with _named(f"coils.{name}"):
            coils[name] = table.build()
    with _named("stackup"):
        stackup = parsed.stackup.build()
    with _named("array"):
        placements = tuple(parsed.array.build(coils))
    array = CoilArray(
        stackup,
        placements,
        board_margin=parsed.board.margin_mm * 1e-3,
        through_holes=parsed.board.through_holes,
    )
    values = _flatten(parsed.model_dump(by_alias=True, exclude={"assumed"}, exclude_none=True))
    for key in parsed.assumed:
        if key not in values:
            raise DesignError(f"assumed.{key!r} names no value of the design{_meant(key, values)}")
    sheets = [sheet.name for sheet in parsed.elastomer]
    if len(set(sheets)) != len(sheets):
        raise DesignError(f"elastomer sheets must have different names; got {', '.join(sheets)}.")
    circuit = parsed.circuit
    for coil in circuit.terminations:
        if coil not in array.names:
            raise DesignError(f"circuit.terminations.{coil} names no coil; there are {', '.join(array.names)}.")
    terminations = tuple(circuit.terminations.get(name, circuit.default_termination) for name in array.names)
    passive: dict[str, Passive] = {"short": "ground", "open": "open"}
    terminated = [passive[termination] for termination in terminations]
    states = parsed.scan or [StateTable(name=name, measure=[name]) for name in array.names]
    plan = tuple(state.build(array.names, terminated) for state in states)
    for state in plan:
        check_state(state, array.names)
    if len({state.name for state in plan}) != len(plan):
        raise DesignError(f"scan must name each state differently; got {', '.join(state.name for state in plan)}.")
    given = frozenset(_flatten(document))
    entering = {key: value for key, value in values.items() if key not in ("title", "source")}
    return Design(
        name=parsed.name,
        title=parsed.title or parsed.name,
        source=parsed.source,
        array=array,
        sheets=tuple(sheet.build() for sheet in parsed.elastomer),
        indentation=_indentation(parsed, array),
        circuit=Circuit(
            circuit.capacitance_pF * 1e-12,
            circuit.short_resistance_ohm,
            circuit.resistivity_ohm_m,
            terminations,
            Switches(
                on_resistance=circuit.short_resistance_ohm / 2,
                off_capacitance=circuit.switch_off_capacitance_pF * 1e-12,
                terminal_capacitance=circuit.terminal_capacitance_pF * 1e-12,
                bus_capacitance=circuit.bus_capacitance_pF * 1e-12,
                lead_inductance=circuit.lead_inductance_nH * 1e-9,
                tank_capacitance=circuit.capacitance_pF * 1e-12,
                tank_at=circuit.tank,
            ),
            plan,
            circuit.elastomer_permittivity,
        ),
        rules=parsed.fab.build(),
        field_height=parsed.field.height_mm * 1e-3,
        values=values,
        given=given,
        assumed={**_assumed_by_profile(parsed.fab.profile, given), **parsed.assumed},
        digest=hashlib.sha256(json.dumps(entering, sort_keys=True).encode()).hexdigest(),
        document=document,
    )


def _indentation(parsed: Document, array: CoilArray) -> Indentation | None:
    """Put the tables [indenter] and [indentation] together, which say nothing one without the other."""
    indenter, table = parsed.indenter, parsed.indentation
    if indenter is None and table is None:
        return None
    if indenter is None or table is None:
        there, missing = ("indentation", "indenter") if indenter is None else ("indenter", "indentation")
        raise DesignError(f"[{there}] needs the table [{missing}] too.")
    if not parsed.elastomer:
        raise DesignError("[indentation] needs at least one [[elastomer]] to press on.")
    for k, sheet in enumerate(parsed.elastomer):
        if sheet.youngs_modulus_kPa is None:
            raise DesignError(f"elastomer.{k}.youngs_modulus_kPa is missing; [indentation] needs it of every sheet.")
    thickness = sum(sheet.thickness_mm for sheet in parsed.elastomer)
    if table.depths_mm[-1] >= thickness:
        raise DesignError(
            f"indentation.depths_mm must be less than the {thickness:g} mm of all sheets; got {table.depths_mm[-1]:g}."
        )
    if table.origin is not None and table.origin not in array.names:
        raise DesignError(
            f"indentation.origin names no coil; there are {', '.join(array.names)}; got {table.origin!r}."
        )
    origin = (0.0, 0.0)
    if table.origin is not None:
        place = array.placements[array.names.index(table.origin)]
        origin = (place.x, place.y)
    x, y = table.positions()
    with _named("indenter"):
        body = indenter.build()
    return Indentation(
        indenter=body,
        base=table.base,
        depths=tuple(depth * 1e-3 for depth in table.depths_mm),
        x=x,
        y=y,
        origin=table.origin,
        origin_point=origin,
        sample_radius=None if table.sample_radius_mm is None else table.sample_radius_mm * 1e-3,
        sample_bounds=table.sample_bounds(),
    )


def _assumed_by_profile(name: str | None, given: frozenset[str]) -> dict[str, str]:
    """Limits that a fab profile assumes and the file does not give, with the reason."""
    assumed = {} if name is None else load_profile(name).assumed
    return {f"fab.{key}": reason for key, reason in assumed.items() if f"fab.{key}" not in given}


@contextmanager
def _named(key: str) -> Iterator[None]:
    """Put the key of a table before the message of a geometry that it cannot have."""
    try:
        yield
    except GeometryError as error:
        raise DesignError(f"{key}: {error}") from None


def _flatten(table: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Give every value by its dotted key; tables in a list are numbered from 0, plain lists stay whole."""
    flat: dict[str, object] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            flat.update(_flatten(value, f"{name}."))
        elif isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
            for index, item in enumerate(value):
                flat.update(_flatten(item, f"{name}.{index}."))
        else:
            flat[name] = value
    return flat


def _meant(key: str, known: Mapping[str, object]) -> str:
    close = difflib.get_close_matches(key, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else "."
