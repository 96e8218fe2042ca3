"""All boards of a design: their rules and their places in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Literal, NamedTuple

from coilarray.compute.display_units import MM
from coilarray.design.fabs import FabProfile, load_profile
from coilarray.geometry.array import array_words
from coilarray.geometry.pose import Pose
from coilarray.geometry.rules import Margin, check_rules, worst_first

if TYPE_CHECKING:
    from coilarray.design.model import Board, Design, DesignFile


def check_boards(design: Design) -> tuple[Margin, ...]:
    """Margins of all boards to their own rules, the worst first, with the board before the layer."""
    found = [of_board(board, check_rules(board.array, board.design.rules)) for board in design.placed]
    return worst_first(chain(*found)) if design.boards else found[0]


def of_board(board: Board, margins: Iterable[Margin]) -> tuple[Margin, ...]:
    """Margins with the name of their board, if any, before the layer."""
    return tuple(
        replace(margin, layer=f"{board.prefix}{margin.layer}" if margin.layer else board.name) if board.name else margin
        for margin in margins
    )


class Verdict(NamedTuple):
    """Sentence about a board, and its kind."""

    kind: Literal["ok", "warn", "bad"]
    text: str


def made_verdict(file: DesignFile, margins: Sequence[Margin], profile: FabProfile | None = None) -> Verdict:
    """Say whether the board can be made, and by whose limits.

    The `margins` are to the limits of the `profile` if it is given, else to those of the `file`.
    Limits that are assumed or left at their default say nothing about a real board house.
    """
    broken, count = sum(not margin.kept for margin in margins), len(margins)
    if broken:
        return Verdict("bad", f"Cannot be made: {broken} of {count} limits are broken.")
    named = None if (name := file.values.get("fab.profile")) is None else load_profile(str(name))
    own = [key for key in file.values if key.startswith("fab.min_") and file.values[key] is not None]
    assumed = [key for key in own if key in file.assumed and (named is None or key in file.given)]
    if profile is None and (assumed or (named is None and not file.given.issuperset(own))):
        whose = f"some in place of those of {named.title}" if named else "no board house is named"
        limits = "its own assumed" if assumed else "the default"
        return Verdict("warn", f"Keeps {limits} limits ({whose}): all {count} limits are kept.")
    house, others = profile or named, bool(file.design.boards) and profile is None
    whose = f"of {house.title}" if house else "given in the design"
    return Verdict("ok", f"Can be made: all {count} limits {whose}{' and of the other boards' * others} are kept.")


def named_boards(design: Design) -> tuple[Board, ...]:
    """Return the own board and those with a name, without further loops of a surface."""
    return tuple(board for k, board in enumerate(design.placed) if board.name or not k)


def boards_words(design: Design) -> str:
    """Describe the coils of all boards."""
    own, *named = named_boards(design)
    loops = len(design.placed) - len(named)
    start = f"{loops} loops in space, the first " if loops > 1 else ""
    others = (f"{board.name}: {array_words(board.array)}" for board in named)
    return "; ".join([start + array_words(own.array), *others])


def board_facts(design: Design) -> list[tuple[str, str]]:
    """Facts about other boards, as rows of name and value."""
    _, *named = named_boards(design)
    loops = len(design.placed) - len(named)
    rows = [("loops", f"{loops} in space, the first as above")] if loops > 1 else []
    return rows + [(f"board {board.name}", f"{array_words(board.array)}, {pose_words(board.pose)}") for board in named]


def pose_words(pose: Pose) -> str:
    """Describe the place of a board.

    >>> pose_words(Pose(x=1e-3, z=8e-3, turn=(math.pi, 0.0, 0.0)))
    'at (1, 0, 8) mm, turned (180, 0, 0)°'
    """
    turns = [round(math.degrees(angle), 3) + 0.0 for angle in pose.turn]
    turned = f", turned ({', '.join(f'{turn:g}' for turn in turns)})°" if any(turns) else ""
    return f"at ({', '.join(f'{value:g}' for value in (MM.of(pose.shift).round(6) + 0.0).tolist())}) mm{turned}"
