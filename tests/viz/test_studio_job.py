"""Work beside the page: it tells how it goes on, ends when it is told to, and never outlives whoever began it."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from support.patience import PATIENCE, alive, until
from support.worker_tasks import count_to, fail, never_listen, tell_on_and_on, wait_for_the_word

from coilarray.design.model import load_design_file
from coilarray.errors import GeometryError
from coilarray.viz.studio import structure
from coilarray.viz.studio.job import Calculator, Job, Step
from coilarray.viz.studio.services import Services
from coilarray.viz.studio.work import Shelf, Work, work_on


class Watched:
    """A job with everything that it says."""

    def __init__(self, task, item, **options):
        self.messages, self.outcome, self.ended, self.told = [], None, threading.Event(), threading.Event()
        self.job = Job(task, item, on_message=self._message, on_end=self._end, **options)

    def _message(self, message):
        self.messages.append(message)
        self.told.set()

    def _end(self, outcome):
        self.outcome = outcome
        self.ended.set()

    def result(self):
        assert self.ended.wait(PATIENCE)
        return self.outcome


def test_a_job_tells_and_ends():
    watched = Watched(count_to, 5)
    outcome = watched.result()
    assert (outcome.kind, outcome.result) == ("done", 25)
    assert watched.messages == [(k, 5) for k in range(1, 6)]
    assert watched.job._process.exitcode == 0


@pytest.mark.parametrize(
    ("item", "line"),
    [
        ("ours", "the coil must be round; got a square."),
        ("theirs", "ZeroDivisionError: nothing to divide"),
        ("gone", "the work ended with exit code 7; is there memory enough?"),
    ],
)
def test_what_goes_wrong_is_one_line(item, line, capfd):
    outcome = Watched(fail, item).result()
    assert (outcome.kind, outcome.problem) == ("failed", line)
    assert ("Traceback" in capfd.readouterr().err) == (item == "theirs")  # ours to mend, not the user's


@pytest.mark.parametrize(
    ("task", "options"),
    # with patience it is not ended, but ends
    [(wait_for_the_word, {"patience": PATIENCE}), (tell_on_and_on, {"patience": PATIENCE}), (never_listen, {})],
)
def test_a_task_ends_in_order_or_is_ended_and_nothing_is_said_after_that(task, options, tmp_path):
    watched = Watched(task, str(tmp_path / "rested"), **options)
    assert watched.told.wait(PATIENCE)
    watched.job.send("q")
    most = len(watched.messages) + 1  # one may have been on its way
    watched.job.close()
    assert watched.result().kind == "cancelled"
    assert len(watched.messages) <= most
    assert not alive(watched.messages[0])
    if task is wait_for_the_word:
        assert (tmp_path / "rested").read_text(encoding="utf-8") == "at rest"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_a_job_ends_with_its_studio_even_if_that_is_killed():
    script = """
import time
from support.worker_tasks import never_listen
from coilarray.viz.studio.job import Job

if __name__ == "__main__":
    Job(never_listen, None, on_message=lambda pid: print(pid, flush=True), on_end=lambda outcome: None)
    time.sleep(600)
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    studio = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment)
    try:
        pid = int(studio.stdout.readline())
        assert alive(pid)
    finally:
        studio.kill()
        studio.communicate()
    until(lambda: not alive(pid))


def run(ask):
    """Run steps until there are none left; `ask` gets a calculator and a list to write to."""

    async def main():
        with ThreadPoolExecutor(1) as threads:
            calculator, seen = Calculator(threads), []
            await ask(calculator, seen)
            while not calculator.idle:
                await asyncio.sleep(0.005)
            calculator.close()
            return seen

    return asyncio.run(main())


def step(seen, name, value=None, *, begun=None, gate=None, **options):
    def compute():
        if begun is not None:
            begun.set()
        assert gate is None or gate.wait(PATIENCE)
        if isinstance(value, Exception):
            raise value
        return value

    def say(result):
        seen.append((name, result))

    return Step(name, compute, say, say, **options)


def test_steps_come_in_order_and_the_newest_wish_counts():
    async def ask(calculator, seen):
        begun, gate = threading.Event(), threading.Event()
        calculator.ask([step(seen, "first", 1, begun=begun, gate=gate), step(seen, "second", 1)])
        assert await asyncio.to_thread(begun.wait, PATIENCE)
        calculator.ask([step(seen, "first", 2), step(seen, "second", 2)])
        calculator.ask([step(seen, "first", 3), step(seen, "second", 3)])
        gate.set()

    assert run(ask) == [("first", 1), ("first", 3), ("second", 3)]


@pytest.mark.slow
def test_a_step_that_waits_for_rest_comes_last_and_once():
    rest, times = 0.3, []

    async def ask(calculator, seen):
        for k in range(5):
            # so long that there is no rest between two wishes, however busy the machine is
            calculator.ask([step(seen, "full", k, rest=1000.0), step(seen, "rough", k)])
            while ("rough", k) not in seen:
                await asyncio.sleep(0.005)
        times.append(time.monotonic())
        calculator.ask([step(seen, "full", 5, rest=rest)])
        while not calculator.idle:
            await asyncio.sleep(0.005)
        times.append(time.monotonic())

    assert run(ask) == [*(("rough", k) for k in range(5)), ("full", 5)]
    assert times[1] - times[0] >= rest


