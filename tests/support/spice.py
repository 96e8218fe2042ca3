"""Circuits that ngspice solves."""

import re
import shutil
import subprocess

import numpy as np
import pytest

needs_ngspice = pytest.mark.skipif(not shutil.which("ngspice"), reason="ngspice is not installed (Debian: ngspice)")


def run_bench(folder, lines, control):
    """Run commands of ngspice on a bench in a folder, where its files are then."""
    bench = ["* bench", *lines, ".control", "set numdgt=16", *control, ".endc", ".end", ""]
    (folder / "bench.cir").write_text("\n".join(bench), encoding="utf-8")
    about = {"cwd": folder, "capture_output": True, "text": True, "timeout": 60}
    run = subprocess.run(["ngspice", "-b", "bench.cir"], **about, check=False)
    log = run.stdout + run.stderr
    assert not re.search("error|singular", log, re.IGNORECASE), log


def run_ngspice(folder, subcircuit, lines, output, frequencies):
    """What ngspice finds for an output of a subcircuit on a bench at each frequency."""
    (folder / "array.cir").write_text(subcircuit, encoding="utf-8")
    runs = [f"ac lin 1 {f!r} {f!r}\nwrdata z{k}.txt {output}" for k, f in enumerate(frequencies)]
    run_bench(folder, [".include array.cir", *lines], runs)
    rows = [np.loadtxt(folder / f"z{k}.txt") for k in range(len(frequencies))]
    assert [row[0] for row in rows] == pytest.approx(frequencies, rel=1e-14)
    return np.array([complex(row[1], row[2]) for row in rows])
