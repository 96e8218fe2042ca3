"""Web server of the studio, and the pages that it serves.

It decides which requests are answered, and holds one session per page: its panels and the
templates in ``html``.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import hmac
import logging
import os
import re
import signal
import socket
import traceback
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web
from trame_client.module import vue3

from coilarray.errors import CoilarrayError, shown
from coilarray.viz.offscreen import switched_off
from coilarray.viz.studio.design import BuildPanel, DesignPanel, NewPanel
from coilarray.viz.studio.live import LivePanel, TouchPanel, drawing
from coilarray.viz.studio.metal import MetalPanel
from coilarray.viz.studio.motion import MotionPanel
from coilarray.viz.studio.numbers import NumbersPanel, SwitchesPanel
from coilarray.viz.studio.runs import RunsPanel
from coilarray.viz.studio.services import Address, Services
from coilarray.viz.studio.session import Session, Setup, template
from coilarray.viz.studio.studies import StudiesPanel
from coilarray.viz.studio.view import ScenePanel
from coilarray.viz.studio.work import Shelf, Work

_LOG = logging.getLogger(__name__)
_DEFAULTS = {  # looks of the parts of the page
    **{
        field: {"density": "compact", "variant": "outlined", "hideDetails": True}
        for field in ("VTextField", "VSelect", "VAutocomplete", "VCombobox", "VCheckbox")
    },
    "VSlider": {"density": "compact", "hideDetails": True, "color": "primary", "thumbSize": 14, "trackSize": 3},
    "VBtnToggle": {"density": "compact", "variant": "outlined", "divided": True},
    "VAlert": {"density": "compact"},
}
_LOOKS = {  # colours of the page in the light and in the dark, with a contrast of at least 4.5
    "defaults": _DEFAULTS,
    "theme": {
        "themes": {
            "light": {
                "dark": False, "variables": {"medium-emphasis-opacity": 0.74},
                "colors": {"primary": "#0B5CAD", "info": "#0B5CAD", "error": "#B00020", "warning": "#8A4B00"},
            },
            "dark": {
                "dark": True,
                "colors": {
                    "primary": "#7DB7F5", "info": "#7DB7F5", "error": "#FF8A80", "warning": "#FFB74D",
                    "background": "#16181C", "surface": "#1E2126",
                },
            },
        }
    },
}  # fmt: skip
# Results that a change of the design makes stale.
_FOLLOWING = ("scene", "numbers", "rules", "circuit", "target", "summary")


class Page(Session):
    """Open page, which begins with the design `work`."""

    def __init__(self, setup: Setup, work: Work, tab: str) -> None:
        super().__init__(setup, work)
        self.tab, self.left = tab, False  # of the browser, and whether it has closed the page
        self.endpoint: Any = None  # endpoint of its messages
        self.numbers = NumbersPanel(self, self._circuit_solved, self._compared)
        self.build = BuildPanel(self)
        self.switches = SwitchesPanel(self, self.numbers)
        self.touch = TouchPanel(self, lambda: self.numbers.circuit and self.numbers.circuit.network)
        self.metal = MetalPanel(self, self.numbers)
        self.motion = MotionPanel(self)
        self.live = LivePanel(self)
        tabs = {"switches": self.switches.scene, "touch": self.touch.scene, "live": self.live.scene}
        self.scene = ScenePanel(self, tabs, self.metal.scene)
        self.runs = RunsPanel(self)
        self.studies = StudiesPanel(self)
        self.design = DesignPanel(self, self.saved)
        self.new = NewPanel(self)
        self.state.client_only("theme", "fold")
        self.state.update({"theme": "light", "fold": {}})
        self.state.tab = "live" if setup.services.alone else "numbers"
        for names, function in (
            (("tab", "scene_sheets", "show_eddies"), self.redraw), (("tab",), self.runs.offer),
            (("tab",), self.motion.begin), (("motion_board", "motion_axis"), self.motion.offer),
            (("tab",), self.touch.begin), (("run_goal",), self.runs.limit), (("field_of", "field_height"), self.redraw),
            (("matrix_of",), self.numbers.draw),
            (("live_span", "live_paused"), self.live.draw),
        ):  # fmt: skip
            self.state.change(*names)(lambda function=function, **_: function())
        self._build_layout()
        self.server.controller.on_server_bind.add(lambda server: setattr(self, "endpoint", server["ws"]))
        # an error of the page's scripts may contain anything
        self.server.controller.on_error.add(lambda text: _LOG.warning("coilarray: the page reports %s", shown(text)))
        self.server.controller.on_exception.add(self._refuse_call)
        self.server.start(
            backend="generic", exec_mode="task", port=0, timeout=0, disable_logging=True, show_connection_info=False,
            open_browser=False,
        )  # fmt: skip
        self.numbers.show(work)
        self.take(work)

    def come_back(self, tab: str) -> None:
        """Show a left page, with all of its jobs and results, to a tab that opens it."""
        self.tab, self.left = tab, False
        with self.state as state:
            state.update({"new_dialog": False, "open_dialog": False, "save_dialog": False, "large": ""})
            self.design.show(self.work, typed=False)  # the closed page alone knew the texts of its fields

    async def close(self) -> None:
        """End all computations and processes, and the server."""
        from trame.app.core import AVAILABLE_SERVERS

        self.runs.close()
        await super().close()
        await self.server.stop()
        AVAILABLE_SERVERS.pop(self.key, None)

    def saved(self, work: Work) -> None:
        """Show a saved design, maybe of another name or title."""
        same = work.design is self.work.design
        self.renamed(self.work, work)
        self.work = replace(self.work, file=work.file)  # no other file is opened
        if not same:
            self._show(work, typed=True)
            return
        self.work = work
        self.numbers.show(work)
        self.design.show(work, typed=True)

    def _show(self, work: Work, *, typed: bool) -> None:
        opened = work.file != self.work.file
        other = opened or set(work.design.coil_names) != set(self.work.design.coil_names)
        if work.kept is not self.work.kept:
            self.numbers.show(work)
        self.work = work
        design = work.design
        self.scene.show(design)
        with self.state:
            self.numbers.say_changes(work, self.metal.at_place)
            self.state.can_undo, self.state.can_redo = bool(self._before), bool(self._after)
            self.build.show(work)
            self.design.show(work, typed=typed)
            self.switches.show(design, anew=opened)
            self.touch.show(design, anew=other)
            self.metal.show(design, anew=other)
            self.motion.show(design)
            self.live.show(design)
            self.runs.show(design)
            self.runs.offer()
            self.studies.show(work, anew=other)
            self.state.accuracy, self.state.failures = "working", {}
            asked = {
                "scene": self.scene.steps(), "target": self.metal.steps(design),
                "summary": self.setup.services.summarize is not None,
            }  # fmt: skip
            self.state.stale = [name for name in _FOLLOWING if asked.get(name, True)]
            self._say_accuracy()
        if not self.setup.services.alone:  # everything that depends on the design is computed
            self.calculator.ask(self.numbers.steps(design))
            self.slow.ask(self.metal.steps(design))
            self.redraw()

    def redraw(self, *, moving: bool = False) -> None:
        """Compute the scene of the current tab again."""
        if not moving:
            self.scene.expect()
        self.scenes.ask(self.scene.steps())

    def _circuit_solved(self, problem: str) -> None:
        if problem:
            self.switches.fail(problem)
            return
        self.switches.solve()
        self.touch.begin()
        if self.state.tab == "switches" or self.state.show_eddies:
            self.redraw()

    def _compared(self) -> None:
        self.switches.solve()
        self.metal.compare()

    def _refuse_call(self, error: Exception) -> None:
        """Show a call's error, with traceback if our own."""
        frames = traceback.walk_tb(error.__traceback__)
        if any(str(frame.f_globals.get("__name__")).startswith("coilarray.") for frame, _ in frames):
            traceback.print_exception(error)
        self.say(str(CoilarrayError(f"{type(error).__name__}: {error}")))

    def _build_layout(self) -> None:
        from trame.ui.vuetify3 import VAppLayout

        def part(found: re.Match[str]) -> str:
            """Part of the page, with a value for its capitals."""
            name, value = found.groups()
            return filled(template(name).replace("VALUE", value or ""))

        def filled(text: str) -> str:
            return re.sub(r"<!-- (\w+)(?: (\w+))? -->", part, text)

        with VAppLayout(self.server, vuetify_config=_LOOKS, theme=("theme", "light")) as layout:
            layout.root.add_child(filled(template("page")))


