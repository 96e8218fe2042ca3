"""What comes in to the studio without a browser: any bytes at its port and its sockets, and clients that leave.

Nothing of it stops the studio, makes it write beside its folder or print a traceback, or is answered by a status of
500; and a page that talks as it should is served as before.
"""

import asyncio
import os
import random
import re
import socket
import struct
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from support import browser
from support.patience import PATIENCE, until

from coilarray.viz.studio.messages import LARGEST, Inbox, MessageError

aiohttp = pytest.importorskip("aiohttp")
msgpack = pytest.importorskip("msgpack")

CASES = int(os.environ.get("COILARRAY_TEST_MESSAGES", "100"))
"""Messages to the sockets, and a fourth as many requests."""

CLIENTS = 20
FORM = {"kind": "target", "shape": "sphere", "material": "steel", "size": "2", "second": "", "thickness": "1"}
CHOICE = {"name": "mine", "coils": "2", "shape": "hexagon", "size": "16", "connector": "none", "decoupled": False}
AXES = [{"number": 0, "key": "array.pitch_mm", "values": "12:14:2"}, {"number": 1, "key": None, "values": ""}]
TRIGGERS = {
    "add_body": [FORM], "add_coil": [], "add_sheet": [], "cancel_job": [], "choose_axis": [0, "array.pitch_mm"],
    "compare": [], "compute_table": [], "enter": ["array.pitch_mm", "12"], "export_board": ["svg"], "keep_study": [],
    "list_recordings": [], "look_at_board": [], "look_at_shelf": [], "look_for_runs": [], "look_from": ["top"],
    "make_design": [CHOICE, True], "move_target": [0], "open_design": ["starter", "starter"], "pause_board": [],
    "place_coil": ["coil1", "x_mm", "1"], "place_target": ["0", "1"], "press": [0.5, 0.5],
    "press_at": ["0", "1", "0.5"], "read_runs": ["run"], "redo": [], "remove_body": ["target"],
    "remove_coil": ["coil2"], "remove_sheet": [0], "respond": [], "save_design": ["mine.toml", "Mine", "mine.toml"],
    "set_base": ["frictionless"], "set_connector": ["left"], "set_house": ["oshpark-2-layer"],
    "set_lattice": ["square"], "set_layers": ["4"], "set_leads": [True], "show_run": ["run", "", ""],
    "span_of_board": [60.0], "start_board": [],
    "start_run": ["smallest", "4"], "start_study": ["sweep", AXES, ["span_mm"], "typical", "8"], "stop_board": [],
    "switch": ["coil1", "ground"], "take_point": ["run"], "take_sweep_point": [0], "toggle_eddies": [],
    "toggle_group": ["board"], "toggle_saved": [], "toggle_sheets": [], "undo": [], "write_report": [],
    "zero_board": [],
}  # fmt: skip
"""Every function of the page with arguments as it may send them."""

CHANGES = {
    "tab": "touch", "choice": CHOICE, "live_port": "emulator", "live_recording": "a.sqlite",
    "live_reference": ["coil1"], "live_log": "a.csv", "place": {"x": "0", "y": "0", "depth": "1"}, "run_goal": "x",
    "run_trials": "3", "study_quantities": ["span_mm"], "sweep_axes": AXES, "target_place": ["0", "0"],
    "settings": {"coil1": "open"}, "job": {"name": "x"}, "stale": [], "trame__title": "x",
    "texts": {"array.pitch_mm": "1"},
}  # fmt: skip
"""Values that a page sends, and some that are not the page's to change."""

