"""Scan settings: registers of the reference board, the rules that refuse, scan time, and the hash of the protocol."""

import itertools
import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.emulated_reader import plain, reader_of, settings_of
from support.scripted_board import crc16

from coilarray import load_design
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import decode
from coilarray.hardware.scan.settings import ScanSettings, StateSettings, board_budget, board_network
from coilarray.hardware.scan.wiring import load_wiring, one_device_a_coil, wired_to_channels

WIRING = load_wiring()
DEFAULT = settings_of(WIRING)


def test_registers_of_the_reference_board():
    # facts, 1.8; SETTLECOUNT ⌈60·27.5/(16·2)⌉ = 52 with the fastest clock that a converter may have
    values = 0xFFFF, 0, 52, 0x1002, 0xF8FD, 0x1401, 0x020C
    assert DEFAULT.registers == tuple(zip((0x08, 0x0C, 0x10, 0x14, 0x19, 0x1A, 0x1B), values, strict=True))
    assert DEFAULT.drive_register(DEFAULT.states[0]) == 6 << 11
    assert [state.name for state in DEFAULT.states] == list(WIRING.coils)
    assert (DEFAULT.states[0].words.hex(), DEFAULT.reference) == ("111111111122", 21.7e6)


def test_scan_time():
    # waking, full resolution and result alone take 293.6 ms, settling 0.2 ms and the half per cent by
    # which a measured clock may be slower 1.5 ms more; a clock that is not known costs a quarter, 70 ms
    measured = settings_of(WIRING, clock=43.4e6)
    scan_time = 6 * (measured.state_time().total - measured.state_time().control)
    assert scan_time == pytest.approx(295.3e-3, abs=0.1e-3)
    assert 6 * (DEFAULT.state_time().total - DEFAULT.state_time().control) == pytest.approx(364.0e-3, abs=0.1e-3)
    # status, sleeping, waking, drive current and switches on top: 0.455 ms a state; a register of 0.12 ms a scan
    assert measured.period() - scan_time == pytest.approx(6 * 0.455e-3 + 0.12e-3, rel=1e-9)
    # the paper's
    # six times wake, full resolution and reading the result; Gast & Zimmermann (2020) print 293.5 ms
    parts = replace(DEFAULT, slowest_clock=43.4e6).state_time()
    scan = 6 * (parts.wake + parts.conversion + parts.result)
    assert scan == pytest.approx(293.6e-3, abs=0.05e-3)  # as printed in the facts, to a tenth of a ms
    assert scan == pytest.approx(293.5e-3, rel=6e-4)


def test_waits():
    # with a clock of 35 MHz 16384, 16·52·2 and (16·65535 + 4)·2 cycles take 0.4681, 0.0475 and 59.9179 ms
    assert DEFAULT.wait_us == math.ceil(60433.5)
    # a tenth of margin, and 6 ms for the watchdog's restart of 5.2 ms
    assert DEFAULT.timeout_us == math.ceil(1.1 * 60433.54 + 6000)
    # a measured clock may still change by 0.5 %: 1.005 times 16384, 16·41·2 and 2097128 cycles of 43.2 MHz
    measured = settings_of(WIRING, clock=43.2e6)
    assert measured.wait_us == math.ceil((16384 + 1312 + 2097128) / 43.2 / 0.995)
    assert measured.timeout_us == pytest.approx(1.1 * (16384 + 1312 + 2097128) / 35 + 6000, abs=1)
    external = settings_of(WIRING, clock=40e6, external_clock=True)
    # the external clock is what it is, but the converter wakes by its own: 0.4681 + 0.0304 + 52.4282 ms
    assert external.wait_us == math.ceil(52926.7)
    assert external.timeout_us == math.ceil(1.1 * 52926.7 + 6000)
    # from result to result a conversion and the slot before it, 0.692 µs and five cycles
    assert settings_of(WIRING, discard=3).again_us == math.ceil(59917.9 + 0.692 + 5 / 17.5)


def test_discarded_conversions_are_counted():
    four, none = (settings_of(WIRING, clock=43.4e6, discard=discard) for discard in (4, 0))
    # each a conversion at the slowest clock and two transfers of 0.12 ms
    each = 1048564 / (43.4e6 * 0.995 / 2) + 0.692e-6 + 5 / (43.4e6 * 0.995 / 2) + 0.24e-3
    assert four.period() - none.period() == pytest.approx(6 * 4 * each, rel=1e-9)
    assert (four.wait_us, four.timeout_us) == (none.wait_us, none.timeout_us)
    fast = settings_of(WIRING, rate=10.0, discard=4)
    assert fast.period() <= 0.1 < replace(fast, rcount=fast.rcount + 1).period()


@given(rate=st.floats(0.01, 50), bus_rate=st.floats(100e3, 400e3))
def test_rate_is_reached_and_no_more(rate, bus_rate):
    settings = settings_of(WIRING, rate=rate, bus_rate=bus_rate)
    period = settings.period(bus_rate)
    assert period <= 1 / rate * (1 + 1e-9)  # rounding of the quotients
    one_more = replace(settings, rcount=min(settings.rcount + 1, 0xFFFF))
    assert settings.rcount == 0xFFFF or one_more.period(bus_rate) > 1 / rate


