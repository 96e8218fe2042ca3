"""Stack-up of a board from its Gerber job file."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from coilarray.errors import BoardError, GeometryError
from coilarray.geometry.readers.assumed_stackup import Slab, filled_copper, filled_dielectrics, united
from coilarray.geometry.readers.gerber_files import DataFile
from coilarray.geometry.stackup import Stackup

_FILES = "the files do"
_MM = 1e-3


@dataclass(frozen=True)
class _Given:
    """What a job file says, None where it says nothing; lengths in m."""

    names: tuple[str, ...] = ()
    copper: tuple[float | None, ...] = ()
    slabs: tuple[Slab, ...] = ()
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
    copper = filled_copper(given.copper or (None,) * copper_layers, _FILES, assumed)
    slabs = given.slabs or ((None, None),) * (copper_layers - 1)
    dielectrics = filled_dielectrics(slabs, copper, given.board, _FILES, assumed)
    try:
        return Stackup(names, copper, *dielectrics), assumed
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
    return _Given(
        tuple(str(layers[k]["Name"]) for k in at if layers[k].get("Name")),
        tuple(_length(layers[k], "Thickness") for k in at),
        tuple(
            united([(_length(part, "Thickness"), _positive(part, "DielectricConstant")) for part in parts])
            for parts in between
        ),
        board,
        job.label,
    )


def _positive(node: Any, key: str) -> float | None:
    value = node.get(key) if isinstance(node, dict) else None
    if not isinstance(value, (int, float)) or isinstance(value, bool) or value <= 0:
        return None
    return float(value)


def _length(node: Any, key: str) -> float | None:
    value = _positive(node, key)
    return None if value is None else value * _MM
