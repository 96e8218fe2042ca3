"""The questions that `coilarray init` asks on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer

from coilarray.errors import DesignError

_FIT, _BESIDE, _DECOUPLED, _ANY, _NONE = "fit", "side by side", "decoupled", "any", "none"


def ask_for_choices(shapes: Sequence[str], edges: Sequence[str]) -> dict[str, Any]:
    """Ask for the choices of a new design, by the names of the options; each answer is checked at once."""
    from coilarray.design import fabs
    from coilarray.studies.create import LONG_SHAPES, Choices, read_arrangement

    def checked_coils(text: str) -> str:
        read_arrangement(text)
        return text

    def checked_size(text: str) -> str:
        Choices(**in_si({"shape": shape, "size_mm": text}))
        return text

    typer.echo("A new design. Press Return for the value in brackets.")
    coils = _ask("Coils: 1, 6 (a row), 4x4 (columns by rows), 3-hex or 7-hex", str(Choices.coils), checked_coils)
    shape = _ask(f"Shape: {', '.join(shapes)}", Choices.shape, _one_of(shapes))
    chosen = {"coils": coils, "shape": shape}
    sides = "Width x height" if shape in LONG_SHAPES else "Width"
    usual = "x".join(f"{side * 1e3:g}" for side in dict.fromkeys(Choices(shape=shape).sides))
    chosen["size_mm"] = _ask(f"{sides} of a coil in mm", usual, checked_size)
    chosen |= _ask("Inductance in µH, or as many turns as fit", _FIT, _number_or("inductance_uH", {_FIT: {}}))
    if read_arrangement(coils).lattice != "single":
        beside = {_BESIDE: {}, _DECOUPLED: {"overlap": _DECOUPLED}}
        chosen |= _ask(f"Pitch in mm, {_BESIDE}, or {_DECOUPLED} by overlap", _BESIDE, _number_or("pitch_mm", beside))
    at = (_NONE, *edges)
    edge = _ask(f"Leads of all coils to a connector at an edge: {', '.join(at)}", _NONE, _one_of(at))
    if edge != _NONE:
        chosen["connector"] = edge
    fab = _ask(f"Board house: {_ANY}, {', '.join(fabs.names())}", _ANY, _one_of((_ANY, *fabs.names())))
    if fab != _ANY:
        chosen["fab"] = fab
    chosen["elastomer"] = typer.confirm("A magnetic elastomer on the board", default=Choices.elastomer)
    return chosen


def in_si(chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return the choices, given by the names of the options, as `coilarray.studies.create.new_design` takes them."""
    from coilarray.design.keys import key_in_si
    from coilarray.studies.create import read_size

    choices = {}
    for key, value in chosen.items():
        name, scale = key_in_si(key)
        choices[name] = read_size(value) if key == "size_mm" else value if scale == 1 else value * scale
    return choices


def _ask(question: str, default: str, read: Callable[[str], Any]) -> Any:
    """Ask until the answer can be read."""
    while True:
        answer = typer.prompt(question, default=default).strip()
        try:
            return read(answer)
        except DesignError as error:
            typer.echo(f"  {error}")


def _one_of(words: Sequence[str]) -> Callable[[str], str]:
    def read(text: str) -> str:
        if text not in words:
            raise DesignError(f"{text!r} is not one of {', '.join(words)}.")
        return text

    return read


def _number_or(option: str, words: dict[str, dict[str, str]]) -> Callable[[str], dict[str, Any]]:
    """Return a reader of a number for an option, or a word that stands for other options."""
    from coilarray.studies.create import Choices

    def read(text: str) -> dict[str, Any]:
        if text in words:
            return words[text]
        try:
            choice = {option: float(text)}
        except ValueError:
            raise DesignError(f"{text!r} is neither a number nor one of {', '.join(words)}.") from None
        Choices(**in_si(choice))
        return choice

    return read
