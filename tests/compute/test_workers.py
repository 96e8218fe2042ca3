"""Executors of this process, of local processes and of a user: the same outcomes, lost processes, interrupts."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from multiprocessing import get_context
from pathlib import Path

import pytest
from support import worker_tasks as tasks
from support.patience import PATIENCE, alive, lasting, until

from coilarray.compute.workers import open_executor, outcomes
from coilarray.errors import ClusterError, MissingDependencyError

LONG = 120.0  # s: nothing that sleeps so long is ever waited for


@pytest.fixture(scope="module", params=["this process", "processes", "a user's threads", "a user's processes"])
def executor(request, tmp_path_factory):
    match request.param:
        case "this process":
            given = 1
        case "processes":
            given = 2
        case "a user's threads":
            given = ThreadPoolExecutor(2)
        case _:
            given = ProcessPoolExecutor(2, mp_context=get_context("spawn"))
    with ExitStack() as stack:
        opened = stack.enter_context(open_executor(given))
        yield opened
        # local processes end with the block, whatever they do
        pids = both_busy(opened, tmp_path_factory.mktemp("meeting")) if given == 2 else ()
        with lasting(LONG / 2):
            stack.close()
        wait_until_gone(pids)


def both_busy(executor, folder):
    """Let two processes sleep; return them."""
    pids = {pid for _, pid in outcomes(executor, tasks.meet, [(folder, 2)] * 2)}
    assert len(pids - {os.getpid()}) == 2
    for _ in pids:
        executor.submit(tasks.nap, LONG)
    return pids


def wait_until_gone(pids):
    until(lambda: not any(map(alive, pids)))


@pytest.mark.slow
def test_every_item_has_its_outcome_and_any_other_error_is_raised(executor):
    assert sorted(outcomes(executor, tasks.square, range(23))) == [(k, k * k) for k in range(23)]
    assert list(outcomes(executor, tasks.square, [])) == []
    halves = {k: f"{k} is odd." if k % 2 else {"half": k / 2} for k in range(6)}
    assert dict(outcomes(executor, tasks.refuse_odd, range(6))) == halves
    with pytest.raises(ZeroDivisionError, match="division by zero"):
        list(outcomes(executor, tasks.divide, [1, 2, 0, 3, 4]))
    with pytest.raises(MissingDependencyError, match=r"^install it\."):  # of no use to repeat for every item
        list(outcomes(executor, tasks.lack, range(3)))
    assert sorted(outcomes(executor, tasks.square, [5])) == [(0, 25)]


@pytest.mark.slow
def test_items_are_read_as_there_is_room_and_a_run_that_is_left_does_not_mix_with_the_next(executor):
    read = []

    def items():
        for k in range(12):
            read.append(k)
            yield k

    for done, _ in enumerate(outcomes(executor, tasks.square, items()), start=1):
        assert len(read) - done < 4
    for _ in outcomes(executor, tasks.square, range(100, 110)):
        break
    assert sorted(outcomes(executor, tasks.square, range(7))) == [(k, k * k) for k in range(7)]


@pytest.mark.slow
def test_every_worker_computes_with_one_thread(executor):
    for _, (counts, ours, cores) in outcomes(executor, tasks.threads, range(4)):
        assert (set(counts), ours, cores) == ({1}, "1", 1)


def test_the_limit_of_threads_ends_with_the_block(monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "5")
    with open_executor():
        assert os.environ["COILARRAY_THREADS"] == "1"
    assert os.environ["COILARRAY_THREADS"] == "5"


@pytest.mark.slow
def test_a_process_that_is_lost_is_one_error():
    with (
        open_executor(2) as executor,
        pytest.raises(ClusterError, match=r"a worker process has ended; is there enough"),
    ):
        list(outcomes(executor, tasks.die, [1]))


@pytest.mark.slow
def test_processes_end_with_the_block_after_an_error_too(tmp_path):
    with lasting(LONG / 2), suppress(KeyError), open_executor(2) as executor:
        pids = both_busy(executor, tmp_path)
        raise KeyError
    wait_until_gone(pids)


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
SCRIPT = """
import sys
from support import worker_tasks as tasks
from coilarray.compute.workers import open_executor, outcomes
with open_executor(2) as executor:
    print(*{pid for _, pid in outcomes(executor, tasks.meet, [(sys.argv[1], 2)] * 2)}, flush=True)
    list(outcomes(executor, tasks.nap, [120.0] * 4))
