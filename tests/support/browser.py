"""A real browser on a studio that is served by a process of its own; as a script, that process.

The studio's page is the package's own. What would take long beside it is replaced by quick stand-ins: a response of
smooth bells, a report of one line, a board that reads the same again and again, a circuit without losses and strays.
"""

import argparse
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from coilarray.design.model import build_design, build_design_file, load_design_file
from coilarray.errors import MissingDependencyError
from coilarray.localize.forward import table_grid
from coilarray.response.dataset import on_board, origin_attributes
from coilarray.viz.studio.services import check_studio
from support.patience import PATIENCE, until

HERE = Path(__file__).parent
ARTIFACTS = "COILARRAY_ARTIFACTS"
"""Environment variable: folder where screenshots are kept."""

QUICK = "quick"
"""File in the folder of the designs that makes reports quick; without it they take longer than any test waits."""

_SLOW = 600.0  # s
_TIMEOUT = 120_000  # ms that the browser may take for anything; the machine may be busy
SIZE = {"width": 1280, "height": 760}

TWO_FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
"""What a page evaluates to be drawn anew, twice."""

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""Options of `launched` for scenes: test machines have no graphics card."""


def missing():
    """Say why there can be no browser test here, or None."""
    if importlib.util.find_spec("playwright") is None:
        return "Playwright is not installed"
    return "there is no chromium" if chromium() is None else missing_studio()


def missing_studio():
    """Say why there can be no studio here, or None."""
    try:
        check_studio()
    except MissingDependencyError as error:
        return str(error)
    return None


def chromium():
    """Path of the system's chromium, or None."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for path in map(shutil.which, names) if path is not None), None)


class Served:
    """A studio in a process of its own."""

    def __init__(self, process):
        self.process = process
        found, self.lines = None, []
        for line in process.stdout:
            self.lines.append(line)
            found = re.search(r"studio: (http://\S+)", line)
            if found:
                break
        assert found, "".join(self.lines)
        self.url = found[1]
        self.root, _, self.query = self.url.partition("?")  # the address, and the token as a query

    def children(self):
        """Processes that it has started and that are still there."""
        command = ["ps", "-ww", "-o", "pid=,stat=,args=", "--ppid", str(self.process.pid)]
        listed = subprocess.run(command, check=False, capture_output=True, text=True).stdout.splitlines()
        there = [line.split(maxsplit=2) for line in listed]
        # multiprocessing's own helper stays as long as the studio
        return [int(pid) for pid, state, what in there if "Z" not in state and "resource_tracker" not in what]

    def wait(self):
        """Wait for it to end; its exit code."""
        return self.process.wait(PATIENCE)

    def end(self):
        """Stop it as Ctrl-C does, and return all that it said."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            rest, _ = self.process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            rest, _ = self.process.communicate()
            raise AssertionError(f"the studio did not end: {rest}") from None
        return "".join(self.lines) + rest


@contextmanager
def served(*arguments, program=False, cwd=None, **environment):
    """Serve a studio with stand-ins, or the whole program."""
    what = ["-c", "from coilarray.cli.main import run; run()", "studio"] if program else ["-m", "support.browser"]
    path = os.pathsep.join((str(HERE.parent), os.environ.get("PYTHONPATH", "")))  # on which they find this package too
    process = subprocess.Popen(
        [sys.executable, *what, "--port", "0", "--no-browser", *map(str, arguments)],
        cwd=cwd, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": path, **environment},
        start_new_session=True,  # an interrupt of the tests is none of the studio
    )  # fmt: skip
    try:
        studio = Served(process)
        yield studio
        said = studio.end()
        assert "Traceback" not in said, said
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()


def wait_until_gone(pids):
    """Wait until there are no such processes any more."""
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids))


@contextmanager
def launched(*options):
    """Open a browser that finds no host but this computer; without `options` it draws nothing in three dimensions."""
    from playwright.sync_api import sync_playwright

    always = ("--no-sandbox", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
    options = [*always, *(options or ["--disable-gpu"])]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=options, timeout=_TIMEOUT)
        try:
            yield browser
        finally:
            browser.close()


def profile(browser, **options):
    """Return a browser profile of its own, whose pages have time."""
    context = browser.new_context(**options)
    context.set_default_timeout(_TIMEOUT)
    return context


def expect(part):
    """Playwright's expectations of a part of a page or a page, which wait until they hold; they have time."""
    from playwright.sync_api import expect as expectations

    expectations.set_options(timeout=_TIMEOUT)
    return expectations(part)


