"""Speed and memory: ratios in one run, on the six coils of the bundled gast2020 board."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coilarray import inductance_matrix, load_design, magnetic_field
from coilarray.circuit.coupling import sweep_design
from coilarray.electromagnetics.field import vector_potential


@dataclass(frozen=True)
class Speed:
    """One figure; `note` compares it in the same run, `goal` and `kept` say what it should be and whether it is."""

    what: str
    value: float
    unit: str
    note: str = ""
    goal: str = ""
    kept: bool = True


def _median_time(call: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def _fresh(code: str, **environment: str) -> tuple[float, str]:
    """Wall time in s and output of a Python process of its own."""
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={**os.environ, **environment}
    )
    return time.perf_counter() - start, done.stdout.strip()


def peak_memory() -> float:
    """Peak memory of this process in MB; ru_maxrss may be that of the process that started it."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


_MEMORY = f"""
import sys
import numpy as np
sys.path.insert(0, {str(Path(__file__).parent)!r})
from speed import peak_memory
from coilarray import load_design, magnetic_field
array = load_design("gast2020").array
points = np.random.default_rng(0).uniform([-0.04, -0.012, 0.002], [0.04, 0.012, 0.01], (1_000_000, 3))
B = magnetic_field(array, points)
print(peak_memory())
"""

_LOADED = """
import importlib.util
from coilarray.cli import main
from coilarray.electromagnetics.kernels import bars, paths, sections, segments
from coilarray.report import page, write
if importlib.util.find_spec("pyvista"):
    from pyvista import plotting
"""


def _program(*arguments: str) -> str:
    """Return the code that runs the installed program with arguments."""
    return f"import sys; from coilarray.cli.main import run; sys.argv[1:] = {list(arguments)!r}; run()"


def not_installed(program: str) -> Speed | None:
    """Say that the figures against another program stay as they were kept; None."""
    print(f"{program} is not installed: its figures stay as they were", file=sys.stderr)
    return None


def measure() -> list[Speed | None]:
    """Take all figures; about a minute."""
    conductors = load_design("gast2020").array.conductors()
    segments = sum(len(conductor.lengths) for conductor in conductors)
    points = np.random.default_rng(0).uniform([-0.04, -0.012, 0.002], [0.04, 0.012, 0.01], (200_000, 3))
    magnetic_field(conductors, points[:10])
    vector_potential(conductors, points[:10])
    b_rate = segments * len(points) / _median_time(lambda: magnetic_field(conductors, points), 5) / 1e6
    a_rate = segments * len(points) / _median_time(lambda: vector_potential(conductors, points), 5) / 1e6
    figures: list[Speed | None] = []
    try:
        import magpylib
    except ImportError:
        figures.append(not_installed("magpylib"))
    else:
        peer = magpylib.Collection(
            *(magpylib.current.Polyline(vertices=conductor.vertices, current=1.0) for conductor in conductors)
        )
        few = points[:2000]
        difference = np.abs(peer.getB(few) - magnetic_field(conductors, few)).max() / np.abs(peer.getB(few)).max()
        peer_rate = segments * len(few) / _median_time(lambda: peer.getB(few), 5) / 1e6
        ratio = b_rate / peer_rate
        note = f"{ratio:.0f} × magpylib {magpylib.__version__}, which differs by {difference:.0e}"
        figures.append(Speed("B, exact segments", b_rate, "M pairs/s", note, "≥ 200 × magpylib", ratio >= 200))
    figures.append(Speed("A, exact segments", a_rate, "M pairs/s", "", "≥ 300 M pairs/s", a_rate >= 300))
    inductance_matrix(conductors)
    warm_matrix = _median_time(lambda: inductance_matrix(conductors), 7)
    figures.append(Speed("L matrix of six coils, warm", warm_matrix, "s", "", "≤ 0.05 s", warm_matrix <= 0.05))
    design = load_design("gast2020")
    sweep_design(design, [1e6, 2e6])
    sweep = _median_time(lambda: sweep_design(design, np.geomspace(1e5, 1e7, 50)), 3)
    figures.append(
        Speed("impedance of six coils at 50 frequencies, six states, warm", sweep, "s", "", "< 2 s", sweep < 2)
    )
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as out:
        # Python's own compiled files are there after an installation, as pip leaves them; no kernel is
        kept = {"NUMBA_CACHE_DIR": cache, "PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
        _fresh(_LOADED, **kept)
        report = _program("report", "--out", out)
        cold, _ = _fresh(report, **kept)
        warm, _ = _fresh(report, **kept)
        pad = str(Path(out) / "pad.toml")
        led, square = (
            _fresh(_program("init", pad, "--force", "--coils", "4x4", *choice), **kept)[0]
            for choice in (("--connector", "bottom"), ("--shape", "square"))
        )
    figures.append(Speed("coilarray report, first run with compilation", cold, "s", "", "≤ 12 s", cold <= 12))
    note = f"{cold / warm:.1f} × faster than the first"
    figures.append(Speed("coilarray report, kernels cached", warm, "s", note, "≤ 6 s", warm <= 6))
    figures.append(
        Speed("coilarray init, 4x4 coils routed to a connector, kernels cached", led, "s", "", "≤ 6 s", led <= 6)
    )
    figures.append(Speed("coilarray init, 4x4 square coils, kernels cached", square, "s", "", "≤ 4 s", square <= 4))
    _, peak = _fresh(_MEMORY)
    figures.append(
        Speed("peak memory, B of six coils at 1 000 000 points", float(peak), "MB", "", "< 500 MB", float(peak) < 500)
    )
    plain, _ = _fresh("import numpy, scipy, numba")
    ours, _ = _fresh("import coilarray")
    figures.append(Speed("import coilarray", ours, "s", f"numpy, scipy and numba alone: {plain:.2f} s"))
    return figures
