"""The tool that runs tests again and again: what it counts and names, and its exit code."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.patience import PATIENCE

TESTS = """
from pathlib import Path

def test_right():
    pass

def test_wrong_the_second_time():
    marker = Path(__file__).with_name("marker")
    assert not marker.exists()
    marker.touch()
"""


@pytest.mark.slow
def test_a_failure_of_one_run_is_counted_and_named(tmp_path):
    (tmp_path / "test_some.py").write_text(TESTS, encoding="utf-8")
    tool = [sys.executable, str(Path(__file__).with_name("repeat"))]
    done = subprocess.run(
        [*tool, "--runs", "2", "--busy", "1", "-p", "no:cacheprovider", "test_some.py"],
        cwd=tmp_path, env={"TMPDIR": str(tmp_path)}, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    first, second, name, kept, last = done.stdout.splitlines()
    assert re.fullmatch(r"run 1: 2 passed in \d+ s", first)
    assert re.fullmatch(
        r"run 2: 1 failed, 1 passed in \d+ s, beside 2 busy processes; pytest ended with exit code 1", second
    )
    assert name == "  test_some.py::test_wrong_the_second_time"
    assert "assert not marker.exists()" in Path(kept.strip()).read_text(encoding="utf-8")
    assert (last, done.returncode) == ("1 of 2 runs failed", 1)
