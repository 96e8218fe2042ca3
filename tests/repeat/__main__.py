"""``python tests/repeat --runs 10 --busy 5``: the tests again and again, the last runs beside two busy processes.

Other arguments are for pytest; without any, all tests run on all cores. A run that failed leaves what pytest said in a
file, whose name is printed. The exit code is 1 if any run failed.
"""

import argparse
import functools
import re
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack

BESIDE = 2
"""Busy processes beside a run."""

ALL = ("-n", "auto", "--dist", "loadfile")


say = functools.partial(print, flush=True)


def run(arguments, busy):
    """Run pytest once; return its exit code, what it said, and the time in s."""
    with ExitStack() as others:
        for _ in range(BESIDE if busy else 0):
            other = others.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            others.callback(other.kill)
        start = time.monotonic()
        command = [sys.executable, "-m", "pytest", "-q", "-rfE", *arguments]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        return done.returncode, done.stdout, time.monotonic() - start


def main():
    """Run the tests as often as asked for, and print one line a run and one a test that failed."""
    parser = argparse.ArgumentParser(prog="python tests/repeat", usage="%(prog)s [options] [pytest arguments]")
    parser.add_argument("--runs", type=int, default=10, help="number of runs (default: 10)")
    parser.add_argument("--busy", type=int, default=5, help="number of last runs with company (default: 5)")
    given, arguments = parser.parse_known_args()
    if not 0 <= given.busy <= given.runs or given.runs < 1:
        parser.error("--runs must be at least 1, and --busy 0 to as many as there are runs")
    failed = 0
    for number in range(1, given.runs + 1):
        busy = number > given.runs - given.busy
        code, said, seconds = run(arguments or ALL, busy)
        counts = re.findall(r"\d+ (?:passed|failed|error|skipped)", (said.splitlines() or [""])[-1])
        beside = f", beside {BESIDE} busy processes" if busy else ""
        end = "" if code == 0 else f"; pytest ended with exit code {code}"
        say(f"run {number}: {', '.join(counts) or 'no test'} in {seconds:.0f} s{beside}{end}")
        for name in re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", said, re.MULTILINE):
            say(f"  {name}")
        if code != 0:
            failed += 1
            with tempfile.NamedTemporaryFile("w", prefix="repeat-", suffix=".txt", delete=False) as file:
                file.write(said)
            say(f"  {file.name}")
    say(f"{failed} of {given.runs} runs failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
