"""Effect of a design's plates on its circuit.

It comes from their eddy currents and iron, over frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coilarray.circuit.network import SampledMatrix
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.recent import Recent
from coilarray.design.digest import digest_of
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.geometry import FinitePlate, Plate
from coilarray.metal.finite_plates import PlateError, moving_plate_error, outlined_inductance
from coilarray.metal.flat_plates import plate_inductance
from coilarray.metal.over_frequency import FrequencyBand

_KEPT = 4
_SAMPLES: Recent[ComplexArray] = Recent(_KEPT)
_ERRORS: Recent[dict[str, PlateError]] = Recent(_KEPT)


@dataclass(frozen=True, eq=False)
class PlateEffect:
    """Change of the impedance over jω by plates.

    The samples are complex (f, n, n) in H, at the nodes of a band.
    """

    band: FrequencyBand
    samples: ComplexArray

    def at(self, frequencies: FloatArray) -> ComplexArray:
        """Change (f, n, n) at frequencies (f,) in Hz.

        A frequency outside the band raises a MetalError.
        """
        return np.asarray(np.tensordot(self.band.shares(frequencies), self.samples, axes=1))

    def dispersion(self, frequencies: FloatArray, working: float) -> SampledMatrix:
        """Inductance minus its value at the working frequency in H.

        Both the frequencies (f,) and the working frequency are in Hz.
        """
        own = self.at(np.array([working])).real
        return SampledMatrix(frequencies, self.at(frequencies).real - own)

    def resistance(self, frequencies: FloatArray) -> FloatArray:
        """Resistance matrices (f, n, n) in Ω over frequency.

        The frequencies (f,) are in Hz.
        """
        return -2 * np.pi * frequencies[:, None, None] * self.at(frequencies).imag


def plate_effect(design: Design, low: float, high: float, accuracy: Accuracy = "full") -> PlateEffect:
    """Return the effect of a design's plates over a band.

    The band reaches from a frequency `low` to a frequency `high` in Hz. The result is kept in memory. Plates that are
    not computed raise a GeometryError or MetalError.
    """
    band = FrequencyBand(low, high)
    key = (digest_of(design.array, design.sheets, design.plates), accuracy, low, high)
    return PlateEffect(band, _SAMPLES.get(key, lambda: _plate_inductance(design, band.nodes, accuracy)))


def plate_errors_by_name(design: Design, frequency: float) -> dict[str, PlateError]:
    """Return the errors of every plate with an outline.

    They hold for each plate alone, at a frequency in Hz, by its name. The result is kept in memory. Plates that are not
    computed raise a GeometryError.
    """
    outlined = [one for one in design.plates if isinstance(one, FinitePlate)]

    def compute() -> dict[str, PlateError]:
        return {
            one.name: moving_plate_error(design.array, one, [one.centre], [frequency], design.sheets)
            for one in outlined
        }

    return _ERRORS.get((digest_of(design.array, design.sheets, design.plates), frequency), compute) if outlined else {}


def _plate_inductance(design: Design, frequencies: FloatArray, accuracy: Accuracy) -> ComplexArray:
    """Change of the impedance over jω by all plates.

    It is complex (f, n, n) in H.
    """
    paths, sheets, plates = design.array.conductors(), design.sheets, design.plates
    endless = [plate for plate in plates if isinstance(plate, Plate)]
    change = plate_inductance(paths, endless, frequencies, sheets, accuracy=accuracy)
    if len(endless) == len(plates):
        return change
    return np.asarray(change + outlined_inductance(paths, plates, frequencies, sheets))