_CLIENT = Path(vue3.www)  # scripts of trame
_HEARTBEAT = 20.0  # s without an answer after which a page counts as closed
_UNUSED = 60.0  # s, longest time for a page to connect to its session
_AWAY = 20.0  # s for which a left page is kept, and as long as it has jobs
_GOING_AWAY, _REFUSED = 1001, 1008  # codes of RFC 6455
_LARGEST = 10_000_000  # bytes of a message
_GOODBYE = 2.0  # s, time for requests to end
_THREADS = 3
_MOST_PAGES = 12
_TOO_MANY = f"the studio serves at most {_MOST_PAGES} pages at once"
_OWN_HOSTS = ("127.0.0.1", "localhost", "[::1]")
_ANOTHER_PAGE = "a request from another page."
_HOST = re.compile(r"[A-Za-z0-9_.-]+(:\d+)?|\[[0-9A-Fa-f:.]+\](:\d+)?")
# The connection of trame's client decides which scripts run, so only the studio is allowed.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; frame-ancestors 'none'; "
    "base-uri 'self'; form-action 'none'; object-src 'none'; connect-src 'self'"
)
# of a report: no scripts, nothing loaded, own origin
_REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)


def serve(
    work: Work,
    shelf: Shelf,
    services: Services,
    address: Address,
    listening: socket.socket,
    *,
    linger: float,
    ready: Callable[[str], None],
) -> None:
    """Serve the studio on a `bind` socket until stopped."""
    # Or until all pages have been closed for `linger` seconds, unless 0. `ready` gets the page's URL once it opens.
    logging.getLogger("wslink").setLevel(logging.CRITICAL + 1)  # a page itself shows the errors of its calls
    os.environ.setdefault("TRAME_ARGS", "")  # else trame would read our command line
    asyncio.run(_Studio(work, shelf, services, address, linger).run(listening, ready))


