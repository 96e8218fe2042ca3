"""Output in encodings that lack characters, minus signs for programs, and names of files that are no UTF-8."""

import io
import os
import re
import sys
from pathlib import Path

import pytest

from coilarray.cli import main
from coilarray.cli.main import COMMANDS

ENCODINGS = ("cp1252", "ascii")
ODD = os.fsdecode(b"\xb5m-")


class Terminal(io.TextIOWrapper):
    def isatty(self):
        return True


def run(monkeypatch, encoding, *arguments, stream=io.TextIOWrapper):
    """Run a command with streams of an encoding; return the exit code and the bytes of both."""
    with monkeypatch.context() as patch:
        both = [stream(io.BytesIO(), encoding=encoding) for _ in range(2)]
        patch.setattr(sys, "stdout", both[0])
        patch.setattr(sys, "stderr", both[1])
        for one in both:
            main._prepare(one)
        code = main.main([str(argument) for argument in arguments])
        for one in both:
            one.flush()
        return code, *(one.buffer.getvalue() for one in both)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.lowest
def test_the_help_of_every_command(monkeypatch, command):
    code, expected, _ = run(monkeypatch, "utf-8", *command.split(), "--help")
    assert code == 0
    for encoding in ENCODINGS:
        code, out, err = run(monkeypatch, encoding, *command.split(), "--help")
        assert (code, err) == (0, b"")
        assert out.decode(encoding).count("?") == expected.decode().count("?")


def test_what_an_encoding_lacks_is_written_in_words():
    assert "δ = −3·10⁻⁶, 1 kΩ, 2 µm, 5 m²".encode("ascii", "coilarray") == b"delta = -3*10^-6, 1 kOhm, 2 um, 5 m^2"
    assert "2 µm, δ".encode("cp1252", "coilarray").decode("cp1252") == "2 µm, delta"


@pytest.mark.slow
@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    "command",
    ["impedance starter --noise", "keys pitch", "view starter --spacing-mm 4 --out f.nc",
     "sweep starter --vary array.pitch_mm=11,12 -q span_mm --workers 1 --out s.csv"],
)  # fmt: skip
def test_commands(monkeypatch, command, encoding):
    code, out, err = run(monkeypatch, encoding, *command.split())
    assert code == 0, err
    assert not re.search("[?−]", out.decode(encoding))
    for path in Path().rglob("*.csv"):  # numbers that float() of any program reads
        assert not re.search(r"(?m)(^|,)−", path.read_text(encoding="utf-8")), path


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("arguments", [("check", "δ.toml"), ("check", "starter", "--Ω"), ("−",), ("view", ODD)])
def test_error_lines(monkeypatch, arguments, encoding):
    code, out, err = run(monkeypatch, encoding, *arguments)
    assert (code, out, err.count(b"\n")) == (2, b"", 1)
    assert err.decode(encoding).startswith("coilarray: error: ")


def test_minus_signs_are_those_of_ascii_except_on_a_terminal(monkeypatch):
    """Places of coils left of the origin have them."""
    _, piped, _ = run(monkeypatch, "utf-8", "check", "starter")
    assert any(float(word) < 0 for word in re.findall(r" (-\d[\d.]+)", piped.decode()))
    _, shown, _ = run(monkeypatch, "utf-8", "check", "starter", stream=Terminal)
    assert re.search(r" −\d", shown.decode())
    assert "−" not in piped.decode()


@pytest.mark.slow
@pytest.mark.usefixtures("own_folder")
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize(
    "command",
    ["init --from starter", "export starter --to kicad --out", "check starter --out",
     "optimize starter worst_k --template",
     "sweep starter --vary array.pitch_mm=11,12 -q span_mm --workers 1 --out"],
)  # fmt: skip
def test_names_that_are_no_utf_8_work_or_are_refused_in_one_line(monkeypatch, command):
    suffix = {"init": ".toml", "optimize": ".toml", "export": ""}
    name = ODD + "a" + suffix.get(command.split()[0], ".csv")
    code, _, err = run(monkeypatch, "utf-8", *command.split(), name)
    assert code == 0 or (code == 2 and err.count(b"\n") == 1), err
