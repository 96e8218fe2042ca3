"""Reflection and transmission by infinite plates and sheets, as images.

The images are of currents between the layers. A source is at the height s in one gap of air and a
place at z in the same or a higher gap. z_l is the lower face of the lower gap and z_u the upper
face of the upper gap. Waves leave the source upwards or downwards and arrive from below or from
above, by the ways

    2 z_u − s − z,   s + z − 2 z_l,   z − s,   2 (z_u − z_l) + s − z,

the first two by an odd number of reflections, as from a mirror image of the source, the last two by
an even number. In a single gap the third is 2 (z_u − z_l) + z − s, as the direct wave is not
included. Each way has the weight w(k) e^{−k·way}. With ρ_u and ρ_l the reflections at the faces of
the source's gap of height D, w contains 1/(1 − ρ_u ρ_l e^{−2kD}) for all waves that go up and down
in it. A sum Σ c e^{−2kd} with a few real distances d approximates w. These are images farther away
by 2d, real for currents of any shape in any body. Horizontal currents keep their direction in every
image, vertical currents reverse in mirror images.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.electromagnetics.flat_stack import Layer, layer_waves, with_gaps
from coilarray.errors import GeometryError, MetalError
from coilarray.geometry import Plate, Sheet
from coilarray.geometry.bodies import TOUCHING

_DIGITS = 14.0  # −ln of the amplitude of the shortest waves that are included
_LONGEST = 0.1  # radians across all bodies, longer waves carry 1e-4 of a coupling
_WAVES = 120  # of a fit
_TOLERANCE = 2e-4  # of the largest wave
_RATIOS = (math.inf, 4.0, 2.8, 2.0, 1.6, 1.3)  # of the distances (inf for a single image)
_SMALLEST = 1e-7  # singular value of a fit
_LEFT_OUT = 5e-5  # of the largest wave: weaker images are left out
_NOTHING = 1e-6  # of the unobstructed wave: passes a thick plate, and acts by its square


def layer_of(plate: Plate) -> Layer:
    """Return a plate as an infinite layer."""
    return Layer(plate.thickness, plate.material.relative_permeability, plate.material.conductivity)


def layers_apart(plates: Sequence[Plate], sheets: Sequence[Sheet]) -> list[tuple[float, float, Layer]]:
    """Order plates and magnetic sheets by height, with faces in m."""
    bodies = [(*plate.heights, layer_of(plate), f"plate {plate.name!r}") for plate in plates]
    heights = itertools.accumulate((sheet.thickness for sheet in sheets), initial=0.0)
    bodies += [
        (low, high, Layer(sheet.thickness, sheet.relative_permeability), f"sheet {sheet.name!r}")
        for (low, high), sheet in zip(itertools.pairwise(heights), sheets, strict=True)
        if sheet.magnetic
    ]
    bodies.sort(key=lambda body: body[0])
    for (low, high, _, one), (start, _, _, other) in itertools.pairwise(bodies):
        if start < high - TOUCHING:
            raise GeometryError(
                f"plates and magnetic sheets must not overlap; {one} lies from z = {low:g} to {high:g} m and {other} "
                f"begins at {start:g} m."
            )
    return [body[:3] for body in bodies]


@dataclass(frozen=True, eq=False)
class Image:
    """Image at `sign` times the height plus `offset` in m, shares (f,)."""

    sign: int
    offset: float
    shares: ComplexArray

    def of(self, points: FloatArray) -> FloatArray:
        """Images in m of points (..., 3)."""
        return points * [1.0, 1.0, self.sign] + [0.0, 0.0, self.offset]

    @property
    def back(self) -> Image:
        """Same image with source and place exchanged."""
        return self if self.sign < 0 else Image(self.sign, -self.offset, self.shares)


ITSELF = Image(1, 0.0, np.ones(1, dtype=np.complex128))  # the source itself, in air


@dataclass(frozen=True, eq=False)
class LayeredAir:
    """Infinite layers, faces (n, 2) in m, air between, frequencies in Hz."""

    layers: tuple[Layer, ...]
    faces: FloatArray
    frequencies: FloatArray

    @classmethod
    def between(cls, plates: Sequence[Plate], sheets: Sequence[Sheet], frequencies: FloatArray) -> LayeredAir:
        """Combine plates and sheets from z = 0, which may not overlap."""
        bodies = layers_apart(plates, sheets)
        faces = np.array([body[:2] for body in bodies]).reshape(-1, 2)
        return cls(tuple(body[2] for body in bodies), faces, frequencies)

    def gap(self, low: float, high: float, what: str) -> int:
        """Find the gap that contains all heights in m, or raise MetalError."""
        number = int((self.faces[:, 0] < (low + high) / 2).sum())
        floor, roof = self.gap_faces(number)
        if low < floor - TOUCHING or high > roof + TOUCHING:
            raise MetalError(
                f"{what} must lie between infinite plates and magnetic sheets, not in them; it reaches from "
                f"{low * 1e3:.4g} to {high * 1e3:.4g} mm and the faces next to it lie at {floor * 1e3:.4g} and "
                f"{roof * 1e3:.4g} mm."
            )
        return number

    def gap_faces(self, number: int) -> tuple[float, float]:
        """Heights in m of a gap's faces, infinite without a body."""
        floor = self.faces[number - 1, 1] if number else -math.inf
        return float(floor), float(self.faces[number, 0]) if number < len(self.faces) else math.inf

    def images(self, source: tuple[int, float, float], place: tuple[int, float, float], extent: float) -> list[Image]:
        """Find the images of a source without the source itself.

        `source` and `place` are gap, least and greatest height in m, `extent` is horizontal, in m.
        """
        if not self.layers:
            return []
        if source[0] > place[0]:
            return [image.back for image in self.images(place, source, extent)]
        floor, roof = self.gap_faces(source[0])[0], self.gap_faces(place[0])[1]
        same = source[0] == place[0]
        through = 2 * (roof - floor)
        nearest = max(place[1] - source[2], 0.0)
        ways = (  # shortest way, sign, offset, and the direction of images farther away
            (2 * roof - source[2] - place[2], -1, 2 * roof, 1),
            (source[1] + place[1] - 2 * floor, -1, 2 * floor, -1),
            (through + place[1] - source[2] if same else nearest, 1, -through if same else 0.0, -1),
            (through + source[1] - place[2], 1, through, 1),
        )
        found = []
        for number, (way, sign, offset, outwards) in enumerate(ways):
            if math.isinf(way):
                continue
            shortest = max(way, TOUCHING)
            k = np.geomspace(_LONGEST / (extent + shortest), _DIGITS / shortest, _WAVES)
            weights = self.weights(k, source[0], place[0])[number]
            for distance, shares in _fitted(k, weights, shortest, extent):
                found.append(Image(sign, offset + outwards * 2 * distance, shares))
        return found

    def weights(self, k: FloatArray, source: int, place: int) -> tuple[ComplexArray, ...]:
        """Weights (f, k) of the four ways between gaps."""
        omega = 2 * np.pi * self.frequencies[:, None]
        floor, roof = self.gap_faces(source)
        up, down = (layer_waves(self._outwards(source, up=side), k, omega) for side in (True, False))
        trip = np.exp(-2 * k * (roof - floor)) if math.isfinite(roof - floor) else 0.0
        again = 1 / (1 - up.reflection * down.reflection * trip)
        if source == place:
            both = up.reflection * down.reflection * again
            return up.reflection * again, down.reflection * again, both, both
        start = self.gap_faces(place)[0]
        edges = roof + np.cumsum([0.0, *(layer.thickness for layer in up.layers)])
        number = int(np.abs(edges - start).argmin())
        out = up.faces[number]
        back = np.zeros_like(out)
        if number < len(up.layers):
            r = up.beyond[number]
            out = out / (1 + r * np.exp(-2 * k * up.layers[number].thickness))
            back = out * r
        passed = (1 + up.reflection) * again * np.exp(k * (start - roof))
        return passed * back, passed * out * down.reflection, passed * out, passed * back * down.reflection

    def _outwards(self, gap: int, *, up: bool) -> tuple[Layer, ...]:
        """Layers outwards from a gap, with the air between them."""
        floor, roof = self.gap_faces(gap)
        if up:
            return with_gaps(list(zip(self.faces[gap:, 0].tolist(), self.layers[gap:], strict=True)), roof)
        inner = (-self.faces[:gap, 1][::-1]).tolist()
        return with_gaps(list(zip(inner, self.layers[:gap][::-1], strict=True)), -floor)


