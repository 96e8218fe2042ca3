"""Several threads and processes at once, and an interrupt in the middle of every long command.

Threads and processes must give the numbers of one that is alone, to the last bit: every sum is cut in the same places.
An interrupt is raised where a command tells of its progress, which is within the work; what was there before must still
be there, what is kept must be whole, and the same command must go on from there to the result of a run without an
interrupt. `tests/cli/test_sweep.py` does the same by a signal to a process and its two workers,
`test_measure_broken_off` with a scan, `test_live` with a stream, `test_optimize_kill` and `test_recording_kill` with
signal 9.
"""

import csv
import io
import json
import os
import subprocess
import sys
import threading
import tomllib
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import xarray as xr
from support.load_work import digests, results
from threadpoolctl import threadpool_limits

from coilarray.cli.main import main
from coilarray.compute.threads import Recent
from coilarray.design.bundled import read
from coilarray.design.vary import vary_document
from coilarray.response.setup import _kept_contact
from coilarray.studies.optimize.run import read_studies

pytestmark = pytest.mark.slow

PATIENCE = 600.0  # s for what takes a few where nobody else computes
# two coils of four turns
SMALL = vary_document(
    tomllib.loads(read("starter")),
    {"coils.hexagon.turns_per_layer": 4, "array.columns": 2, "indentation.strain": "linear"},
)
ETCH = "schema = 1\nothers = 'none'\n[etch]\nboard_um = 5\nlayer_um = 5\n"
GOAL = """
schema = 1
title = "a search without the local solver"
variable = [{ entry = "array.pitch_mm", low = 10.5, high = 14.0 }]
objective = [{ quantity = "worst_k", direction = "minimize" }]
search = { sampler = "random", seed = 1, polish = 0 }
"""


@pytest.fixture(scope="module", autouse=True)
def _threads():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COILARRAY_THREADS", "2")
        yield


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


def started(code, folder, **environment):
    """A process that runs some code, with one more folder to import from."""
    path = os.pathsep.join((str(folder), os.environ.get("PYTHONPATH", "")))
    environment = {**os.environ, **environment, "PYTHONPATH": path}
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)


def test_another_process_with_more_threads_gives_the_same(alone):
    code = "import json; from support.load_work import digests, results; print(json.dumps(digests(results())))"
    # not even the number of threads changes a bit
    running = started(code, Path(__file__).parents[1], OPENBLAS_NUM_THREADS="2", COILARRAY_THREADS="3")
    output = running.communicate(timeout=PATIENCE)[0]
    assert (running.returncode, json.loads(output)) == (0, alone)


KERNEL = """
from coilarray.electromagnetics.kernels import kernel

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

    running = [started(code, tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")) for _ in range(2)]
    (output,) = {process.communicate(timeout=PATIENCE)[0] for process in running}
    assert any((tmp_path / "cache").rglob("*.nbc"))
    assert float.fromhex(output) == pytest.approx(np.sqrt(np.arange(9.0)).sum(), rel=1e-12)


def _interrupt(*_):
    raise KeyboardInterrupt


def interrupted(folder, command, after=1, writing=False):
    """Run a command here until it has told so much progress, or writes a file, and return its lines on standard error.

    A real signal raises the same error in the same thread (tests/cli/test_sweep.py).
    """

    def tell(done, total, *_):
        if done >= after and not writing:
            assert done < total, "over before the interrupt"
            raise KeyboardInterrupt

    @contextmanager
    def telling(*_):
        yield tell

    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err), chdir(folder):
        patch.setenv("COILARRAY_CACHE", str(folder / "cache"))
        # one tells of every block; with several the first word may be the last
        patch.setenv("COILARRAY_THREADS", "1")
        for module in [one for name, one in sys.modules.items() if name.startswith("coilarray.cli.")]:
            for bar in ("progress_bar", "_progress"):
                if hasattr(module, bar):
                    patch.setattr(module, bar, telling)
        if writing:  # the file is complete but has not got its name; so is the folder when its nets are checked
            patch.setattr(Path, "replace", _interrupt)
            patch.setattr("coilarray.design.export._net_faults", _interrupt)
        assert main(command.split()) == 130, err.getvalue()
    assert "wrote" not in out.getvalue()
    *lines, last = err.getvalue().splitlines()
    assert last == "coilarray: interrupted"
    return lines


def files(folder):
    """Names of all files in a folder, hidden ones of unfinished writing included."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def write_inputs(folder):
    """Write the designs and settings that the commands read, and return their names."""
    flat = {key: value for key, value in SMALL.items() if key not in ("indenter", "indentation")}  # a short report
    texts = {"small.toml": tomli_w.dumps(SMALL), "flat.toml": tomli_w.dumps(flat), "etch.toml": ETCH, "goal.toml": GOAL}
    for name, text in texts.items():
        (folder / name).write_text(text)
    return list(texts)