VIEWS = {
    "viewport.camera.update": ["1", [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    "viewport.image.push": [{"view": "1", "size": [400, 300], "quality": 70, "ratio": 1}],
    "viewport.image.push.original.size": ["1", 400, 300],
    "viewport.mouse.interaction": [{"view": "1", "action": "down", "x": 0.5, "y": 0.5, "buttonLeft": 1}],
    "viewport.image.push.quality": ["1", 70, 1],
}


def nested(depth):
    """Lists in lists."""
    tree = []
    for _ in range(depth):
        tree = [tree]
    return tree


VALUES = [
    None, True, 0, -1, 3, 1 << 63, 0.5, float("nan"), float("inf"), -1e308, "", "x", "../x.toml", "/etc/passwd", "a\0b",
    "\u202e", "x" * 5000, b"\xff", [], [[]], {}, {"a": 1}, {1: 2}, ["x", "x"], nested(12), nested(400), "coil1", "nan",
    "1e400", "-1", "1e9", "<script>", "\x1b[31m", ["../x"], {"key": 1},
]  # fmt: skip


def mutated(rng, tree):
    """A tree with one of its places, or the whole, replaced by another value."""
    if isinstance(tree, list | dict) and tree and rng.random() < 0.8:
        key = rng.choice(range(len(tree)) if isinstance(tree, list) else list(tree))
        changed = tree.copy()
        changed[key] = mutated(rng, tree[key])
        if rng.random() < 0.1:
            changed.pop(key)
        return changed
    return rng.choice(VALUES)


def call(method, *arguments, id="rpc:1"):
    return {"wslink": "1.0", "id": id, "method": method, "args": list(arguments), "kwargs": {}}


def framed(message, number=1):
    data = message if isinstance(message, bytes) else msgpack.packb(message)
    return struct.pack("<III", number, 0, len(data)) + data


def frame(rng):
    """One frame that a client sends."""
    match rng.randrange(10):
        case 0:
            return rng.randbytes(rng.choice([0, 1, 11, 12, 13, 60, 600]))
        case 1:
            return rng.choice(["", "x", "{}"])
        case 2:
            data = msgpack.packb(call("trame.state.get"))
            begin, size = rng.choice([0, 0, 5, 2**32 - 1]), rng.choice([len(data), 0, 3, LARGEST + 1, 2**32 - 1])
            return struct.pack("<III", rng.randrange(4), begin, size) + data[: rng.choice([5, len(data)])]
        case 3:
            return framed(
                mutated(rng, call(rng.choice(["trame.trigger", "wslink.hello", "application.exit"]), "x", []))
            )
        case 4:
            key = rng.choice(list(CHANGES))
            return framed(call("trame.state.update", [{"key": key, "value": mutated(rng, CHANGES[key])}]))
        case 5:
            name = rng.choice(list(VIEWS))
            return framed({**call(name), "args": mutated(rng, VIEWS[name])})
        case 6:
            return framed(call("trame.error.client", rng.choice(VALUES)))
        case _:
            name = rng.choice(list(TRIGGERS))
            arguments = TRIGGERS[name] if rng.random() < 0.2 else mutated(rng, TRIGGERS[name])
            return framed(call("trame.trigger", name, arguments, {}))


async def connected(http, url, *, hello=True):
    """A socket to a session of its own; None where the studio has no room."""
    root, _, query = url.partition("?")
    async with http.post(f"{root}open/{random.getrandbits(64)}?{query}") as answer:
        session = await answer.json()
    if "error" in session:
        return None
    ws = await http.ws_connect(f"{root}ws/{session['sessionURL'].rpartition('/')[2]}?{query}", max_msg_size=0)
    if hello:
        await ws.send_bytes(framed(call("wslink.hello", {"secret": session["secret"]}, id="system:c0:0")))
        await ws.receive(PATIENCE)
    return ws


async def strange_client(http, url, rng, count):
    """Send strange frames; begin anew where the studio ends the session."""
    sent = 0
    while sent < count:
        ws = await connected(http, url, hello=rng.random() < 0.9)
        if ws is None:
            await asyncio.sleep(0.1)
            continue
        heard = asyncio.create_task(listen(ws))
        with suppress(ConnectionError, aiohttp.ClientError):
            while sent < count and not ws.closed and rng.random() < 0.97:
                given = frame(rng)
                await (ws.send_str if isinstance(given, str) else ws.send_bytes)(given)
                sent += 1
                await asyncio.sleep(0.005)
        if rng.random() < 0.3:
            ws._writer.transport.abort()  # leaves without a word
        await ws.close()
        heard.cancel()


async def listen(ws):
    with suppress(ConnectionError, aiohttp.ClientError):
        async for _ in ws:
            pass


def strange_request(rng, host, query):
    """Bytes of a request, as no browser sends them; two in three have the token."""
    secret = "../" * 8 + "etc/passwd"
    paths = ["/", "/open/a", "/ws/x", "/reports/x", "/%00", "/%ff", "/%2e%2e/" + secret, "/" + secret, "/" + "x" * 9000]
    heads = [
        f"Host: {host}", "Host: evil.example", "Host:", "Host: \xff", "Origin: http://evil.example", "Origin: null",
        "Origin: \xff", "Cookie: coilarray_studio_8080=\xff", "Content-Length: -1", "Content-Length: 99999999999999999",
        "Transfer-Encoding: chunked", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Key: x",
        "Sec-WebSocket-Version: 13", "Sec-WebSocket-Version: 99", "Range: bytes=5-1", "X: " + "y" * 20_000, "no colon",
        "Expect: 100-continue", "If-Modified-Since: never", "Sec-Fetch-Site: cross-site",
    ]  # fmt: skip
    path = rng.choice(paths) + rng.choice(["", f"?{query}", f"?{query}"])
    method = rng.choice(["GET", "GET", "POST", "POST", "HEAD", "PUT", "G\0T", ""])
    chosen = [f"Host: {host}"] * (rng.random() < 0.8) + rng.sample(heads, rng.randrange(4))
    text = "\r\n".join([f"{method} {path} HTTP/{rng.choice(['1.1', '1.0', '9.9', 'x'])}", *chosen, "", ""])
    return text.encode("latin1") + rng.choice([b"", b"x", rng.randbytes(500), b"zz\r\n"])


def answered(url, data):
    """The answer to bytes at the port, until the studio closes or says no more."""
    place = urlsplit(url)
    with socket.create_connection((place.hostname, place.port), PATIENCE) as connection:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        connection.settimeout(PATIENCE)
        with suppress(ConnectionError):
            return b"".join(iter(lambda: connection.recv(65536), b""))
    return b""


async def state_of(ws):
    """All values of a session's page."""
    await ws.send_bytes(framed(call("trame.state.get", id="rpc:state")))
    inbox = Inbox()
    while True:
        given = await ws.receive(PATIENCE)
        assert given.type == aiohttp.WSMsgType.BINARY, given
        with suppress(MessageError):  # answers are no calls
            inbox.take(given.data)
        if b"rpc:state" in given.data[:60]:
            return msgpack.unpackb(given.data[12:])["result"]["state"]


async def a_good_page(url):
    """Enter a pitch and wait for the full numbers; those of the page."""
    async with aiohttp.ClientSession() as http:
        ws = await connected(http, url)
        await ws.send_bytes(framed(call("trame.trigger", "enter", ["array.pitch_mm", "12.5"], {})))
        for _ in range(600):
            state = await state_of(ws)
            if state["accuracy"] == "full" and state["changed"]:
                return state
            await asyncio.sleep(0.1)
    raise AssertionError("no numbers")


def resident(pid):
    """Memory of a process in bytes."""
    pages = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.usefixtures("studio_libraries")
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_strange_messages_and_requests_change_nothing(tmp_path):
    folder = tmp_path / "designs"
    folder.mkdir()
    (folder / browser.QUICK).touch()  # reports take no time
    with browser.served(
        "starter", "--folder", folder, "--pages", CLIENTS, COILARRAY_NO_RENDERING="1",
        COILARRAY_CACHE=str(tmp_path / "cache"),
    ) as studio:  # fmt: skip
        url = studio.url
        before = resident(studio.process.pid)

        async def all_clients():
            async with aiohttp.ClientSession() as http:
                rngs = [random.Random(f"23 {k}") for k in range(CLIENTS)]
                await asyncio.gather(*(strange_client(http, url, rng, CASES // CLIENTS) for rng in rngs))

        asyncio.run(all_clients())
        rng = random.Random(23)
        for _ in range(CASES // 4):
            sent = strange_request(rng, urlsplit(url).netloc, studio.query)
            answer = answered(url, sent)
            status = re.match(rb"HTTP/1\.[01] (\d{3})", answer)
            assert status is None or int(status[1]) < 500, (sent, answer)
            assert b"root:" not in answer
        until(lambda: not studio.children())
        # 20 sessions at once take some 10 MB each, which Python keeps; a message that is only announced takes none
        assert resident(studio.process.pid) < before + 500e6
        assert {path.name for path in tmp_path.iterdir()} <= {"designs", "cache"}
        state = asyncio.run(a_good_page(url))
        assert np.shape(state["matrix"]["cells"]) == (3, 3)
        said = studio.end()
    odd = [line for line in said.splitlines() if not re.match(r"studio: http|coilarray: ", line)]
    assert odd == []


@pytest.mark.slow
@pytest.mark.usefixtures("studio_libraries", "rendering")
def test_strange_calls_of_the_picture_are_told_on_the_page(tmp_path):
    """They are trame's own, and without a picture there is none of them."""
    with browser.served("starter", "--folder", tmp_path, COILARRAY_CACHE=str(tmp_path / "cache")) as studio:

        async def calls():
            async with aiohttp.ClientSession() as http:
                rng, ws = random.Random(23), await connected(http, studio.url)
                for k in range(30):
                    name = list(VIEWS)[k % len(VIEWS)]
                    sent = framed({**call(name), "args": mutated(rng, VIEWS[name])})
                    with suppress(MessageError):  # of which the studio would end the session
                        Inbox().take(sent)
                        await ws.send_bytes(sent)
                return await state_of(ws)

        assert asyncio.run(calls())["problem"]
        said = studio.end()
    assert said == f"studio: {studio.url}\n"
