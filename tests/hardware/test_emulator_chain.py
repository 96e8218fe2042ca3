"""The emulated switches: what the chain shifts and latches, what breaks it, and what the converter then sees.

Who checks whom: the nets found by joining nodes against the direct currents of a network of resistors; a whole board
against both bundled wirings, whose words come from `coilarray.hardware.scan.wiring`.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.quick_coils import plain_board

from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.emulator.board import EmulatedChain, VirtualClock
from coilarray.hardware.scan.wiring import WiredSwitch, load_wiring, switch_table, what_is_seen

COILS = ("coil1", "coil2", "coil3", "coil4", "coil5", "coil6")
SENT = b"\x22\x11\x11\x11\x11\x11"
GROUND_A, INA_A, INB_A, OTHER_A, GROUND_B, INB_B, INA_B, OTHER_B = range(8)  # bits of a word of one device a coil


def plan_b(coils=6):
    """The switch_table of the facts: one device a coil, the last coil's at the far end."""
    pairs = ((0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (1, 2), (1, 1), (1, 3))  # ends and nets
    return switch_table(bytes(4 * (2 * coil + end) + net for coil in reversed(range(coils)) for end, net in pairs))


def seen(words, chain=None):
    chain = chain or EmulatedChain(plan_b(), VirtualClock())
    chain.transfer(bytes(words))
    return what_is_seen(chain.closed(), COILS)


def words(**bytes_of):
    """Words by coil; all others are grounded."""
    return bytes(bytes_of.get(name, 0x11) for name in reversed(COILS))


@pytest.fixture
def chain():
    return EmulatedChain(plan_b(), VirtualClock())


@pytest.fixture
def board():
    return plain_board(load_wiring())


def test_all_switches_are_open_after_power_up(chain):
    assert (chain.words, chain.closed()) == (bytes(6), ())
    chain.transfer(b"\x11" * 6)
    assert len(chain.closed()) == 12
    chain.transfer(bytes([0x22, 0, 0, 0, 0, 0]))  # the first byte goes to the far end and the last coil
    assert chain.closed() == (WiredSwitch((5, 0), "INA"), WiredSwitch((5, 1), "INB"))


@given(st.binary(min_size=6, max_size=6), st.binary(min_size=6, max_size=6))
def test_what_went_in_comes_out_at_the_next_transfer(first, second):
    chain = EmulatedChain(plan_b(), VirtualClock())
    assert (chain.transfer(first), chain.transfer(second), chain.words) == (bytes(6), first, second)
    assert EmulatedChain(plan_b(), VirtualClock(), readback=False).transfer(first) is None


@pytest.mark.parametrize(("mode", "slips"), [(1, 0), (2, 0), (0, 1), (3, 1)])
def test_modes_of_spi_that_are_not_stable_at_the_falling_edge_slip_by_a_bit(chain, mode, slips):
    chain.mode = mode
    chain.transfer(SENT)
    assert int.from_bytes(chain.words) == int.from_bytes(SENT) >> slips
    assert (chain.transfer(SENT) == SENT) == (not slips)


def test_a_wiring_has_eight_bytes_a_device_and_unused_switches_close_nothing():
    for length in (0, 7, 9):
        with pytest.raises(HardwareError, match="8 bytes a device"):
            switch_table(bytes(length))
    chain = EmulatedChain(switch_table(bytes([0x00, *[0xFF] * 7])), VirtualClock())
    chain.transfer(b"\xff")
    assert chain.closed() == (WiredSwitch((0, 0), "ground"),)


STUCK = {
    # state of the switch, which it is, what the converter then sees when coil1 is measured
    "measured, open": ("open", (0, 0, "INA"), "open", None),
    "measured, grounded": ("closed", (0, 0, "ground"), "grounded", None),
    "measured, joined to the other pin": ("closed", (0, 0, "INB"), "short", None),
    "idle, one end free": ("open", (1, 0, "ground"), "coils", "ground other end"),
    "idle, other end free": ("open", (1, 1, "ground"), "coils", "ground one end"),
    "idle, on a pin": ("closed", (1, 0, "INA"), "grounded", None),
    "idle, on a spare net": ("closed", (1, 0, "other"), "coils", "ground"),
}


@pytest.mark.parametrize("case", STUCK)
def test_what_a_stuck_switch_does(chain, case):
    state, switch, kind, passive = STUCK[case]
    chain.stick(*chain.find(*switch), state)
    found = seen(words(coil1=0x22), chain)
    assert found.kind == kind
    if passive:
        assert found.state.exceptions["coil2"] == passive
        assert found.state.exceptions["coil3"] == "ground"
    chain.heal()
    assert what_is_seen(chain.closed(), COILS).state.exceptions["coil2"] == "ground"


def test_one_coil_and_what_closes_the_others():
    # both ends of coil2 on INA: it is a shorted one
    state = seen(words(coil1=0x22, coil2=0x42)).state
    assert (state.measured, state.exceptions["coil2"]) == ((("coil1", 1),), "ground")
    found = seen(words(coil2=0x22, coil3=0x00, coil4=0x01, coil5=0x10))
    assert (found.kind, found.state.measured) == ("coils", (("coil2", 1),))
    assert dict(found.state.exceptions) == {
        "coil1": "ground", "coil3": "open", "coil4": "ground one end", "coil5": "ground other end", "coil6": "ground",
    }  # fmt: skip


@pytest.mark.parametrize(("commanded", "connection", "measured"), [
    ({"coil2": 0x44}, "series", (("coil2", -1),)),  # turned round
    ({"coil2": 0x22, "coil5": 0x44}, "parallel", (("coil2", 1), ("coil5", -1))),
    # end a of coil1 on INA, end b of both on the spare net, end a of coil3 on INB
    ({"coil1": 0x02 | 0x80, "coil3": 0x04 | 0x80}, "series", (("coil1", 1), ("coil3", -1))),
])  # fmt: skip
def test_coils_each_with_its_sense(commanded, connection, measured):
    state = seen(words(**commanded)).state
    assert (state.connection, state.measured) == (connection, measured)


def resistances(closed, coils):
    """Direct-current resistances in Ω between the pins and from each to ground, with 1 Ω a coil and next to none a
    switch, and the number of coils that carry the current from pin to pin: Kirchhoff's laws by the pseudo-inverse of
    the conductance matrix."""
    names = ["ground", "INA", "INB", "other", *((coil, end) for coil in range(coils) for end in range(2))]
    nodes = {name: k for k, name in enumerate(names)}
    G = np.zeros((len(nodes), len(nodes)))
    branches = [((c, 0), (c, 1), 1.0) for c in range(coils)] + [(s.terminal, s.net, 1e6) for s in closed]
    for a, b, conductance in branches:
        i, j = nodes[a], nodes[b]
        G[np.ix_([i, j], [i, j])] += conductance * np.array([[1, -1], [-1, 1]])
    inverse = np.linalg.pinv(G, rcond=1e-12, hermitian=True)

    def between(a, b):
        e = np.zeros(len(nodes))
        e[nodes[a]], e[nodes[b]] = 1, -1
        potential = inverse @ e
        # without a path the currents do not balance
        return (float(e @ potential) if np.allclose(G @ potential, e, atol=1e-3) else np.inf), potential

    across, potential = between("INA", "INB")
    carrying = sum(abs(potential[nodes[c, 0]] - potential[nodes[c, 1]]) > 1e-3 for c in range(coils))
    return across, between("INA", "ground")[0], between("INB", "ground")[0], carrying


@settings(max_examples=60)
@given(st.lists(st.sampled_from([0, 0x11, 0x22, 0x44, 0x01, 0x02, 0x12, 0x82, 0x28, 0x84, 0x88, 0x24]), min_size=3,
                max_size=3), st.sets(st.tuples(st.integers(0, 2), st.integers(0, 7)), max_size=2))  # fmt: skip
def test_nets_against_direct_currents(commanded, also_closed):
    chain = EmulatedChain(plan_b(3), VirtualClock())
    chain.transfer(bytes(commanded))
    for device, bit in also_closed:
        chain.stick(device, bit, "closed")
    found = what_is_seen(chain.closed(), COILS[:3])
    across, a, b, carrying = resistances(chain.closed(), 3)
    if across < 0.01:
        assert found.kind == "short"
    elif min(a, b) < np.inf:
        assert found.kind == "grounded"
    elif across == np.inf:
        assert found.kind == "open"
    elif found.kind == "coils":
        assert len(found.state.measured) == carrying
        assert across == pytest.approx(carrying if found.state.connection == "series" else 1 / carrying, rel=1e-3)
    else:
        assert found.kind == "tangled"
        assert not np.isclose(across, [carrying, 1 / carrying], rtol=1e-3).any()


@settings(max_examples=40)
@given(st.sampled_from(["six_coils", "six_coils_4"]), st.integers(0, 5), st.sampled_from([1, -1]),
       st.lists(st.sampled_from(["ground", "ground one end", "ground other end", "open"]), min_size=6,
                max_size=6))  # fmt: skip
def test_every_legal_state_is_seen_as_it_was_meant(name, measured, sense, others):
    wiring = load_wiring(name)
    coils = wiring.coils
    exceptions = {coil: passive for coil, passive in zip(coils, others, strict=True) if coil != coils[measured]}
    state = ScanState("a", ((coils[measured], sense),), exceptions=exceptions)
    try:
        sent = wiring.words(state)
    except HardwareError:
        assert (name, sense) == ("six_coils_4", -1)  # it cannot turn a coil round
        return
    board = plain_board(wiring)
    board.chain.shift(sent)
    found = board.seen.state
    assert (found.measured, dict(found.exceptions)) == (state.measured, exceptions)
    board.chain.shift(wiring.safe_words)
    assert (board.seen.kind, board.misuse.notes) == ("open", [])


def test_words_that_ground_the_converter_are_noted_but_a_stuck_switch_is_nobodys_misuse(board):
    board.chain.stick(*board.chain.find(0, 0, "ground"), "closed")
    board.chain.shift(words(coil1=0x22))
    assert (board.seen.kind, board.misuse.notes) == ("grounded", [])
    board.chain.shift(words(coil1=0x23))
    assert "grounded" in board.misuse.notes[0]


def test_shifting_takes_time_and_a_broken_line_brings_zeros(board):
    board.chain.shift(b"\x11" * 6)
    assert board.clock.now() == pytest.approx(48 / 8e6)
    board.chain.broken = True
    assert board.chain.shift(b"\x11" * 6) == b"\x11" * 6  # what was there before
    assert board.chain.shift(b"\x11" * 6) == bytes(6)
