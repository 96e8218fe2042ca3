"""Who may come in to the studio and where it listens, without a browser; and what the command hands to it."""

import http.client
import json
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import xarray as xr
from support.browser import missing_studio, served
from support.command_line import runner
from support.patience import PATIENCE, until

from coilarray import load_design
from coilarray.cli import studio as command
from coilarray.cli.board.live_source import LiveOptions, tour, watch_board
from coilarray.cli.board.options import BoardOptions
from coilarray.design import bundled
from coilarray.design.model import load_design_file
from coilarray.errors import OutputError
from coilarray.viz.studio.server import LOOPBACK, Address, bind, new_token
from coilarray.viz.studio.services import BoardRequest, Services, compute_table
from coilarray.viz.studio.session import ReportPages

needs_studio = pytest.mark.usefixtures("studio_libraries")

run, refused = runner("studio")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("designs")
    (made / "secret.txt").write_text("secret", encoding="utf-8")
    # of another program, as a download may lie beside the designs
    (made / "report.html").write_text("<p>secret<script>parent.trame</script>", encoding="utf-8")
    (made / "starter-report").mkdir()
    (made / "starter-report" / "report.html").write_text("<p>secret", encoding="utf-8")
    return made


def serving(*options):
    @pytest.fixture(scope="module")
    def url(folder):
        with served("starter", "--folder", folder, "--pages", 2, *options, COILARRAY_NO_RENDERING="1") as started:
            yield started.url

    return url


alone, shared = serving(), serving("--host", "127.0.0.1")


def ask(url, path="/", method="GET", **headers):
    """Status, headers and text of an answer; a token in the address is sent with the path."""
    place = urlsplit(url)
    path = f"{path}?{place.query}" if place.query and "?" not in path else path
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=PATIENCE)
    try:
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read().decode("utf-8", "replace")
    finally:
        connection.close()


@pytest.mark.slow
@needs_studio
def test_the_page_and_all_that_it_loads_come_from_here(alone):
    status, headers, text = ask(alone)
    assert status == 200
    assert "<title>coilarray studio</title>" in text
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'self';")
    assert "http:" not in policy
    assert "https:" not in policy
    # a socket to this server and no other: who is at its end says which scripts the page runs
    host = urlsplit(alone).netloc
    assert policy.endswith(f"; connect-src 'self' ws://{host} wss://{host}")
    assert "frame-ancestors 'none'" in policy
    status, _, text = ask(alone, "/open/sometab", "POST")
    session = json.loads(text)
    assert status == 200
    assert session["sessionURL"].startswith("ws://USE_HOST/ws/")
    key = session["sessionURL"].rpartition("/")[2]
    assert key == key.lower()  # the client makes all letters small
    assert ask(alone, "/vue.global.js")[0] == 200
    assert ask(alone, f"/ws/{'0' * 32}")[0] == 404


@needs_studio
@pytest.mark.parametrize("path", ["/", "/open/tab", "/ws/x", "/vue.global.js"])
def test_other_pages_and_names_are_refused(alone, path):
    method = "POST" if "open" in path else "GET"
    # a name that was pointed to this computer, and a script of another page
    names, pages = ("evil.example", "evil.example:80"), ("http://evil.example", "null")
    for headers in (*({"Host": name} for name in names), *({"Origin": page} for page in pages)):
        status, _, text = ask(alone, path, method, **headers)
        assert status == 403
        assert text.startswith("coilarray studio: ")


@needs_studio
@pytest.mark.parametrize("site", ["cross-site", "same-site"])  # same-site: another port of this computer
def test_another_site_may_link_to_the_page_and_use_nothing_of_it(alone, site):
    uses = (("/", "iframe"), ("/", "image"), ("/vue.global.js", "script"), ("/files/report.html", "document"))
    for path, use in uses:
        assert ask(alone, path, Sec_Fetch_Site=site, Sec_Fetch_Dest=use)[0] == 403
    assert ask(alone, "/open/tab", "POST", Sec_Fetch_Site=site, Sec_Fetch_Dest="empty")[0] == 403
    status, headers, _ = ask(alone, Sec_Fetch_Site=site, Sec_Fetch_Dest="document")
    assert status == 200
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    for own in ("same-origin", "none"):  # of the page itself, and of an address that was typed
        assert ask(alone, "/vue.global.js", Sec_Fetch_Site=own, Sec_Fetch_Dest="script")[0] == 200


