"""The questions that `coilarray init` asks on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import typer

from coilarray.errors import DesignError

_LONG = ("rectangle", "racetrack")  # shapes with a width and a height
_FIT, _BESIDE, _DECOUPLED, _ANY = "fit", "side by side", "decoupled", "any"


def ask_for_choices(shapes: Sequence[str]) -> dict[str, Any]:
    """Ask for the choices of a new design, by the names of the options; each answer is checked at once."""
    from coilarray.design import fabs
    from coilarray.studies.create import read_arrangement

    typer.echo("A new design: Return takes what stands in brackets.")
    coils = _ask(
        "Coils: 1, 6 (a row), 4x4 (columns by rows) or 7-hex", "4x4", lambda text: _kept(text, read_arrangement)
    )
    shape = _ask(f"Shape: {', '.join(shapes)}", "square", _one_of(shapes))
    sides, usual = ("Width x height", "20x12") if shape in _LONG else ("Width", "12")
    chosen = {"coils": coils, "shape": shape}
    chosen["size_mm"] = _ask(f"{sides} of a coil in mm", usual, lambda text: _kept(text, read_size))
    chosen |= _ask("Inductance in µH, or as many turns as fit", _FIT, _number_or("inductance_uH", {_FIT: {}}))
    several = read_arrangement(coils).lattice != "single"
    if several:
        beside = {_BESIDE: {}, _DECOUPLED: {"overlap": _DECOUPLED}}
        chosen |= _ask(f"Pitch in mm, {_BESIDE}, or {_DECOUPLED} by overlap", _BESIDE, _number_or("pitch_mm", beside))
    fab = _ask(f"Board house: {_ANY}, {', '.join(fabs.names())}", _ANY, _one_of((_ANY, *fabs.names())))
    if fab != _ANY:
        chosen["fab"] = fab
    chosen["elastomer"] = typer.confirm("A magnetic elastomer on the board", default=several)
    return chosen


def read_size(text: str) -> float | tuple[float, float]:
    """Read a width, or width and height as 20x12, in mm; return it in m."""
    try:
        sides = [float(side) * 1e-3 for side in text.lower().replace("×", "x").split("x")]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2):
        raise DesignError(f"--size-mm must be a width, as 16, or width and height, as 20x12; got {text!r}.")
    return sides[0] if len(sides) == 1 else (sides[0], sides[1])


def _ask(question: str, default: str, read: Callable[[str], Any]) -> Any:
    """Ask until the answer can be read."""
    while True:
        answer = typer.prompt(question, default=default).strip()
        try:
            return read(answer)
        except DesignError as error:
            typer.echo(f"  {error}")


def _kept(text: str, read: Callable[[str], object]) -> str:
    """Return a text that can be read."""
    read(text)
    return text


def _one_of(words: Sequence[str]) -> Callable[[str], str]:
    def read(text: str) -> str:
        if text not in words:
            raise DesignError(f"{text!r} is none of {', '.join(words)}.")
        return text

    return read


def _number_or(option: str, words: dict[str, dict[str, str]]) -> Callable[[str], dict[str, Any]]:
    """Return what reads a number for an option, or a word that stands for other options."""

    def read(text: str) -> dict[str, Any]:
        if text in words:
            return words[text]
        try:
            return {option: float(text)}
        except ValueError:
            raise DesignError(f"{text!r} is no number and none of {', '.join(words)}.") from None

    return read
