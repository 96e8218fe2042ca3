"""Functions from outside `coilarray.viz`: reports, response tables and boards.

`coilarray.viz` imports neither hardware nor reports, so the caller of the studio passes these
functions. They run in processes of their own and are therefore functions of a module with plain
arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.viz.studio.job import Link

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.table import Table
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.localize.inverse import Location
    from coilarray.localize.presses import Press

Document = Mapping[str, Any]
"""Contents of a design file, for `coilarray.design.model.build_design`."""


@dataclass(frozen=True)
class BoardRequest:
    """Request for the readings of a board."""

    document: Document  # of the design, and its name
    name: str
    port: str  # port of the board, or ``"emulator"`` without a board
    recording: str | None = None  # file of a recording that is replayed instead
    reference: Sequence[str] = ()  # states that nothing touches. Their δ is subtracted from δ of all other states
    log: str | None = None  # file of a recording to be written


@dataclass(frozen=True, eq=False)
class BoardFrame:
    """Readings of one scan of a board."""

    line: str  # description of the board
    emulated: bool  # true for an emulated board
    sequence: int  # number of the scan
    # δ of every state, None for a state without it, and why the readings of states are not good.
    delta: Mapping[str, float | None]
    reasons: Mapping[str, str] = field(default_factory=dict)
    waiting: int = 0  # numbers of scans that the baseline still needs, and of lost scans
    location: Location | None = None  # position of the indentation, or the reason why there is none
    problem: str = ""
    rate: float | None = None  # number of scans per second
    lost: int = 0
    time: float = 0.0  # time of the scan in s since the first scan
    press: Press | None = None  # press during this scan, or that has ended with it
    temperature: float | None = None  # temperature of the board in °C, if it is known


@dataclass(frozen=True)
class Summary:
    """Summary of a design, `converter` False if unknown."""

    table: Table
    verdicts: Sequence[str]
    converter: bool = True


@dataclass(frozen=True)
class Services:
    """Functions of the caller, not offered if missing."""

    # Returns the response of a design (document, name) at the positions of
    # `coilarray.localize.forward.table_grid`.
    response_table: Callable[[Document, str, Progress], xr.Dataset] | None = None
    # Writes the report of a design (document, name) into a folder and returns its page.
    write_report: Callable[[Document, str, Path, Progress], Path] | None = None
    # Opens a board or a recording, sends lists of frames, and leaves the board at rest. It follows
    # the order `ZERO`.
    watch_board: Callable[[BoardRequest, Link], None] | None = None
    port: str = "emulator"  # port of the watched board, if the page does not name another port
    # Summarizes a design with its coupling (of `coilarray.couple_design`) and its response on the
    # board, if known.
    summarize: Callable[[Design, xr.Dataset, xr.Dataset | None], Summary] | None = None
    recording: str | None = None  # file of a recording that is replayed instead
    log: str | None = None  # file of a recording to be written
    reference: Sequence[str] = ()  # states that nothing touches, for the first reading
    alone: bool = False  # whether the page is the live display alone, and reads at once
    failed: Callable[[str], None] = lambda problem: None  # called with the reason if reading a board has failed
