"""A Dask scheduler and its workers as processes on the loopback."""

import json
import os
import subprocess
import sys
from pathlib import Path

from support.patience import until

PATIENCE = 120.0  # s for what takes a few where nobody else computes
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