"""


@pytest.fixture
def running(tmp_path):
    """A process of its own with two workers that are busy, in a process group of their own as in a terminal."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    with subprocess.Popen(command, env=ENVIRONMENT, start_new_session=True, **pipes) as process:
        pids = [int(pid) for pid in process.stdout.readline().split()]
        try:
            assert len(pids) == 2
            yield process, pids
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for processes in /proc")
def test_ctrl_c_ends_everything_with_the_traceback_of_this_process_alone(running):
    process, pids = running
    os.killpg(process.pid, signal.SIGINT)  # to all of the group, as a terminal does
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == -signal.SIGINT
    assert err.count("Traceback") == 1
    assert err.splitlines()[-1] == "KeyboardInterrupt"
    wait_until_gone(pids)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks for processes in /proc")
def test_workers_end_with_the_process_that_started_them_even_where_that_is_killed(running):
    process, pids = running
    process.kill()
    wait_until_gone(pids)


@pytest.mark.slow
def test_a_script_without_the_guard_is_told_of_it(tmp_path):
    script = tmp_path / "unguarded.py"
    script.write_text(SCRIPT, encoding="utf-8")
    command, pipes = [sys.executable, str(script), str(tmp_path)], {"capture_output": True, "text": True}
    done = subprocess.run(command, env=ENVIRONMENT, timeout=PATIENCE, check=False, **pipes)
    assert done.returncode == 1
    # Python's own resource tracker may have a word after it, as the processes were lost
    (last,) = [line for line in done.stderr.splitlines() if line.startswith("coilarray.errors.ClusterError")]
    assert last.endswith('A script must ask for workers under if __name__ == "__main__".')


@pytest.mark.parametrize("count", [0, -1, 1025, 2.0, True, None])
def test_the_number_of_workers_must_be_allowed(count):
    with pytest.raises(ClusterError, match=r"number of workers must be 1 to 1024; got "), open_executor(count):
        pass


LIBRARIES = ("numpy", "scipy", "numba", "shapely", "xarray", "pydantic", "dask", "distributed", "optuna", "sqlalchemy")
POOL = """
from coilarray.compute.workers import open_executor, outcomes
from support.worker_tasks import square

if __name__ == "__main__":
    with open_executor(2) as executor:
        assert dict(outcomes(executor, square, [3])) == {0: 9}
"""
JOB = """
import threading
from coilarray.viz.studio.job import Job
from support.worker_tasks import count_to

if __name__ == "__main__":
    ended = threading.Event()
    outcomes = []
    Job(count_to, 3, on_message=print, on_end=lambda outcome: (outcomes.append(outcome.result), ended.set()))
    ended.wait()
    assert outcomes == [9]
"""


@pytest.mark.slow
@pytest.mark.parametrize("program", [POOL, JOB], ids=["pool", "job"])
def test_files_that_are_called_as_modules_are_not_executed(tmp_path, program):
    """The process that draws: tests/report/test_drawing.py."""
    folder, witness = tmp_path / "work", tmp_path / "witness"
    folder.mkdir()
    for name in (*sys.stdlib_module_names, *LIBRARIES):
        text = f"with open({str(witness)!r}, 'a') as file:\n    file.write({name!r})\nraise SystemExit(77)\n"
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    script = tmp_path / "program.py"
    script.write_text(program, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, script], cwd=folder, env=environment, timeout=2 * PATIENCE,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert not witness.exists(), witness.read_text(encoding="utf-8")
