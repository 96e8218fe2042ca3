"""Designs made in Python: plain values whose identity is computed, and which can be written as a document.

Checked against each other: a design and that of its document; one made in Python and the same one in a file.
"""

import math
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, round_spiral
from support.boards import VIA as BOARD_VIA
from support.refusals import refused

import coilarray as ca
from coilarray import geometry
from coilarray.circuit.coupling import design_circuit
from coilarray.design.bundled import names
from coilarray.design.model import build_design, build_design_file
from coilarray.design.write import design_text
from coilarray.studies.tolerance.tolerances import perturb

VIA = ca.PlatedHole(0.25e-3, 0.5e-3)
TWO_LAYERS = ca.Stackup(("L1", "L2"), (35e-6, 35e-6), (0.2e-3,), (4.5,))
SPIRAL = ca.Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3, leads=None).coil()
ROW = ca.Design(ca.lattice_array(TWO_LAYERS, SPIRAL, ca.Lattice("linear", pitch=20e-3, columns=3)))


def gast2020_in_python():
    """The bundled design, written with the numbers of its file; what its calibration finds is read there."""
    file = ca.load_design_file("gast2020").values
    dielectrics = tuple(mm * 1e-3 for mm in file["stackup.dielectric_thickness_mm"])
    hexagon = ca.Spiral(
        6, 23e-3, 30, 0.1e-3, file["coils.hexagon.gap_mm"] * 1e-3, first_corner=math.pi / 2, winding_rule="corner"
    )
    row = ca.Lattice("linear", 13.28e-3, columns=6, layers=(("L3", "L4"), ("L1", "L2")))
    magnetic = ca.Sheet(
        "magnetic", 2e-3, file["elastomer.1.relative_permeability"], file["elastomer.1.youngs_modulus_kPa"] * 1e3
    )
    seat = geometry.Seat(file["indentation.seat_stiffness_kPa_per_mm"] * 1e6)
    x, y = (tuple(k * 2e-3 for k in range(first, last + 1)) for first, last in ((-13, 33), (-7, 7)))
    switches = ca.Switches(on_resistance=file["circuit.short_resistance_ohm"] / 2)
    return ca.Design(
        ca.lattice_array(
            replace(FOUR_LAYERS, dielectric_thickness=dielectrics), replace(hexagon, via=BOARD_VIA).coil(), row
        ),
        (ca.Sheet("base", 6e-3, 1.0, 55e3), magnetic),
        ca.Indentation(
            ca.Hemisphere(2.5e-3), (1e-3,), x, y, seat, origin="coil2", ellipse_bounds=(-26e-3, -6e-3, 26e-3, 6e-3)
        ),
        ca.Circuit(switches, elastomer_permittivity=file["circuit.elastomer_permittivity"]),
        ca.FabRules(min_gap=file["fab.min_gap_mm"] * 1e-3),
    )


