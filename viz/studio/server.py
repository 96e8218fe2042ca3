"""Web server of the studio: access control, one session for each page, and an end without leftovers."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import hmac
import logging
import os
import re
import secrets
import signal
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.compute.extras import import_extra
from coilarray.errors import CoilarrayError, OutputError
from coilarray.viz.offscreen import rendering_problem, require_pyvista
from coilarray.viz.studio.services import Services
from coilarray.viz.studio.session import ReportPages, Setup, template
from coilarray.viz.studio.work import Shelf, Work

if TYPE_CHECKING:
    from aiohttp import web

    from coilarray.viz.studio.page import Page

LOOPBACK = "127.0.0.1"
"""Default host of the studio, for this computer alone."""

_OWN_HOSTS = ("127.0.0.1", "localhost", "[::1]")
_HEARTBEAT = 20.0  # s without an answer after which a page counts as closed
_UNUSED = 60.0  # s, longest time for a page to connect to its session
_GOING_AWAY, _REFUSED = 1001, 1008  # codes of RFC 6455
_LONGEST_REASON = 100  # bytes, as RFC 6455 has room for 123
_BAD_CALL = -32602  # code of JSON-RPC for wrong arguments
_GOODBYE = 2.0  # s, time for requests to end
_THREADS = 3
_MOST_PAGES = 12
_TOO_MANY = f"the studio serves at most {_MOST_PAGES} pages at once"
_ANOTHER_PAGE = "a request from another page."
_MOST_TABS = 200  # number of tabs whose design is kept for a reload
# The connection of trame's client decides which scripts run, so only the studio is allowed.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; frame-ancestors 'none'; "
    "base-uri 'self'; form-action 'none'; object-src 'none'; connect-src 'self'"
)
# A report runs no script, loads nothing, and has an origin of its own, so it cannot connect to the studio.
_REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
_HOST = re.compile(r"[A-Za-z0-9_.-]+(:\d+)?|\[[0-9A-Fa-f:.]+\](:\d+)?")
_HEADERS = {
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-cache",
    "Cross-Origin-Resource-Policy": "same-origin",
}  # fmt: skip
# A tab keeps its name through a reload, and every tab has its own. All of the address but the token is removed, because
# trame's client would take its connection from it.
_TAB = """<script>{
const token = new URLSearchParams(location.search).get("token");
history.replaceState(null, "", location.pathname + (token === null ? "" : "?token=" + encodeURIComponent(token)));
const part = () => Math.random().toString(36).slice(2);
if (!sessionStorage.studioTab) sessionStorage.studioTab = part() + part() + part();
document.documentElement.dataset.sessionManagerUrl = "open/" + sessionStorage.studioTab;
}</script>"""


def new_token() -> str:
    """Make a random token."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class Address:
    """Address of the studio."""

    host: str  # name or IP address on which it listens
    port: int  # 0 takes a free port
    alone: bool = False  # whether browsers must name this computer, as its own browsers do
    token: str = field(default_factory=new_token)  # sent by every browser, as this computer may have other accounts


def check_studio() -> None:
    """Raise MissingDependencyError if a library of the studio is missing."""
    require_pyvista("pages of the studio", "studio")
    needed = {"trame.app": "trame", "trame.ui.vuetify3": "trame-vuetify", "trame_vtk.modules.vtk": "trame-vtk"}
    for module, package in {**needed, "aiohttp": "aiohttp"}.items():
        import_extra(module, "pages of the studio", package=package, extra="studio")