class Opened:
    """A page, and what was wrong with it: requests to other hosts, errors of scripts, answers that are none."""

    def __init__(self, browser, url):
        self.context = profile(browser, viewport=SIZE, reduced_motion="reduce")
        self.page = self.context.new_page()
        self.wrong, self._host = [], url.split("/")[2]
        self._listen("request", self._elsewhere, lambda request: f"asked {request.url}")
        # "Object" is what trame's client has on its way when its page is loaded again
        self._listen("pageerror", lambda error: str(error) != "Object", lambda error: f"error {error}")
        self._listen("response", lambda one: one.status >= 400, lambda one: f"{one.status} {one.url}")
        # the last words of a page that is loaded again find no connection
        late = "connection not open"
        self._listen("console", lambda said: said.type == "error" and late not in said.text, lambda said: said.text)
        self.page.goto(url)

    def _listen(self, event, wrong, text):
        self.page.on(event, lambda what: self.wrong.append(text(what)) if wrong(what) else None)

    def _elsewhere(self, request):
        scheme, _, rest = request.url.partition(":")
        return scheme not in ("data", "blob") and rest.split("/")[2] != self._host


@contextmanager
def opened(browser, url):
    """Open a page in a browser profile of its own; whatever was wrong with it is an error when the block is left."""
    one = Opened(browser, url)
    try:
        at_rest(one.page)
        yield one.page
        assert one.wrong == []
    finally:
        one.context.close()


def heard(page):
    """Wait until the studio has done all that the page has asked for so far, and the page knows it.

    What is asked is done in turn, so that this is done last. An answer may overtake the news of what was done before
    it; they are sent before the second question is heard.
    """
    for _ in range(2):
        page.wait_for_function("trame.trigger('look_at_shelf').then(() => true)")


def at_rest(page):
    """Wait until the numbers that follow from the design are on the page, in full."""
    page.wait_for_selector("#accuracy[data-accuracy=full]")  # perhaps those of before the last change
    heard(page)
    page.wait_for_selector("#accuracy[data-accuracy=full]")


def still(page):
    """Wait until the scene is drawn and smooth."""
    heard(page)
    page.wait_for_selector("#scene[data-rests=true]")


def drawn(page):
    """Wait until the scene is drawn and smooth; return its picture."""
    still(page)
    return page.locator("#board").screenshot()


def redrawn(page, before):
    """Wait until the scene is drawn, and is another one than it was; return its picture.

    A new scene is made beside the page, so that for a while the one before is at rest still.
    """

    return until(lambda: now if (now := drawn(page)) != before else None)


def picture(page, name):
    """Keep a screenshot where the environment says a folder."""
    folder = os.environ.get(ARTIFACTS)
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(Path(folder, f"studio_{name}.png")))


def field(page, key):
    """The field of an entry."""
    return page.locator(f"[data-key='{key}'] input[type=text]")


def enter(page, key, text):
    """Type a value into the field of an entry, and Enter."""
    field(page, key).fill(str(text))
    field(page, key).press("Enter")


def matrix(page):
    """The numbers behind the cells of the matrix, with all their digits."""
    page.wait_for_selector("#matrix td")
    titles = page.eval_on_selector_all("#matrix td", "cells => cells.map(cell => cell.title)")
    values = [float(title.partition(" = ")[2].removesuffix(" H")) for title in titles]
    return np.reshape(values, (round(len(values) ** 0.5),) * 2)


def bells(document, name, progress=lambda done, total: None):
    """A response of one bell for each coil, quick and smooth."""
    import xarray as xr

    design = build_design(document, name)
    depth, x, y = table_grid(design, spacing=2e-3)
    centres = design.array.centres - design.indentation.origin_point
    H, Y, X = np.meshgrid(depth, y, x, indexing="ij")
    delta = [
        4e-3 * (H / 1e-3) ** 1.6 * np.exp(-((X - cx) ** 2 + (Y - cy) ** 2) / (6e-3 * (1 + 100 * H)) ** 2)
        for cx, cy in centres.tolist()
    ]
    for k in range(3):
        progress(k + 1, 3)
    coords = {"depth": depth, "y": y, "x": x, "state": [state.name for state in design.plan]}
    attributes = {"design_hash": design.digest, **origin_attributes(design.indentation)}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), np.stack(delta, axis=-1))}, coords, attributes)


def summary_of_circuit(design, coupling, response):
    """The report's summary without its scan, which takes seconds."""
    from coilarray.geometry import check_rules
    from coilarray.report.summary import summary_table, verdicts
    from coilarray.viz.studio.services import Summary

    table = summary_table(coupling, None, check_rules(design.array, design.rules), response).brief().without("key")
    return Summary(table, verdicts(None, ()))


def ideal_circuit(design):
    """The circuit without losses at alternating current and strays, which take seconds for every change."""
    from coilarray.circuit.coupling import couple_design, design_circuit
    from coilarray.viz.studio.numbers import Circuit

    return Circuit(design_circuit(design, ideal=True), couple_design(design, ideal=True))


GOAL = """
schema = 1
variable = [{entry = "array.pitch_mm", low = 9.0, high = 13.0}, {entry = "array.columns", low = 2, high = 4}]
objective = [{quantity = "board_area_mm2", direction = "minimize"}, {quantity = "span_mm", direction = "maximize"}]
constraint = [{quantity = "covered_mm2", at_least = 500}]
search = {trials = 12, batch = 6}
"""


