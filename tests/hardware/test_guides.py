"""The guides of `docs/hardware`: their programs run, and their commands print what stands below them.

A line "…" stands for any lines, "…" within a line for anything, and several spaces for any number of them. Real ports
are played: I²C, SPI and FT232H by the emulated chips themselves, a serial port by the firmware on them.
"""

import csv
import functools
import re
import shlex
import textwrap
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.command_line import runner
from support.firmware_host import COMPILER, FirmwareHost

from coilarray import load_design
from coilarray.hardware.board import connect, microcontroller
from coilarray.hardware.emulator.board import emulated_board
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.ports import parse_port

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs" / "hardware"
PAGES = sorted(page.name for page in DOCS.glob("*.md"))
BLOCK = re.compile(r"^ *```{}\n(.*?)^ *```", re.DOTALL | re.MULTILINE)


def _blocks(page, language):
    pattern = BLOCK.pattern.format(language)
    return [textwrap.dedent(block) for block in re.findall(pattern, (DOCS / page).read_text("utf-8"), BLOCK.flags)]


def _console(page):
    """Commands of a page, each with what it is shown to print."""
    for block in _blocks(page, "console"):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, shown = part.partition("\n")
            yield shlex.split(command), shown


def _pattern(shown):
    lines = []
    for line in shown.splitlines():
        pieces = [re.escape(piece) for piece in line.split("…")]
        lines.append("(?:.*\n)*?" if line == "…" else re.sub(r"(\\ ){2,}", r"\\s+", ".*".join(pieces)) + "\n")
    return "".join(lines)


@functools.cache
def _said():
    """The sources of drivers and commands, with the parts of a message joined."""
    files = [path for folder in ("hardware", "coilarray/cli") for path in (ROOT / folder).rglob("*.py")]
    return re.sub(r'"\s*\n\s*f?"', "", "".join(path.read_text("utf-8") for path in files))


@pytest.fixture
def ports(monkeypatch):
    """Let every port but the emulator's lead to an emulated board with switches."""
    board = emulated_board(load_design("gast2020"), load_wiring())
    monkeypatch.setattr(connect.buses, "LinuxRegisterBus", lambda *_: board.bus)
    monkeypatch.setattr(connect.buses, "SpiSwitchChain", lambda *_, **__: board.chain)
    both = SimpleNamespace(read=board.bus.read, write=board.bus.write, clear=board.bus.clear, close=board.bus.close)
    both.shift = board.chain.shift
    monkeypatch.setattr(connect.buses, "Ft232h", lambda *_, **__: both)
    monkeypatch.setattr(connect.buses, "Clock", lambda: board.clock)
    with ExitStack() as hosts:

        def to_the_firmware(name):
            if COMPILER is None:
                pytest.skip("g++ is not installed")
            host = hosts.enter_context(FirmwareHost(board.bus, board.chain, board.clock))
            return SimpleNamespace(name=host.port, serial_number="")

        monkeypatch.setattr(microcontroller, "choose_serial_port", to_the_firmware)
        yield


@pytest.mark.usefixtures("ports")
@pytest.mark.parametrize("page", [page for page in PAGES if _blocks(page, "console")])
def test_every_command_prints_what_the_page_shows(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text('coils = ["coil1", "coil2"]\n')
    for (program, *arguments), shown in _console(page):
        assert program == "coilarray"
        run, _ = runner(*arguments)
        code, out, err = run(capsys)
        assert (code, err) == (0, ""), arguments
        assert re.fullmatch(_pattern(shown), out), f"{arguments}\n{out}"


@pytest.mark.parametrize("page", PAGES)
def test_every_port_link_and_message_of_a_page_exists(page):
    text = (DOCS / page).read_text("utf-8")
    named = re.findall(r"`((?:i2c:|ftdi:|usb:|emulator\?)[^` ]+|/dev/tty[^` ]+|COM5)`", text)
    for port in [port.strip('"') for port in re.findall(r'--port ("[^"]+"|[^\s`"]+)', text)] + named:
        if port != "PORT":
            parse_port(port)
    for target, anchor in re.findall(r"\]\((?!http)([^)#]*)(?:#([^)]*))?\)", text):
        there = DOCS / (target or page)
        assert there.exists(), target
        heads = re.findall(r"^#+ (.*)$", there.read_text("utf-8"), re.MULTILINE) if anchor else []
        assert not anchor or anchor in {re.sub(r"[^\w -]", "", head).lower().replace(" ", "-") for head in heads}
    for row in re.findall(r"^\| (`.*?) \|", text, re.MULTILINE):  # "what you see"
        for message in re.findall(r"`([^`]+)`", row):
            if " " in message and "=" not in message:
                assert all(piece.strip() in _said() for piece in message.split("…")), message


@pytest.mark.filterwarnings("default")  # whatever the framework has
def test_a_procedure_of_pymeasure_writes_the_inductances_of_every_scan(tmp_path, monkeypatch):
    pytest.importorskip("pymeasure", reason="pymeasure is not installed")
    monkeypatch.chdir(tmp_path)
    (program,) = _blocks("lab_frameworks.md", "python")
    exec(program, {"__name__": "__main__"})
    lines = [line for line in (tmp_path / "inductances.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert len(rows) == 5
    assert list(rows[0]) == ["Time (s)", *[f"coil{k} (H)" for k in range(1, 7)]]
    # 107.6 µH in the README, which counts the switches; the same 120 pF here
    assert all(float(row["coil1 (H)"]) == pytest.approx(107.6e-6, rel=1e-3) for row in rows)
