"""Commands on terminals of 60 to 120 columns; conftest.py checks there what all other tests of commands print."""

import sys

import pytest
from support.screen import on_terminal, require_fits

from coilarray.cli import main, shared
from coilarray.cli.main import COMMANDS
from coilarray.compute.display_units import DisplayUnit
from coilarray.compute.table import Column, Table, fill, text_table

WIDTHS = (60, 80, 100, 120)
QUICK = [
    "check starter", "check starter --all", "check starter --fab oshpark-4-layer", "check --list-fabs",
    "keys trace_width", "optimize --list-quantities", "impedance starter --noise", "board campaign starter --dry-run",
    "board test --list", "check nothing", "sweep starter --vary circuit.capacitance_pFF=1,2 -q worst_k",
    "init pad.toml --layers 99", "init one.toml --coils 0x3",
]  # fmt: skip


@pytest.fixture
def screen(monkeypatch, capsys, own_folder):
    """Run a command as on a terminal of some columns; return the exit code and what it shows."""

    def run(command: str, width: int) -> tuple[int, str]:
        monkeypatch.setattr(shared, "terminal_width", lambda **_: width)
        monkeypatch.setenv("COLUMNS", str(width))
        code = main.main(command.split())
        shown = capsys.readouterr()
        return code, shown.out + shown.err

    return run


@pytest.mark.parametrize("command", QUICK)
def test_commands_fit(screen, command):
    for width in WIDTHS:
        _, text = screen(command, width)
        require_fits(text, width)


def test_the_verdict_of_a_check_comes_first(screen):
    code, text = screen("check starter", 80)
    assert (code, text.splitlines()[0][0]) == (0, "✔")
    code, text = screen("check starter --fab oshpark-4-layer", 80)
    assert (code, text.splitlines()[0][0]) == (2, "✖")
    # one table, its places in one column
    assert sum(line.startswith("no.") for line in text.splitlines()) == 1


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_one_screen_with_examples_and_all_of_it_can_be_had(screen, command):
    code, text = screen(f"{command} --help", 80)
    assert code == 0
    assert text.count("\n") <= 40
    assert max(map(len, text.splitlines())) <= 80
    examples = (main.COMMANDS[command].__doc__ or "").count("Example: ")
    assert text.count("Example: ") == min(examples, 2) > 0
    _, narrow = screen(f"{command} --help", 60)
    assert narrow.count("\n") <= 40
    _, whole = screen(f"{command} --help-all", 80)
    assert whole.count("Example: ") == examples
    assert "--help-all explains everything" in text


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="it has no pseudo-terminals")
def test_a_real_terminal():
    for width in (60, 120):
        text, code = on_terminal([sys.executable, "-m", "coilarray", "check", "starter"], width)
        assert code == 0
        require_fits(text, width)
        assert "✔ Can be made" in text


def test_long_texts_stand_below_their_rows():
    source = "as measured by somebody who wrote more about it than stands in a narrow column of a table " * 2
    table = text_table(("cause", "size", "source"), [("heat", "0.1", source), ("noise", "0.02", "known")])
    lines = table.text(60).splitlines()
    assert lines[:2] == ["cause  size", "heat   0.1"]
    assert all(line.startswith("    ") for line in lines[2:6])
    assert lines[-2:] == ["noise  0.02", "    known"]
    assert "source" in table.text(None)


def test_headings_that_do_not_fit_are_symbols_with_their_meaning():
    columns = Column("state"), Column("effective_inductance", "effective inductance of the coil", "H"), Column("a" * 30)
    table = Table("", "", columns, (("coil1", 1e-5, "x"),))
    assert "effective inductance of the coil (µH)" in table.text(None).splitlines()[0]
    first, *_, last = table.text(50).splitlines()
    assert first.split()[1:3] == ["L_eff", "(µH)"]
    assert last == "L_eff effective inductance of the coil"


def test_decimal_points_stand_below_each_other():
    numbers = DisplayUnit(digits=4, significant=True)
    rows = tuple((name, value) for name, value in (("a", 12.34), ("b", 5.0), ("c", -0.01234)))
    lines = Table("", "", (Column("name"), Column("x", unit="1", shown=numbers)), rows).text(None).splitlines()
    assert len({(line + ".").index(".", 6) for line in lines[1:] if "." in line}) == 1
    assert lines[2] == "b      5"


def test_a_number_and_its_unit_stay_in_one_line():
    text = "the copper is " + "wide " * 9 + "12.5 mm and 3 % of 40 turns"
    for width in range(30, 75):
        assert not any(line.endswith(("12.5", " 3")) for line in fill(text, width).splitlines())
    assert fill("  indented words that are wrapped at some width", 22).splitlines()[1].startswith("    ")
