"""Where the studio listens, and which requests it answers."""

from __future__ import annotations

import errno
import hmac
import os
import re
import secrets
import socket
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from coilarray.compute.extras import import_extra
from coilarray.errors import OutputError
from coilarray.viz.offscreen import require_pyvista

if TYPE_CHECKING:
    from aiohttp import web

LOOPBACK = "127.0.0.1"
"""Default host of the studio, for this computer alone."""

_OWN_HOSTS = ("127.0.0.1", "localhost", "[::1]")
_ANOTHER_PAGE = "a request from another page."
_HOST = re.compile(r"[A-Za-z0-9_.-]+(:\d+)?|\[[0-9A-Fa-f:.]+\](:\d+)?")
# The connection of trame's client decides which scripts run, so only the studio is allowed.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; frame-ancestors 'none'; "
    "base-uri 'self'; form-action 'none'; object-src 'none'; connect-src 'self'"
)
REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
"""Policy of a report: no scripts, nothing loaded, own origin."""


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
    needed = {"trame.app": "trame", "trame.ui.vuetify3": "trame-vuetify", "trame_vtk.modules.vtk": "trame-vtk"}
    for module, package in {**needed, "aiohttp": "aiohttp"}.items():
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


def refusal(request: web.Request, address: Address, cookie: str) -> str:
    """Reason why a request is refused, empty if answered.

    Refused are other host names, scripts of other pages, and requests without the token, which a
    `cookie` holds.
    """
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
