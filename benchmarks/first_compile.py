"""What it takes to compile every kernel that the commands of a first session need, with nothing kept on disk."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from speed import Speed

# Times of the compiling thread: other threads and other programs do not count, nor does what a kernel's callees take.
# Python runs this as it starts, in every process of the commands: some kernels are compiled beside the others.
_LISTEN = """
import os, threading, time
import numba.core.event as event

class Times(event.Listener):
    running = threading.local()

    def on_start(self, happening):
        self.running.__dict__.setdefault("stack", []).append([time.thread_time(), 0.0])

    def on_end(self, happening):
        begun, inner = self.running.stack.pop()
        taken = time.thread_time() - begun
        kernel = happening.data["dispatcher"].py_func
        with open(os.environ["COMPILE_TIMES"], "a", encoding="utf-8") as kept:
            kept.write(f"{kernel.__module__.rpartition('.')[2]}.{kernel.__name__} {taken - inner}\\n")
        if self.running.stack:
            self.running.stack[-1][1] += taken

event.register("numba:compile", Times())
"""
_RUN = """
import contextlib, io
from coilarray.cli.main import main
for command in (
    ["report", "gast2020"],
    ["view", "gast2020", "--out", "field.nc"],
    ["impedance", "gast2020", "--points", "3"],
    ["sweep", "gast2020", "--vary", "array.pitch_mm=13:14:2", "--quantity", "worst_k", "--accuracy", "screen",
     "--workers", "1", "--cache", "cache"],
    ["response", "gast2020", "--depth-mm", "0.5,1", "--x-mm", "-20:20:5", "--y-mm", "-6:6:5", "--out", "map.nc"],
    ["locate", "--model", "map.nc", *(f"--coil=coil{k}" for k in (1, 2, 3)), "coil1=1e-4,coil2=5e-4,coil3=1e-4"],
):
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(command) == 0, command
"""
_SHOWN = 6


def figures() -> Iterator[Speed]:
    """Compile with a cache of its own."""
    with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as folder:
        times = Path(cache, "times.txt")
        Path(cache, "sitecustomize.py").write_text(_LISTEN, encoding="utf-8")
        path = os.pathsep.join(filter(None, [cache, os.environ.get("PYTHONPATH")]))
        given = {"NUMBA_CACHE_DIR": cache, "COMPILE_TIMES": str(times), "PYTHONPATH": path}
        subprocess.run([sys.executable, "-c", _RUN], check=True, cwd=folder, env={**os.environ, **given})
        own: defaultdict[str, float] = defaultdict(float)
        for line in times.read_text(encoding="utf-8").splitlines():
            name, taken = line.split()
            own[name] += float(taken)
    total = sum(own.values())
    most = sorted(own.items(), key=lambda item: -item[1])[:_SHOWN]
    note = f"{len(own)} kernels; " + ", ".join(f"{name} {taken:.1f} s" for name, taken in most)
    what = "first-ever compilation: report, field, impedance, sweep, response, locate"
    yield Speed(what, total, "s", note, "≤ 15 s", total <= 15)


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.value:.3g} {figure.unit} ({figure.note}) {figure.goal} {figure.kept}")
