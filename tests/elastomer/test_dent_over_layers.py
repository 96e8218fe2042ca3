"""A dent over layers below the coils.

Who checks whom: finite elements about the axis solve coils, dented sheets and plate at once; coils and their mirror
images over a perfect conductor; a lift of the sheets against thicker ones; limits; the passive sign of the loss.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from support.axial_field import dent_over_metal, pit
from support.references import polygon

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.elastomer.dent import Dent, Motion
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.scattering import LayerMesh, wavenumber_rule
from coilarray.electromagnetics.flat_stack import Backing, Layer

LOOPS = [(3e-3, -0.5e-3), (7e-3, -0.5e-3)]  # radius and height in m
COILS = [polygon(360, *loop) for loop in LOOPS]
FEW = [polygon(24, 6e-3, -0.5e-3, centre=(1e-3, 0.0)), polygon(24, 8e-3, -0.8e-3, centre=(-3e-3, 2e-3))]
PLACES = np.array([[0.0, 0.0], [4e-3, -2e-3]])
MESH = LayerMesh().coarser()
FACE, METAL = -2e-3, 2e-3  # upper face and thickness of the plate in m
ALUMINIUM, STEEL, PERFECT = Layer(METAL, 1.0, 3.5e7), Layer(METAL, 100.0, 5e6), Layer(METAL, 1.0, math.inf)


def over(layer: Layer, dent: Dent, frequency: float = 1e4, face: float = FACE) -> ComplexArray:
    return dent_inductance(FEW, [dent], PLACES, MESH, backing=Backing(face, (layer,), frequency))[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("layer", "frequency"),
    [(ALUMINIUM, 1e4), (STEEL, 1e4)],
    ids=["aluminium", "steel"],
)
def test_coils_dent_and_plate_are_those_of_finite_elements(layer: Layer, frequency: float) -> None:
    """What a dent does over a plate, over what it does without: elements of 0.12 mm err alike in both."""
    dent = pit()

    def inside(r: FloatArray, z: FloatArray) -> npt.NDArray[np.bool_]:
        return np.asarray((z < FACE) & (z > FACE - METAL))

    def edges(r: FloatArray, z: FloatArray) -> FloatArray:
        return np.where(r < 16e-3, np.abs(z - FACE), 1.0)  # the skin depth of steel is 0.2 mm

    of_metal, of_air = (
        dent_over_metal(LOOPS, dent, (inside, edges), one.permeability, one.conductivity, frequency)
        for one in (layer, Layer(METAL))
    )
    backing = Backing(FACE, (layer,), frequency)
    alone = dent_inductance(COILS, [dent], [[0.0, 0.0]])[0, 0].diagonal()
    found = dent_inductance(COILS, [dent], [[0.0, 0.0]], backing=backing)[0, 0].diagonal()
    # 1 %: what remains of the elements' 0.5 to 1.6 % in the ratio, most in that of the skin depth
    assert found / alone == pytest.approx(of_metal / of_air, rel=0.01)


@pytest.mark.parametrize("motion", [Motion(), Motion(slope=(0.01, -0.02), pivot=3e-3)], ids=["still", "turned"])
def test_over_a_perfect_conductor_coils_have_mirror_images(motion: Motion) -> None:
    """Of sheets so weak that they reflect nothing themselves, the dent sees coils and images of opposite current."""
    dent = pit(mu=1.0001).moved(motion)
    images = [coil * [1, 1, -1] + [0, 0, 2 * FACE] for coil in FEW]
    four = dent_inductance(FEW + images, [dent], PLACES, MESH)[0]
    expected = four[:, :2, :2] - four[:, :2, 2:] - four[:, 2:, :2] + four[:, 2:, 2:]
    found = over(PERFECT, dent)
    assert not found.imag.any()
    # the sheets' own reflections: their contrast of 1e-4
    np.testing.assert_allclose(found.real, expected, atol=3e-4 * np.abs(expected).max())


@pytest.mark.parametrize("layer", [PERFECT, STEEL], ids=["perfect conductor", "steel"])
def test_lifted_sheets_are_those_on_a_thicker_base(layer: Layer) -> None:
    backing, mesh = Backing(FACE, (layer,), 1e4), LayerMesh(harmonics=3)
    lifted, thicker = (
        dent_inductance(FEW, [dent], PLACES[:1], mesh, backing=backing) / dent_inductance(FEW, [dent], PLACES[:1], mesh)
        for dent in (pit().moved(Motion(lift=1e-3)), pit(5e-3))
    )
    np.testing.assert_allclose(lifted, thicker, rtol=1e-2)  # rows of elements and wavenumbers of the two differ


def test_a_plate_of_nothing_and_a_far_one_change_nothing() -> None:
    alone = dent_inductance(FEW, [pit()], PLACES, MESH)[0]
    np.testing.assert_allclose(over(Layer(1e-3, 1.0, 1e-9), pit()), alone, rtol=1e-11)
    np.testing.assert_allclose(over(PERFECT, pit(), face=-1.0), alone, rtol=1e-5)  # (6 mm/1 m)³


def test_a_plate_within_its_skin_depth_is_transparent_and_a_thick_one_perfect() -> None:
    alone, perfect = dent_inductance(FEW, [pit()], PLACES, MESH)[0], over(PERFECT, pit())
    scale = np.abs(alone).max()
    for frequency, limit in ((0.1, alone), (1e13, perfect)):  # ωμ0σd/2 is 0.1 of 1/10 mm; a skin depth of 30 nm
        assert np.abs(over(ALUMINIUM, pit(), frequency) - limit).max() < 2e-3 * scale


def test_the_change_is_symmetric_and_iron_raises_it_where_metal_lowers_it() -> None:
    alone = dent_inductance(FEW, [pit()], PLACES, MESH)[0]
    for layer, sign in ((ALUMINIUM, -1), (Layer(METAL, 1000.0), 1)):
        found = over(layer, pit())
        np.testing.assert_allclose(found, found.swapaxes(-1, -2), rtol=1e-12)
        own = np.diagonal(found - alone, axis1=1, axis2=2)
        assert (sign * own.real > 0).all()


@pytest.mark.parametrize("layer", [Layer(35e-6, 1.0, 5.8e7), STEEL], ids=["copper pour", "steel"])
def test_wavenumbers_of_the_rule_resolve_what_plates_reflect(layer: Layer, monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1 kHz the poles of both are near wavenumbers of 0: three times as many nodes change little."""
    few = over(layer, pit(), 1e3)
    monkeypatch.setattr(
        "coilarray.elastomer.dented_layer.wavenumber_rule",
        lambda clearance, extent, mesh: wavenumber_rule(clearance, 3 * extent, mesh),
    )
    many = over(layer, pit(), 1e3)
    np.testing.assert_allclose(few, many, atol=5e-6 * np.abs(many).max())


def test_the_field_of_the_dent_itself_is_sent_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its part is 2 % of the change near a perfect conductor, and in proportion to the dent."""
    whole, between = {}, Backing.between
    for depth in (1.0, 0.5):
        near = pit(2e-3, 2.7)
        near = replace(near, displacement=0.5 * depth * near.displacement)
        found = over(PERFECT, near, face=-1e-3)[0, 0, 0].real
        with monkeypatch.context() as patch:
            patch.setattr(Backing, "between", lambda *given: (between(*given)[0], 0 * between(*given)[1]))
            whole[depth] = over(PERFECT, near, face=-1e-3)[0, 0, 0].real / found - 1
    assert 0.005 < whole[1.0] < 0.03
    assert 0.3 < whole[0.5] / whole[1.0] < 0.7
