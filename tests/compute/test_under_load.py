"""Several threads and processes at once, and an interrupt in the middle of every long command.

Threads and processes must give the numbers of one that is alone, to the last bit: every sum is cut in the same places.
Commands are run as processes of their own, whose progress is told on standard output and which then wait, so that the
interrupt comes within the work; what was there before must still be there, what is kept must be whole, and the same
command must go on from there to the result of a run without an interrupt. `test_cli_sweep` does the same with two
workers, `test_cli_measure_broken_off` with a scan, `test_cli_live` with a stream, `test_optimize_kill` and
`test_recording_kill` with signal 9.
"""

from __future__ import annotations

import csv
import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
import tomllib
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import xarray as xr
from support.load_work import digests, results
from threadpoolctl import threadpool_limits

from coilarray.cli.main import main
from coilarray.compute.large_file import parts_folder
from coilarray.compute.netcdf import load_part
from coilarray.compute.threads import run_blocks
from coilarray.design.bundled import read

pytestmark = pytest.mark.slow

PATIENCE = 300.0  # s for what takes a few where nobody else computes
DOCUMENT = tomllib.loads(read("starter"))


@pytest.fixture(scope="module")
def alone():
    return digests(results())


def test_threads_at_once_give_what_one_gives(alone):
    found, start = [], threading.Barrier(2)

    def work():
        start.wait()
        found.append(digests(results()))

    threads = [threading.Thread(target=work) for _ in range(2)]
    with threadpool_limits(limits=1, user_api="blas"):  # one of the threads would lift a limit of its own for both
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert found == [alone, alone]


def test_processes_at_once_give_what_one_gives(alone):
    code = "import json; from support.load_work import digests, results; print(json.dumps(digests(results())))"
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join((str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", ""))),
    }
    running = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            stdout=subprocess.PIPE,
            text=True,
            env={**environment, "OPENBLAS_NUM_THREADS": str(count), "COILARRAY_THREADS": str(count)},
        )
        for count in (1, 2, 3, 4)  # not even these change a bit
    ]
    outputs = [process.communicate(timeout=PATIENCE)[0] for process in running]
    assert [process.returncode for process in running] == [0] * 4
    assert [json.loads(output) for output in outputs] == [alone] * 4


KERNEL = """
from coilarray.electromagnetics.kernels.compiled import kernel

@kernel
def total(x):
    s = 0.0
    for value in x:
        s += value**0.5
    return s
"""


def test_processes_at_once_compile_into_one_cache(tmp_path):
    """A kernel in a folder of its own, so that nothing of it is compiled before."""
    (tmp_path / "fresh_kernel.py").write_text(KERNEL)
    code = "import numpy as np; from fresh_kernel import total; print(total(np.arange(9.0)).hex())"
    path = os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", "")))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": path}
    command = [sys.executable, "-c", code]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(4)]
    outputs = {process.communicate(timeout=PATIENCE)[0] for process in running}
    assert any((tmp_path / "cache").rglob("*.nbc"))
    after = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)  # from what they left
    assert outputs == {after.stdout}
    assert float.fromhex(after.stdout) == pytest.approx(np.sqrt(np.arange(9.0)).sum(), rel=1e-12)


# interrupts

START = """
import sys, time
from contextlib import contextmanager
import coilarray.cli.shared as shared
after, *arguments = sys.argv[1:]

def tell(done, total, *_):
    print(done, total, flush=True)
    while done >= int(after):  # however late the interrupt is sent, the work is not over
        time.sleep(0.01)  # not long: another thread may take the signal, which does not wake this one

@contextmanager
def telling(*_):
    yield tell

shared.progress_bar = telling
from coilarray.cli import main, optimize
optimize._progress = telling
sys.exit(main.main(arguments))
"""


# stops while a file is being written, which is complete but has not got its name
WRITING = """
import sys, time
import coilarray.compute.files as files
import coilarray.design.export as export
from coilarray.cli import main
atomically = files.write_atomically

def wait(*_):
    print(0, 1, flush=True)
    while True:
        time.sleep(0.01)  # as above

def write(path, fill):
    atomically(path, lambda temporary: (fill(temporary), wait()))

files.write_atomically = write
export._net_faults = wait  # of a folder, which is complete then
sys.exit(main.main(sys.argv[2:]))
"""