@pytest.mark.parametrize(("command", "targets", "writing"), [
    ("view flat.toml --z-mm 1:4 --spacing-mm 0.25 --out f.nc", "f.nc", False),
    ("impedance small.toml --points 2 --out i.csv", "i.csv", True),
    ("export small.toml --to gerber --out g.zip --force", "g.zip", True),
    ("export small.toml --to kicad --out k --force", "k/starter.kicad_pcb", True),
])  # fmt: skip
def test_what_keeps_nothing_leaves_everything_as_it_was(tmp_path, command, targets, writing):
    inputs, targets = write_inputs(tmp_path), targets.split()
    for target in targets:
        path = tmp_path / target
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("before")
    assert interrupted(tmp_path, command, writing=writing) == []
    # the contact that was solved before is kept, whole
    assert [name for name in files(tmp_path) if not name.startswith("cache/")] == sorted([*inputs, *targets])
    assert {(tmp_path / target).read_text() for target in targets} == {"before"}


def numbers_of(path):
    """Arrays of a dataset, or the columns of a table, by name."""
    if path.suffix == ".nc":
        with xr.open_dataset(path, engine="h5netcdf") as result:
            return {str(name): one.values for name, one in result.load().data_vars.items()}
    rows = list(csv.DictReader(path.read_text().splitlines()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def whole_points(folder, told, what="of 5 points"):
    (line,) = told
    number, rest = line.removeprefix("coilarray: ").split(" ", 1)
    assert rest == f"{what} are kept in {folder / 'cache'}; the same command continues from there"
    kept = [path for path in (folder / "cache").rglob("*.*") if path.suffix != ".nc"]  # matrices
    assert len(kept) >= int(number) - 1  # the nominal board may be one of the drawn ones
    assert all({"values", "reason"} & set(json.JSONDecoder().raw_decode(path.read_text())[0]) for path in kept)


whole_boards = partial(whole_points, what="boards")


def whole_trials(folder, told):
    (line,) = told
    assert line.endswith(" points are kept in o; the same command continues from there")
    (points,) = read_studies(folder / "o").values()
    assert abs(int(line.removeprefix("coilarray: ").split(" ", 1)[0]) - len(points)) <= 1


@pytest.mark.parametrize(("command", "after", "check", "result"), [
    ("sweep small.toml --vary array.pitch_mm=12:16:5 -q worst_k --workers 1 -o s.nc", 2, whole_points, "s.nc"),
    ("tolerance small.toml etch.toml --samples 8 --workers 1 --out t.nc", 2, whole_boards, "t.nc"),
    ("optimize small.toml goal.toml --trials 5 --workers 1 --out o", 2, whole_trials, "o/trials.csv"),
])  # fmt: skip
def test_the_same_command_goes_on_to_the_same_result(tmp_path, monkeypatch, capsys, command, after, check, result):
    broken_off, whole = tmp_path / "broken_off", tmp_path / "whole"
    for folder in (broken_off, whole):
        folder.mkdir()
        write_inputs(folder)
    check(broken_off, interrupted(broken_off, command, after=after))
    assert result not in files(broken_off)
    found = []
    for folder in (broken_off, whole):
        monkeypatch.chdir(folder)
        monkeypatch.setenv("COILARRAY_CACHE", str(folder / "cache"))
        _kept_contact.cache_clear()  # what is in memory would not be kept in the second folder
        for kept in ("_KEPT", "_BOARDS"):
            monkeypatch.setattr(f"coilarray.circuit.board_circuit.{kept}", Recent(8))
        assert main(command.split()) == 0, capsys.readouterr().err
        found.append(numbers_of(folder / result))
    assert files(broken_off) == files(whole)
    assert set(found[0]) == set(found[1])
    for name, expected in found[1].items():
        if expected.dtype.kind in "fc":  # a worker has one thread, this process all cores: sums are cut elsewhere
            largest = np.abs(np.nan_to_num(expected)).max()  # amplitudes are missing where nothing is read
            np.testing.assert_allclose(found[0][name], expected, rtol=1e-9, atol=1e-9 * largest)
        else:
            assert found[0][name].tolist() == expected.tolist()