def _fitted(k: FloatArray, weights: ComplexArray, way: float, extent: float) -> list[tuple[float, ComplexArray]]:
    """Distances in m and shares (f,) of images for weights (f, k)."""
    # two loops couple by the square of the wave that both see, and less for waves beyond the extent
    counted = np.exp(-k * way) * np.minimum(k * (extent + way), 1.0) ** 2
    wanted = weights * counted
    largest = np.abs(wanted).max()
    allowed = max(_TOLERANCE * largest, _NOTHING * counted.max())
    if largest <= allowed:
        return []
    for ratio in _RATIOS:
        count = 0 if math.isinf(ratio) else math.ceil(math.log(4 * k[-1] / k[0]) / math.log(ratio))
        distances = np.array([0.0, *np.geomspace(0.5 / k[-1], 2 / k[0], count)])
        waves = np.exp(-2 * np.outer(k, distances)) * counted[:, None]
        shares = np.linalg.lstsq(waves, wanted.T, rcond=_SMALLEST)[0]
        if np.abs(waves @ shares - wanted.T).max() <= allowed:
            break
    else:
        raise MetalError(
            f"the reflection by infinite plates and magnetic sheets must be a sum of images to {_TOLERANCE:g}; "
            f"{count} images of a source {way * 1e3:.4g} mm away by reflection, {extent * 1e3:.4g} mm wide, err by "
            f"{np.abs(waves @ shares - wanted.T).max() / largest:.2g}: move plates with an outline farther away from "
            "them."
        )
    strengths = np.abs(shares).max(axis=1) * np.abs(waves).max(axis=0)
    return [
        (distance, share)
        for distance, share, strength in zip(distances.tolist(), shares, strengths.tolist(), strict=True)
        if strength > _LEFT_OUT * largest
    ]