def interrupted(folder, *arguments, after=1, start=START):
    """Run a command, interrupt it when it tells so much progress, and return its lines on standard error."""
    with subprocess.Popen(
        [sys.executable, "-c", start, str(after), *map(str, arguments)],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # one thread tells of every block; with several the first word may come when all are done
        env={**os.environ, "COILARRAY_CACHE": str(folder / "cache"), "COILARRAY_THREADS": "1"},
    ) as process:
        try:
            for line in process.stdout:
                done, total = map(int, line.split())
                if done >= after:
                    assert done < total, "over before the interrupt"
                    break
            os.killpg(process.pid, signal.SIGINT)  # to all of the group, as a terminal does
            rest, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 130, err
    assert "wrote" not in rest
    assert err.splitlines()[-1] == "coilarray: interrupted"
    return err.splitlines()[:-1]


def files(folder):
    """Names of all files in a folder, hidden ones of unfinished writing included."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize(
    ("arguments", "targets"),
    [
        (["report", "flat.toml", "--out", "r"], ["r/report.html", "r/report/coupling.nc"]),
        (["field", "starter", "--z-mm", "1:4", "--spacing-mm", "0.25", "--out", "f.nc"], ["f.nc"]),
        (["distortion", "gast2020", "--out", "d.csv", "--plot", "d.png"], ["d.csv", "d.png"]),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_what_keeps_nothing_leaves_everything_as_it_was(tmp_path, arguments, targets):
    for target in targets:
        path = tmp_path / target
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("before")
    flat = {key: value for key, value in DOCUMENT.items() if key not in ("indenter", "indentation")}  # a short report
    (tmp_path / "flat.toml").write_text(tomli_w.dumps(flat))
    assert interrupted(tmp_path, *arguments) == []
    assert files(tmp_path) == sorted(["flat.toml", *targets])
    assert {(tmp_path / target).read_text() for target in targets} == {"before"}


@pytest.mark.parametrize(
    ("arguments", "target"),
    [
        (["matrix", "starter", "--out", "m.nc"], "m.nc"),
        (["matrix", "starter", "--out", "m.csv"], "m.csv"),
        (["impedance", "starter", "--points", "2", "--out", "i.csv"], "i.csv"),
        (["indent", "gast2020", "--out", "d.nc"], "d.nc"),
        (["fit", "gast2020", "--out", "f.json"], "f.json"),
        (["field", "starter", "--out", "f.vtr"], "f.vtr"),
        (["export", "starter", "--to", "gerber", "--out", "g.zip", "--force"], "g.zip"),
        (["export", "starter", "--to", "kicad", "--out", "k", "--force"], "k/starter.kicad_pcb"),
    ],
    ids=lambda value: None if isinstance(value, list) else value,
)
def test_what_is_being_written_leaves_nothing(tmp_path, arguments, target):
    path = tmp_path / target
    path.parent.mkdir(exist_ok=True)
    path.write_text("before")
    assert interrupted(tmp_path, *arguments, after=0, start=WRITING) == []
    assert files(tmp_path) == [target]
    assert path.read_text() == "before"


ETCH = "schema = 1\n[etch]\nboard_um = 5\nlayer_um = 5\n"
GOAL = """
schema = 1
title = "a search without the local solver"
[[variable]]
entry = "array.pitch_mm"
low = 10.5
high = 14.0
[[objective]]
quantity = "worst_k"
direction = "minimize"
[search]
sampler = "random"
seed = 1
polish = 0
"""


def numbers_of(path):
    """Arrays of a dataset, or the columns of a table, by name."""
    if path.suffix == ".nc":
        with xr.open_dataset(path, engine="h5netcdf") as result:
            return {str(name): one.values for name, one in result.load().data_vars.items()}
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize(
    ("arguments", "after", "result"),
    [
        (
            ["response", "starter", "--depth-mm", "0.5,1", "--x-mm", "0,1", "--y-mm", "0", "--out", "r.nc"],
            101,
            "r.nc",
        ),
        (
            ["field", "starter", "--z-mm", "1:5", "--spacing-mm", "0.15", "--large", "--workers", "1", "--out", "f.nc"],
            1,
            "f.nc",
        ),
        (
            ["sweep", "starter", "--vary", "array.pitch_mm=12:16:20", "-q", "worst_k", "--workers", "1", "-o", "s.nc"],
            2,
            "s.nc",
        ),
        (["tolerance", "starter", "etch.toml", "--samples", "16", "--workers", "1", "--out", "t.nc"], 2, "t.nc"),
        (["optimize", "starter", "goal.toml", "--trials", "8", "--workers", "1", "--out", "o"], 2, "o/trials.csv"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_the_same_command_goes_on_to_the_same_result(tmp_path, monkeypatch, capsys, arguments, after, result):
    broken_off, whole = tmp_path / "broken_off", tmp_path / "whole"
    for folder in (broken_off, whole):
        folder.mkdir()
        (folder / "etch.toml").write_text(ETCH)
        (folder / "goal.toml").write_text(GOAL)
    interrupted(broken_off, *arguments, after=after)
    kept = set(files(broken_off)) - {"etch.toml", "goal.toml"}
    assert kept
    assert result not in kept
    found = []
    for folder in (broken_off, whole):
        monkeypatch.chdir(folder)
        monkeypatch.setenv("COILARRAY_CACHE", str(folder / "cache"))
        assert main(arguments) == 0, capsys.readouterr().err
        found.append(numbers_of(folder / result))
    assert [name for name in files(broken_off) if name.endswith(".parts")] == []
    assert files(broken_off) == files(whole)
    assert set(found[0]) == set(found[1])
    for name, expected in found[1].items():
        if expected.dtype.kind in "fc":  # a worker has one thread, this process all cores: sums are cut elsewhere
            np.testing.assert_allclose(found[0][name], expected, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(expected)))
        else:
            assert found[0][name].tolist() == expected.tolist()


def test_an_interrupt_drops_the_blocks_that_have_not_begun(monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "2")
    begun = []

    def work(number):
        begun.append(number)
        time.sleep(0.01)

    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_blocks(work, range(10_000), interrupt)
    assert len(begun) < 5000  # 40 where the first progress is told after 0.2 s


def test_an_interrupted_response_keeps_whole_parts(tmp_path):
    """A depth is a part; the interrupt comes in the second one, so that the first is kept."""
    arguments = ["response", "gast2020", "--depth-mm", "0.5,1", "--x-mm", "0,1", "--y-mm", "0", "--out", "m.nc"]
    assert interrupted(tmp_path, *arguments, after=101) == []
    (part,) = files(tmp_path)
    assert part.startswith("m.nc.parts/")
    assert load_part(tmp_path / part).change.shape == (2, 6, 6)


def test_an_interrupted_volume_keeps_whole_blocks(tmp_path):
    grid = ["--z-mm", "1:9", "--spacing-mm", "0.15"]
    (told,) = interrupted(tmp_path, "field", "starter", *grid, "--large", "--workers", "1", "--out", "f.nc")
    assert told.endswith(" blocks are kept in f.nc.parts; the same command goes on from there")
    assert files(tmp_path) == ["f.nc.parts/data.nc", "f.nc.parts/journal.db"]
    with closing(sqlite3.connect(parts_folder(tmp_path / "f.nc") / "journal.db")) as journal:
        blocks = journal.execute("SELECT number FROM block").fetchall()
    assert told.startswith(f"coilarray: {len(blocks)} of ")


def test_an_interrupted_tolerance_keeps_whole_boards(tmp_path):
    arguments = ["tolerance", "starter", "--samples", "256", "--workers", "2", "--out", "t.nc"]
    (told,) = interrupted(tmp_path, *arguments, after=2)
    kept = files(tmp_path)
    number, rest = told.removeprefix("coilarray: ").split(" ", 1)
    assert rest == f"boards are kept in {tmp_path / 'cache'}; the same command goes on from there"
    assert all(name.startswith("cache/") for name in kept)
    assert len(kept) >= int(number) - 1  # the nominal board may be one of the drawn ones
    for name in kept:
        assert {"values", "reason"} & set(json.loads((tmp_path / name).read_text()))


def test_an_interrupted_search_keeps_whole_trials(tmp_path):
    arguments = ["optimize", "starter", "worst_k", "--trials", "100", "--workers", "1", "--out", "o"]
    (told,) = interrupted(tmp_path, *arguments, after=2)
    assert told.endswith(" points are kept in o; the same command goes on from there")
    number = int(told.removeprefix("coilarray: ").split(" ", 1)[0])
    with closing(sqlite3.connect(tmp_path / "o" / "study.db")) as study:
        states = [state for (state,) in study.execute("SELECT state FROM trials")]
    assert states == ["COMPLETE"] * len(states)
    assert number - 1 <= len(states) <= number + 1
