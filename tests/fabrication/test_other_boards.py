"""One coil as other people and programs draw it: always the same inductance.

Who checks whom: boards written by board_text.py or here against the coil of tracks, whose inductance is that of its
path (0.2514 µH, also by the current sheet of Mohan within 2 %).
"""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from support.board_text import board, segment, via
from support.refusals import refused

from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.errors import BoardError
from coilarray.fabrication.tracing import trace_coils, traced_array

CORNERS = [
    (-8, -8), (8, -8), (8, 8), (-7, 8), (-7, -7), (7, -7), (7, 7), (-6, 7), (-6, -6), (6, -6), (6, 6), (-5, 6), (-5, -5)
]  # fmt: skip
PATH = 0.2514  # µH of these three turns, 0.3 mm wide


def tracks(*points, **options):
    return "\n".join(segment(a, b, **{"width": "0.3", **options}) for a, b in pairwise(points))


def on_sheet(x, y):
    """Place as KiCad has it, with the drill origin of `board` at (100, 100)."""
    return f"{100 + x:g} {100 - y:g}"


def drawn(kind, points=CORNERS, layer="F.Cu", place=on_sheet):
    """Lines of the board (gr) or of a footprint (fp) from point to point."""
    return "\n".join(
        f'({kind}_line (start {place(*a)}) (end {place(*b)}) (stroke (width 0.3) (type solid)) (layer "{layer}"))'
        for a, b in pairwise(points)
    )


def pad(number, x, y, net='1 "A"', place=on_sheet):
    """Surface pad of 1 mm."""
    return f'(pad "{number}" smd rect (at {place(x, y)}) (size 1 1) (layers "F.Cu") (net {net}))'


def footprint(name, *items):
    return f'(footprint "x" (layer "F.Cu") (at 0 0) (property "Reference" "{name}") {" ".join(items)})'


def polygon(shape):
    """Shape in mm as a drawn polygon with no line."""
    points = " ".join(f"(xy {on_sheet(x, y)})" for x, y in shape.exterior.coords[:-1])
    return f'(gr_poly (pts {points}) (width 0) (fill solid) (layer "F.Cu"))'


def found(read, *items, **options):
    """Coils of a board, with their inductances in µH and notes."""
    copper = read(board(*items, **options))
    coils = trace_coils(copper).coils
    traced = traced_array(copper, coils)
    return coils, np.diag(inductance_matrix(traced.array.conductors())) * 1e6, traced.notes


COIL = tracks(*CORNERS)
PADS = pad(1, -8, -8), pad(2, -5, -5, '2 "B"')
RIBBON = shapely.LineString(CORNERS).buffer(0.15, cap_style="square", join_style="mitre")
IN_PAD = drawn("gr", place=lambda x, y: f"{x + 8} {-y - 8}")
CUSTOM = pad(1, -8, -8).replace("smd rect", "smd custom").replace("(net", f"(primitives {IN_PAD}) (net")
VARIANTS = {
    "tracks": (COIL,),
    "lines of the board": (drawn("gr"),),
    "lines of a footprint that ties two nets": (footprint("L1", drawn("fp"), *PADS),),
    "lines in a custom pad": (footprint("L1", pad(2, -5, -5), CUSTOM),),
    "a whisker inside other copper": (COIL, tracks((8, -8), (8.05, -8))),
    "an end that other copper covers": (tracks(*CORNERS[:6], (7, 2)), tracks((7.1, 2.1), (7, 7), *CORNERS[7:])),
    "an end short of a pad's middle": (COIL, footprint("J1", pad(1, -8.2, -8))),
    "a region that holds an end": (COIL, polygon(shapely.box(-8.5, -8.5, -7.5, -7.5))),
    "a branch to an open end": (COIL, tracks((8, 0), (12, 0))),
    "arcs beside straight pieces": (tracks(*CORNERS[:4]), drawn("gr", CORNERS[3:])),
    "the tracks twice": (COIL, tracks(*[(x + 0.02, y) for x, y in CORNERS])),
}  # fmt: skip


