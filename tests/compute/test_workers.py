"""Pools in this process and in local processes: the same outcomes, lost processes, interrupts, and no leftovers.

The numbers of designs are in `tests/studies/test_points.py`, all of the same on a Dask cluster in `test_cluster.py`.
"""

import os
import pickle
import signal
import subprocess
import sys
import time
from contextlib import closing, nullcontext, suppress
from pathlib import Path

import pytest
from support import worker_tasks as tasks
from support.patience import PATIENCE, alive, lasting, until

from coilarray.compute.workers import IN_FLIGHT, default_count, workers
from coilarray.compute.workers.pool import InProcess
from coilarray.compute.workers.processes import LocalPool
from coilarray.errors import ClusterError, MissingDependencyError

LONG = 120.0  # s: nothing that sleeps so long is ever waited for


@pytest.fixture(scope="module")
def local():
    """Two processes for many tests, which must leave them usable."""
    with closing(LocalPool(2)) as pool:
        yield pool


@pytest.fixture(params=["this process", "local processes"])
def pool(request, local):
    return InProcess() if request.param == "this process" else local


def wait_until_gone(pids):
    until(lambda: not any(map(alive, pids)))


@pytest.mark.slow
def test_every_item_has_its_outcome_once(pool):
    outcomes = list(pool.run(tasks.square, range(23)))
    assert sorted(outcomes) == [(k, k * k) for k in range(23)]
    assert list(pool.run(tasks.square, [])) == []


def test_what_is_refused_is_one_line_and_the_others_go_on(pool):
    outcomes = dict(pool.run(tasks.refuse_odd, range(6)))
    assert outcomes == {k: f"{k} is odd." if k % 2 else {"half": k / 2} for k in range(6)}


def test_any_other_error_is_raised(pool):
    with pytest.raises(ZeroDivisionError, match="division by zero") as caught:
        list(pool.run(tasks.divide, [1, 2, 0, 3, 4]))
    if isinstance(pool, LocalPool):
        assert "worker_tasks.py" in str(caught.value.__cause__)  # where it was raised
    with pytest.raises(MissingDependencyError, match=r"^install it\."):  # of no use to repeat for every item
        list(pool.run(tasks.lack, range(3)))
    with pytest.raises(IndexError):
        pool.collect()
    assert sorted(pool.run(tasks.square, [5])) == [(0, 25)]


def test_what_cannot_travel_is_an_error_at_once(local):
    with pytest.raises(RuntimeError, match="UnportableError: 7"):  # told as text
        list(local.run(tasks.raise_unportable, [7]))
    with pytest.raises((AttributeError, pickle.PicklingError)):  # other processes cannot find the function
        list(local.run(lambda x: x, [1]))
    assert sorted(local.run(tasks.square, [3])) == [(0, 9)]


def test_items_are_read_as_there_is_room(pool):
    read = []

    def items():
        for k in range(12):
            read.append(k)
            yield k

    for done, _ in enumerate(pool.run(tasks.square, items()), start=1):
        assert len(read) - (done - 1) <= pool.capacity
    assert pool.capacity == (1 if isinstance(pool, InProcess) else 2 * IN_FLIGHT)


def test_this_process_keeps_the_order_so_that_an_item_may_depend_on_earlier_outcomes():
    found = [2]
    with workers() as pool:
        assert [index for index, _ in pool.run(tasks.square, range(9))] == list(range(9))
        for _, outcome in pool.run(tasks.square, (found[-1] for _ in range(4))):
            found.append(outcome)
    assert found == [2, 4, 16, 256, 65536]


def test_a_run_that_is_left_does_not_mix_with_the_next(pool):
    for _ in pool.run(tasks.square, range(100, 110)):
        break
    assert pool.in_flight == 0
    assert sorted(pool.run(tasks.square, range(7))) == [(k, k * k) for k in range(7)]


def test_every_worker_computes_with_one_thread(pool, monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "5")
    with workers() if isinstance(pool, InProcess) else nullcontext(pool) as one:
        ((_, (counts, ours, cores)),) = one.run(tasks.threads, [0])
    assert (set(counts), ours, cores) == ({1}, "1", 1)
    assert os.environ["COILARRAY_THREADS"] == "5"  # as it was


@pytest.mark.slow
def test_both_processes_take_part_and_no_more_are_started_than_there_are_tasks(tmp_path):
    with closing(LocalPool(4)) as pool:
        assert len({pid for _, pid in pool.run(tasks.nap, [0.0])}) == 1
        assert len(pool._workers) == 1
        both = {pid for _, pid in pool.run(tasks.meet, [(tmp_path, 2)] * 2)}
        assert len(both) == len(pool._workers) == 2
    assert os.getpid() not in both
    wait_until_gone(both)


@pytest.mark.slow
def test_a_process_that_is_lost_costs_only_time(local, tmp_path):
    """At its task, while it sends a result, and idle."""
    items = [(k, str(tmp_path / str(k)) if k in (2, 3, 7) else None) for k in range(10)]
    assert sorted(local.run(tasks.die_once, items)) == [(k, k) for k in range(10)]
    assert list(local.run(tasks.die_while_sending, [tmp_path / "marker"])) == [(0, bytes(1_000_000))]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["2", "3", "7", "marker"]
    for pid in {pid for _, pid in local.run(tasks.nap, [0.2] * 4)}:
        os.kill(pid, signal.SIGKILL)
    assert sorted(local.run(tasks.square, range(4))) == [(k, k * k) for k in range(4)]


@pytest.mark.slow
def test_a_task_that_ends_every_process_ends_the_run(local):
    with pytest.raises(ClusterError, match=r"during the same task, with exit code -9; is there enough memory\?$"):
        list(local.run(tasks.die, [1]))
    assert sorted(local.run(tasks.square, [2])) == [(0, 4)]


@pytest.mark.slow
@pytest.mark.parametrize("error", [None, KeyError])
def test_processes_end_with_the_block_whatever_they_do(error, tmp_path):
    # the naps are longer; a closed connection ends them in milliseconds
    with lasting(LONG / 2), suppress(KeyError), workers(2) as pool:
        pids = {pid for _, pid in pool.run(tasks.meet, [(tmp_path, 2)] * 2)}
        pool.submit(0, tasks.nap, LONG)
        pool.submit(1, tasks.nap, LONG)
        time.sleep(0.1)
        if error is not None:
            raise error
    assert len(pids) == 2
    wait_until_gone(pids)


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
SCRIPT = """
import sys
from support import worker_tasks as tasks
from coilarray.compute.workers import workers
with workers(2) as pool:
    print(*{pid for _, pid in pool.run(tasks.meet, [(sys.argv[1], 2)] * 2)}, flush=True)
    list(pool.run(tasks.nap, [120.0] * 4))
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
    assert last.startswith("coilarray.errors.ClusterError: a local process ended 3 times during the same task")
    assert last.endswith('a script must ask for workers under if __name__ == "__main__".')


@pytest.mark.parametrize("count", [0, -1, 1025, 2.0, True, None])
def test_the_number_of_workers_must_be_allowed(count):
    with pytest.raises(ClusterError, match=r"number of workers must be 1 to 1024; got "), workers(count):
        pass


def test_by_default_there_is_one_a_core(monkeypatch):
    monkeypatch.delenv("COILARRAY_THREADS", raising=False)
    assert 1 <= default_count() <= (os.cpu_count() or 1)