@pytest.mark.parametrize(("rate", "bus_rate"), [(10.0, 400e3), (40.0, 100e3)])
def test_rate_is_reached_by_the_emulated_board(rate, bus_rate):
    board = plain()
    board.bus.speed = bus_rate
    reader = reader_of(board)
    reader.configure(settings_of(WIRING, rate=rate, bus_rate=bus_rate, drives=7))
    times = [scan.time for scan in itertools.islice(reader.scans(), 6)]
    # its switches take data at 8 MHz, not at 1 MHz: up to 50 µs less a state, of 4 ms at least, and 1 µs of rounding
    assert rate * (1 - 1e-3) <= 5 / (times[-1] - times[0]) < rate * (1 + 50e-6 / 4e-3)


@given(
    frequency=st.floats(1e4, 10e6), quality=st.floats(1, 200), clock=st.floats(2e6, 40e6) | st.floats(35e6, 55e6),
    external=st.booleans(), rcount=st.integers(5, 0xFFFF), drive=st.integers(0, 31),
)  # fmt: skip
def test_what_is_made_keeps_the_rules(frequency, quality, clock, external, rcount, drive):
    """Every setting that is made at all: the rules of the data sheet's table 43, written out again."""
    given = {"frequency": frequency, "quality": quality, "clock": clock, "external_clock": external}
    try:
        settings = settings_of(WIRING, **given, rcount=rcount, drives=drive)
    except HardwareError:
        low, high = (2e6, 40e6) if external else (35e6, 55e6)
        assert not low <= clock <= high or (external and frequency >= 15 / 4 * min(clock, 35e6) / 2)
        return
    assert frequency / settings.fin_divider < settings.reference / 4
    assert settings.fin_divider >= 2 or frequency < 8.75e6
    assert settings.reference <= 35e6
    assert external or settings.fref_divider >= 2
    assert settings.settle_count >= quality * settings.reference / (16 * frequency)
    assert {1: 1e6, 4: 3.3e6, 5: 10e6, 7: 33e6}[settings.deglitch] > frequency
    assert decode("CLOCK_DIVIDERS0", dict(settings.registers)[0x14])["FREF_DIVIDER0"] == settings.fref_divider
    assert ScanSettings.from_json(settings.to_json()) == settings


NOT_POSITIVE = [("rate", 0.0), ("rate", math.inf), ("clock", math.nan), ("clock", -1.0), ("frequency", 0.0),
                ("quality", math.inf)]  # fmt: skip


@pytest.mark.parametrize(("given", "message"), [
    ({"rcount": 4}, "RCOUNT must be 5 to 65535; got 4"),
    ({"rcount": 0x10000}, "RCOUNT must be 5 to 65535; got 65536"),
    ({"rcount": 100, "rate": 10.0}, "give rate or rcount, not both; got 10.0 and 100"),
    *(({name: value}, f"{name} must be positive and finite; got {value}") for name, value in NOT_POSITIVE),
    ({"rate": 200.0}, r"rate must be at most \d+\.\d scans/s of 6 states on an I²C bus of 400 kHz; got 200"),
    ({"rate": 100.0, "bus_rate": 100e3}, r"rate must be at most \d+\.\d+ scans/s .* of 100 kHz; got 100"),
    ({"rate": 1.0, "bus_rate": 0.0}, "bus_rate must be positive and finite; got 0.0"),
    ({"clock": 34e6}, "clock must be 35 MHz to 55 MHz; got 34 MHz"),
    ({"clock": 41e6, "external_clock": True}, "clock must be 2 MHz to 40 MHz; got 41 MHz"),
    ({"frequency": 11e6}, "frequency must be 1 kHz to 10 MHz; got 11 MHz"),
    ({"frequency": 900.0}, "frequency must be 1 kHz to 10 MHz; got 0.9 kHz"),
    *(({"drives": value}, f"a drive must be an integer from 0 to 31; got {value}") for value in (32, -1, True)),
    *(({"discard": value}, f"discard must be an integer from 0 to 15; got {value}") for value in (-1, 16, 1.5, True)),
    ({"external_clock": True}, "an external clock needs its frequency"),
    ({"plan": ()}, "a scan must have 1 to 255 states; got 0"),
    ({"plan": [ScanState(str(k), (("coil1", 1),)) for k in range(256)]}, "must have 1 to 255 states; got 256"),
    ({"plan": [ScanState("s", (("coil1", 1),))] * 2}, "different names; got 's' twice"),
    ({"plan": [ScanState("s", (("coil1", 1), ("coil2", 1)))]}, "s must measure one coil"),
])  # fmt: skip
def test_refused(given, message):
    with pytest.raises(HardwareError, match=message) as raised:
        settings_of(WIRING, **given)
    assert "\n" not in str(raised.value)


