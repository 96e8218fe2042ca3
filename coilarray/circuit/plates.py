"""What the plates of a design add to its circuit: their eddy currents and their iron, over frequency."""

from __future__ import annotations

import math
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
from coilarray.metal.surface_impedance import ModelError

_STEP = 1.12  # between neighbouring frequencies; cubic interpolation errs by 1e-5 of the plates' part
_KEPT = 4
_SAMPLES: Recent[ComplexArray] = Recent(_KEPT)


@dataclass(frozen=True, eq=False)
class PlateEffect:
    """Change of the impedance over jω by plates, complex (f, n, n) in H: at `_STEP` to the powers from `first` on."""

    first: int
    samples: ComplexArray

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies of the samples in Hz."""
        return np.asarray(_STEP ** (self.first + np.arange(len(self.samples), dtype=np.float64)))

    def at(self, frequency: float) -> ComplexArray:
        """Change (n, n) at a frequency in Hz: cubic in its logarithm, constant beyond the samples."""
        place = min(max(math.log(frequency) / math.log(_STEP) - self.first, 0.0), len(self.samples) - 1.0)
        start = min(max(int(place) - 1, 0), len(self.samples) - 4)
        nodes = np.arange(start, start + 4)
        shares = [
            math.prod((place - other) / (node - other) for other in nodes if other != node) for node in nodes.tolist()
        ]
        return np.asarray(np.tensordot(shares, self.samples[nodes], axes=1))

    def dispersion(self, frequencies: FloatArray, working: float) -> SampledMatrix:
        """Inductance in H at frequencies (f,) against that at the working one, in Hz."""
        own = self.at(working).real
        return SampledMatrix(frequencies, np.array([self.at(f).real - own for f in frequencies.tolist()]))

    def resistance(self, frequencies: FloatArray) -> FloatArray:
        """Resistance matrices (f, n, n) in Ω at frequencies (f,) in Hz."""
        return np.array([-2 * math.pi * f * self.at(f).imag for f in frequencies.tolist()])


def plate_effect(design: Design, low: float, high: float, accuracy: Accuracy = "full") -> PlateEffect:
    """Return what the plates of a design do from a frequency `low` to one `high` in Hz; kept in memory.

    GeometryError or MetalError for plates that are not computed.
    """
    first = math.floor(math.log(low) / math.log(_STEP)) - 1
    count = max(math.ceil(math.log(high) / math.log(_STEP)) - first + 2, 4)
    effect = PlateEffect(first, np.zeros((count, 0, 0), dtype=np.complex128))
    key = (digest_of(design.array, design.sheets, design.plates), accuracy, first, count)
    samples = _SAMPLES.get(
        key,
        lambda: _plate_inductance(design, effect.frequencies, accuracy),
    )
    return PlateEffect(first, samples)


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