class _Studio:
    def __init__(self, work: Work, shelf: Shelf, services: Services, address: Address, linger: float) -> None:
        self._work, self._shelf, self._services = work, shelf, services
        self._address, self._linger = address, linger
        self._pages: dict[str, Page] = {}
        self._tabs: dict[str, Work] = {}  # last designs of closed pages, by the browser's tab
        self._talking: set[web.WebSocketResponse] = set()
        self._static: dict[str, Path] = {}
        self._reports: dict[str, Path] = {}
        self._unused: dict[str, asyncio.TimerHandle] = {}
        self._ending: asyncio.TimerHandle | None = None

    async def run(self, listening: socket.socket, ready: Callable[[str], None]) -> None:
        """Serve pages until the studio ends."""
        self._stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
                    loop.add_signal_handler(getattr(signal, name), self._stop.set)
        port = listening.getsockname()[1]
        self._cookie = f"coilarray_studio_{port}"
        app = web.Application(middlewares=[self._guard])
        app.router.add_get("/", self._index)
        app.router.add_post("/open/{tab}", self._open)
        app.router.add_get("/ws/{key}", self._talk)
        app.router.add_get("/reports/{key}", self._report)
        app.router.add_get("/arrays/{page}/{keys}", self._arrays)
        app.router.add_get("/{path:.+}", self._asset)
        runner = web.AppRunner(app, access_log=None, handle_signals=False, shutdown_timeout=_GOODBYE)
        with ThreadPoolExecutor(max_workers=_THREADS) as self._threads:
            await runner.setup()
            try:
                await web.SockSite(runner, listening).start()
                host = self._address.host
                host = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
                ready(f"http://{f'[{host}]' if ':' in host else host}:{port}/?token={self._address.token}")
                await self._stop.wait()
            finally:
                if self._ending is not None:
                    self._ending.cancel()
                await asyncio.gather(*(one.close(code=_GOING_AWAY) for one in list(self._talking)))
                await asyncio.gather(*(self._close(key) for key in list(self._pages)))
                await runner.cleanup()
                self._threads.shutdown(wait=False, cancel_futures=True)

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Refuse requests of other pages, and add the security headers."""
        if self._stop.is_set():  # a page that is loaded again now would find nothing, without a message
            return web.Response(status=503, text="coilarray studio: it is ending.\n")
        headers = security_headers(request.headers.get("Host", ""))
        problem = refusal(request, self._address, self._cookie)
        if problem:
            return web.Response(status=403, text=f"coilarray studio: {problem}\n", headers=headers)
        response = await handler(request)
        if not response.prepared:
            for name, value in headers.items():
                response.headers.setdefault(name, value)  # a report has a policy of its own
            response.set_cookie(self._cookie, self._address.token, httponly=True, samesite="Strict", path="/")
        return response

    async def _index(self, _: web.Request) -> web.Response:
        """Serve the first text of a page."""
        if sum(not page.left for page in self._pages.values()) >= _MOST_PAGES:
            return web.Response(
                status=503, text=f"coilarray studio: {_TOO_MANY}; close one, and load this one again.\n"
            )
        text = (_CLIENT / "index.html").read_text(encoding="utf-8")
        text = re.sub("<title>.*?</title>", "<title>coilarray studio</title>", text)
        own = "".join(template(name) for name in ("tab", "gone", "keys", "look", "viewer"))
        view = drawing(self._work.design, {})  # is there before the page
        first = f'<svg viewBox="{view["box"]}" style="width: min(90vw, 900px)">{view["svg"]}</svg>'
        first = f'<div id="first" style="position: fixed; inset: 0; display: grid; place-content: center">{first}</div>'
        text = text.replace("<head>", f"<head>{own}", 1).replace("<body>", f"<body>{first}", 1)
        return web.Response(text=text, content_type="text/html")

    async def _open(self, request: web.Request) -> web.Response:
        """Begin a session with its tab's last design, or go on with a page that was left."""
        tab, left = request.match_info["tab"], [page for page in self._pages.values() if page.left]
        for page in sorted(left, key=lambda one: one.tab != tab):
            if page.tab == tab or page.busy:
                page.come_back(tab)
                return self._opened(page)
        if len(self._pages) >= _MOST_PAGES:
            await asyncio.gather(*(self._close(page.key) for page in left))  # none of them has a job
        if len(self._pages) >= _MOST_PAGES:
            return web.json_response({"error": _TOO_MANY}, status=503)
        open_still = [page.work for page in self._pages.values() if page.tab == tab]
        work = open_still[-1] if open_still else self._tabs.get(tab, self._work)
        setup = Setup(self._shelf, self._services, self._reports, self._threads, switched_off())
        try:
            page = Page(setup, work, tab)
        except CoilarrayError as error:
            return web.json_response({"error": str(error)}, status=503)
        if self._services.alone and not (self._pages or self._tabs):
            state = page.state
            with page.showing_errors("live_problem"):
                page.live.start(state.live_port, state.live_recording, state.live_reference, state.live_log)
        self._pages[page.key] = page
        for name, place in page.server.serve.items():  # a path or a path with options
            self._static[name] = Path(place[0] if isinstance(place, list | tuple) else place)
        return self._opened(page)

    def _opened(self, page: Page) -> web.Response:
        """Answer with the address of a session, which closes if no page connects to it."""
        self._close_later(page, _UNUSED)
        return web.json_response({"sessionURL": f"ws://USE_HOST/ws/{page.key}", "secret": page.secret})

    def _close_later(self, page: Page, wait: float) -> None:
        """Close a session without a page after some time in s, and after its jobs."""
        loop = asyncio.get_running_loop()

        def end() -> None:
            if page.busy:
                self._close_later(page, _AWAY)
            else:
                self._closing = loop.create_task(self._close(page.key))

        if page.key in self._unused:
            self._unused[page.key].cancel()
        self._unused[page.key] = loop.call_later(wait, end)

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        """Carry messages between a page and its session."""
        page = self._pages.get(request.match_info["key"])
        if page is None or page.endpoint is None:
            raise web.HTTPNotFound
        if page.key in self._unused:
            self._unused.pop(page.key).cancel()
        page.left = False
        if self._ending is not None:
            self._ending.cancel()
        socket_ = web.WebSocketResponse(max_msg_size=_LARGEST, heartbeat=_HEARTBEAT, compress=False)
        await socket_.prepare(request)
        self._talking.add(socket_)
        client = await page.endpoint.connect()

        async def send(_: bool, data: bytes) -> None:
            with contextlib.suppress(ConnectionError):
                if not socket_.closed:
                    await socket_.send_bytes(data)

        client.on_message(send)
        try:
            async for frame in socket_:
                if frame.type == WSMsgType.BINARY:
                    await page.endpoint.onMessage(True, frame, client.client_id)
        except Exception:  # bytes that no page sends
            await socket_.close(code=_REFUSED)
        finally:
            self._talking.discard(socket_)
            await page.endpoint.disconnect(client.client_id)
            self._leave(page)
        return socket_

    async def _report(self, request: web.Request) -> web.StreamResponse:
        path = self._reports.get(request.match_info["key"])
        if path is None or not path.is_file():
            raise web.HTTPNotFound
        return web.FileResponse(path, headers={"Content-Security-Policy": _REPORT_POLICY})

    async def _arrays(self, request: web.Request) -> web.StreamResponse:
        """Serve arrays of a page's scene."""
        page = self._pages.get(request.match_info["page"])
        data = None if page is None else page.scene.arrays(request.match_info["keys"])
        if data is None:
            raise web.HTTPNotFound
        return web.Response(body=data, content_type="application/octet-stream")

    async def _asset(self, request: web.Request) -> web.StreamResponse:
        path: str = request.match_info["path"]
        name, _, rest = path.partition("/")
        return _file_of(self._static[name], rest) if name in self._static else _file_of(_CLIENT, path)

    async def _close(self, key: str) -> None:
        """End the session of a closed page."""
        page = self._pages.pop(key, None)
        if page is None:
            return
        if key in self._unused:
            self._unused.pop(key).cancel()
        self._tabs[page.tab] = page.work
        await page.close()
        self._leave(page)
        del page
        gc.collect()  # a page is full of cycles

    def _leave(self, page: Page) -> None:
        """Keep a closed page for a while, as it may only be loaded again."""
        page.left = True
        if page.key in self._pages:
            self._close_later(page, _AWAY)

        def end_unused() -> None:
            if all(one.left for one in self._pages.values()):
                self._stop.set()

        if self._linger > 0:
            self._ending = asyncio.get_running_loop().call_later(self._linger, end_unused)