def test_canonical_bytes():
    """The protocol's own words: these bytes, in this order, written out by hand for two devices and one state."""
    settings = ScanSettings(
        states=(StateSettings("s", bytes.fromhex("1122"), 18),), safe_words=bytes.fromhex("1111"),
        wiring=bytes(range(16)), clock=40e6, external_clock=True, rcount=0x04D6, settle_count=10, fin_divider=1,
        fref_divider=2, deglitch=4,
    )  # fmt: skip
    parts = ["02", bytes(range(16)).hex(), "1111"]
    parts += ["0804d6", "0c0000", "10000a", "141002", "19f8fd", "1a1601", "1b020c"]
    parts += [f"{settings.wait_us:08x}", f"{settings.timeout_us:08x}", "01", "11229000"]
    assert settings.canonical == b"coilarray1" + bytes.fromhex("".join(parts))
    assert settings.hash == crc16(settings.canonical)
    # 16384/35 MHz + 160/20 MHz + (16·1238 + 4)/20 MHz
    assert settings.wait_us == math.ceil(468.1143 + 8 + 990.6)
    discarding = replace(settings, discard=5)
    parts[-2:-2] = [f"05{discarding.again_us:08x}"]
    assert discarding.canonical == b"coilarray1" + bytes.fromhex("".join(parts))


def test_json():
    named = replace(DEFAULT, states=(replace(DEFAULT.states[0], name='µ "a"\n'), *DEFAULT.states[1:]))
    for settings in (DEFAULT, named):
        text = settings.to_json()
        assert "\n" not in text
        assert (ScanSettings.from_json(text), json.loads(text)["hash"]) == (settings, f"{settings.hash:04X}")


@pytest.mark.parametrize(("changes", "message"), [
    ({"schema": 4}, "scan settings: schema"), ({"discard": 16}, "scan settings: discard"),
    ({"hash": "0000"}, "scan settings: hash .* got 0000"),
    ({"rcount": 100}, "scan settings: hash must be [0-9A-F]{4}"), ({"rcount": 4}, "RCOUNT0 must be 5 to 65535; got 4"),
    ({"rcount": "100"}, "scan settings: rcount"), ({"clock": float("nan")}, "scan settings: clock"),
    ({"safe_words": "11"}, "states must have 1 words each"), ({"states": []}, "scan settings: states"),
    ({"states": [{"name": "a", "words": "111111111122", "drive": 32}]}, "scan settings: states.0.drive"),
    ({"states": [{"name": "a"}]}, "scan settings: states.0.words is missing"), ({"more": 1}, "has no key 'more'"),
    *((text, "scan settings: ") for text in ("", "[]", "[" * 100_000, "9" * 5000, '{"a": 1}')),
])  # fmt: skip
def test_bad_json(changes, message):
    text = changes if isinstance(changes, str) else json.dumps({**json.loads(DEFAULT.to_json()), **changes})
    with pytest.raises(HardwareError, match=message) as raised:
        ScanSettings.from_json(text)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_a_design_that_was_changed_in_python_gets_its_own_network_and_budget():
    """The single coil of gast_fem has 97.12 µH under its magnetic sheet and 94.82 µH under air."""
    design = load_design("gast_fem")
    air = replace(design, sheets=tuple(replace(sheet, relative_permeability=1.0) for sheet in design.sheets))
    magnetic = board_network(design)
    fresh, kept = (board_network(air) for _ in range(2))
    assert magnetic.inductance[0, 0] == pytest.approx(97.12e-6, abs=0.005e-6)
    assert fresh.inductance[0, 0] == pytest.approx(94.82e-6, abs=0.005e-6)
    assert kept.inductance[0, 0] == fresh.inductance[0, 0]
    assert board_network(design).inductance[0, 0] == magnetic.inductance[0, 0]
    # a crystal, a short conversion, and no switches where there are none; the design says 5 Ω and its own read-out
    circuit = replace(design.circuit, switches=replace(design.circuit.switches, on_resistance=2.5), part="ADG739")
    design, (coil,) = replace(design, circuit=circuit), design.array.names
    switched = settings_of(one_device_a_coil([coil]), rcount=2048)
    wired = settings_of(wired_to_channels([coil], [0]), rcount=2048, clock=40e6, external_clock=True)
    by_switches, by_channel = (board_budget(design, one, baseline_scans=4) for one in (switched, wired))
    assert board_network(design, wired=True).switches.on_resistance == 0.0
    sizes = [{cause.name: cause.size for cause in one.causes} for one in (by_switches, by_channel)]
    assert [one["resistance of the switches"] for one in sizes] == ["assumed", "none"]
    assert "jitter of the crystal oscillator" in sizes[1]
    # 8e-7 of f at RCOUNT 2048, twice that of L; one scan and a baseline of four; thermal noise is 1 % of it
    assert by_switches.noise == pytest.approx(1.6e-6 * (1 + 1 / 4) ** 0.5, rel=0.01)
    assert abs(by_channel.causes[4].drift[0]) < abs(by_switches.causes[4].drift[0]) / 5