def bind(address: Address) -> socket.socket:
    """Bind the port of the studio.

    A port that is in use or not allowed, or a host that is not on this computer, raises an OutputError.
    """
    if not 0 <= address.port <= 65535:
        raise OutputError(f"--port must be 0 to 65535; got {address.port}.")
    try:
        kind, _, _, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(kind, socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(
            f"--host must be a name or number of this computer; got {address.host!r} ({reason})."
        ) from None
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
    """Serve the studio until it is stopped.

    It is served on a socket of `bind`. `work` is the first design. The studio also ends if all pages have been closed
    for `linger` seconds, unless this is 0. `ready` is called with the URL of the page once it can be opened.
    """
    logging.getLogger("wslink").setLevel(logging.CRITICAL)  # a page itself shows the errors of its calls
    os.environ.setdefault("TRAME_ARGS", "")  # else trame would read our command line
    asyncio.run(_Studio(work, shelf, services, address, linger).run(listening, ready))


class _Studio:
    """Sessions and routes of one `run`."""

    def __init__(self, work: Work, shelf: Shelf, services: Services, address: Address, linger: float) -> None:
        self._work, self._shelf, self._services = work, shelf, services
        self._address, self._linger = address, linger
        self._pages: dict[str, Page] = {}
        self._talking: set[web.WebSocketResponse] = set()
        self._tabs: dict[str, Work] = {}
        self._of_page: dict[str, str] = {}
        self._static: dict[str, Path] = {}
        self._reports = ReportPages()
        self._cookie = ""
        self._had_page = self._begun = False
        self._unused: dict[str, asyncio.TimerHandle] = {}
        self._ending: asyncio.TimerHandle | None = None
        self._port = address.port

    async def run(self, listening: socket.socket, ready: Callable[[str], None]) -> None:
        """Serve pages until the studio ends."""
        from aiohttp import web

        self._stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
                    loop.add_signal_handler(getattr(signal, name), self._stop.set)
        self._port = listening.getsockname()[1]
        self._cookie = f"coilarray_studio_{self._port}"
        with ThreadPoolExecutor(max_workers=_THREADS) as threads:
            self._threads = threads
            problem = loop.run_in_executor(threads, rendering_problem)

            @web.middleware
            async def guard(request: web.Request, handler: Callable[..., Any]) -> web.StreamResponse:
                return await self._guard(request, handler)

            app = web.Application(middlewares=[guard])
            app.router.add_get("/", self._index)
            app.router.add_post("/open/{tab}", self._open)
            app.router.add_get("/ws/{key}", self._talk)
            app.router.add_get("/favicon.ico", self._nothing)
            app.router.add_get("/loading.tpl", self._loading)
            app.router.add_get("/reports/{key}", self._report)
            app.router.add_get("/{path:.+}", self._asset)
            runner = web.AppRunner(
                app, access_log=None, logger=_logger(), handle_signals=False, shutdown_timeout=_GOODBYE
            )
            await runner.setup()
            try:
                self._problem = await problem
                await web.SockSite(runner, listening).start()
                ready(self._url())
                await self._stop.wait()
            finally:
                if self._ending is not None:
                    self._ending.cancel()
                await asyncio.gather(*(one.close(code=_GOING_AWAY) for one in list(self._talking)))
                await asyncio.gather(*(self._close(key) for key in list(self._pages)))
                await runner.cleanup()
                threads.shutdown(wait=False, cancel_futures=True)

    # ------------------------------------------------------------------------ who may come in

    async def _guard(self, request: web.Request, handler: Callable[..., Any]) -> web.StreamResponse:
        """Refuse requests that are not from our pages.

        Other host names, scripts of other pages, and requests without the token are refused.
        """
        from aiohttp import web

        if self._stop.is_set():  # a page that is loaded again now would find nothing, without a message
            return web.Response(status=503, text="coilarray studio: it is ending.\n")
        problem = self._refusal(request)
        if problem:
            return web.Response(status=403, text=f"coilarray studio: {problem}\n", headers=_headers(request))
        response: web.StreamResponse = await handler(request)
        if not response.prepared:
            for name, value in _headers(request).items():
                response.headers.setdefault(name, value)  # a report has a policy of its own
            response.set_cookie(self._cookie, self._address.token, httponly=True, samesite="Strict", path="/")
        return response

    def _refusal(self, request: web.Request) -> str:
        """Explain why a request is refused."""
        host = request.headers.get("Host", "")
        origin = request.headers.get("Origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return _ANOTHER_PAGE
        # Programs send no such header. A link of another site may open only the page itself, as a user does.
        site = request.headers.get("Sec-Fetch-Site", "none")
        opens = request.path == "/" and request.headers.get("Sec-Fetch-Dest") == "document"
        if site not in ("same-origin", "none") and not opens:
            return _ANOTHER_PAGE
        if self._address.alone and re.sub(r":\d+$", "", host) not in _OWN_HOSTS:
            return "it is served to this computer alone."
        given = request.query.get("token") or request.cookies.get(self._cookie, "")
        if not hmac.compare_digest(given.encode(), self._address.token.encode()):
            return "the address lacks its token; open the one that was printed."
        return ""

    # ------------------------------------------------------------------------ what is served

    async def _index(self, _: web.Request) -> web.Response:
        """Serve the first text of a page."""
        from aiohttp import web

        if len(self._pages) >= _MOST_PAGES:
            return web.Response(
                status=503, text=f"coilarray studio: {_TOO_MANY}; close one, and load this one again.\n"
            )
        text = (_client_folder() / "index.html").read_text(encoding="utf-8")
        own = "".join(template(name) for name in ("gone", "keys", "look"))
        text = re.sub("<title>.*?</title>", "<title>coilarray studio</title>", text)
        return web.Response(text=text.replace("<head>", f"<head>{_TAB}{own}", 1), content_type="text/html")

    async def _loading(self, _: web.Request) -> web.Response:
        """Serve the text of the page until its session begins."""
        from aiohttp import web

        return web.Response(text='<p style="font-family: sans-serif; padding: 2em">coilarray studio …</p>')

    async def _nothing(self, _: web.Request) -> web.Response:
        from aiohttp import web

        return web.Response(status=204)

    async def _open(self, request: web.Request) -> web.Response:
        """Begin a session for a loaded page."""
        from aiohttp import web

        from coilarray.viz.studio.page import Page

        if len(self._pages) >= _MOST_PAGES:
            return web.json_response({"error": _TOO_MANY}, status=503)
        tab = request.match_info["tab"]
        setup = Setup(self._shelf, self._services, self._reports, self._threads, self._problem)
        try:
            page = Page(setup, self._work_of(tab))
        except CoilarrayError as error:
            return web.json_response({"error": str(error)}, status=503)
        self._pages[page.key], self._of_page[page.key] = page, tab
        if self._services.alone and not self._begun:
            self._begun = True
            page.live.start()
        for name, place in page.server.serve.items():  # a path or a path with options
            self._static[name] = Path(place[0] if isinstance(place, list | tuple) else place)
        loop = asyncio.get_running_loop()  # closes a session whose page never connects
        self._unused[page.key] = loop.call_later(_UNUSED, lambda: loop.create_task(self._close(page.key)))
        return web.json_response({"sessionURL": f"ws://USE_HOST/ws/{page.key}", "secret": page.secret})

    def _work_of(self, tab: str) -> Work:
        """Find the last design of a tab."""
        still = [self._pages[key].work for key, other in self._of_page.items() if other == tab and key in self._pages]
        return still[-1] if still else self._tabs.get(tab, self._work)

    async def _talk(self, request: web.Request) -> web.StreamResponse:
        """Carry messages between a page and its session."""
        from aiohttp import web

        from coilarray.viz.studio.messages import LARGEST

        page = self._pages.get(request.match_info["key"])
        if page is None or page.endpoint is None:
            raise web.HTTPNotFound
        if request.match_info["key"] in self._unused:
            self._unused.pop(request.match_info["key"]).cancel()
        socket_ = web.WebSocketResponse(max_msg_size=LARGEST, heartbeat=_HEARTBEAT, compress=False)
        await socket_.prepare(request)
        self._had_page = True
        if self._ending is not None:
            self._ending.cancel()
        self._talking.add(socket_)
        client = await page.endpoint.connect()

        async def send(_: bool, data: bytes) -> None:
            with contextlib.suppress(ConnectionError):
                if not socket_.closed:
                    await socket_.send_bytes(data)

        client.on_message(send)
        try:
            await _hear(socket_, page, client.client_id)
        finally:
            self._talking.discard(socket_)
            await page.endpoint.disconnect(client.client_id)
            await self._close(page.key)
        return socket_

    async def _report(self, request: web.Request) -> web.Response:
        """Serve a report that a page wrote in this run."""
        from aiohttp import web

        page = await asyncio.to_thread(self._reports.read, request.match_info["key"])
        if page is None:
            raise web.HTTPNotFound
        policy = {"Content-Security-Policy": _REPORT_POLICY}
        return web.Response(body=page, content_type="text/html", charset="utf-8", headers=policy)

    async def _asset(self, request: web.Request) -> web.StreamResponse:
        """Serve scripts, styles and fonts."""
        name, _, rest = request.match_info["path"].partition("/")
        if name in self._static:
            return _file_of(self._static[name], rest)
        return _file_of(_client_folder(), request.match_info["path"])

    # ------------------------------------------------------------------------ how it ends

    def _url(self) -> str:
        host = self._address.host
        if host in ("0.0.0.0", "::", ""):
            host = socket.gethostname()
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{self._port}/?token={self._address.token}"

    async def _close(self, key: str) -> None:
        """End the session of a closed page."""
        page = self._pages.pop(key, None)
        if page is None:
            return
        if key in self._unused:
            self._unused.pop(key).cancel()
        tab = self._of_page.pop(key)
        self._tabs.pop(tab, None)
        self._tabs[tab] = page.work
        while len(self._tabs) > _MOST_TABS:
            del self._tabs[next(iter(self._tabs))]
        await page.close()
        del page
        gc.collect()  # a page is full of cycles, and each holds a window and threads of VTK
        if not self._pages and self._had_page and self._linger > 0:
            self._ending = asyncio.get_running_loop().call_later(self._linger, self._end_unused)

    def _end_unused(self) -> None:
        if not self._pages:
            self._stop.set()


def _logger() -> logging.Logger:
    """Logger of the web server."""
    from aiohttp.http_exceptions import HttpProcessingError

    def ours(record: logging.LogRecord) -> bool:
        error = record.exc_info[1] if record.exc_info else None
        return not isinstance(error, HttpProcessingError | ConnectionError)  # answered by 400, or the client has left

    logger = logging.Logger(__name__)
    logger.addHandler(logging.StreamHandler())
    logger.addFilter(ours)
    return logger


async def _hear(socket_: web.WebSocketResponse, page: Page, client: str) -> None:
    """Pass messages of a page to its session."""
    from aiohttp import WSMsgType

    from coilarray.viz.studio.messages import Inbox, MessageError, refusal

    inbox = Inbox()
    async for frame in socket_:
        try:
            if frame.type != WSMsgType.BINARY:
                raise MessageError("a frame must be binary.")
            message = inbox.take(frame.data)
        except MessageError as error:
            await socket_.close(code=_REFUSED, message=str(error).encode()[:_LONGEST_REASON])
            return
        if message is None:
            continue
        problem = refusal(message)
        if problem:
            page.say(problem)
            await page.endpoint.sendWrappedError(message["id"], _BAD_CALL, problem, client_id=client)
        else:
            await page.endpoint.onCompleteMessage(message, client)


def _headers(request: web.Request) -> dict[str, str]:
    """Security headers of a response."""
    host = request.headers.get("Host", "")
    sockets = f" ws://{host} wss://{host}" if _HOST.fullmatch(host) else ""
    return {**_HEADERS, "Content-Security-Policy": _POLICY + sockets}


def _client_folder() -> Path:
    from trame_client.module import vue3

    return Path(vue3.www)


def _file_of(folder: Path, name: str) -> web.StreamResponse:
    """Serve a file below a folder, never outside it."""
    from aiohttp import web

    try:
        path = (folder / name).resolve()
        inside = path.is_relative_to(folder.resolve()) and path.is_file()
    except (OSError, ValueError):
        inside = False
    if not inside:
        raise web.HTTPNotFound
    return web.FileResponse(path)