def _file_of(folder: Path, name: str) -> web.StreamResponse:
    """Serve a file below a folder, never outside it."""
    try:
        path = (folder / name).resolve()
        inside = path.is_relative_to(folder.resolve()) and path.is_file()
    except (OSError, ValueError):
        inside = False
    if not inside:
        raise web.HTTPNotFound
    return web.FileResponse(path)


def refusal(request: web.Request, address: Address, cookie: str) -> str:
    """Reason why a request is refused, empty if answered. A `cookie` holds the token."""
    host = request.headers.get("Host", "")
    origin = request.headers.get("Origin")
    if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
        return _ANOTHER_PAGE
    # Programs send no such header. A link of another site may open only the page itself, as a user
    # does.
    site = request.headers.get("Sec-Fetch-Site", "none")
    opens = request.path == "/" and request.headers.get("Sec-Fetch-Dest") == "document"
    if site not in ("same-origin", "none") and not opens:
        return _ANOTHER_PAGE
    if address.alone and re.sub(r":\d+$", "", host) not in _OWN_HOSTS:
        return "it is served to this computer alone."
    given = request.query.get("token") or request.cookies.get(cookie, "")
    if not hmac.compare_digest(given.encode(), address.token.encode()):
        return "the address lacks its token; open the one that was printed."
    return ""


def security_headers(host: str) -> dict[str, str]:
    """Security headers of a response."""
    sockets = f" ws://{host} wss://{host}" if _HOST.fullmatch(host) else ""
    return {
        "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-cache",
        "Cross-Origin-Resource-Policy": "same-origin", "Content-Security-Policy": _POLICY + sockets,
    }  # fmt: skip
