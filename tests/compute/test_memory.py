"""How much memory there is, by made-up systems, and that large arrays are refused before they are made."""

import os
import subprocess
import sys

import numpy as np
import pytest

import coilarray.compute.memory as memory
from coilarray import inductance_matrix, load_design, magnetic_field, mutual_inductance
from coilarray.circuit.coupling import design_circuit
from coilarray.cli.main import main
from coilarray.compute.memory import allowed_memory, available_memory, require_memory
from coilarray.electromagnetics.field import grid_points, vector_potential
from coilarray.errors import CoilarrayError, MemoryLimitError
from coilarray.geometry import Conductor

MEMINFO = "MemTotal:       16000000 kB\nMemFree:         1000000 kB\nMemAvailable:    8000000 kB\n"


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Write files of /proc and /sys/fs/cgroup; none of them is there before."""
    monkeypatch.delenv(memory.LIMIT_VARIABLE, raising=False)
    monkeypatch.setattr(memory, "_PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "_CGROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "own_limit", lambda: float("inf"))  # a shell may have set one

    def write(**files):
        for name, text in files.items():
            path = tmp_path / name.replace("__", "/").replace("_dot_", ".")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(str(text))

    return write


def test_a_machine_without_limits(system):
    """One that says nothing has what it has."""
    assert available_memory() == os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    system(proc__meminfo=MEMINFO)
    assert available_memory() == 8_000_000 * 1024
    assert allowed_memory() == 0.75 * 8_000_000 * 1024


def test_control_groups_of_version_2(system):
    system(proc__meminfo=MEMINFO, proc__self__cgroup="0::/batch/job\n")
    system(cgroup__batch__job__memory_dot_max="max\n", cgroup__batch__job__memory_dot_current=500)
    assert available_memory() == 8_000_000 * 1024
    system(cgroup__batch__memory_dot_max=4_000_000_000, cgroup__batch__memory_dot_current=1_000_000_000)
    assert available_memory() == 3_000_000_000
    # pages of files that nobody looks at can be given up
    system(cgroup__batch__memory_dot_stat="anon 5\ninactive_file 600000000\n")
    assert available_memory() == 3_600_000_000
    system(cgroup__memory_dot_max=2_000_000_000, cgroup__memory_dot_current=3_000_000_000)  # a container's own root
    assert available_memory() == 0


@pytest.mark.skipif(sys.platform != "linux", reason="the size of a process is from /proc")
def test_the_limit_of_the_process():
    code = (
        "import resource\nfrom coilarray.compute.memory import available_memory, _fields, own_limit, _PROC\n"
        "used = _fields(_PROC / 'self' / 'status')['VmSize'] * 1024\n"
        "resource.setrlimit(resource.RLIMIT_AS, (used + 300_000_000,) * 2)\n"
        "print(own_limit(), available_memory())"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    own, available = map(float, done.stdout.split())
    assert 200_000_000 < own <= 300_000_000
    assert available <= 300_000_000  # the machine itself may have less


def test_the_variable_goes_before_the_system(monkeypatch):
    monkeypatch.setenv(memory.LIMIT_VARIABLE, "2.5")
    assert allowed_memory() == 2.5e9
    require_memory(2.4e9, "this")
    for end in ([], ["take less"]):
        message = r"^this needs about 2\.6 GB of memory; 2\.5 GB are allowed" + "".join(f": {text}" for text in end)
        with pytest.raises(MemoryLimitError, match=message + r"\.$"):
            require_memory(2.6e9, "this", *end)
    with pytest.raises(MemoryLimitError, match="a map needs about nan GB"):
        require_memory(float("nan"), "a map")
    for wrong in ("much", "0", "-1", "nan", ""):
        monkeypatch.setenv(memory.LIMIT_VARIABLE, wrong)
        with pytest.raises(MemoryLimitError, match="COILARRAY_MEMORY_GB must be a positive number of GB; got"):
            allowed_memory()
    assert issubclass(MemoryLimitError, CoilarrayError)
    assert issubclass(MemoryLimitError, MemoryError)


@pytest.mark.slow
def test_fields_and_matrices_are_refused_before_anything_is_made():
    """Points of zero strides: 24 bytes stand for 1e13 points, and anything of their size ends in an error of NumPy."""
    many = np.broadcast_to(np.zeros(3), (10**13, 3))
    loop = Conductor([[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]], 1e-4, 35e-6)
    axis = np.zeros(10**5)
    for what, function in (
        ("the field at 10000000000000 points", magnetic_field),
        ("the field at 10000000000000 points", vector_potential),
        ("a grid of 1000000000000000 points", lambda *_: grid_points(axis, axis, axis)),
        ("the inductance matrix of 10000000 paths", lambda *_: inductance_matrix([loop] * 10**7)),
        ("the inductance matrix of 2000000 paths", lambda *_: mutual_inductance([loop] * 10**6, [loop] * 10**6)),
    ):
        message = rf"^{what} needs about .* GB of memory; .* GB are allowed: .*\.$"
        with pytest.raises(MemoryLimitError, match=message):
            function(loop, many)


TABLE = "--x-mm -20:20:1000 --y-mm -6:6:1000"


@pytest.mark.slow
@pytest.mark.parametrize(("command", "limit", "what"), [
    (f"response gast2020 --reach all {TABLE}", "0.5", "a map of 1 depths at 1000000 positions with 6 coils"),
    ("view gast2020 --spacing-mm 0.05 --out f.nc", "0.02", "a grid of 1231012 points"),
])  # fmt: skip
def test_commands_refuse_in_one_line_what_needs_too_much(command, limit, what, tmp_path, monkeypatch, capsys):
    design_circuit(load_design("gast2020"))  # is kept from now on: the capacitance would meet the limit before
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(memory.LIMIT_VARIABLE, limit)
    assert main(command.split()) == 2
    out, err = capsys.readouterr()
    (line,) = err.splitlines()
    assert line.startswith(f"coilarray: error: {what} needs about ")
    assert f" GB of memory; {float(limit):.3g} GB are allowed" in line
    assert out == ""
    assert not list(tmp_path.iterdir())
