"""Output in encodings that lack characters, minus signs for programs, and names of files that are no UTF-8.

Each command runs in this process with streams of an encoding, as `coilarray.cli.main.run` prepares them; some run as
programs.
"""

import io
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.every_command import PICTURES, SLOW, WRITES, command_of, write_inputs
from support.made_up import made_up_distortion, made_up_ellipses

import coilarray.paper.distortion
import coilarray.studies.calibrate.calibration
from coilarray.cli.main import COMMANDS, main
from coilarray.cli.output import prepare_output, readable

ENCODINGS = ("cp1252", "ascii")
ODD = os.fsdecode(b"\xb5m-")
READS = [
    ("impedance", "starter", "--noise"),
    ("locate", "--model", "gast2020", "coil1=-1e-5,coil2=3.84e-4,coil3=7.14e-4,coil4=6.8e-5,coil5=-1.3e-5,coil6=-2e-6"),
    ("response", "two.toml", "--x-mm", "-6.64", "--y-mm", "0", "--depth-mm", "0.5", "--out", "r.csv"),
    ("calibrate", "gast2020", "published", "--unknown", "coils.hexagon.gap_mm=0.05:0.1", "--workers", "1"),
    ("board", "test", "two.toml", "--wiring", "wiring.toml"),
    ("board", "compare", "campaign.sqlite", "quick.nc"),
    ("report", "bare.toml"),
    ("keys", "pitch"),
]


def quickest():
    """One run of every command, most of which write a file."""
    found = {command_of(case): case for case in READS}
    for _, *case in reversed(WRITES):
        if case[-1] not in SLOW | PICTURES:
            found[command_of(case)] = tuple(case)
    return found.values()


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return folder


@pytest.fixture
def at_work(own_folder, inputs, monkeypatch):
    """A folder with all inputs, and stand-ins for what takes half a minute."""
    monkeypatch.setattr(coilarray.paper.distortion, "distortion", made_up_distortion)
    monkeypatch.setattr(coilarray.studies.calibrate.calibration, "evaluate_model", made_up_ellipses)
    shutil.copytree(inputs, own_folder, dirs_exist_ok=True)


class Terminal(io.TextIOWrapper):
    def isatty(self):
        return True


def run(monkeypatch, encoding, *arguments, stream=io.TextIOWrapper):
    """Run a command with streams of an encoding; return the exit code and the bytes of both."""
    with monkeypatch.context() as patch:
        both = [stream(io.BytesIO(), encoding=encoding) for _ in range(2)]
        patch.setattr(sys, "stdout", both[0])
        patch.setattr(sys, "stderr", both[1])
        prepare_output()
        code = main([str(argument) for argument in arguments])
        for one in both:
            one.flush()
        return code, *(one.buffer.getvalue() for one in both)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.lowest
def test_the_help_of_every_command(monkeypatch, command):
    code, expected, _ = run(monkeypatch, "utf-8", *command.split(), "--help")
    text = expected.decode()
    assert code == 0
    for encoding in ENCODINGS:
        found = run(monkeypatch, encoding, *command.split(), "--help")
        assert found == (0, readable(text, encoding).encode(encoding), b"")
        assert found[1].count(b"?") == text.count("?")


@pytest.mark.slow
@pytest.mark.usefixtures("at_work")
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("command", quickest(), ids=command_of)
def test_every_command(monkeypatch, command, encoding):
    code, out, err = run(monkeypatch, encoding, *command)
    assert code == (1 if command[0] == "optimize" else 0), err  # which finds nothing better
    assert "?" not in out.decode(encoding)
    assert "−" not in out.decode(encoding)
    for path in Path().rglob("*.csv"):  # numbers that float() of any program reads
        assert not re.search(r"(?m)(^|,)−", path.read_text(encoding="utf-8")), path


def test_every_command_is_looked_at():
    assert set(map(command_of, quickest())) | {"docs", "studio"} == set(COMMANDS)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("arguments", [("check", "δ.toml"), ("check", "starter", "--Ω"), ("−",), ("view", ODD), ("Ω")])
def test_error_lines(monkeypatch, arguments, encoding):
    code, out, err = run(monkeypatch, encoding, *arguments)
    assert (code, out, err.count(b"\n")) == (2, b"", 1)
    assert err.decode(encoding).startswith("coilarray: error: ")


def test_minus_signs_are_those_of_ascii_except_on_a_terminal(monkeypatch):
    _, piped, _ = run(monkeypatch, "utf-8", "impedance", "starter")
    rows = [line.split() for line in piped.decode().splitlines() if line.startswith("coil1 ")]
    assert min(float(number) for row in rows[:2] for number in row[1:]) < 0  # a coupling
    _, shown, _ = run(monkeypatch, "utf-8", "impedance", "starter", stream=Terminal)
    assert "−0." in shown.decode()


@pytest.mark.slow
@pytest.mark.usefixtures("at_work")
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize(
    "case", [case for _, *case in WRITES if case[-1] not in SLOW | PICTURES], ids=lambda case: f"{case[0]} {case[-1]}"
)
def test_names_that_are_no_utf_8_work_or_are_refused_in_one_line(monkeypatch, case):
    *command, last = case
    for name in [path for path in Path().iterdir() if path.name in command]:
        name.rename(ODD + name.name)
        command[command.index(name.name)] = ODD + name.name
    last = ODD + last if "." in last else last
    code, _, err = run(monkeypatch, "utf-8", *command, last)
    done = 1 if command[0] == "optimize" and last == "3" else 0  # which finds nothing better
    assert code == done or (code == 2 and err.count(b"\n") == 1), err


@pytest.mark.slow
@pytest.mark.usefixtures("at_work")
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    ("arguments", "code"),
    [("report bare.toml", 0), ("sweep starter --vary array.pitch_mm=11,12 --quantity worst_k --workers 2", 0),
     ("check δ.toml", 2), ("nonsense", 2)],
)  # fmt: skip
def test_programs(arguments, code, encoding):
    environment = {
        **os.environ,
        "PYTHONUTF8": "0",
        "PYTHONIOENCODING": encoding,
    }
    program = [sys.executable, "-c", "from coilarray.cli.main import run\nif __name__ == '__main__': run()"]
    done = subprocess.run([*program, *arguments.split()], capture_output=True, env=environment, check=False)
    assert (done.returncode, b"Traceback" in done.stderr) == (code, False), done.stderr
    said = (done.stdout or done.stderr).decode(encoding)
    assert said
    assert "\\u" not in said
