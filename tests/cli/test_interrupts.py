"""Ctrl-C in the middle of long commands: exit code 130, one line, soon, and nothing half-written."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from support.command_line import runner
from support.patience import PATIENCE, computed, until

from coilarray.design.bundled import read

pytestmark = [
    pytest.mark.usefixtures("own_folder"),
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are watched by /proc"),
]
# a computation in C of a minute, which lets other threads run and does not look for signals
BUSY = "import hashlib; hashlib.pbkdf2_hmac('sha256', b'', b'', 100_000_000)"
run, _ = runner()


def interrupted(*command, after):
    """Start a program, send Ctrl-C to it and its children when it has computed for some s, and return what it said."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "COILARRAY_CACHE": "cache"}
    process = subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment,
        start_new_session=True,
    )  # fmt: skip
    until(lambda: process.poll() is not None or computed(process.pid) > after)
    assert process.poll() is None, process.communicate()
    start = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE)
    return process.returncode, out, err, time.monotonic() - start


@pytest.mark.slow
@pytest.mark.parametrize(
    ("after", "command"),  # the package is loaded after about one second
    [
        (1.2, "check large.toml"),
        (2.0, "report gast2020 --out folder"),
        (2.0, "response gast2020 --x-mm=-40:40:400 --depth-mm 0.1:1:20 --out r.nc"),
    ],
)
def test_a_long_command_is_interrupted(after, command):
    large = read("starter")
    # 6000 coils far apart: work for several seconds, which is not over before the signal comes from a starved test
    for old, new in (
        ('lattice = "linear"', 'lattice = "square"'),
        ("columns = 3", "columns = 1000"),
        ("# rows = 1 ", "rows = 6 "),
        ("pitch_mm = 11.0", "pitch_mm = 25.0"),
    ):
        assert large.count(old) == 1
        large = large.replace(old, new)
    Path("large.toml").write_text(large, encoding="utf-8")
    code, out, err, seconds = interrupted("-m", "coilarray", *command.split(), after=after)
    assert (code, out) == (130, "")
    assert err.splitlines()[-1] == "coilarray: interrupted"
    assert "Traceback" not in err
    assert seconds < 20  # it takes about one where nobody else computes
    # finished parts of a map are kept, from which the same command goes on
    folders = {path.parts[0] for path in Path().rglob("*") if path.is_file()}
    assert folders <= {"large.toml", "cache", "r.nc.parts"}
    assert not [path for path in Path("r.nc.parts").rglob(".*") if path.is_file()]


@pytest.mark.slow
def test_a_computation_that_does_not_return_to_python_is_ended():
    script = f"from coilarray.cli.main import ending_on_interrupt\nwith ending_on_interrupt():\n    {BUSY}"
    code, _, err, _ = interrupted("-c", script, after=0.5)
    assert (code, err) == (130, "coilarray: interrupted\n")


def test_an_interrupt_while_the_program_loads_is_one_line():
    script = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "coilarray.cli.main":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
from coilarray.__main__ import start
start()
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True, env=environment)
    assert (ended.returncode, ended.stderr) == (130, "coilarray: interrupted\n")


@pytest.mark.slow
def test_a_program_that_ends_while_processes_start_leaves_no_word():
    """The semaphores that it shares are cleared by a process of Python's, whose warning nobody can act on."""
    script = "import os; from coilarray.compute.workers import _Processes; held = _Processes(2); os._exit(130)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True, env=environment)
    assert (ended.returncode, ended.stderr) == (130, "")


def test_an_interrupt_is_raised_as_usual_where_python_runs():
    from coilarray.cli.main import ending_on_interrupt

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), ending_on_interrupt():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    assert signal.set_wakeup_fd(-1) == -1


@pytest.mark.parametrize("error", [ValueError("of a library"), KeyboardInterrupt()])
def test_an_error_that_a_library_makes_of_an_interrupt_is_one(monkeypatch, capsys, error):
    from coilarray.cli import main

    def interrupted_program(*arguments, **options):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise error

    monkeypatch.setattr(main, "program", lambda name: interrupted_program)
    with main.ending_on_interrupt():
        assert main.main(["check"]) == 130
    assert capsys.readouterr().err == "coilarray: interrupted\n"
    assert not main._heard.is_set()


def test_an_interrupt_while_a_process_starts_comes_after_that():
    from coilarray.compute.workers import starting

    done = []

    def start():
        with starting():
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.01)
            done.append("started")

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        start()
    assert done == ["started"]
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("error", "code"),
    [(MemoryError(), 2), (ImportError("x.so: failed to map segment from shared object"), 2), (OSError(12, "no"), 2)],
)
def test_lack_of_memory_is_one_line(monkeypatch, capsys, error, code):
    from coilarray.cli import main

    def program(*arguments, **options):
        raise error

    monkeypatch.setattr(main, "program", lambda name: program)
    assert main.main(["impedance"]) == code
    assert capsys.readouterr().err == "coilarray: error: there is not enough memory for coilarray impedance.\n"
    monkeypatch.setattr(main, "own_limit", lambda: 3e8)
    assert main.main(["impedance"]) == 2
    line = "coilarray: error: coilarray impedance needs 0.6 GB of address space; 0.30 GB are left (ulimit -v).\n"
    assert capsys.readouterr().err == line
