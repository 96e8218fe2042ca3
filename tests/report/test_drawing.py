"""Tasks of the process that draws: answers, errors, and what it cannot do is done here."""

import os

import pytest

from coilarray.report.drawing import drawing_beside

pytestmark = pytest.mark.slow


def end_elsewhere(here):
    """End a process that is another one."""
    if os.getpid() != here:
        os._exit(1)


def test_the_process_answers_and_what_it_cannot_do_is_done_here(monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "2")
    here = os.getpid()
    with drawing_beside() as drawing:
        there = drawing.submit(os.getpid).result(60)
        assert there != here
        with pytest.raises(FileNotFoundError):
            drawing.submit(os.stat, "no such file").result(60)
        with drawing_beside() as inner:  # of a function that a command has called
            assert inner.submit(os.getpid).result(60) == there
        drawing.submit(end_elsewhere, here)
        after = drawing.submit(os.getpid)
        drawing.finish()
        assert after.result() == here


def test_what_lies_in_the_working_folder_is_not_run(monkeypatch, tmp_path):
    monkeypatch.setenv("COILARRAY_THREADS", "2")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shapely.py").write_text("open('run', 'w')\nraise SystemExit\n")
    with drawing_beside() as drawing:
        assert drawing.submit(os.getpid).result(60) != os.getpid()
    assert not (tmp_path / "run").exists()


def test_what_cannot_be_pickled_is_done_here(monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "2")
    with drawing_beside() as drawing:
        ours = drawing.submit(lambda: -os.getpid())
        drawing.finish()
        assert ours.result() == -os.getpid()


def test_one_core_draws_in_this_process(monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "1")
    with drawing_beside() as drawing:
        ours = drawing.submit(os.getpid)
        drawing.finish()
        assert ours.result() == os.getpid()
