"""The live display on a page: readings of a board in another process, and a window of its own.

The page is that of the studio, so that there is one display for both. A browser is on every system, unlike a toolkit
for windows, and can show a board at another computer.
"""

from __future__ import annotations

import threading
import webbrowser
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from coilarray.cli.board.live_source import QUIT, LiveOptions, live_readings, live_source
from coilarray.cli.board.options import BoardOptions, is_emulator
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design, DesignFile
    from coilarray.hardware.record.live_tracking import LiveReading
    from coilarray.localize.forward import ForwardModel
    from coilarray.viz.studio.services import BoardFrame, BoardRequest, Orders

_TOLD = 0.1  # s from message to message to the page
_MOST_WAITING = 20_000  # scans that wait for a page that does not take them; the oldest are dropped, not read later
_LINGER = 5.0  # s to load the page again before the window counts as closed


def show_window(options: LiveOptions, file: DesignFile, table: Path | None, *, locate: bool, browser: bool) -> None:
    """Serve a page with only the live display until it is closed, or Ctrl-C; the board is at rest afterwards.

    HardwareError if the reading of the board failed.
    """
    from coilarray.viz.studio.server import LOOPBACK, Address, bind, check_studio, serve
    from coilarray.viz.studio.services import Services
    from coilarray.viz.studio.work import Shelf, work_on

    check_studio()
    failures: list[str] = []

    def ready(url: str) -> None:
        typer.echo(f"live display: {url}  (Ctrl-C, or closing the page, ends it)")
        if browser:
            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()

    services = Services(
        watch_board=partial(watch_board, options, table, locate),
        port=options.board.port,
        recording=None if options.recording is None else str(options.recording),
        reference=options.reference,
        log=None if options.log is None else str(options.log),
        alone=True,
        failed=failures.append,
    )
    with bind(Address(LOOPBACK, 0)) as listening, suppress(KeyboardInterrupt):
        work = work_on(file, file.design.name)
        serve(work, Shelf(Path.cwd()), services, Address(LOOPBACK, 0), listening, linger=_LINGER, ready=ready)
    if failures:
        raise HardwareError(failures[-1])


# This runs in a process of its own, and is therefore a function of a module with plain arguments.


def watch_board(
    base: LiveOptions,
    table: Path | None,
    locate: bool,
    request: BoardRequest,
    send: Callable[[Sequence[BoardFrame]], None],
    orders: Orders,
) -> None:
    """See `coilarray.viz.studio.services.WatchBoard`; `base` has all options that the page does not offer."""
    from coilarray.design.model import build_design

    design = build_design(request.document, request.name)
    options = _options(base, request)
    with _sender(send) as tell:
        name = request.recording or request.port
        emulated = request.recording is None and is_emulator(request.port)
        wait = partial(_wait, tell, name, emulated)
        locates = locate and design.indentation is not None
        model = _model(design, table, wait) if locates and not options.opens_first else None
        with live_source(options, design, progress=wait) as source:
            if locates and options.opens_first:
                model = _model(design, table, wait)

            def asked() -> str:
                return QUIT if orders() else "".join(orders.take())

            with closing(live_readings(source, options, design, model, asked)) as readings:
                for reading in readings:
                    tell(_frame(reading, source.line, emulated=source.emulated))


def _options(base: LiveOptions, request: BoardRequest) -> LiveOptions:
    """Return the options with the choices of the page, without those for another kind of board."""
    board = base.board
    if request.recording is not None:
        board = BoardOptions()
    elif request.port != board.port:
        other = not is_emulator(request.port)
        board = replace(
            board, port=request.port, emulate=None if other else board.emulate,
            temperature=board.temperature if other else None,
        )  # fmt: skip
    log = None if request.log is None else Path(request.log)
    return replace(
        base,
        board=board,
        recording=None if request.recording is None else Path(request.recording),
        speed=1.0 if request.recording is None else base.speed,
        reference=tuple(request.reference),
        log=log,
        force=base.force and log == base.log,
    )


def _model(design: Design, table: Path | None, wait: Progress) -> ForwardModel:
    from coilarray.cli.maps import kept_table, stored_table
    from coilarray.localize.forward import forward_model
    from coilarray.response.dataset import on_board

    return forward_model(on_board(stored_table(design, progress=wait) if table is None else kept_table(design, table)))


def _wait(tell: Callable[[BoardFrame], None], name: str, emulated: bool, done: int, total: int) -> None:
    from coilarray.viz.studio.services import BoardFrame

    part = f" {100 * done / total:.0f} %" if total else ""
    tell(BoardFrame(f"{name}; response of the design{part} …", emulated, 0, {}))


def _frame(reading: LiveReading, line: str, *, emulated: bool) -> BoardFrame:
    from coilarray.viz.studio.services import BoardFrame

    return BoardFrame(
        line=line,
        emulated=emulated,
        sequence=reading.sequence,
        delta={state.name: state.delta for state in reading.states},
        reasons={
            state.name: f"{state.verdict}: {', '.join(state.reasons)}" for state in reading.states if state.reasons
        },
        waiting=reading.waiting,
        location=reading.location,
        problem=reading.problem,
        rate=reading.rate,
        lost=reading.lost,
        time=reading.elapsed,
        press=reading.press,
        temperature=reading.temperature,
    )


@contextmanager
def _sender(send: Callable[[Sequence[BoardFrame]], None]) -> Iterator[Callable[[BoardFrame], None]]:
    """Yield a function that passes frames to a thread, which sends those that wait ten times a second.

    So a slow page never delays the scans.
    """
    waiting: deque[BoardFrame] = deque(maxlen=_MOST_WAITING)
    ended = threading.Event()

    def flush() -> None:
        frames = [waiting.popleft() for _ in range(len(waiting))]
        if frames:
            send(frames)

    def work() -> None:
        from coilarray.viz.studio.job import Cancelled

        with suppress(Cancelled):
            while not ended.wait(_TOLD):
                flush()
            flush()

    thread = threading.Thread(target=work, daemon=True, name="frames")
    thread.start()
    try:
        yield waiting.append
    finally:
        ended.set()
        thread.join(timeout=2 * _TOLD)
