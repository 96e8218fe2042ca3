"""A real Dask scheduler with real worker processes on the loopback, started as a user starts them."""

import contextlib
import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from support import worker_tasks as tasks
from support.patience import until

from coilarray.cli.main import main
from coilarray.compute import workers
from coilarray.compute.store import code_version
from coilarray.compute.workers import dask_executor, outcomes
from coilarray.errors import ClusterError, MissingDependencyError

PATIENCE = 600.0  # s for what takes a few where nobody else computes
TESTS = Path(__file__).parents[1]


class Dask:
    """A scheduler on the loopback and its workers, one process or nanny each."""

    def __init__(self, folder, **environment):
        self.folder = folder
        self.environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join((str(TESTS), str(folder), os.environ.get("PYTHONPATH", ""))),
            "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",  # a task may end one worker, not two
            # workers that start again need not load Dask again
            "DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD": "forkserver" if os.name == "posix" else "spawn",
            **environment,
        }
        self.processes = []
        file = folder / "scheduler.json"
        # whatever becomes of this process, the scheduler ends when it is idle, and the workers after it
        self.scheduler = self._start(
            *("scheduler", "--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0"),
            *("--scheduler-file", str(file), "--idle-timeout", f"{3 * PATIENCE:g}s"),
        )
        self.address = until(
            lambda: file.exists() and json.loads(file.read_text() or "{}").get("address"), within=PATIENCE
        )

    def add_worker(self, *options):
        return self._start(
            *("worker", self.address, "--host", "127.0.0.1", "--nworkers", "1", "--nthreads", "1", "--no-dashboard"),
            *("--local-directory", str(self.folder), "--death-timeout", f"{PATIENCE:g}", *options),
        )

    def close(self):
        for process in reversed(self.processes):  # workers look for a scheduler that is gone
            process.terminate()
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _start(self, *arguments):
        log = self.folder / f"{arguments[0]}{len(self.processes)}.log"
        with log.open("w") as file:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments], env=self.environment, stdout=file, stderr=file
            )
        self.processes.append(process)
        return process


pytestmark = pytest.mark.slow

pytest.importorskip("distributed", reason="the extra [cluster] is not installed")