def quick_run(folder):
    """Leave an optimisation of shapes alone, which is cheap, in a folder."""
    from coilarray import load_design
    from coilarray.compute.workers import open_executor
    from coilarray.studies.optimize.goal import parse_goal
    from coilarray.studies.optimize.run import optimize_design

    with open_executor() as pool:
        return optimize_design(load_design("starter"), parse_goal(GOAL), folder, pool)


def quick_new(name, choices, progress):
    """The starter design with as many coils in a row as are asked for."""
    document = load_design_file("starter").document
    return build_design_file(
        {**document, "name": name, "array": {**document["array"], "columns": int(choices["coils"])}}
    )


def slow_report(document, name, folder, progress):
    """A report of one line that takes its time, unless it is told otherwise."""
    for k in range(6000):
        progress(k, 6000)
        if (folder.parent / QUICK).exists():
            break
        time.sleep(_SLOW / 6000)
    folder.mkdir(exist_ok=True)
    page = folder / "report.html"
    # what a script of a report could do in the origin of the studio
    script = "document.title = 'ran'; fetch('/open/stolen', {method: 'POST'})"
    text = f"<!doctype html><meta charset=utf-8><title>{name}</title><p>A report.<script>{script}</script>"
    page.write_text(text, encoding="utf-8")
    return page


def steady_board(request, link):
    """A board that is pressed at one place for half of the time, after a baseline of two scans."""
    from coilarray.localize.forward import forward_model
    from coilarray.localize.inverse import locate
    from coilarray.localize.presses import Press
    from coilarray.viz.studio import BoardFrame
    from coilarray.viz.studio.job import QUIT, ZERO

    design = build_design(request.document, request.name)
    model = forward_model(on_board(bells(request.document, request.name)))
    delta = model.delta([2e-3, 1e-3, model.depth[2]])
    location = locate(model, delta)
    zero = 0
    for k in range(1_000_000):
        asked = link.orders()
        if QUIT in asked:
            return
        if ZERO in asked:
            zero = k + 8  # a baseline that is long enough to be seen
        waiting, at = max(0, zero + 2 - k), 0.1 * k
        values = [None] * len(model.states) if waiting else delta.tolist()
        begin = 0.8 * (k // 8)
        press = None if waiting else Press(k // 8 + 1, begin, at if k % 8 == 4 else None, delta.max(), location)
        link.send([
            BoardFrame(
                f"[emulator] {request.port}: a stand-in", True, k, dict(zip(model.states, values, strict=True)),
                {design.array.names[0]: "doubtful: amplitude"}, waiting, None if waiting else location, "", 10.0, 0,
                at, press if k % 8 <= 4 else None, 25.5,
            )
        ])  # fmt: skip
        time.sleep(0.1)


def cheap_template(name):
    """Part of the page that draws a picture at rest twice, not sixteen times, and looks for news 20 times a second."""
    from coilarray.viz.studio.session import template

    text = template(name).replace("SAMPLES = 16", "SAMPLES = 2")
    return text.replace("requestAnimationFrame(frame)", "setTimeout(requestAnimationFrame, 30, frame)")


def main():
    """Serve a studio with the stand-ins."""
    from coilarray.viz.studio import design, live, numbers, server
    from coilarray.viz.studio.server import serve
    from coilarray.viz.studio.services import LOOPBACK, Address, Services, bind
    from coilarray.viz.studio.work import Shelf, work_on

    parser = argparse.ArgumentParser()
    parser.add_argument("design")
    parser.add_argument("--folder", type=Path, default=Path())
    parser.add_argument("--port", type=int)
    parser.add_argument("--no-browser", action="store_true")
    parser.add_argument("--host")
    parser.add_argument("--pages", type=int, default=12)
    parser.add_argument("--linger", type=float, default=0.0)
    given = parser.parse_args()
    # functions of this module by its name, under which other processes import it too
    from support import browser  # noqa: PLW0406 - it runs as __main__

    # on a busy machine pages may be slow to connect and to answer, and are there all the same
    server._UNUSED = server._HEARTBEAT = 3600.0  # s
    server._MOST_PAGES = given.pages
    numbers.circuit_of = browser.ideal_circuit
    live.coarse_table = lambda design, _: browser.bells(load_design_file(design.name).document, design.name)
    design.make_design = browser.quick_new
    server.template = browser.cheap_template

    services = Services(browser.bells, browser.slow_report, browser.steady_board, "emulator", summary_of_circuit)
    address = Address(given.host or LOOPBACK, given.port, alone=given.host is None)
    work = work_on(load_design_file(given.design), given.design)
    with bind(address) as listening:
        serve(
            work, Shelf(given.folder.resolve()), services, address, listening, linger=given.linger,
            ready=lambda url: print(f"studio: {url}", flush=True),  # noqa: T201 - the tests read it
        )  # fmt: skip


if __name__ == "__main__":
    main()
