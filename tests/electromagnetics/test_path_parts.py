"""Parts of paths make up the path, images of one another are found, and sums by parts are those of whole paths."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from coilarray import Conductor, inductance_matrix, load_design, mutual_inductance
from coilarray.design.vary import vary
from coilarray.electromagnetics.kernels.paths import mutual_sum, own_mutual_sum
from coilarray.electromagnetics.neumann import (
    MUTUAL_NEAR_WIDTHS,
    OWN_NEAR_WIDTHS,
    find_parts,
    segment_table,
)

QUANTUM = 1e-13
COIL = load_design("starter").array.conductors()[0]
SIGNS = st.tuples(*(st.sampled_from([1.0, -1.0]) for _ in range(3)))


def vertices(table):
    return np.vstack((table[:, :3], table[-1, :3] + table[-1, 3:6] * table[-1, 6]))


def image(conductor, mirror, turned=False, shift=(0.0, 0.0, 0.0)):
    """Mirrored at the origin, then moved; `turned` in the direction of the current."""
    order = slice(None, None, -1 if turned else 1)
    vertices = (conductor.vertices * mirror)[order] + shift
    return Conductor(vertices, conductor.widths[order], conductor.thicknesses[order])


def whole(first, second):
    """The sum over two whole paths in H."""
    a, b = segment_table(first), segment_table(second)
    return 1e-7 * mutual_sum(a, b, second.vertices[0] - first.vertices[0], 0, len(a), MUTUAL_NEAR_WIDTHS, 0)


@settings(max_examples=30)
@given(SIGNS, st.booleans(), st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3))
def test_parts_make_up_their_paths(mirror, turned, shift):
    helix = Conductor(np.random.default_rng(3).uniform(0, 1e-2, (9, 3)), 1e-4, 1e-5)
    paths = [COIL, helix, image(COIL, mirror, turned, shift), image(helix, mirror, turned, shift)]
    tables = [segment_table(path) for path in paths]
    parts = find_parts(tables, np.full(4, QUANTUM))
    assert parts.first.tolist() == [0, 3, 4, 7, 8]  # layer, via, layer; and what lies at no one height
    assert len(parts.tables) == 3  # whatever the mirror
    assert parts.flat.tolist() == [True, False, False]
    assert parts.upright.tolist() == [False, True, False]
    for k, table in enumerate(tables):
        found = []
        for p in range(parts.first[k], parts.first[k + 1]):
            points = vertices(parts.tables[parts.number[p]]) * parts.mirror[p] + parts.origin[p]
            found.append(points[:: int(parts.sign[p])])
        assert all(np.abs(b[0] - a[-1]).max() < 3 * QUANTUM for a, b in itertools.pairwise(found))
        joined = np.concatenate([found[0], *(points[1:] for points in found[1:])])
        np.testing.assert_allclose(joined, vertices(table), atol=2 * QUANTUM, rtol=0)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    SIGNS, st.booleans(), st.tuples(*[st.sampled_from([0.0, 13e-3, -13e-3]) | st.floats(-0.02, 0.02)] * 2),
    st.sampled_from([0.5e-3, -0.6e-3, 1.2e-3]),
)  # fmt: skip
def test_sums_by_parts_are_those_of_whole_paths(mirror, turned, aside, up):
    other = image(COIL, mirror, turned, (*aside, up))
    heights = [np.unique(path.vertices[:, 2]) for path in (COIL, other)]
    assume(np.abs(np.subtract.outer(*heights)).min() > 0.1e-3)  # not into each other's copper
    own = 1e-7 * own_mutual_sum(segment_table(COIL), 0, len(COIL.lengths), OWN_NEAR_WIDTHS, 0)
    # of a pair of nearly parallel bars the lateral direction is the first one's, and which that is depends on the parts
    # that stand for them: measured up to 3e-8 of L
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("coilarray.electromagnetics.neumann.MOST_NODES", 0)  # none by equivalent currents
        assert mutual_inductance(COIL, other)[0, 0] == pytest.approx(whole(COIL, other), abs=1e-7 * own, rel=0)


@pytest.mark.parametrize("accuracy", ["full", "screen"])
@pytest.mark.parametrize("layers", [1, 2, 3, 4])
def test_matrices_by_parts_are_those_of_whole_paths(monkeypatch, layers, accuracy):
    changes = {"coils.hexagon.winding_layers": layers, "coils.hexagon.turns_per_layer": 4, "array.pitch_mm": 40.0}
    sets = [["L1", "L2", "L3", "L4"][:layers]]
    coil = vary(load_design("starter"), {**changes, "array.layers": sets}).array.conductors()[0]
    places = [(1, 1, 1, 0, 0, 0), (1, 1, 1, 9e-3, 4e-3, 2e-3), (-1, 1, 1, -8e-3, 0, 4e-3), (-1, -1, -1, 0, 9e-3, 6e-3)]
    coils = [image(coil, place[:3], k == 2, place[3:]) for k, place in enumerate(places)]
    L = inductance_matrix(coils, accuracy=accuracy)
    monkeypatch.setattr("coilarray.electromagnetics.neumann.MOST_PARTS", 1)  # none is cut
    whole = inductance_matrix(coils, accuracy=accuracy)
    # as above; screening's rules act along the turns of the winding that comes second
    np.testing.assert_allclose(L, whole, atol=(1e-7 if accuracy == "full" else 1e-4) * L[0, 0], rtol=0)


def test_a_wire_across_a_loop_has_no_part_in_it():
    loop = Conductor([[0, 0, 0], [1e-2, 0, 0], [1e-2, 1e-2, 0], [0, 1e-2, 0], [0, 1e-4, 0]], 1e-4, 1e-5)
    assert mutual_inductance(loop, Conductor([[4e-3, 6e-3, -5e-3], [4e-3, 6e-3, 5e-3]], 1e-4, 1e-5))[0, 0] == 0.0
