"""Who may come in to the studio and where it listens, without a browser; and what the command hands to it."""

import asyncio
import http.client
import json
import random
import re
import struct
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest
import xarray as xr
from support.browser import served
from support.command_line import runner
from support.patience import PATIENCE, until

from coilarray.cli import view as command
from coilarray.cli.board.live import LiveOptions, watch_board
from coilarray.cli.board.options import BoardOptions
from coilarray.design import bundled
from coilarray.design.model import load_design_file
from coilarray.errors import OutputError
from coilarray.viz.studio.services import LOOPBACK, Address, BoardRequest, bind

aiohttp = pytest.importorskip("aiohttp")
msgpack = pytest.importorskip("msgpack")
server = pytest.importorskip("coilarray.viz.studio.server")
needs_studio = pytest.mark.usefixtures("studio_libraries")

run, refused = runner("studio")

ALONE, SHARED = (Address(LOOPBACK, 80, alone, "a-token-of-24-letters") for alone in (True, False))
COOKIE = "coilarray_studio_80"


def problem(address, path="/", *, token=ALONE.token, host="127.0.0.1:80", **headers):
    """Why a request is refused."""
    from aiohttp.test_utils import make_mocked_request

    named = {name.replace("_", "-"): value for name, value in {"Host": host, **headers}.items()}
    return server.refusal(make_mocked_request("GET", f"{path}?token={token}", headers=named), address, COOKIE)


@pytest.mark.parametrize("path", ["/", "/open/tab", "/ws/x", "/vue.global.js"])
def test_other_pages_names_and_tokens_are_refused(path):
    for address in (ALONE, SHARED):
        assert problem(address, path) == problem(address, path, Origin="http://127.0.0.1:80") == ""
        for origin in ("http://evil.example", "null"):
            assert "another page" in problem(address, path, Origin=origin)
        for token in ("", ALONE.token[:-1], "%C3%A4"):
            assert "lacks its token" in problem(address, path, token=token)
        assert problem(address, path, token="", Cookie=f"{COOKIE}={ALONE.token}") == ""
        assert "lacks its token" in problem(address, path, token="", Cookie=f"{COOKIE}=wrong")
    for host in ("evil.example", "evil.example:80"):  # a name that was pointed to this computer
        assert "this computer alone" in problem(ALONE, path, host=host)
        assert problem(SHARED, path, host=host) == ""


@pytest.mark.parametrize("site", ["cross-site", "same-site"])  # same-site: another port of this computer
def test_another_site_may_link_to_the_page_and_use_nothing_of_it(site):
    uses = (("/", "iframe"), ("/", "image"), ("/vue.global.js", "script"), ("/reports/x", "document"))
    for path, use in uses:
        assert "another page" in problem(ALONE, path, Sec_Fetch_Site=site, Sec_Fetch_Dest=use)
    assert problem(ALONE, Sec_Fetch_Site=site, Sec_Fetch_Dest="document") == ""
    for own in ("same-origin", "none"):  # of the page itself, and of an address that was typed
        assert problem(ALONE, "/vue.global.js", Sec_Fetch_Site=own, Sec_Fetch_Dest="script") == ""


def test_only_the_studio_may_run_scripts_and_only_a_name_gets_a_socket():
    policy = server.security_headers("lab.example:80")["Content-Security-Policy"]
    assert policy.startswith("default-src 'self';")
    assert "frame-ancestors 'none'" in policy
    assert "http:" not in policy
    assert "https:" not in policy
    assert policy.endswith("; connect-src 'self' ws://lab.example:80 wss://lab.example:80")
    for name in ("a b", "a;script-src *", "*", "[::1"):
        assert server.security_headers(name)["Content-Security-Policy"].endswith("; connect-src 'self'")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("home") / "designs"
    made.mkdir()
    (made / "secret.txt").write_text("secret", encoding="utf-8")
    (made / "starter-report").mkdir()
    (made / "starter-report" / "report.html").write_text("<p>secret", encoding="utf-8")
    return made


@pytest.fixture(scope="module")
def studio(folder, studio_libraries):
    with served("starter", "--folder", folder, "--pages", 2, COILARRAY_NO_RENDERING="1") as started:
        yield started


