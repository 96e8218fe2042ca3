"""Copper layers and stack-up of a KiCad board."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from coilarray.errors import BoardError, GeometryError
from coilarray.geometry.readers.sexpr import Node
from coilarray.geometry.stackup import Stackup

_COPPER = re.compile(r"F\.Cu|In(\d+)\.Cu|B\.Cu")
_COPPER_THICKNESS = 35e-6
_EPSILON_R = 4.5
_PER_M = 1e3  # numbers in the file are in mm


@dataclass(frozen=True)
class KicadLayers:
    """Copper layers of a board, top to bottom.

    Parameters
    ----------
    stackup : Stackup
        With the names that the user gave the layers, KiCad's own where there are none.
    names : dict of str to str
        From KiCad's names (F.Cu, In1.Cu, …, B.Cu) to those of the stack-up, top to bottom.
    assumed : dict of str to str
        As in `BoardCopper`.
    """

    stackup: Stackup
    names: dict[str, str]
    assumed: dict[str, str]

    def one(self, node: Node) -> str | None:
        """Return the copper layer in a node's (layer …), None where it lies on another kind of layer."""
        layer = node.need("layer").text()
        if not _COPPER.fullmatch(layer):
            return None
        return self._known(layer, node)

    def all(self, node: Node) -> tuple[str, ...]:
        """Return the copper layers in a node's (layers …) or (layer …), top to bottom."""
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
    """Read the copper layers and what the board says of their thickness.

    Parameters
    ----------
    root : Node
        The whole board.
    stackup : Stackup, optional
        Taken in place of the board's own; as many copper layers.

    Raises
    ------
    BoardError
        No copper layer, a stack-up of other layers, or thicknesses that cannot be.
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
    setup = root.child("setup")
    given = None if setup is None else setup.child("stackup")
    copper = [_COPPER_THICKNESS] * len(order)
    slabs: list[tuple[float | None, float | None]] = [(None, None)] * (len(order) - 1)
    if given is None:
        assumed["stackup.copper_thickness_um"] = "the board file has no stack-up; standard 1 oz copper"
    else:
        copper, slabs = _given(given, order, assumed)
    filled = _filled(root, copper, slabs, assumed)
    try:
        built = Stackup(
            tuple(user_names[name] for name in order),
            tuple(copper),
            tuple(thickness for thickness, _ in filled),
            tuple(epsilon for _, epsilon in filled),
        )
    except GeometryError as error:
        raise BoardError(f"{(given or table).where}: {error}") from None
    return KicadLayers(built, {name: user_names[name] for name in order}, assumed)


def _depth(name: str) -> float:
    match = _COPPER.fullmatch(name)
    inner = match and match[1]
    return float(inner) if inner else (0.0 if name == "F.Cu" else float("inf"))


def _given(
    given: Node, order: list[str], assumed: dict[str, str]
) -> tuple[list[float], list[tuple[float | None, float | None]]]:
    """Copper thicknesses, and thickness and permittivity of the dielectrics between, None where not said."""
    copper: dict[str, float | None] = {}
    slabs: list[list[tuple[float | None, float | None]]] = []
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
    if None in copper.values():
        assumed["stackup.copper_thickness_um"] = "not given for every layer of the board file; standard 1 oz copper"
    thicknesses = [_COPPER_THICKNESS if value is None else value for value in copper.values()]
    return thicknesses, [_united(parts) for parts in slabs[:-1]]


def _sublayers(layer: Node) -> Iterator[tuple[float | None, float | None]]:
    """Thickness in m and permittivity of every part of a layer of the stack-up; the word addsublayer parts them."""
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


def _united(parts: list[tuple[float | None, float | None]]) -> tuple[float | None, float | None]:
    """One dielectric of the thickness and the capacitance of several in series."""
    thicknesses = [thickness for thickness, _ in parts if thickness is not None]
    epsilons = [epsilon for _, epsilon in parts if epsilon is not None]
    if len(parts) == 1:
        return parts[0]
    if len(thicknesses) < len(parts) or not parts:
        return None, (max(epsilons) if epsilons else None)
    total = sum(thicknesses)
    if len(epsilons) < len(parts) or min(epsilons) <= 0:
        return total, None
    return total, total / sum(d / epsilon for d, epsilon in zip(thicknesses, epsilons, strict=True))


def _filled(
    root: Node, copper: list[float], slabs: list[tuple[float | None, float | None]], assumed: dict[str, str]
) -> list[tuple[float, float]]:
    """Put assumed values where the board says nothing, and say so."""
    missing = [index for index, (thickness, _) in enumerate(slabs) if thickness is None]
    share = 0.0
    if missing:
        general = root.child("general")
        whole = None if general is None else general.child("thickness")
        board = 1.6e-3 if whole is None else whole.number() / _PER_M
        known = sum(copper) + sum(thickness for thickness, _ in slabs if thickness is not None)
        share = (board - known) / len(missing)
        if share <= 0:
            where = root.where if whole is None else whole.where
            raise BoardError(f"{where}: a board of {board * 1e3:g} mm is too thin for its {len(copper)} copper layers.")
        source = "usual" if whole is None else "given"
        assumed["stackup.dielectric_thickness_mm"] = (
            f"the board file does not say; equal parts of what is left of the {source} board thickness of "
            f"{board * 1e3:g} mm"
        )
    if any(epsilon is None for _, epsilon in slabs):
        assumed["stackup.dielectric_epsilon_r"] = f"the board file does not say; FR-4, {_EPSILON_R:g}"
    return [
        (share if thickness is None else thickness, _EPSILON_R if epsilon is None else epsilon)
        for thickness, epsilon in slabs
    ]
