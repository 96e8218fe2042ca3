"""Copper layers and stack-up of a KiCad board."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from coilarray.errors import BoardError, GeometryError
from coilarray.geometry.readers.board_copper import Slab, filled_copper, filled_dielectrics, united
from coilarray.geometry.readers.sexpr import Node
from coilarray.geometry.stackup import Stackup

_COPPER = re.compile(r"F\.Cu|In(\d+)\.Cu|B\.Cu")
_FILE = "the board file does"
_PER_M = 1e3  # numbers in the file are in mm


@dataclass(frozen=True)
class KicadLayers:
    """Copper layers of a board, top to bottom.

    The stack-up has the names that the user gave the layers, otherwise KiCad's own. `names` maps KiCad's layers (F.Cu,
    In1.Cu, …, B.Cu) to the layers of the stack-up. `assumed` are assumed values as in `BoardCopper`.
    """

    stackup: Stackup
    names: dict[str, str]
    assumed: dict[str, str]

    def one(self, node: Node) -> str | None:
        """Return a node's copper layer.

        It stands in (layer …) or (layers …). Mask layers are ignored. None if there is no copper layer.
        """
        if node.child("layers") is None:
            node.need("layer")
        found = self.all(node)
        if len(found) > 1:
            raise BoardError(f"{node.where}: ({node.name} …) must lie on one copper layer; got {', '.join(found)}.")
        return found[0] if found else None

    def all(self, node: Node) -> tuple[str, ...]:
        """Return the copper layers of a node, top to bottom.

        They stand in its (layers …) or (layer …).
        """
        words = {word for found in node.children("layers", "layer") for word in found.words}
        if "*.Cu" in words:
            return self.stackup.names
        if "F&B.Cu" in words:
            words |= {"F.Cu", "B.Cu"}
        found = {self._known(word, node) for word in words if _COPPER.fullmatch(word)}
        return tuple(name for name in self.stackup.names if name in found)

    def _known(self, layer: str, node: Node) -> str:
        if layer not in self.names:
            raise BoardError(f"{node.where}: there is no copper layer {layer}; the board has {', '.join(self.names)}.")
        return self.names[layer]


def read_layers(root: Node, stackup: Stackup | None = None) -> KicadLayers:
    """Read the copper layers of a board and their thicknesses.

    A given stack-up is used instead of the board's. Raises BoardError if there is no copper layer, the stack-up has
    other layers, or thicknesses are impossible.
    """
    table = root.need("layers")
    user_names = {}
    for node in table.items:
        if isinstance(node, Node) and _COPPER.fullmatch(node.text()):
            words = node.words
            user_names[str(words[0])] = str(words[2]) if len(words) > 2 else str(words[0])
    order = sorted(user_names, key=_depth)
    if not order:
        raise BoardError(f"{table.where}: the board has no copper layer.")
    if stackup is not None:
        if len(stackup.names) != len(order):
            raise BoardError(
                f"{table.where}: the board has {len(order)} copper layers and the given stack-up {len(stackup.names)}."
            )
        return KicadLayers(stackup, dict(zip(order, stackup.names, strict=True)), {})
    assumed: dict[str, str] = {}
    given = root.child("setup", "stackup")
    thicknesses: list[float | None] = [None] * len(order)
    slabs: list[Slab] = [(None, None)] * (len(order) - 1)
    if given is not None:
        thicknesses, slabs = _given(given, order)
    copper = filled_copper(thicknesses, _FILE, assumed)
    whole = root.child("general", "thickness")
    dielectrics = filled_dielectrics(slabs, copper, None if whole is None else whole.number() / _PER_M, _FILE, assumed)
    if min(dielectrics[0], default=1.0) <= 0 and "stackup.dielectric_thickness_mm" in assumed:
        where, board = (root.where, "usual thickness") if whole is None else (whole.where, f"{whole.number():g} mm")
        raise BoardError(f"{where}: a board of {board} is too thin for its {len(order)} copper layers.")
    try:
        built = Stackup(tuple(user_names[name] for name in order), copper, *dielectrics)
    except GeometryError as error:
        raise BoardError(f"{(given or table).where}: {error}") from None
    return KicadLayers(built, {name: user_names[name] for name in order}, assumed)


def _depth(name: str) -> float:
    match = _COPPER.fullmatch(name)
    inner = match and match[1]
    return float(inner) if inner else (0.0 if name == "F.Cu" else float("inf"))


def _given(given: Node, order: list[str]) -> tuple[list[float | None], list[Slab]]:
    """Thicknesses of copper, and the dielectrics between.

    A dielectric has a thickness and a permittivity. Unknown values are None.
    """
    copper: dict[str, float | None] = {}
    slabs: list[list[Slab]] = []
    for layer in given.children("layer"):
        if _COPPER.fullmatch(layer.text()):
            copper[layer.text()] = next((thickness for thickness, _ in _sublayers(layer)), None)
            slabs.append([])
        elif slabs:
            slabs[-1] += [slab for slab in _sublayers(layer) if slab != (None, None)]
    if list(copper) != order:
        raise BoardError(
            f"{given.where}: the stack-up must list the copper layers {', '.join(order)}; got {', '.join(copper)}."
        )
    return list(copper.values()), [united(parts) for parts in slabs[:-1]]


def _sublayers(layer: Node) -> Iterator[Slab]:
    """Yield thickness in m and permittivity of every sublayer.

    The word addsublayer separates the parts of a layer of the stack-up.
    """
    thickness = epsilon = None
    for item in layer.items:
        if item == "addsublayer":
            yield thickness, epsilon
            thickness = epsilon = None
        elif isinstance(item, Node) and item.name == "thickness":
            thickness = item.number() / _PER_M
        elif isinstance(item, Node) and item.name == "epsilon_r":
            epsilon = item.number()
    yield thickness, epsilon
