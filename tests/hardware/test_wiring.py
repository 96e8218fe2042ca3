"""Words of switches and wirings: those of every state, and that none get through that join what must not be joined.

What words join is worked out here a second time, as a graph: every closed switch is an edge between an end of a coil
and a net, and what hangs together is one node.
"""

import re
import tomllib
from dataclasses import replace
from itertools import product

import pytest

from coilarray.design.scan_states import ScanState, paper_plan, switch_part
from coilarray.errors import HardwareError, NetworkError
from coilarray.hardware.scan.wiring import WIRINGS, check_switching

from coilarray.hardware.scan.wiring import (  # isort: skip
    Terminal, Wiring, load_wiring, parse_wiring,
)  # fmt: skip

SIX, FOUR = load_wiring("six_coils"), load_wiring("six_coils_4")
BOTH = pytest.mark.parametrize("wiring", [SIX, FOUR], ids=["six", "four"])
NETS = ("ground", "INA", "INB", "other")


def _two_coils(devices):
    """The part of a bundled wiring that two of its coils need, so that all its words can be tried."""
    coils = ("coil1", "coil2")
    kept = [[switch for switch in device.switches if switch.terminal.coil in coils] for device in devices]
    devices = (replace(device, switches=tuple(some)) for device, some in zip(devices, kept, strict=True))
    return Wiring("two coils", "", coils, tuple(devices))


TWO = _two_coils(SIX.devices[:2])
TWO_ON_A_BUS = _two_coils((FOUR.devices[0], FOUR.devices[2]))


def _groups(wiring, words):
    """Sets of ends and nets that hang together, and whether a switch is closed that is not wired."""
    group = {node: {node} for node in (*wiring.terminals, *NETS)}
    stray = False
    for device, word in zip(wiring.devices, reversed(words), strict=True):
        for bit in range(8):
            if word >> bit & 1:
                edges = [(s.terminal, s.net) for s in device.switches if s.name == device.bits[bit]]
                stray = stray or not edges
                for end, net in edges:
                    joined = group[end] | group[net]
                    for node in joined:
                        group[node] = joined
    return group, stray


def _is_legal(wiring, words):
    group, stray = _groups(wiring, words)
    on = {net: [node for node in group[net] if isinstance(node, Terminal)] for net in NETS}
    if stray or any(sum(net in group[one] for net in NETS) > 1 for one in NETS):
        return False
    measured = on["INA"] + on["INB"]
    return not measured or (len(on["INA"]) == len(on["INB"]) == 1 and measured[0].coil == measured[1].coil)


def check(wiring, words, safe_words=None):
    """Raise HardwareError where a state of these words is refused."""
    check_switching(wiring.encode(), safe_words or wiring.safe_words, [("s", words)])


def _is_let_through(wiring, words):
    try:
        check(wiring, words)
    except HardwareError:
        return False
    return True


@pytest.mark.slow
@pytest.mark.parametrize("wiring", [TWO, TWO_ON_A_BUS], ids=["device a coil", "bus"])
def test_every_word_of_two_coils(wiring):
    """All that close wired switches: whatever is let through measures one coil or none."""
    switches = [
        (place, 1 << device.bits.index(switch.name))
        for place, device in enumerate(reversed(wiring.devices))
        for switch in device.switches
    ]
    legal = 0
    for closed in product((0, 1), repeat=len(switches)):
        words = bytearray(len(wiring.devices))
        for (place, bit), is_closed in zip(switches, closed, strict=True):
            words[place] |= bit * is_closed
        assert _is_let_through(wiring, words) == _is_legal(wiring, words)
        legal += _is_legal(wiring, words)
    # four ends, each to ground or nothing; or one coil on the bus (either way round), the other's ends likewise
    assert legal == (2**4 + 2 * 2 * 2**2 if wiring is TWO else 2**4 + 2 * 2**2)


@BOTH
def test_no_other_safe_words_pass_that_differ_in_one_switch(wiring):
    safe = wiring.safe_words
    for device, bit in product(range(len(safe)), range(8)):
        words = bytearray(safe)
        words[device] ^= 1 << bit
        with pytest.raises(HardwareError, match="the safe words"):
            check(wiring, safe, words)


