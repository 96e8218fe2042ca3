"""Stack-up of a board from its Gerber job file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from coilarray.errors import BoardError, GeometryError
from coilarray.geometry.readers.gerber_files import DataFile
from coilarray.geometry.stackup import Stackup

_COPPER_THICKNESS = 35e-6
_EPSILON_R = 4.5
_BOARD_THICKNESS = 1.6e-3
_MM = 1e-3


@dataclass(frozen=True)
class _Given:
    """What a job file says, None where it says nothing; lengths in m."""

    names: tuple[str, ...] = ()
    copper: tuple[float | None, ...] = ()
    dielectric: tuple[float | None, ...] = ()
    epsilon_r: tuple[float | None, ...] = ()
    board: float | None = None
    label: str = field(default="")


def job_stackup(job: DataFile | None, copper_layers: int, source: str) -> tuple[Stackup, dict[str, str]]:
    """Take the stack-up from a job file and usual values for what it does not say.

    Parameters
    ----------
    job : DataFile or None
        The job file, where there is one.
    copper_layers : int
        Number of the files of copper.
    source : str
        Zip or folder, for messages.

    Returns
    -------
    stackup : Stackup
        Layers named as in the job file, otherwise L1, L2, ….
    assumed : dict of str to str
        As in `BoardCopper`.

    Raises
    ------
    BoardError
        A file that is not JSON, another number of layers, or thicknesses that cannot be.
    """
    given = _Given() if job is None else _read(job, copper_layers)
    assumed: dict[str, str] = {}
    names = given.names
    if len(set(names)) != copper_layers:
        names = tuple(f"L{k + 1}" for k in range(copper_layers))
        assumed["stackup.layers"] = "the files give the order of the layers, not their names"
    copper = [thickness or _COPPER_THICKNESS for thickness in given.copper or (None,) * copper_layers]
    if None in (given.copper or (None,)):
        assumed["stackup.copper_thickness_um"] = "the files do not say; standard 1 oz copper"
    dielectric = given.dielectric or (None,) * (copper_layers - 1)
    epsilon_r = given.epsilon_r or (None,) * (copper_layers - 1)
    if None in dielectric:
        board = given.board or _BOARD_THICKNESS
        left = board - sum(copper) - sum(thickness or 0.0 for thickness in dielectric)
        share = left / dielectric.count(None)
        dielectric = tuple(thickness or share for thickness in dielectric)
        assumed["stackup.dielectric_thickness_mm"] = (
            "the files do not say; equal parts of what is left of the "
            f"{'given' if given.board else 'usual'} board thickness of {board * 1e3:g} mm"
        )
    if None in epsilon_r:
        epsilon_r = tuple(epsilon or _EPSILON_R for epsilon in epsilon_r)
        assumed["stackup.dielectric_epsilon_r"] = f"the files do not say; FR-4, {_EPSILON_R:g}"
    try:
        return Stackup(names, tuple(copper), _known(dielectric), _known(epsilon_r)), assumed
    except GeometryError as error:
        raise BoardError(f"{given.label or source}: {error}") from None


def _read(job: DataFile, copper_layers: int) -> _Given:
    try:
        document = json.loads(job.text)
    except json.JSONDecodeError as error:
        raise BoardError(f"{job.label}:{error.lineno}: is not a whole Gerber job file: {error.msg}.") from None
    document = document if isinstance(document, dict) else {}
    general = document.get("GeneralSpecs")
    board = _length(general, "BoardThickness")
    listed = document.get("MaterialStackup")
    layers = [layer for layer in listed if isinstance(layer, dict)] if isinstance(listed, list) else []
    at = [k for k, layer in enumerate(layers) if layer.get("Type") == "Copper"]
    if not at:
        return _Given(board=board, label=job.label)
    if len(at) != copper_layers:
        raise BoardError(
            f"{job.label}: the stack-up has {len(at)} copper layers and there are files for {copper_layers}."
        )
    between = [
        [layer for layer in layers[first:last] if layer.get("Type") == "Dielectric"] for first, last in pairwise(at)
    ]
    united = [_united(parts) for parts in between]
    return _Given(
        tuple(str(layers[k]["Name"]) for k in at if layers[k].get("Name")),
        tuple(_length(layers[k], "Thickness") for k in at),
        tuple(thickness for thickness, _ in united),
        tuple(epsilon for _, epsilon in united),
        board,
        job.label,
    )


def _united(parts: Sequence[dict[str, Any]]) -> tuple[float | None, float | None]:
    """Thickness and permittivity of one dielectric in place of several in series."""
    thicknesses = [_length(part, "Thickness") for part in parts]
    epsilons = [_positive(part, "DielectricConstant") for part in parts]
    known = [(d, e) for d, e in zip(thicknesses, epsilons, strict=True) if d is not None and e is not None]
    total = sum(thickness or 0.0 for thickness in thicknesses)
    thickness = None if None in thicknesses or not parts else total
    if len(parts) == 1:
        return thickness, epsilons[0]
    epsilon = total / sum(d / e for d, e in known) if parts and len(known) == len(parts) else None
    return thickness, epsilon


def _positive(node: Any, key: str) -> float | None:
    value = node.get(key) if isinstance(node, dict) else None
    if not isinstance(value, (int, float)) or isinstance(value, bool) or value <= 0:
        return None
    return float(value)


def _length(node: Any, key: str) -> float | None:
    value = _positive(node, key)
    return None if value is None else value * _MM


def _known(values: Sequence[float | None]) -> tuple[float, ...]:
    return tuple(value for value in values if value is not None)
