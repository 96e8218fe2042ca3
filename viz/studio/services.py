"""Functions that the studio needs from outside of `coilarray.viz`: reports, stored response tables and boards.

`coilarray.viz` imports neither hardware nor reports, so the caller of the studio passes these functions. They run in
processes of their own and are therefore functions of a module with plain arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.localize.inverse import Location

Document = Mapping[str, Any]
"""Contents of a design file, from which `coilarray.design.model.build_design` makes the design."""


@dataclass(frozen=True)
class BoardRequest:
    """Request for the readings of a board.

    Parameters
    ----------
    document, name
        Document and name of the design.
    port : str
        Port of the board; ``"emulator"`` for none.
    wiring : str or None
        File or name of the wiring of its switches.
    """

    document: Document
    name: str
    port: str
    wiring: str | None = None


@dataclass(frozen=True, eq=False)
class BoardFrame:
    """Readings of one scan of a board.

    Parameters
    ----------
    line : str
        Description of the board.
    emulated : bool
        True for an emulated board.
    sequence : int
        Number of the scan.
    delta, reasons : mapping of str to (float or None), and to str
        δ of every state, None for one without it; and why the readings of states are not good.
    waiting, lost : int
        Numbers of scans that the baseline still needs, and of lost scans.
    location, problem : Location or None, and str
        Position of the indentation, or the reason why there is none.
    rate : float or None
        Number of scans per second.
    """

    line: str
    emulated: bool
    sequence: int
    delta: Mapping[str, float | None]
    reasons: Mapping[str, str] = field(default_factory=dict)
    waiting: int = 0
    location: Location | None = None
    problem: str = ""
    rate: float | None = None
    lost: int = 0


@dataclass(frozen=True)
class Summary:
    """What a design comes to: a table of texts, and a line for each limit that is broken."""

    headers: Sequence[str]
    rows: Sequence[Sequence[str]]
    verdicts: Sequence[str]


Tell = Callable[[Any], None]
"""Sends a message from the process of a job; raises `coilarray.viz.studio.job.Cancelled` after a stop."""

Stopped = Callable[[], bool]
"""Returns whether the job is to end."""

WriteReport = Callable[[Document, str, Path, "Progress"], Path]
"""Writes the report of a design (document, name) into a folder; returns its page."""

ResponseTable = Callable[[Document, str, "Progress"], "xr.Dataset"]
"""Returns the response of a design (document, name) at the positions of `coilarray.localize.forward.table_grid`."""

Summarize = Callable[["Design", "xr.Dataset", "xr.Dataset | None"], "Summary"]
"""Summarizes a design with its coupling (of `coilarray.couple_design`) and its response on the board, where known."""

WatchBoard = Callable[[BoardRequest, Callable[[BoardFrame], None], Stopped], None]
"""Opens a board, sends a frame for every scan until it is stopped, and leaves the board at rest."""


def compute_table(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Compute a response table without storing it."""
    from coilarray.design.model import build_design
    from coilarray.localize.forward import table_for

    return table_for(build_design(document, name), progress=progress)


@dataclass(frozen=True)
class Services:
    """Functions that the caller of the studio provides.

    Parameters
    ----------
    response_table : callable
        A `ResponseTable`.
    write_report, watch_board, summarize : callable, optional
        A `WriteReport`, a `WatchBoard` and a `Summarize`; without one there is no button, tab or table for it.
    port, wiring : str, optional
        Port of the board that is watched, and wiring of its switches.
    """

    response_table: ResponseTable = compute_table
    write_report: WriteReport | None = None
    watch_board: WatchBoard | None = None
    port: str = "emulator"
    wiring: str | None = None
    summarize: Summarize | None = None
