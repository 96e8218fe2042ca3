"""What the studio's caller gives: functions from outside `coilarray.viz`, and the address.

`coilarray.viz` imports neither hardware nor reports, so the caller passes these functions. They run
in processes of their own and are therefore functions of a module with plain arguments.
"""

from __future__ import annotations

import errno
import os
import secrets
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.compute.extras import import_extra
from coilarray.errors import OutputError
from coilarray.viz.offscreen import require_pyvista
from coilarray.viz.studio.job import Link

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.table import Table
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.localize.inverse import Location
    from coilarray.localize.presses import Press

Document = Mapping[str, Any]  # contents of a design file, for `coilarray.design.model.build_design`


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


LOOPBACK = "127.0.0.1"  # default host of the studio, for this computer alone


@dataclass(frozen=True)
class Address:
    """Address of the studio."""

    host: str  # name or IP address on which it listens
    port: int  # 0 takes a free port
    alone: bool = False  # whether browsers must name this computer, as its own browsers do
    # sent by every browser, as this computer may have other accounts
    token: str = field(default_factory=partial(secrets.token_urlsafe, 24))


def check_studio() -> None:
    """Raise MissingDependencyError if a library of the studio is missing."""
    require_pyvista("pages of the studio", "studio")
    ui = {"trame.app": "trame", "trame.ui.vuetify3": "trame-vuetify"}
    for module, package in (*ui.items(), ("aiohttp", "aiohttp")):
        import_extra(module, "pages of the studio", package=package, extra="studio")


def bind(address: Address) -> socket.socket:
    """Bind the port of the studio, or raise an OutputError."""
    if not 0 <= address.port <= 65535:
        raise OutputError(f"--port must be 0 to 65535; got {address.port}.")
    try:
        kind, _, _, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(
            f"--host must be a name or number of this computer; got {address.host!r} ({reason})."
        ) from None
    listening = socket.socket(kind, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(place)
        listening.listen(64)
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise OutputError(
                f"port {address.port} is in use; give another one with --port, or --port 0 for any that is free."
            ) from None
        raise OutputError(f"cannot listen on {address.host}, port {address.port}: {error.strerror}.") from None
    return listening