def test_a_report_is_given_out_as_it_was_written_or_not_at_all(tmp_path):
    reports, file = ReportPages(), tmp_path / "report.html"
    file.write_bytes(b"<p>a report")
    first, second = reports.add(file), reports.add(file)
    assert first != second
    assert len(first) == 32
    assert reports.read(first) == reports.read(second) == b"<p>a report"
    for key in ("", "report.html", str(file), first[:-1]):
        assert reports.read(key) is None
    file.write_bytes(b"<p>another's")
    assert reports.read(first) is None
    third = reports.add(file)
    assert reports.read(third) == b"<p>another's"
    file.unlink()
    assert reports.read(third) is None
    with pytest.raises(FileNotFoundError):
        reports.add(file)


@pytest.mark.slow
@needs_studio
def test_a_name_that_is_none_gets_no_socket(shared):
    address, _, query = shared.partition("?")
    for name in ("a b", "a;script-src *", "*", "[::1"):
        _, headers, _ = ask(address, f"/?{query}", Host=name)
        assert headers["Content-Security-Policy"].endswith("; connect-src 'self'")


@needs_studio
@pytest.mark.parametrize(
    "path",
    [
        "/files/secret.txt", "/files/report.html", "/reports/report.html", "/reports/starter-report/report.html",
        "/reports/starter-report%2freport.html", "/reports/..%2freport.html", "/report.html", "/reports//etc/passwd",
        "/../../etc/passwd", "/%2e%2e/%2e%2e/%2e%2e/etc/passwd", "/assets/..%2f..%2f..%2f..%2fetc%2fpasswd",
        "/nothing.js", "/files/a%00.html",
    ],
)  # fmt: skip
def test_nothing_else_of_the_disk_is_served(alone, path):
    status, _, text = ask(alone, path)
    assert status in (400, 404)
    assert "secret" not in text
    assert "root:" not in text


@needs_studio
@pytest.mark.parametrize("name", ["alone", "shared"])
def test_without_the_token_nothing_is_served(request, name):
    """Not even on this computer, which may have other accounts."""
    address, _, query = request.getfixturevalue(name).partition("?")
    token = query.removeprefix("token=")
    assert len(token) >= 32
    tokens = ("", token[:-1], "%C3%A4")
    for path in ("/", "/index.html", "/vue.global.js", "/reports/0", *(f"/?token={one}" for one in tokens)):
        status, headers, text = ask(address, path)
        assert status == 403
        assert "Set-Cookie" not in headers
        assert "the address lacks its token" in text
    assert ask(address, "/open/tab", "POST")[0] == 403
    status, headers, _ = ask(address, f"/?{query}")
    assert status == 200
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert ask(address, "/vue.global.js", Cookie=cookie.partition(";")[0])[0] == 200
    assert ask(address, "/vue.global.js", Cookie=cookie.partition("=")[0] + "=wrong")[0] == 403
    assert ask(address, f"/?{query}", Origin="http://evil.example")[0] == 403


def test_a_free_port_is_taken_and_tokens_are_never_the_same():
    assert len({new_token() for _ in range(100)}) == 100
    with bind(Address(LOOPBACK, 0)) as listening:
        assert listening.getsockname()[0] == LOOPBACK
        assert listening.getsockname()[1] > 0


def test_a_port_that_is_in_use_is_one_line(capsys):
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(OutputError, match=f"^port {port} is in use; give another one with --port"):
            bind(Address(LOOPBACK, port))
        if missing_studio() is None:
            assert f"port {port} is in use" in refused(capsys, "starter", "--port", port, "--no-browser")


