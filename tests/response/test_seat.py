"""Contacts of maps: kept on disk, of either strain, on a seat; what a seat does to every result behind it.

Who checks whom: a stiff seat against the board that it stands for, in three dimensions and in two; a kept contact
against the solved one.
"""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.contacts import IDEAL, QUICK

import coilarray.response.setup as pressing
from coilarray import load_design
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.design.vary import vary
from coilarray.elastomer.dent import dent_of
from coilarray.errors import ElastomerError
from coilarray.geometry import Seat
from coilarray.paper.two_dimensional import line_response
from coilarray.response.map import response_map
from coilarray.response.setup import contact_at
from coilarray.studies.quantities import evaluate

pytestmark = pytest.mark.slow

FEM = load_design("gast_fem")
SOFT = Seat(4.3e6)


def on(base, strain="linear"):
    return replace(FEM, indentation=replace(FEM.indentation, base=base, strain=strain))


def delta(design):
    return response_map(
        design, depths=[1e-3], x=[0.0, 6e-3], y=[0.0], imperfections=IDEAL, accuracy=QUICK
    ).delta.values.ravel()


@pytest.fixture
def solved(tmp_path, monkeypatch):
    """Strains of the contacts that were solved; the store is empty."""
    strains, whole = [], pressing.indent
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(pressing, "indent", lambda *a, **k: strains.append(k["strain"]) or whole(*a, **k))
    pressing._kept_contact.cache_clear()
    yield strains
    pressing._kept_contact.cache_clear()


def test_the_line_model_refuses_the_sides_of_a_sample():
    setup = replace(FEM.indentation, sample_bounds=(-20e-3, -20e-3, 20e-3, 20e-3))
    with pytest.raises(ElastomerError, match="does not include the sides of a sample; gast_fem has sample_x_mm"):
        line_response(replace(FEM, indentation=setup))


def test_a_contact_of_finite_strain_is_solved_once_on_a_machine(solved):
    setup = on("bonded", "finite").indentation
    first = contact_at(setup, FEM.sheets, [0.2e-3])
    pressing._kept_contact.cache_clear()  # as in another process
    again = contact_at(setup, FEM.sheets, [0.2e-3])
    assert solved == ["finite"]
    xr.testing.assert_identical(again, first)
    others = [
        (setup, FEM.sheets, [0.25e-3]),
        (replace(setup, base=SOFT), FEM.sheets, [0.2e-3]),
        (setup, (replace(FEM.sheets[0], youngs_modulus=50e3), FEM.sheets[1]), [0.2e-3]),
    ]
    forces = {float(contact_at(*other).force[0]) for other in others} | {float(first.force[0])}
    assert (len(solved), len(forces)) == (4, 4)


def test_linear_contacts_are_not_kept(solved, tmp_path):
    contact_at(on("bonded").indentation, FEM.sheets, [0.2e-3])
    assert (solved, (tmp_path / "cache").exists()) == (["linear"], False)


def test_a_store_that_cannot_be_written_costs_time_only(solved, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path / "file" / "cache"))
    setup = on("bonded", "finite").indentation
    assert float(contact_at(setup, FEM.sheets, [0.2e-3]).force[0]) > 0
    assert solved == ["finite"]


@pytest.mark.parametrize("strain", ["finite", "linear"])
def test_faces_move_as_their_strain_allows(strain):
    contact = contact_at(on("bonded", strain).indentation, FEM.sheets, [1e-3]).isel(depth=0)
    dent = dent_of(contact, FEM.sheets)
    k = int(np.argmin(contact.displacement_r.values[-1]))  # where the top moves inwards most
    r = contact.r.values[k] + (contact.displacement_r.values[-1, k] if strain == "finite" else 0.0)
    assert contact.displacement_r.values[-1, k] < -10e-6
    # the spline has been sampled anew at points 30 µm apart; u_r is worth 6 µm and more
    assert dent.faces(np.array([r]))[0, -1] == pytest.approx(contact.displacement_z.values[-1, k], abs=0.5e-6)


@pytest.mark.parametrize(("stiff", "board"), [(Seat(1e12, 1e12), "bonded"), (Seat(1e12), "frictionless")])
def test_a_stiff_seat_answers_as_the_board(stiff, board):
    # 1e12 Pa/m give by 1e-5 of what the sheets give
    assert delta(on(stiff)) == pytest.approx(delta(on(board)), rel=1e-4)
    lines = [line_response(on(base), depths=[1e-3], x=[0.0]).delta.values for base in (stiff, board)]
    assert lines[0] == pytest.approx(lines[1], rel=1e-4)


def test_a_soft_seat_widens_the_response_and_is_named(tmp_path):
    soft, hard = delta(on(SOFT)), delta(on("frictionless"))
    assert (soft > hard).all()
    assert soft[1] / soft[0] > hard[1] / hard[0]
    response = response_map(on(SOFT), depths=[1e-3], x=[0.0], y=[0.0], imperfections=IDEAL, accuracy=QUICK)
    save_dataset(response, tmp_path / "r.nc")
    stored = load_part(tmp_path / "r.nc").attrs
    assert (stored["base"], stored["strain"]) == ("seat of 4.3 kPa/mm", "linear")


def test_a_seat_can_be_varied():
    seat = {"indentation.base": "seat", "indentation.strain": "linear"}
    found = [
        evaluate(vary(FEM, {**seat, "indentation.seat_stiffness_kPa_per_mm": stiffness}), ["peak_delta"])["peak_delta"]
        for stiffness in (2.0, 8.0)
    ]
    assert found[0] > found[1] > 0


def test_a_magnetic_sheet_on_a_seat_is_refused():
    magnetic = replace(on(SOFT), sheets=(replace(FEM.sheets[1], thickness=5e-3),))
    with pytest.raises(ElastomerError, match=r"a magnetic sheet cannot lie on a soft seat, where it would move .* mm"):
        delta(magnetic)
    board = replace(magnetic, indentation=replace(magnetic.indentation, base="frictionless"))
    assert (delta(board) < 0).all()  # there it is thinner under the indenter