def test_words_of_the_six():
    # facts: measure 0x22, others 0x11; turned round 0x44; the first byte lands in the far end, U6
    assert SIX.safe_words.hex() == "111111111111"
    assert [SIX.words(state).hex() for state in paper_plan(SIX.coils)][:2] == ["111111111122", "111111112211"]
    assert SIX.words(ScanState("turned", (("coil6", -1),))).hex() == "441111111111"
    assert SIX.words(ScanState("open", (("coil1", 1),), others="open")).hex() == "000000000022"
    assert SIX.words(ScanState("one", (("coil1", 1),), others="ground one end")).hex() == "010101010122"
    assert SIX.words(ScanState("other", (("coil1", 1),), others="ground other end")).hex() == "101010101022"


@pytest.mark.parametrize("k", range(1, 7))
def test_words_of_the_four(k):
    # facts: U1 = 1 << (k − 1) in both nibbles, U2 = 0, U3 = 0xFF ^ U1, U4 = 0x33; coils 5 and 6 on U2 and U4
    bus = 0x11 << (k - 1) % 4
    wanted = (bus, 0, 0xFF ^ bus, 0x33) if k <= 4 else (0, bus, 0xFF, 0x33 ^ bus)
    assert FOUR.words(ScanState("state", ((f"coil{k}", 1),))) == bytes(reversed(wanted))
    assert FOUR.safe_words == bytes([0x33, 0xFF, 0, 0])


@BOTH
def test_encoding(wiring):
    """Against the file itself: device by device from the far end, bit by bit."""
    file = tomllib.loads(WIRINGS.read(wiring.name))["wiring"]
    codes = []
    for device in reversed(file["device"]):
        for name in switch_part(device["part"]).bits:
            switch = device["switch"].get(name)
            terminal = None if switch is None else 2 * file["coils"].index(switch["coil"]) + (switch["end"] == "b")
            codes.append(0xFF if switch is None else 4 * terminal + NETS.index(switch["net"]))
    assert list(wiring.encode()) == codes
    # U6 first: end a of coil 6 is 10, its end b is 11
    assert SIX.encode()[:8].hex(" ") == "28 29 2a ff 2c 2e 2d ff"


@pytest.mark.parametrize(("words", "message"), [
    ("111111111133", "state s joins end a of coil 1 to ground and INA at once"),
    ("111111111102", "state s joins an end to one pin of the converter and nothing to the other"),
    ("111111112222", "state s joins end a of coil 2 and end a of coil 1 to INA at once"),
    ("111111112002", "state s joins end a of coil 1 to INA but end b of coil 2 to INB"),
    ("111111111142", "state s joins end a of coil 1 and end b of coil 1 to INA at once"),
    ("111111111166", "state s joins end a of coil 1 to INA and INB at once"),
    ("111111111180", "state s: bit 7 of word 5 must be 0; its switch is not wired"),
])  # fmt: skip
def test_conflicts_are_named(words, message):
    for allowed in (SIX.safe_words, bytes(6)):
        check(SIX, allowed)
    with pytest.raises(HardwareError, match=re.escape(message)):
        check(SIX, bytes.fromhex(words))


@pytest.mark.parametrize(("state", "error", "message"), [
    (ScanState("s", (("coil1", 1), ("coil2", 1))), HardwareError, "s must measure one coil.*; got coil1, coil2"),
    (ScanState("s", (("coil1", 1),), others="load"), HardwareError, "s: wiring six_coils cannot make coil2 'load'"),
    (ScanState("s", (("coil9", 1),)), NetworkError, "names the coil 'coil9'"),
    (ScanState("s", ()), NetworkError, "measures no coil"),
])  # fmt: skip
def test_states_that_cannot_be(state, error, message):
    with pytest.raises(error, match=message):
        SIX.words(state)