@pytest.mark.parametrize(
    ("address", "line"),
    [
        (Address(LOOPBACK, 70_000), "--port must be 0 to 65535; got 70000."),
        (Address(LOOPBACK, -1), "--port must be 0 to 65535; got -1."),
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
    assert seen["work"].file == "mine.toml"
    assert seen["shelf"].folder == tmp_path.resolve()
    assert (seen["address"].host, seen["address"].alone, seen["linger"]) == (LOOPBACK, True, 3.0)
    first = seen["address"].token
    assert len(first) >= 32
    assert seen["services"].port == "/dev/ttyX"
    code, _, _ = run(capsys, "starter", "--port", "0", "--no-browser", "--host", "0.0.0.0", "--folder", tmp_path)
    assert code == 0
    assert len(seen["address"].token) >= 32
    assert seen["address"].token != first
    assert not seen["address"].alone
    assert len(opened) == 1


def test_a_report_is_that_of_the_report_command(monkeypatch, tmp_path):
    calls = []

    class Made:
        page = tmp_path / "report.html"

    def write(design, where, progress):
        calls.append((design.design.digest, where))
        progress(1, 8)
        return Made

    monkeypatch.setattr("coilarray.report.write.write_report", write)
    file, steps = load_design_file("starter"), []
    design = file.design
    page = command.write_report(file.document, design.name, tmp_path, lambda *step: steps.append(step))
    assert (page, calls, steps) == (tmp_path / "report.html", [(design.digest, tmp_path)], [(1, 8)])


@pytest.mark.slow
def test_a_response_is_computed_once(monkeypatch, tmp_path):
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path))
    made = []

    def table_for(design, *, progress=None):
        made.append(design.digest)
        return xr.Dataset({"delta": ("state", [1.0])}, attrs={"design_hash": design.digest})

    monkeypatch.setattr("coilarray.localize.forward.table_for", table_for)
    file = load_design_file("starter")
    design = file.design
    for _ in range(2):
        found = command.kept_response(file.document, design.name, lambda done, total: None)
        assert found.attrs["design_hash"] == design.digest
    assert made == [design.digest]
    monkeypatch.setattr("coilarray.localize.forward.table_for", lambda design, progress: design.name)
    assert compute_table(file.document, "name", lambda done, total: None) == "starter"
    assert Services().response_table is compute_table


@pytest.mark.slow
def test_the_emulated_board_is_watched_until_it_is_stopped(monkeypatch, tmp_path):
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path))
    # without an indentation there is no response to be computed, which takes half a minute
    document = dict(load_design_file("gast2020").document)
    for table in ("indenter", "indentation"):
        del document[table]
    document["assumed"] = {key: why for key, why in document["assumed"].items() if not key.startswith("indent")}
    frames = []
    options = LiveOptions(BoardOptions())
    watch_board(options, True, BoardRequest(document, "gast2020", "emulator"), frames.extend, Four(frames))
    assert len(frames) >= 4
    assert all(frame.emulated and frame.line.startswith("[emulator] emulator: ") for frame in frames)
    assert [frame.waiting for frame in frames[:4]] == [9, 8, 7, 6]
    assert [frame.sequence for frame in frames] == sorted(frame.sequence for frame in frames)
    assert list(frames[0].delta) == [f"coil{k}" for k in range(1, 7)]
    assert set(frames[0].delta.values()) == {None}  # the baseline is not there yet
    assert frames[0].temperature == 25.0


class Four:
    """Orders to end after four frames."""

    def __init__(self, frames):
        self._frames = frames

    def __call__(self):
        return len(self._frames) >= 4

    def take(self):
        return []


@pytest.mark.slow
def test_the_finger_presses_on_the_map_and_the_folder_is_that_of_the_design(monkeypatch, tmp_path):
    setup = load_design("gast2020").indentation
    path = tour(setup, 5.0)
    times = [time for time, *_ in path]
    assert times == sorted(times)
    assert times[0] == 5.0
    assert path[0][3] == 0.0
    for _, x, y, depth in path[1:]:
        assert setup.x[0] <= x <= setup.x[-1]
        assert setup.y[0] <= y <= setup.y[-1]
        assert 0 <= depth <= max(setup.depths)
    (tmp_path / "designs").mkdir()
    (tmp_path / "designs" / "mine.toml").touch()
    monkeypatch.chdir(tmp_path)
    assert command._folder("designs/mine.toml", None) == (tmp_path / "designs").resolve()
    assert command._folder("designs/mine.toml", Path()) == tmp_path.resolve()
    assert command._folder("starter", None) == tmp_path.resolve()
    assert command._folder(None, None) == tmp_path.resolve()


@pytest.mark.slow
@needs_studio
def test_of_twenty_clients_at_once_all_are_answered_and_no_more_served_than_allowed(alone):
    """It fills the studio of the other tests, which takes 2 of the usual 12, and so comes last."""
    with ThreadPoolExecutor(20) as clients:
        answers = list(clients.map(lambda k: ask(alone, f"/open/tab{k}", "POST"), range(20)))
    keys = {json.loads(text)["sessionURL"] for status, _, text in answers if status == 200}
    refused = [json.loads(text) for status, _, text in answers if status == 503]
    assert len(keys) in (1, 2)  # another test may have opened the first of both
    assert refused == [{"error": "the studio serves at most 12 pages at once"}] * (20 - len(keys))
    with ThreadPoolExecutor(20) as clients:
        pages = list(clients.map(lambda _: ask(alone), range(20)))
    for status, _, text in pages:
        assert status == 503
        assert text.startswith("coilarray studio: the studio serves at most 12 pages at once; close one")
    assert ask(alone, "/vue.global.js")[0] == 200  # those that are open go on
