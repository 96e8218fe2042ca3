"""The response over a backplane as a quantity: it grows with the distance, and a tolerance follows its slope."""

import pytest
from support.backplane import over_backplane
from support.contacts import coarse_maps

from coilarray.studies.quantities import evaluate
from coilarray.studies.tolerance import Spread, Tolerances, analyse

pytestmark = pytest.mark.slow

PEAK = "peak_delta[coil1]"


def test_the_distance_of_a_backplane_acts_on_the_response():
    sigma = 20e-6
    with coarse_maps():
        peaks = [evaluate(over_backplane(2, 1.0 + step), [PEAK])[PEAK] for step in (-0.1, 0.1)]
        result = analyse(
            over_backplane(2), Tolerances({"plate_distance": Spread(layer=sigma)}), samples=0, quantities=[PEAK]
        )
    assert peaks[1] > peaks[0] > 0
    effect = float(result.effect.sel(output=PEAK, contributor="plate_distance, layer backplane").squeeze())
    # 5 %: screened inductances, and the curvature over 0.2 mm
    assert abs(effect) == pytest.approx((peaks[1] - peaks[0]) / 0.2e-3 * sigma, rel=0.05)
