"""Amplitudes of coils at a dent.

Who checks whom: the energies between all amplitudes against `dent_inductance`, which goes by another sum over
angles; a table of splines against amplitudes at its own offsets.
"""

import numpy as np
import pytest
from support.references import polygon

from coilarray import load_design
from coilarray.elastomer.dent import STILL, Dent, Motion
from coilarray.elastomer.dented_layer import amplitude_table, dent_amplitudes, dent_inductance, offset_grid
from coilarray.elastomer.scattering import LayerMesh, scatter, wavenumber_rule
from coilarray.electromagnetics.flat_stack import coil_segments, segment_spectra, turned_spectra
from coilarray.errors import CoilarrayError, MemoryLimitError

MESH = LayerMesh()
RADIUS = np.linspace(0, 20e-3, 41)
DEPTH = -0.8e-3 * np.exp(-((RADIUS / 4e-3) ** 2))
DENT = Dent((5e-3, 2e-3), (1.0, 2.7), RADIUS, np.column_stack((0 * RADIUS, 0.6 * DEPTH, DEPTH)))
HEXAGON = polygon(6, 8e-3)
# nothing of it is symmetric, and it lies deeper
OTHER = np.array([[0, 0, -1e-3], [9e-3, 1e-3, -1e-3], [6e-3, 7e-3, -0.8e-3], [-3e-3, 5e-3, -1e-3], [0, 0, -1e-3]])
REACH = 20e-3


@pytest.fixture(scope="module")
def solved():
    wavenumbers, weights = wavenumber_rule(DENT.clearance, REACH + 9e-3 + DENT.width, MESH)
    return scatter(DENT, wavenumbers, weights, MESH), segment_spectra(coil_segments([HEXAGON, OTHER]), wavenumbers)


def test_coils_of_one_shape_share_a_spectrum():
    spectra = segment_spectra(coil_segments(load_design("gast2020").array), np.array([100.0]))
    assert (spectra.shape_of, len(spectra.series)) == ((0, 1) * 3, 2)  # two pairs of layers


@pytest.mark.slow
@pytest.mark.parametrize("motion", [STILL, Motion(0.2e-3, (0.01, -0.02), 8e-3)])
def test_energies_between_amplitudes_are_inductances(solved, motion):
    scattering, level = solved
    spectra = turned_spectra(level, motion.slope)
    places = np.array([[0, 0], [11e-3, 4e-3], [-6e-3, -12e-3]])  # of a hexagon; the other one beside it
    beside = places + np.array([3e-3, 9e-3])
    coils = [HEXAGON + np.append(place, 0) for place in places] + [OTHER + np.append(place, 0) for place in beside]
    indenter = np.array([1e-3, 2e-3])
    expected = dent_inductance(coils, [DENT.moved(motion)], [indenter], MESH)[0, 0]
    offsets = [indenter - places - spectra.centres[0], indenter - beside - spectra.centres[1]]
    dent = dent_amplitudes(scattering, spectra, offsets, 1e-6, motion)
    amplitudes = np.concatenate(dent.amplitudes)
    change = (amplitudes * dent.strengths) @ amplitudes.T
    # 1e-6 of the amplitudes are left out, and both rules over the wavenumber leave out e^-16 = 1e-7
    assert change == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_what_is_left_out_is_below_the_tolerance(solved, tolerance):
    scattering, spectra = solved
    offsets = np.random.default_rng(1).uniform(-REACH / 1.5, REACH / 1.5, (60, 2))
    few, all_of_them = (dent_amplitudes(scattering, spectra, [offsets, offsets], t) for t in (tolerance, 1e-8))
    assert len(few.strengths) < len(all_of_them.strengths)  # something is left out
    short, full = ((one.amplitudes[0] * one.strengths) @ one.amplitudes[1].T for one in (few, all_of_them))
    assert np.abs(short - full).max() < tolerance * np.abs(full).max()


def test_a_table_gives_the_amplitudes_between_its_offsets(solved):
    scattering, spectra = solved
    axis, grid = offset_grid(REACH / 1.5, DENT.clearance)
    between = np.random.default_rng(2).uniform(-REACH / 1.5, REACH / 1.5, (80, 2))
    dent = dent_amplitudes(scattering, spectra, [np.concatenate((grid, between))] * 2, 1e-4)
    for amplitudes in dent.amplitudes:
        known, found = amplitudes[len(grid) :], amplitude_table(axis, amplitudes[: len(grid)])(between)
        change, expected = ((one * dent.strengths * one).sum(axis=1) for one in (found, known))
        # splines of the fifth degree over a third of the clearance; measured 2e-5
        assert np.abs(change - expected).max() < 1e-4 * np.abs(expected).max()


def test_too_many_offsets_are_refused(solved, monkeypatch):
    monkeypatch.setenv("COILARRAY_MEMORY_GB", "0.001")
    with pytest.raises(MemoryLimitError, match=r"the field of coils at 2000 offsets needs about .* GB") as refused:
        dent_amplitudes(*solved, [np.zeros((1000, 2))] * 2, 1e-3)
    assert isinstance(refused.value, CoilarrayError)