@pytest.mark.parametrize("items", VARIANTS.values(), ids=VARIANTS)
def test_however_it_is_drawn_it_is_the_same_coil(read, items):
    (coil,), (L,), _ = found(read, *items)
    assert abs(coil.turns) == pytest.approx(3, abs=0.05)
    assert pytest.approx(PATH, rel=2e-3) == L


@pytest.mark.slow
def test_a_polygon_is_followed_along_its_centre(read):
    (coil,), (L,), _ = found(read, polygon(RIBBON))
    assert abs(coil.turns) == pytest.approx(3, abs=0.05)
    assert pytest.approx(PATH, rel=4e-3) == L  # the centre line cuts the corners by a tenth of the width


def test_branches_are_cut_off_and_named(read):
    lead = tracks((-8, -8), (-8, -10), (-11, -10)), tracks((-8, -10), (-8, -14))
    parts = footprint("C1", pad(1, -11, -10)), footprint("U3", pad(7, -8, -14))
    (coil,), (L,), notes = found(read, COIL, *lead, *parts)
    assert coil.length == pytest.approx(164e-3)
    assert PATH <= L <= 0.2543
    assert "A: what leads on to C1.1 and U3.7 is left out." in notes
    # copper that overlaps by its round end is a lead as well
    _, (L,), _ = found(read, COIL, tracks((-8, -8.3), (-8, -12), width="1"))
    assert pytest.approx(0.2518, abs=5e-5) == L


def test_a_via_short_of_its_middle_joins_layers(read):
    """The track on the back ends 0.1 mm beside the via."""
    (coil,), (L,), _ = found(read, COIL, via(-5, -5), tracks((-5, -5.1), (-5, -12), layer="B.Cu"))
    assert coil.layers == ("F.Cu", "B.Cu")
    assert pytest.approx(0.2617, abs=2e-4) == L


def test_a_star_gives_its_phases(read):
    """Three coils that end in one point, from three pads."""
    arms, ends = [], []
    for k in range(3):
        turn = np.exp(2j * np.pi * k / 3)
        places = np.array([complex(-x, -y) - 14j for x, y in CORNERS[::-1]]) * turn
        arms.append(tracks(*[(round(at.real, 4), round(at.imag, 4)) for at in places], (0, 0)))
        ends.append(footprint(f"P{k}", pad(1, round(places[0].real, 4), round(places[0].imag, 4))))
    coils, L, _ = found(read, *arms, *ends)
    assert [coil.name for coil in coils] == ["A", "A_2", "A_3"]
    assert [abs(coil.turns) for coil in coils] == pytest.approx([3] * 3, abs=0.2)
    assert pytest.approx(L[0], rel=2e-3) == L[1:]


def test_wide_copper_in_the_way_is_bridged_with_its_error_or_refused_by_name(read):
    wide = polygon(shapely.box(-2, -8.6, 2, -7.4))
    ends = tracks((-8, -8), (-1.9, -8)), tracks((1.9, -8), *CORNERS[1:])
    (coil,), (L,), notes = found(read, *ends, wide)
    assert abs(coil.turns) == pytest.approx(3, abs=0.05)
    assert pytest.approx(PATH, rel=5e-3) == L
    assert any("is crossed the shortest way, 3.8 mm; its inductance is wrong by at most" in note for note in notes)
    bent = polygon(shapely.box(-2, -13, 2, -7.4) - shapely.box(-0.5, -11, 0.5, -6))
    refused(BoardError, "is wide, bent, and in the way of the current", found, read, *ends, bent)


def test_a_figure_eight_is_one_coil_of_two_windings(read):
    left = [(-9, 2)]
    for d in 0.8 * np.arange(5):
        left += [(-9 - d, -2.8 - d), (-4.2 + d, -2.8 - d), (-4.2 + d, 2.8 + d), (-9.8 - d, 2.8 + d)]
    (coil,), (L,), _ = found(read, tracks(*left, (-13, 8), (13, 8), *[(-x, y) for x, y in left[::-1]]))
    assert [pole.turns for pole in coil.poles] == pytest.approx([4.97, 4.97], abs=0.02)
    assert pytest.approx(0.5425, abs=2e-4) == L