def awkward():
    """A design of everything that a file says in another way, or that only Python makes."""
    tapered = ca.path_coil(
        [[(0, 0), (4e-3, 0), (4e-3, math.pi * 1e-3)], [(4e-3, math.pi * 1e-3), (1e-3, 1e-3)]],
        [[0.2e-3, 0.35e-3], [0.3e-3]],
        0.25e-3,
        ca.PlatedHole(0.25e-3, 0.5e-3, 20e-6),
        ca.PlatedHole(0.5e-3, 1e-3, 30e-6),
    )
    leads = geometry.Leads(2e-3, 1.5e-3, ca.PlatedHole(0.5e-3, 1e-3, 30e-6))
    built = {"winding": "cw", "layers": 3, "leads": leads, "return_lead": True}
    circle = round_spiral(20e-3 / 3, 5, 0.1e-3, 0.1e-3, direction=0.1, **built).coil()
    square = ca.Coil(tapered.lines, tapered.widths, tapered.gap, VIA, None, np.array([[0, 0], [5e-3, 0], [5e-3, 4e-3]]))
    placements = (
        ca.Placement("tapered", tapered, ("L1", "L2"), 1.23456789e-3, -2e-3, 0.3),
        ca.Placement("circle", circle, ("L1", "L2", "L3", "L4"), 20e-3 / 3, 0, -2.0),
        ca.Placement("square", square, ("L3", "L4"), 50e-3, 10e-3),
    )
    scan = (
        ca.ScanState("pair", (("tapered", 1), ("circle", -1)), "parallel", "load", {"square": "open"}, 75.0),
        ca.ScanState("one", (("square", 1),), others="ground one end"),
    )
    return ca.Design(
        ca.Array(FOUR_LAYERS, placements, 0.5e-3, through_holes=False),
        (ca.Sheet("soft", 1e-2 / 3, youngs_modulus=1e5 / 3),),
        ca.Indentation(
            geometry.Cone(1.0, 2e-3), (0.1e-3, 0.3e-3), (-1e-3, 0.0, 5e-3), (0.7e-3,), geometry.Seat(1e7 / 3, 2e5),
            origin_point=(1e-3 / 7, 2e-3), sample_radius=30e-3, sample_bounds=(-40e-3, -20e-3, 40e-3, 20e-3),
            ellipse_bounds=(-7e-3, -6e-3, 7e-3, 6e-3),
            strain="linear",
        ),
        ca.Circuit(
            ca.Switches(2.5, 1e-12, 42e-12, 55e-12, 3e-9, 330e-12, "coil"), 1.8e-8, {"square": "load"},
            "ground one end", scan, 3.3,
        ),
        ca.FabRules(0.12e-3, max_layers=4, max_board=(0.4, 0.5), blind_holes=False),
        field_height=1e-3, name="awkward", title="All that is odd", source="a test",
    )  # fmt: skip


def same_text(design):
    return ca.parse_design(design_text(design), design.name)


@pytest.mark.parametrize("name", names())
def test_the_document_of_a_bundled_design_has_the_keys_and_values_of_its_file(name):
    file = ca.load_design_file(name)
    again = build_design_file(ca.design_document(file.design), name)
    assert again.design.digest == file.design.digest == same_text(file.design).digest
    # a design has the limits of a profile, not its name
    values = {key: value for key, value in file.values.items() if key != "fab.profile"}
    assert again.values == values
    assert set(again.assumed) <= {"fab.min_bend_ratio"}  # which a bent board has by default
    again = build_design_file(ca.design_document(again.design), name)
    assert again.values == values


@pytest.mark.parametrize("design", [
    ROW, gast2020_in_python(), awkward(), replace(ca.load_design("gast2020"), sheets=()),
    perturb(ca.load_design("starter"), {"etch.L1": 3e-6, "rotation.L3": 1e-3, "placement_x": 1e-4, "capacitance": 0.1}),
    ca.Design(ca.Array(TWO_LAYERS, (ca.Placement("a b", SPIRAL, ("L1", "L2"), 0, 0),)), name="with a space"),
], ids=["row", "gast2020", "awkward", "bare", "perturbed", "names"])  # fmt: skip
def test_any_design_is_that_of_its_document(design):
    again = build_design(ca.design_document(design))
    if all(name == other for name, other in zip(design.array.names, again.array.names, strict=True)):
        assert again.digest == design.digest
    assert build_design(ca.design_document(again)).digest == again.digest
    assert same_text(design).array.names == again.array.names  # to 1 nm, as the text is written
    assert pickle.loads(pickle.dumps(design)).digest == design.digest


lengths = st.floats(0.05e-3, 0.3e-3)


