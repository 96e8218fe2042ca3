"""A run that is killed with signal 9, in the search and in the local solver, and taken up again: the same trials."""

import json
import os
import runpy
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

SCRIPT = '''
import json, sys, time
from coilarray import load_design
from coilarray.compute import store
from coilarray.studies.optimize import optimize_with, parse_goal

store.code_version = lambda: "the same"  # a working copy may be edited while this runs

GOAL = """
schema = 1
variable = [
  { entry = "array.pitch_mm", low = 10, high = 16 },
  { entry = "elastomer.0.thickness_mm", low = 2, high = 20 },
]
objective = [{ quantity = "worst_k", direction = "minimize" }]
constraint = [{ quantity = "span_mm", at_least = 12.9 }]
search = { trials = 12, batch = 4, polish = 12 }
"""

def run(folder, seconds, most=100):
    points = []

    def evaluate(changes, accuracy):
        for index, change in enumerate(changes):
            points.append(index)
            if len(points) > most:
                time.sleep(600)  # however late the kill comes, the run is not over
            pitch, base = change.get("array.pitch_mm", 13.28), change.get("elastomer.0.thickness_mm", 6.0)
            time.sleep(seconds)
            print("point", flush=True)
            yield index, {"worst_k": (pitch - 12.3) ** 2 + (base - 5.0) ** 2, "span_mm": pitch}

    result = optimize_with(load_design("gast2020"), parse_goal(GOAL), folder, evaluate)
    return [[trial.name, dict(trial.changes), list(trial.scores)] for trial in result.trials], result.found

if __name__ == "__main__":
    run(sys.argv[1], 0.05, int(sys.argv[2]))
'''


@pytest.mark.skipif(os.name != "posix", reason="signal 9 is for POSIX systems")
def test_killed_and_resumed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("coilarray.compute.store.code_version", lambda: "put back after the script has set it")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    run = runpy.run_path(str(script))["run"]
    whole, _ = run(tmp_path / "whole", 0.0)
    evaluated = 0
    for points in (7, 9):  # of each run, the start included: in the second batch; in the local solver
        command = [sys.executable, str(script), str(tmp_path / "killed"), str(points + 2)]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
            for _ in range(points):
                assert process.stdout.readline() == "point\n"
            process.kill()
            assert process.wait() == -9
            evaluated += points + process.stdout.read().count("point\n") - 1
    capsys.readouterr()
    resumed, found = run(tmp_path / "killed", 0.0)
    last = capsys.readouterr().out.count("point") - 1
    assert json.dumps(resumed) == json.dumps(whole)  # to the last bit
    # a point is lost only where the kill came between its evaluation and its record, once a kill at most
    assert evaluated + last <= len(whole) - 1 + 2
    assert evaluated - 2 <= found - 1 <= evaluated
    assert found > 12  # the second kill was in the local solver
