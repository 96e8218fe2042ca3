"""``coilarray board test``: who answers, which ports there are, the self-test of a board with and without a fault."""

import json
import sys

import pytest
from support.command_line import mistakes, runner, successes

import coilarray.hardware.emulator.board as emulator_boards
from coilarray.hardware.wire import ports
from coilarray.hardware.wire.ports import PortInfo

pytestmark = pytest.mark.slow

run, refused = runner("board", "test")
good, answer = successes("board", "test")


@pytest.fixture(autouse=True)
def known_ports(monkeypatch):
    monkeypatch.setattr(ports.buses, "linux_buses", lambda: ("i2c:1", "spi:0.0"))
    monkeypatch.setattr(ports.buses, "ft232h_adapters", tuple)
    port = PortInfo("/dev/ttyACM0", "000591234567", "/dev/ttyACM0 1366:0105 usb:000591234567 (J-Link)")
    monkeypatch.setattr(ports, "list_serial_ports", lambda: (port,))


@pytest.fixture
def broken(monkeypatch):
    """Let the emulator open with something done to it."""

    def breaking(action):
        make = emulator_boards.emulated_board

        def made(*arguments, **emulation):
            emulator = make(*arguments, **emulation)
            action(emulator)
            return emulator

        monkeypatch.setattr(emulator_boards, "emulated_board", made)

    return breaking


def test_it_says_who_answers_and_what_ports_there_are(capsys):
    lines = good(capsys, "--list").splitlines()
    assert all(line.startswith("[emulator] ") for line in lines)
    assert lines[:3] == [
        "[emulator] serial ports: /dev/ttyACM0 1366:0105 usb:000591234567 (J-Link)",
        "[emulator] buses of this computer: i2c:1, spi:0.0",
        "[emulator] adapters: none",
    ]
    assert lines[3].startswith("[emulator] emulator: emulator; LDC1614 (5449/3055); wiring six_coils; session ")
    assert len(lines) == 4


def test_the_same_as_json(capsys):
    reported = answer(capsys, "--list", "--wiring", "six_coils_4")
    assert (reported["emulated"], reported["port"], reported["wiring"]) == (True, "emulator", "six_coils_4")
    assert (reported["identity"]["manufacturer"], reported["identity"]["device"]) == (0x5449, 0x3055)
    assert reported["ports"]["linux"] == ["i2c:1", "spi:0.0"]
    assert set(reported["assumed"]) >= {"wiring", "ADG739.bits", "ADG739.drain_capacitance"}
    assert {reported[key] for key in ("drives", "self_test")} == {None}


def test_the_emulator_has_the_coils_of_any_design(capsys):
    reported = answer(capsys, "--list", "starter")  # three coils
    assert (reported["wiring"], reported["chain"]) == ("one_device_a_coil", None)
    line = refused(capsys, "starter", "--wiring", "six_coils")
    assert "the wiring has the coil 'coil4', the design starter only coil1, coil2, coil3" in line


def test_a_good_board_passes_its_self_test(capsys):
    out = good(capsys, "--find-drives")
    assert all(line.startswith("[emulator] ") for line in out.splitlines())
    assert "self-test passed: the board agrees with its wiring, as far as the test can show" in out
    assert "drives = { coil1 = 7, coil2 = 8" in out  # 46 and 52 µA into 28 and 27 kΩ: 1.65 and 1.8 V
    rows = {line.split()[1]: line.split()[2:] for line in out.splitlines() if line.startswith("[emulator] coil")}
    assert float(rows["coil1"][0]) == pytest.approx(1.4001, abs=1e-4)  # coilarray impedance: 1.4001 MHz
    assert rows["coil1"][2] == "coil2"


def test_a_switch_that_is_stuck_is_named_and_the_exit_code_is_2(capsys, broken):
    broken(lambda emulator: emulator.chain.stick(*emulator.chain.find(2, 0, "INA"), "open"))
    code, out, err = run(capsys)
    assert code == 2
    assert "[emulator]   coil3 does not oscillate with all others grounded" in out
    assert "[emulator] any one of these explains it:" in out
    assert "[emulator]   U3.S2A (coil3.a to INA) stays open" in out
    reason = "coil3 does not oscillate with all others grounded."
    assert err == f"coilarray: error: the self-test of emulator has failed: {reason}\n"


def test_the_findings_are_in_the_json_too(capsys, broken):
    broken(lambda emulator: emulator.chain.stick(*emulator.chain.find(2, 0, "ground"), "closed"))
    code, out, _ = run(capsys, "--json")
    assert code == 2
    reported = json.loads(out)["self_test"]
    assert not reported["passed"]
    assert reported["findings"] == ["U3.S1A (coil3.a to ground) stays closed"]
    assert reported["coils"][2]["frequency"] is None


def test_a_converter_that_does_not_answer_is_reported(capsys, broken):
    broken(lambda emulator: emulator.bus.refuse(10**6))
    assert "no converter answers" in good(capsys, "--list")
    assert "error: the converter did not acknowledge" in refused(capsys)


test_wrong_arguments_are_one_line = mistakes(
    refused,
    (("--port", "nowhere"), "port 'nowhere' is not valid: it must be emulator, a serial port"),
    (("--port", "/dev/ttyACM99"), "port /dev/ttyACM99 does not exist."),
    (("--port", "i2c:99"), "there is no /dev/i2c-99"),
    (("--emulate", "clock_MHz=60"), "--emulate clock_MHz must be a finite number from 35 to 55; got '60'"),
    (("--emulate", "seed=1", "--port", "/dev/ttyACM99"), "--emulate is for the emulator"),
)


def test_a_missing_library_is_one_line_that_names_the_extra(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    assert "microcontroller boards need pyserial, which" in refused(capsys, "--port", "COM5")
