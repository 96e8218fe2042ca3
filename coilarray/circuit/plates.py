"""What the plates of a design add to its circuit: their eddy currents and their iron, over frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coilarray.circuit.network import SampledMatrix
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.recent import Recent
from coilarray.design.digest import digest_of
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import MetalError
from coilarray.geometry import FinitePlate, Plate
from coilarray.metal.finite_plates import moving_plate, moving_plate_error
from coilarray.metal.flat_plates import plate_inductance
from coilarray.metal.over_frequency import FrequencyBand
from coilarray.metal.surface_impedance import ModelError

_KEPT = 4
_SAMPLES: Recent[ComplexArray] = Recent(_KEPT)


@dataclass(frozen=True, eq=False)
class PlateEffect:
    """Change of the impedance over jω by plates: complex samples (f, n, n) in H at the nodes of a band."""

    band: FrequencyBand
    samples: ComplexArray

    def at(self, frequencies: FloatArray) -> ComplexArray:
        """Change (f, n, n) at frequencies (f,) in Hz; MetalError outside the band."""
        return np.asarray(np.tensordot(self.band.shares(frequencies), self.samples, axes=1))

    def dispersion(self, frequencies: FloatArray, working: float) -> SampledMatrix:
        """Inductance in H at frequencies (f,) against that at the working one, in Hz."""
        own = self.at(np.array([working])).real
        return SampledMatrix(frequencies, self.at(frequencies).real - own)

    def resistance(self, frequencies: FloatArray) -> FloatArray:
        """Resistance matrices (f, n, n) in Ω at frequencies (f,) in Hz."""
        return -2 * np.pi * frequencies[:, None, None] * self.at(frequencies).imag


def plate_effect(design: Design, low: float, high: float, accuracy: Accuracy = "full") -> PlateEffect:
    """Return what the plates of a design do from a frequency `low` to one `high` in Hz; kept in memory.

    GeometryError or MetalError for plates that are not computed.
    """
    band = FrequencyBand(low, high)
    key = (digest_of(design.array, design.sheets, design.plates), accuracy, low, high)
    return PlateEffect(band, _SAMPLES.get(key, lambda: _plate_inductance(design, band.nodes, accuracy)))


def plate_model_error(design: Design, frequency: float) -> ModelError | None:
    """Estimate the errors of the model of a plate with an outline at a frequency in Hz; None where there is none.

    GeometryError or MetalError for plates that are not computed.
    """
    bounded = _bounded(design)
    if bounded is None:
        return None
    return moving_plate_error(design.array, bounded, [bounded.centre], [frequency], design.sheets)


def _bounded(design: Design) -> FinitePlate | None:
    """Return the plate with an outline of a design, which must be its only one."""
    for k, plate in enumerate(design.plates):
        if isinstance(plate, FinitePlate):
            if len(design.plates) > 1:
                raise MetalError(
                    f"plate.{k} {plate.name!r} has an outline and is computed only without other plates; there are "
                    f"{len(design.plates)}."
                )
            return plate
    return None


def _plate_inductance(design: Design, frequencies: FloatArray, accuracy: Accuracy) -> ComplexArray:
    """Change of the impedance over jω by all plates of a design, complex (f, n, n) in H."""
    paths, sheets = design.array.conductors(), design.sheets
    bounded = _bounded(design)
    if bounded is None:
        wide = [plate for plate in design.plates if isinstance(plate, Plate)]
        return plate_inductance(paths, wide, frequencies, sheets, accuracy=accuracy)
    return np.asarray(moving_plate(paths, bounded, [bounded.centre], frequencies, sheets)[0])
