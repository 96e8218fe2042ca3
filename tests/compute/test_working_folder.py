"""No process that the package starts executes a file of the working folder that has the name of a module.

The folder has a file for every module of Python and of the libraries; each writes down that it was executed.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.patience import PATIENCE

LIBRARIES = ("numpy", "scipy", "numba", "shapely", "xarray", "pydantic", "dask", "distributed", "optuna", "sqlalchemy")
POOL = """
from coilarray.compute.workers import open_executor, outcomes
from support.worker_tasks import square

if __name__ == "__main__":
    with open_executor(2) as executor:
        assert dict(outcomes(executor, square, range(3))) == {0: 0, 1: 1, 2: 4}
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
DRAWING = """
from coilarray.report.drawing import drawing_beside
from support.worker_tasks import square

if __name__ == "__main__":
    with drawing_beside() as drawing:
        assert drawing.submit(square, 3).result() == 9
"""


@pytest.mark.slow
@pytest.mark.parametrize("program", [POOL, JOB, DRAWING], ids=["pool", "job", "drawing"])
def test_files_that_are_called_as_modules_are_not_executed(tmp_path, program):
    folder, witness = tmp_path / "work", tmp_path / "witness"
    folder.mkdir()
    for name in (*sys.stdlib_module_names, *LIBRARIES):
        text = f"with open({str(witness)!r}, 'a') as file:\n    file.write({name!r})\nraise SystemExit(77)\n"
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    script = tmp_path / "program.py"
    script.write_text(program, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    environment["COILARRAY_THREADS"] = "2"  # with one core there is no process beside that draws
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, script], cwd=folder, env=environment, timeout=2 * PATIENCE,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert not witness.exists(), witness.read_text(encoding="utf-8")
