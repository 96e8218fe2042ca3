"""Tasks of the process that draws: answers, errors, and what it cannot do is done here."""

import os
from pathlib import Path

import pytest

from coilarray.report.drawing import drawing_beside

pytestmark = pytest.mark.slow


def end_elsewhere(here):
    """End a process that is another one."""
    if os.getpid() != here:
        os._exit(1)


def test_the_process_answers_and_what_it_cannot_do_is_done_here(monkeypatch, tmp_path):
    monkeypatch.setenv("COILARRAY_THREADS", "2")
    monkeypatch.chdir(tmp_path)
    Path("shapely.py").write_text("open('run', 'w')\nraise SystemExit\n")  # what lies in the working folder is not run
    here = os.getpid()
    with drawing_beside() as drawing:
        there = drawing.submit(os.getpid).result(60)
        assert there != here
        with pytest.raises(FileNotFoundError):
            drawing.submit(os.stat, "no such file").result(60)
        with drawing_beside() as inner:  # of a function that a command has called
            assert inner.submit(os.getpid).result(60) == there
        ours = drawing.submit(lambda: -os.getpid())  # which cannot be pickled
        drawing.submit(end_elsewhere, here)
        after = drawing.submit(os.getpid)
        drawing.finish()
        assert (ours.result(), after.result()) == (-here, here)
    assert not Path("run").exists()


def test_one_core_draws_in_this_process(monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "1")
    with drawing_beside() as drawing:
        ours = drawing.submit(os.getpid)
        drawing.finish()
        assert ours.result() == os.getpid()