@pytest.mark.slow
@settings(max_examples=20)
@given(
    kind=st.sampled_from(["single", "linear", "square", "hexagonal", "triangle", "rings", "free"]),
    pitch=st.floats(5e-3, 40e-3),
    angles=st.tuples(st.floats(-7, 7), st.floats(-7, 7), st.floats(-7, 7)),
    sizes=st.tuples(lengths, lengths, st.floats(5e-3, 20e-3)),
    shape=st.sampled_from(["4", "6", "7", "circle", "rounded", "rectangle", "racetrack"]),
    values=st.tuples(st.floats(1e-12, 1e-9), st.floats(0, 50), st.floats(1e-4, 1e-2), st.floats(1, 10)),
)
@example(  # a direction near zero, written as that of a corner 36° away
    "single", 31.25e-3, (9.355000582319652e-05, 0, 0), (0.3e-3, 0.1e-3, 12e-3), "rounded", (1e-9, 0, 8e-3, 1)
)
def test_all_digits_stand_in_the_document(kind, pitch, angles, sizes, shape, values):
    width, gap, apothem = sizes
    capacitance, resistance, thickness, permeability = values
    turns = (3, width, gap)
    if shape.isdecimal():
        spiral = ca.Spiral(int(shape), 2 * apothem, *turns, angles[0])
    elif shape in ("circle", "rounded"):
        radius, sides = (apothem, 4) if shape == "circle" else (apothem / 3, 5)
        spiral = ca.RoundedSpiral(2 * apothem, 2 * apothem, *turns, radius, sides, angles[0])
    else:
        radius = apothem if shape == "racetrack" else apothem / 7
        spiral = ca.RoundedSpiral(3 * apothem, 2 * apothem, *turns, radius, direction=math.pi / 2)
    coil = replace(spiral, leads=None).coil()
    if kind == "free":
        places = tuple(ca.Placement(f"c{k}", coil, ("L1", "L2"), k * pitch, -pitch / 3, angles[k]) for k in range(2))
        array = ca.Array(TWO_LAYERS, places)
    else:
        columns, rows = {"single": (1, 1), "rings": (1, 1), "linear": (3, 1), "triangle": (3, 1)}.get(kind, (3, 3))
        layers, rings = (("L1", "L2"), ("L2", "L1")), int(kind == "rings")
        lattice = ca.Lattice(kind, pitch, columns, rows, layers, angles[1], angles[2], rings=rings)
        array = ca.lattice_array(TWO_LAYERS, coil, lattice)
    circuit = ca.Circuit(ca.Switches(resistance, tank_capacitance=capacitance))
    design = ca.Design(array, (ca.Sheet("s", thickness, permeability),), circuit=circuit)
    document = ca.design_document(design)
    assert document["array"]["lattice"] == kind
    assert build_design(document).digest == design.digest


def test_a_design_made_in_python_is_the_one_in_the_file():
    file, made = ca.load_design("gast2020"), gast2020_in_python()
    assert made.digest == file.digest == replace(file, name="x", title="y", source="z").digest
    assert (made.name, made.title) == ("design", "")  # which do not count
    moved = made.array.with_placements([replace(made.array.placements[0], x=-0.03321), *made.array.placements[1:]])
    assert replace(made, array=moved).digest != file.digest


@pytest.mark.parametrize("change", [
    {"sheets": ()}, {"indentation": None}, {"field_height": 5e-3}, {"rules": ca.FabRules(0.2e-3)},
    {"circuit": ca.Circuit()}, {"circuit": ca.Circuit(default_termination="open")},
], ids=str)  # fmt: skip
def test_what_is_replaced_is_another_design(change):
    design = ca.load_design("gast2020")
    assert replace(design).digest == design.digest
    other = replace(design, **change)
    assert other.digest != design.digest
    assert build_design(ca.design_document(other)).digest == other.digest


def test_the_lattice_is_a_hint_that_is_not_believed():
    array = ROW.array
    shifted = array.with_placements([replace(place, x=place.x + 1e-3) for place in array.placements])
    assert shifted.lattice is not None
    assert ca.design_document(replace(ROW, array=shifted))["array"]["lattice"] == "free"
    wider = replace(array, board_margin=3e-3)
    assert ca.design_document(replace(ROW, array=wider))["array"]["lattice"] == "linear"
    assert replace(SPIRAL, lines=SPIRAL.lines).wound is None  # lines that are given are not taken for a spiral's