def test_a_step_that_fails_is_told_and_the_next_one_done(capfd):
    async def ask(calculator, seen):
        named = {"first": GeometryError("a line."), "second": KeyError("x"), "third": 3}
        calculator.ask([step(seen, name, value) for name, value in named.items()])

    assert run(ask) == [("first", "a line."), ("second", "KeyError: 'x'"), ("third", 3)]
    assert "KeyError" in capfd.readouterr().err


def test_nothing_is_begun_after_the_end():
    """A job of a page may end, and ask for a new scene, when the threads are gone."""

    async def ask(calculator, seen):
        calculator.close()
        calculator.ask([step(seen, "late", 1)])

    assert run(ask) == []


@pytest.fixture
def on_a_page(tmp_path, monkeypatch):
    """Run a coroutine of a page of the starter design, which computes nothing by itself."""
    pytest.importorskip("trame")
    monkeypatch.setenv("TRAME_ARGS", "")
    from coilarray.viz.studio.server import Page
    from coilarray.viz.studio.session import Setup

    async def whole(use):
        with ThreadPoolExecutor(1) as threads:
            setup = Setup(Shelf(tmp_path), Services(alone=True), {}, threads, "no picture")
            page = Page(setup, work_on(load_design_file("starter"), "starter"), "tab")
            try:
                return await use(page)
            finally:
                await page.close()

    return lambda use: asyncio.run(asyncio.wait_for(whole(use), PATIENCE))


@pytest.mark.slow
def test_an_error_in_what_follows_a_job_is_told_on_the_page(on_a_page, capfd):
    def broken(result):
        raise KeyError(f"a result of {result}")

    async def later(result):
        raise KeyError(f"a picture of {result}")

    async def problems(page):
        told = []
        for done in (broken, lambda result: page.begin(later, result)):
            page.say("")
            assert page.start_bar("sum", "a sum", count_to, 2, done=done)
            while not page.state.problem:
                await asyncio.sleep(0.02)
            told.append((page.state.problem, page.state.job["running"]))
        assert page.start_bar("sum", "a sum", fail, "gone", done=broken)  # whatever tab is open by then
        assert page.state.problem == ""
        while not page.state.problem:
            await asyncio.sleep(0.02)
        told.append((page.state.problem, page.state.job["running"]))
        return told

    expected = [
        ("KeyError: 'a result of 4'", False), ("KeyError: 'a picture of 4'", False),
        ("a sum: the work ended with exit code 7; is there memory enough?", False),
    ]  # fmt: skip
    assert on_a_page(problems) == expected
    assert capfd.readouterr().err.count("Traceback") == 2


@pytest.mark.slow
def test_coils_are_led_out_beside_the_page_and_what_is_changed_meanwhile_waits(on_a_page, monkeypatch):
    gate, with_document = threading.Event(), Work.with_document

    def routed(work, document):
        assert "connector" not in document or gate.wait(PATIENCE)  # for ever, if the page itself waited here
        return with_document(work, document)

    monkeypatch.setattr(Work, "with_document", routed)

    def connector(work):
        return structure.set_connector(work.opened.document, work.design, "top")

    async def changes(page):
        def enter(key, value):
            page.change(lambda work: work.document_with({key: value}), entry=key)

        async def done():
            while not page._changing.done():
                await asyncio.sleep(0.02)

        first = page.work
        page.change(connector, "build_problem")
        await asyncio.sleep(0)  # the first one has begun
        for value in (5.0, 4.0):  # of which only the last counts
            enter("board.margin_mm", value)
        enter("array.columns", 1000)
        assert page.work is first
        assert page.state.routing
        gate.set()
        await done()
        values, array = page.work.opened.values, page.work.design.array
        assert (values["board.margin_mm"], array.routing.connector.side) == (4.0, "top")
        assert page.state.errors["array.columns"].startswith("array.columns must leave at most 64 coils")
        assert (page.state.can_undo, page.state.can_redo, page.state.routing) == (True, False, False)
        page._step(page._before, page._after)
        assert (page.work.opened.values["board.margin_mm"], page.state.can_redo) == (2.0, True)
        page._step(page._before, page._after)
        assert page.work.opened is first.opened
        gate.clear()
        page.change(connector, "build_problem")
        await asyncio.sleep(0)
        page._step(page._after, page._before)  # another design meanwhile: the change is of none that is on show
        redone = page.work
        gate.set()
        await done()
        assert page.work is redone

    on_a_page(changes)


@pytest.mark.slow
def test_a_field_that_is_left_as_it_was_changes_nothing(on_a_page):
    """It shows twelve digits of a value that may have more."""

    async def fields(page):
        page.take(page.work.with_document(page.work.document_with({"array.pitch_mm": 11 + 1 / 3})))
        begun = page.work
        for text, same in (("11.3333333333", True), ("11.3", False)):
            page.design._enter("array.pitch_mm", text)
            while page._changing is not None and not page._changing.done():
                await asyncio.sleep(0.02)
            assert (page.work is begun) == same

    on_a_page(fields)
