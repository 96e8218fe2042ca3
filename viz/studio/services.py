"""What the studio needs from outside of `coilarray.viz`: reports, kept response tables and boards.

Pictures know nothing of boards, and reports stand above pictures. So whoever starts the studio hands these in; all of
them run in processes of their own and are therefore functions of a module, whose arguments are plain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.threads import Progress
    from coilarray.localize.inverse import Location

Document = Mapping[str, Any]
"""A design file as TOML reads it: `coilarray.design.model.build_design` makes the design of it."""


@dataclass(frozen=True)
class BoardRequest:
    """What is asked of a board.

    Parameters
    ----------
    document : mapping of str to object
        Of the design.
    name : str
        Of the design.
    port : str
        Of the board; ``"emulator"`` for none.
    wiring : str or None
        File or name of the wiring of its switches.
    """

    document: Document
    name: str
    port: str
    wiring: str | None = None


@dataclass(frozen=True, eq=False)
class BoardFrame:
    """What one scan of a board says.

    Parameters
    ----------
    line : str
        Who answers.
    emulated : bool
        Whether no real board is behind it.
    sequence : int
        Of the scan.
    delta : mapping of str to (float or None)
        δ of every state; None where there is none.
    reasons : mapping of str to str
        Why a state's reading is not good.
    waiting : int
        Scans that the baseline still needs.
    location : Location or None
        Where the indentation is.
    problem : str
        Why there is no location.
    rate : float or None
        Scans per second.
    lost : int
        Scans that were missing.
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


Tell = Callable[[Any], None]
"""Sends a message from the process of a piece of work; raises `coilarray.viz.studio.job.Cancelled` after a stop."""

Stopped = Callable[[], bool]
"""Whether the work is to end."""

WriteReport = Callable[[Document, str, Path, "Progress"], Path]
"""Writes the report of a design (document, name) into a folder; returns its page."""

ResponseTable = Callable[[Document, str, "Progress"], "xr.Dataset"]
"""Returns the response of a design (document, name) at the positions of `coilarray.localize.forward.table_grid`."""

WatchBoard = Callable[[BoardRequest, Callable[[BoardFrame], None], Stopped], None]
"""Opens a board and sends a frame for every scan until it is stopped; leaves the board at rest."""


def compute_table(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Compute a response table, and keep it nowhere."""
    from coilarray.design.model import build_design
    from coilarray.localize.forward import table_for

    return table_for(build_design(document, name), progress=progress)


@dataclass(frozen=True)
class Services:
    """What the studio can do besides.

    Parameters
    ----------
    response_table : callable
        See `ResponseTable`.
    write_report : callable, optional
        See `WriteReport`; None takes the button away.
    watch_board : callable, optional
        See `WatchBoard`; None takes the tab away.
    port : str
        Of the board that is watched.
    wiring : str, optional
        Of its switches.
    """

    response_table: ResponseTable = compute_table
    write_report: WriteReport | None = None
    watch_board: WatchBoard | None = None
    port: str = "emulator"
    wiring: str | None = None