def test_the_origin_follows_its_coil():
    design = ca.load_design("gast2020")
    moved = design.array.with_placements([replace(place, x=place.x + 1e-3) for place in design.array.placements])
    there = replace(design, array=moved).indentation.origin_point
    assert there == pytest.approx(np.add(design.indentation.origin_point, (1e-3, 0)), abs=1e-15)


def test_an_indentation_that_cannot_be():
    ball = ca.Hemisphere(1e-3)
    refused(ca.errors.DesignError, "at least one depth", ca.Indentation, ball, ())
    refused(ca.errors.DesignError, "must rise from above zero", ca.Indentation, ball, (2e-3, 1e-3))
    pressed = ((ca.Sheet("s", 1e-2, 1.0, 1e4),), ca.Indentation(ball, (1e-3,), origin="x"))
    refused(ca.errors.DesignError, "names no coil", ca.Design, ROW.array, *pressed)


def test_a_map_covers_the_array_where_no_positions_are_given():
    """Over the outlines of all coils, to less than a step; of another array over that one; written as not given."""
    pressed = ca.Indentation(ca.Hemisphere(1e-3), (1e-3,), origin="coil2")
    design = replace(ROW, sheets=(ca.Sheet("s", 1e-2, 1.0, 1e4),), indentation=pressed)
    for array in (
        design.array,
        design.array.with_placements([replace(p, y=p.y + p.x / 3) for p in ROW.array.placements]),
    ):
        setup = replace(design, array=array).indentation
        step = setup.x[1] - setup.x[0]
        edges = np.reshape(array.outline_bounds, (2, 2)) - setup.origin_point
        for k, axis in enumerate((setup.x, setup.y)):
            assert -step < axis[0] - edges[0, k] <= 1e-9
            assert -1e-9 <= axis[-1] - edges[1, k] < step
            np.testing.assert_allclose(np.array(axis) / step, np.rint(np.array(axis) / step), atol=1e-9)
        assert 3 <= 16e-3 / step <= 13  # of a coil's 16 mm
    written = design_text(design)
    assert not re.search(r"^(x|y|step)_(mm|positions_mm) =", written, re.MULTILINE)
    assert same_text(design).indentation == design.indentation
    coarse = ca.parse_design(written.replace('origin = "coil2"', 'origin = "coil2"\nstep_mm = 4'), "coarse").indentation
    assert coarse.x[1] - coarse.x[0] == pytest.approx(4e-3)
    chosen = replace(design, indentation=replace(design.indentation, x=(0.0,), y=(0.0,))).indentation
    assert (chosen.x, chosen.y) == ((0.0,), (0.0,))
    # the contact stays on a sample with sides
    small = replace(pressed, sample_bounds=(-10e-3, -6e-3, 8e-3, 6e-3))
    setup = replace(design, indentation=small).indentation
    assert -10e-3 < setup.x[0] - 1e-3 < setup.x[-1] + 1e-3 < 8e-3
    off = replace(design, indentation=replace(pressed, sample_bounds=(0.9, 0.9, 0.91, 0.93))).indentation
    assert (off.x, off.y) == ((0.905,), (0.915,))  # its middle, which the response refuses


@pytest.mark.parametrize(
    "compute",
    [
        lambda design: ca.couple_design(design, ideal=True).frequency.values.tolist(),
        lambda design: ca.noise_budget(design, network=design_circuit(ca.load_design("starter"), ideal=True)).sigma,
        ca.design_document,
    ],
)
def test_a_file_stands_for_its_design_and_a_name_is_refused(compute):
    file = ca.load_design_file("starter")
    assert np.all(compute(file) == compute(file.design))
    refused(
        ca.errors.DesignError,
        r"must be a Design, .* as \.design; got 'starter'\. A name .* load_design",
        compute,
        "starter",
    )


def test_an_unknown_format_is_refused_before_any_work():
    words = "to must be one of kicad, gerber, dxf, svg, step, stl, glb; got 'kicad_pcb'"
    refused(ca.errors.OutputError, words, ca.export, ROW, "x", "kicad_pcb")