@pytest.fixture(scope="module", autouse=True)
def _patient():
    """A scheduler and workers may take long to start and to answer; `impatient` is for those that never do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers, "ANSWER_WITHIN", PATIENCE)
        patch.setattr(workers, "_ALONE", PATIENCE)
        yield


@pytest.fixture(scope="module")
def dask(tmp_path_factory):
    """A scheduler and two workers under nannies, which start them again."""
    import distributed

    folder = tmp_path_factory.mktemp("dask")
    with contextlib.closing(Dask(folder)) as running:
        for _ in range(2):
            running.add_worker()
        with distributed.Client(running.address, timeout=PATIENCE, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
        yield running


@pytest.fixture(scope="module")
def pool(dask):
    """One connection for many tests; two workers."""
    with dask_executor(dask.address) as remote:
        yield remote


@pytest.fixture
def impatient(monkeypatch):
    """As if ten seconds were one."""
    monkeypatch.setattr(workers, "ANSWER_WITHIN", 1.0)


def refused(address):
    """The line with which a cluster at an address is refused."""
    with pytest.raises((ClusterError, MissingDependencyError)) as caught, dask_executor(address):
        pass
    line = str(caught.value)
    assert len(line.splitlines()) == 1
    return line


def test_outcomes_are_those_of_any_pool(pool):
    assert sorted(outcomes(pool, tasks.square, range(9))) == [(k, k * k) for k in range(9)]
    assert dict(outcomes(pool, tasks.refuse_odd, range(4))) == {
        k: f"{k} is odd." if k % 2 else {"half": k / 2} for k in range(4)
    }
    with pytest.raises(ZeroDivisionError):
        list(outcomes(pool, tasks.divide, [1, 0]))
    assert sorted(outcomes(pool, tasks.square, [5])) == [(0, 25)]


def test_both_workers_take_part_with_one_thread_each(pool):
    pids = {pid for _, pid in outcomes(pool, tasks.nap, [0.3] * 6)}
    assert len(pids) == 2
    assert os.getpid() not in pids
    for _, (counts, ours, cores) in outcomes(pool, tasks.threads, range(4)):
        assert (set(counts), ours, cores) == ({1}, "1", 1)


def test_a_sweep_on_the_cluster_from_the_command_line(dask, tmp_path, capsys):
    def sweep(name, *where):
        arguments = ["--vary", "array.pitch_mm=12:14:3", "--vary", "array.columns=2", "--quantity", "worst_k"]
        kept = ["--accuracy", "screen", "--cache", str(tmp_path / name), "--out", str(tmp_path / f"{name}.csv")]
        assert main(["sweep", "starter", *arguments, *kept, *where]) == 0
        return capsys.readouterr()

    here, there = sweep("here", "--workers", "1"), sweep("there", "--cluster", dask.address)
    assert (tmp_path / "here.csv").read_bytes() == (tmp_path / "there.csv").read_bytes()
    assert (here.err, there.err) == ("", "")
    assert here.out.replace("here.csv", "there.csv") == there.out
    assert len(list((tmp_path / "there").rglob("*.json"))) == 3  # the cache is where the command runs


def test_a_worker_that_is_lost_costs_only_time_and_one_task_that_ends_all_the_run(pool, tmp_path):
    items = [(k, str(tmp_path / str(k)) if k == 3 else None) for k in range(8)]
    assert sorted(outcomes(pool, tasks.die_once, items)) == [(k, k) for k in range(8)]
    assert (tmp_path / "3").exists()
    with pytest.raises(ClusterError, match="a task ended several workers, one after another"):
        list(outcomes(pool, tasks.die, [1]))
    assert sorted(outcomes(pool, tasks.square, [2])) == [(0, 4)]  # by a worker that was started again


def test_a_run_that_is_left_does_not_mix_with_the_next(pool):
    for _ in outcomes(pool, tasks.nap, [0.2] * 8):
        break
    assert sorted(outcomes(pool, tasks.square, range(5))) == [(k, k * k) for k in range(5)]


def test_another_version_of_coilarray_on_a_worker_is_refused(pool, monkeypatch):
    monkeypatch.setattr(workers, "code_version", lambda: "9.9.9+0")
    line = f"a worker has coilarray {code_version()}; here it is 9.9.9+0: install the same on all machines."
    with pytest.raises(ClusterError, match=re.escape(line)):
        list(outcomes(pool, tasks.square, [1]))


def test_where_nothing_answers_there_is_one_line(impatient, capfd, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # no listen: refuses connections
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        arguments = ["--vary", "array.pitch_mm=12,13", "--quantity", "span_mm", "--cache", str(tmp_path)]
        assert main(["sweep", "--cluster", address, "--out", str(tmp_path / "s.nc"), *arguments]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err == f"coilarray: error: no Dask scheduler answers at {address} within 1 s.\n"
    assert not (tmp_path / "s.nc").exists()


def test_the_address_must_have_its_form():
    for address in ("", "host:8786", "http://host:8786", "tcp://host", "tcp://:1", "tcp://host:0", "tcp://h:x"):
        assert refused(address) == f"the address of a cluster must be tcp://HOST:PORT; got {address!r}."


def test_without_the_package_one_line_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert refused("tcp://127.0.0.1:8786").startswith("Dask clusters need distributed, which is not installed: ")


def test_workers_and_scheduler_that_are_lost_end_the_run(tmp_path, monkeypatch, impatient, capfd):
    """No worker at first, then one that is killed, then the scheduler is."""
    monkeypatch.setattr(workers, "_ALONE", 1.0)
    with contextlib.closing(Dask(tmp_path)) as own:

        def no_worker():
            line = refused(own.address)
            return line if "has no worker" in line else None

        # in a second in which the scheduler was stopped it does not answer at all
        line = until(no_worker, within=PATIENCE)
        assert line == f"the Dask scheduler at {own.address} has no worker; start one: dask worker {own.address}"
        monkeypatch.setattr(workers, "ANSWER_WITHIN", PATIENCE)
        worker = own.add_worker("--no-nanny")
        with dask_executor(own.address) as pool:
            assert sorted(outcomes(pool, tasks.square, [3])) == [(0, 9)]
            running = outcomes(pool, tasks.nap, [0.0, *[PATIENCE] * 3])
            assert next(running)[0] == 0
            worker.kill()
            lost = r"all workers of the cluster are lost, and none came back within 1 s\."
            with pytest.raises(ClusterError, match=lost):
                next(running)
            own.scheduler.kill()
            with pytest.raises(ClusterError, match="Dask scheduler is lost"):
                list(outcomes(pool, tasks.square, [3]))
    assert all(process.poll() is not None for process in own.processes)
    assert capfd.readouterr() == ("", "")  # Dask's own log stays off the terminal