SMALL = """
schema = 1
[wiring]
title = "one coil"
coils = ["one"]
[wiring.part.ADG739]
bits = ["S1A", "S2A", "S3A", "S4A", "S1B", "S2B", "S3B", "S4B"]
[[wiring.device]]
name = "U1"
part = "ADG739"
[wiring.device.switch]
S1A = { coil = "one", end = "a", net = "ground" }
S2A = { coil = "one", end = "a", net = "INA" }
S1B = { coil = "one", end = "b", net = "ground" }
S2B = { coil = "one", end = "b", net = "INB" }
"""


@pytest.mark.parametrize(("old", "new", "message"), [
    ("schema = 1", "schema = 2", "small: schema"),
    ('title = "one coil"', 'titel = "one coil"', "wiring has no key 'titel'; did you mean title"),
    ('coils = ["one"]', 'coils = ["one", "one"]', "names the coil 'one' twice"),
    ('coils = ["one"]', 'coils = ["one", "two"]', "must have a switch that grounds two.a"),
    ('coils = ["one"]', 'coils = ["two"]', "U1.S1A goes to 'one.a'; there are the coils two"),
    ('"S1A", "S2A", ', '"S1A", "S1A", ', "device U1: bits must name each of"),
    ('part = "ADG739"', 'part = "74HC4066"', "wiring.device.part must be ADG714, ADG738, ADG739; got '74HC4066'"),
    ("[wiring.part.ADG739]", "[wiring.part.ADG799]", "a table of wiring.part must be ADG714, .*; got 'ADG799'"),
    ("S1A = {", "S5A = {", "U1 has no switch 'S5A'"),
    ('net = "INA"', 'net = "INC"', "wiring.device.0.switch.S2A.net"),
    ('net = "INA"', 'net = "ground"', "two switches from one.a to ground"),
    ('net = "INA"', 'net = "INB"', "must join one.a to INA and one.b to INB"),
    ('S1B = { coil = "one", end = "b", net = "ground" }', "", "must have a switch that grounds one.b"),
    ('name = "U1"', "", "wiring.device.0.name is missing"),
])  # fmt: skip
def test_bad_files(old, new, message):
    with pytest.raises(HardwareError, match=message) as raised:
        parse_wiring(SMALL.replace(old, new), "small")
    assert "\n" not in str(raised.value)
    assert "small" in str(raised.value)


def _with_part(part, *devices):
    """The small wiring with devices of another part, each given by what its switches join, in order: an end, a net."""
    tables = "".join(
        f'[[wiring.device]]\nname = "U{k}"\npart = "{part}"\n[wiring.device.switch]\n'
        + "".join(
            f'{name} = {{ coil = "one", end = "{join[0]}", net = "{join[2:]}" }}\n'
            for name, join in zip(switch_part(part).bits, joins.split(), strict=False)
        )
        for k, joins in enumerate(devices, start=1)
    )
    return parse_wiring(SMALL[: SMALL.index("[wiring.part")] + tables, "small")


ENDS, MIXED = ("a-ground a-INA", "b-ground b-INB"), "a-ground b-INB a-INA b-ground"


@pytest.mark.parametrize(("part", "devices"), [
    ("ADG714", [MIXED]), ("ADG738", ENDS), ("ADG738", ["a-ground b-ground", "a-INA", "b-INB"]), ("ADG739", ENDS),
])  # fmt: skip
def test_switches_that_can_share_their_common_pin(part, devices):
    assert _with_part(part, *devices).coils == ("one",)


@pytest.mark.parametrize(("part", "devices", "who"), [
    # S1A to S4A have one drain DA: it cannot be end a and end b, nor ground and INB
    ("ADG739", [MIXED], r"U1 \(ADG739\): S1A from one.a to ground and S2A from one.b to INB"),
    ("ADG738", [" ".join(ENDS)], r"U1 \(ADG738\): S1 from one.a .* and S4 from one.b to INB"),
    ("ADG738", [ENDS[0], "b-ground a-INB b-INB"], r"U2 \(ADG738\): S1 from one.b .* and S2 from one.a to INB"),
])  # fmt: skip
def test_switches_that_cannot_are_refused_by_name(part, devices, who):
    with pytest.raises(HardwareError, match=f"small: wiring small, {who} share a common pin, which cannot be both"):
        _with_part(part, *devices)