def ask(studio, path="/", method="GET", **headers):
    """Status, headers and text of an answer to a request with the token."""
    place = urlsplit(studio.url)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=PATIENCE)
    try:
        connection.request(method, f"{path}?{studio.query}" if "?" not in path else path, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read().decode("utf-8", "replace")
    finally:
        connection.close()


@pytest.mark.slow
def test_the_page_comes_with_its_token_and_nothing_else_of_the_disk(studio):
    status, headers, text = ask(studio)
    assert status == 200
    assert "<title>coilarray studio</title>" in text
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Strict" in headers["Set-Cookie"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert ask(studio, "/vue.global.js?", Cookie=headers["Set-Cookie"].partition(";")[0])[0] == 200
    status, headers, text = ask(studio, "/?token=wrong")
    assert status == 403
    assert "Set-Cookie" not in headers
    assert "the address lacks its token" in text
    assert ask(studio, f"/ws/{'0' * 32}")[0] == 404
    for path in (
        "/files/secret.txt", "/secret.txt", "/reports/report.html", "/reports/starter-report%2freport.html",
        "/reports//etc/passwd", "/../../etc/passwd", "/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/assets/..%2f..%2f..%2f..%2fetc%2fpasswd", "/nothing.js", "/files/a%00.html",
    ):  # fmt: skip
        status, _, text = ask(studio, path)
        assert status in (400, 404)
        assert "secret" not in text
        assert "root:" not in text


VALUES = [
    None, True, 0, -1, 3, 1 << 63, 0.5, float("nan"), -1e308, "", "x", "../x.toml", "/etc/passwd", "a\0b", "\u202e",
    "x" * 5000, b"\xff", [], [[]], {}, {"a": 1}, "coil1", "nan", "1e400", "12", "<script>", "\x1b[31m", ["../x"],
]  # fmt: skip


def framed(message):
    data = message if isinstance(message, bytes) else msgpack.packb(message)
    return struct.pack("<III", 1, 0, len(data)) + data


def call(method, *arguments, id="rpc:1"):
    return framed({"wslink": "1.0", "id": id, "method": method, "args": list(arguments), "kwargs": {}})


async def connected(http, studio):
    """A socket to a session of its own."""
    async with http.post(f"{studio.root}open/{random.getrandbits(64)}?{studio.query}") as answer:
        session = await answer.json()
    key = session["sessionURL"].rpartition("/")[2]
    assert key == key.lower()  # the client makes all letters small
    ws = await http.ws_connect(f"{studio.root}ws/{key}?{studio.query}", max_msg_size=0)
    await ws.send_bytes(call("wslink.hello", {"secret": session["secret"]}, id="system:c0:0"))
    await ws.receive(PATIENCE)
    return ws


async def last_state(ws):
    """All values of a session's page, once all that was sent is done."""
    await ws.send_bytes(call("trame.state.get", id="rpc:state"))
    while b"rpc:state" not in (given := (await ws.receive(PATIENCE)).data)[:60]:
        pass
    return msgpack.unpackb(given[12:])["result"]["state"]


@pytest.mark.slow
def test_strange_messages_end_their_session_at_most(studio, folder):
    """Nothing of them stops the studio or is written beside its folder; another page is served as before."""
    html = resources.files("coilarray.viz.studio") / "html"
    text = "".join(part.read_text(encoding="utf-8") for part in html.iterdir())
    # every function of the page, but those that begin runs
    names = sorted(set(re.findall(r"trigger\('(\w+)'", text)) - {"compute_table", "respond", "start_board"})
    rng = random.Random(23)

    async def talk():
        async with aiohttp.ClientSession() as http:
            ws = await connected(http, studio)
            for name in names * 2:
                arguments = [rng.choice(VALUES) for _ in range(rng.randrange(4))]
                await ws.send_bytes(call("trame.trigger", name, arguments, {}))
            assert await last_state(ws)
            await ws.close()
            for bytes_ in (b"", b"x", rng.randbytes(60), framed(b"\xff"), framed([]), framed({"id": 1})):
                ws = await connected(http, studio)
                await ws.send_bytes(bytes_)
                await ws.close()
            ws = await connected(http, studio)
            await ws.send_bytes(call("trame.trigger", "enter", ["array.pitch_mm", "12.5"], {}))
            async with asyncio.timeout(PATIENCE):
                while (state := await last_state(ws))["accuracy"] != "full" or not state["changed"]:
                    await asyncio.sleep(0.1)
            await ws.close()

    asyncio.run(talk())
    assert list(folder.parent.iterdir()) == [folder]


@pytest.mark.slow
def test_of_twenty_clients_at_once_all_are_answered_and_no_more_served_than_allowed(studio):
    """It fills the studio of the other tests, which takes 2 of the usual 12, and so comes last."""
    with ThreadPoolExecutor(20) as clients:
        answers = list(clients.map(lambda k: ask(studio, f"/open/tab{k}", "POST"), range(20)))
    keys = {json.loads(text)["sessionURL"] for status, _, text in answers if status == 200}
    assert len(keys) in (1, 2)
    assert [status for status, *_ in answers if status != 200] == [503] * (20 - len(keys))
    status, _, text = ask(studio)
    assert status == 503
    assert "at most 12 pages at once; close one" in text
    assert ask(studio, "/vue.global.js")[0] == 200  # those that are open go on


@needs_studio
def test_a_free_port_is_taken_and_one_in_use_is_refused(capsys):
    assert len({Address(LOOPBACK, 0).token for _ in range(100)}) == 100
    assert len(Address(LOOPBACK, 0).token) >= 32
    with bind(Address(LOOPBACK, 0)) as listening:
        host, port = listening.getsockname()
        assert (host, port > 0) == (LOOPBACK, True)
        assert f"port {port} is in use; give another" in refused(capsys, "starter", "--port", port, "--no-browser")


@pytest.mark.parametrize(
    ("address", "line"),
    [
        (Address(LOOPBACK, 70_000), "--port must be 0 to 65535; got 70000."),
        (Address("no.such.host.invalid", 0), "--host must be a name or number of this computer; got 'no.such.host."),
        (Address("192.0.2.1", 0), "cannot listen on 192.0.2.1, port 0: "),  # kept for documents, RFC 5737
    ],
)
def test_what_it_cannot_listen_on_is_one_line(address, line):
    with pytest.raises(OutputError) as failed:
        bind(address)
    assert str(failed.value).startswith(line)
    assert "\n" not in str(failed.value)


@needs_studio
def test_the_browser_is_opened_with_the_address(capsys, monkeypatch, tmp_path):
    seen, opened = {}, []

    def serve(work, shelf, services, address, listening, *, linger, ready):
        seen.update(work=work, shelf=shelf, services=services, address=address, linger=linger)
        ready("http://127.0.0.1:1/")

    monkeypatch.setattr("coilarray.viz.studio.server.serve", serve)
    monkeypatch.setattr("webbrowser.open", opened.append)
    (tmp_path / "mine.toml").write_text(bundled.read("starter"), encoding="utf-8")
    code, out, err = run(capsys, tmp_path / "mine.toml", "--port", "0", "--board", "/dev/ttyX", "--linger", "3")
    assert (code, out) == (0, "studio: http://127.0.0.1:1/ (Ctrl-C ends it)\n")
    assert err == "coilarray: the studio has ended\n"
    until(lambda: opened)  # in a thread
    assert opened == ["http://127.0.0.1:1/"]
    assert (seen["work"].file, seen["shelf"].folder) == ("mine.toml", tmp_path.resolve())
    assert (seen["address"].host, seen["address"].alone, seen["linger"]) == (LOOPBACK, True, 3.0)
    assert seen["services"].port == "/dev/ttyX"
    code, _, _ = run(capsys, "starter", "--port", "0", "--no-browser", "--host", "0.0.0.0", "--folder", tmp_path)
    assert (code, seen["address"].alone, len(opened)) == (0, False, 1)


def test_a_report_is_that_of_the_report_command(monkeypatch, tmp_path):
    def write(file, where, progress):
        progress(1, 8)
        return SimpleNamespace(page=where / file.design.digest)

    monkeypatch.setattr("coilarray.report.write.write_report", write)
    file, steps = load_design_file("starter"), []
    page = command.write_report(file.document, "starter", tmp_path, lambda *step: steps.append(step))
    assert (page, steps) == (tmp_path / file.design.digest, [(1, 8)])


def test_a_response_is_computed_once(monkeypatch, tmp_path):
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path))
    made = []

    def table_for(design, *, progress=None):
        made.append(design.digest)
        return xr.Dataset({"delta": ("state", [1.0])}, attrs={"design_hash": design.digest})

    monkeypatch.setattr("coilarray.localize.forward.table_for", table_for)
    file = load_design_file("starter")
    for _ in range(2):
        found = command.kept_response(file.document, "starter", lambda done, total: None)
        assert found.attrs["design_hash"] == file.design.digest
    assert made == [file.design.digest]


class Frames(list):
    """A link of a page that ends the reading after four frames."""

    send = list.extend

    def orders(self):
        return "q" if len(self) >= 4 else ""


@pytest.mark.slow
def test_the_emulated_board_is_watched_until_it_is_stopped(monkeypatch, tmp_path):
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path))
    # without an indentation there is no response to be computed, which takes half a minute
    document = dict(load_design_file("starter").document)
    for table in ("indenter", "indentation"):
        del document[table]
    assumed = document.get("assumed", {})
    document["assumed"] = {key: why for key, why in assumed.items() if not key.startswith("indent")}
    frames = Frames()
    watch_board(LiveOptions(BoardOptions()), True, BoardRequest(document, "starter", "emulator"), frames)
    assert len(frames) >= 4
    assert all(frame.emulated and frame.line.startswith("[emulator] emulator: ") for frame in frames)
    assert [frame.waiting for frame in frames[:4]] == [9, 8, 7, 6]
    assert [frame.sequence for frame in frames] == sorted(frame.sequence for frame in frames)
    assert list(frames[0].delta) == [f"coil{k}" for k in range(1, 4)]
    assert set(frames[0].delta.values()) == {None}  # the baseline is not there yet
    assert frames[0].temperature == 25.0
