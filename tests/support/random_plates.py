"""Plates with an outline before coils, drawn at random, and independent solutions of what they change.

Lengths of a `Case` are in mm and its values are rounded, so that a row of a table says them exactly.
"""

from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from coilarray.constants import MU_0
from coilarray.geometry.bodies import MATERIALS, Disc, FinitePlate, Material, Polygon, Rectangle, Ring
from coilarray.metal.plate_mesh import inscribed_radius
from support.axial_plates import AxialPlate, axial_truth
from support.coil_paths import loop
from support.references import polygon
from support.thin_plates import thin_truth

MM = 1e-3
METALS = [MATERIALS[name].conductivity for name in ("copper", "aluminium", "brass", "stainless_steel")]


def _arc(radius, start, stop, pieces=96):
    angle = np.linspace(start, stop, pieces + 1)
    return list(zip((radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist(), strict=True))


def _slotted(radius, inner, slot):
    half = np.arcsin(slot / 2 / radius)
    return Polygon(tuple(_arc(radius, half, 2 * np.pi - half) + _arc(inner, 2 * np.pi - half, half)))


def _ell(width, height, arm):
    x, y = width / 2, height / 2
    return Polygon(((-x, -y), (x, -y), (x, arm - y), (arm - x, arm - y), (arm - x, y), (-x, y)))


def _holed(width, height, radius, x, y):
    corners = Rectangle(width, height).exterior
    hole = polygon(48, radius, centre=(x, y))[:-1, :2]
    return Polygon(corners, (tuple(map(tuple, hole.tolist())),))


def _comb(width, height, slot, depth):
    x, y, s = width / 2, height / 2, slot / 2
    return Polygon(((-x, -y), (x, -y), (x, y), (s, y), (s, y - depth), (-s, y - depth), (-s, y), (-x, y)))


OUTLINES = {
    "disc": Disc, "ring": Ring, "rectangle": Rectangle,
    "slotted": _slotted, "ell": _ell, "holed": _holed, "comb": _comb,
}  # fmt: skip
"""Outlines by name; their numbers are said in tests/reference/ref_plates.csv."""


@dataclass(frozen=True)
class Case:
    """A plate before coils in series on z = 0, at one frequency.

    The coils are regular polygons of the same area as circles of the radii, 360 sides for a circle; z is the height of
    the middle of the plate. The outline is a name of `OUTLINES` with its numbers. Conductivity in S/m, frequency in Hz.
    """

    method: str
    sides: int
    radii_mm: tuple[float, ...]
    outline: str
    numbers_mm: tuple[float, ...]
    x_mm: float
    y_mm: float
    z_mm: float
    thickness_mm: float
    tilt_deg: float
    towards_deg: float
    conductivity: float
    permeability: float
    frequency: float

    @property
    def plate(self):
        lengths = [value * MM for value in self.numbers_mm]
        return FinitePlate(
            "plate", OUTLINES[self.outline](*lengths), (self.x_mm * MM, self.y_mm * MM, self.z_mm * MM),
            self.thickness_mm * MM, Material("metal", self.conductivity, self.permeability),
            np.radians(self.tilt_deg), np.radians(self.towards_deg),
        )  # fmt: skip

    @property
    def paths(self):
        return [loop(radius * MM, sides=self.sides) for radius in self.radii_mm]

    @property
    def row(self):
        """Texts of all values, in the order of `COLUMNS`."""
        return [";".join(map(str, one)) if isinstance(one, tuple) else str(one) for one in astuple(self)]

    @classmethod
    def of_row(cls, row):
        """The case of a mapping of columns to texts."""
        kinds = {"method": str, "outline": str, "sides": int}
        return cls(**{
            name: tuple(map(float, row[name].split(";"))) if name in ("radii_mm", "numbers_mm")
            else kinds.get(name, float)(row[name])
            for name in COLUMNS
        })  # fmt: skip

    def truth(self):
        """ΔL − jΔR/ω in H, and its own error, of the real part and of the imaginary one, by another method."""
        if self.method == "axial":
            radius, *inner = self.numbers_mm
            bottom, top = ((self.z_mm + side * self.thickness_mm / 2) * MM for side in (-1, 1))
            metal = AxialPlate(sum(inner) * MM, radius * MM, bottom, top, self.conductivity, self.permeability)
            return axial_truth([(one * MM, 0.0) for one in self.radii_mm], metal, self.frequency)
        return thin_truth(self.paths, self.plate, self.frequency)


COLUMNS = [one.name for one in fields(Case)]


def drawn(seed, number):
    """Draw the plate of a seed and a number.

    Of 20, 7 are plain and 4 are magnetic discs and rings on the axis of circles, for finite elements about the axis; 6
    are thin, of any outline, many of them tilted, for a stream function; 3 are of any outline and thickness.
    """
    rng = np.random.default_rng([seed, number])
    method = (["axial"] * 7 + ["iron"] * 4 + ["thin"] * 6 + ["thick"] * 3)[number % 20]

    def log(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def rounded(*values):
        return tuple(float(f"{value:.3g}") for value in values)

    turns = 0.85 ** np.arange(rng.integers(1, 5))
    radii = rounded(*rng.uniform(3, 15) * turns)
    gap, thickness, frequency = log(0.4, 8), log(0.035, 2), log(1e3, 1e7)
    conductivity, permeability = METALS[rng.integers(len(METALS))], 1.0
    if method == "iron" or (method == "thick" and rng.random() < 0.3):
        # most are thicker than three skin depths and discs, which is what the package computes
        conductivity, permeability, thickness = log(0.5e6, 12e6), log(1.5, 1000), log(0.1, 2)
        least = 9 / (np.pi * MU_0 * permeability * conductivity * (thickness * MM) ** 2)
        frequency = log(min(max(1e3, 0.7 * least), 5e6), 1e7)
    if method in ("axial", "iron"):
        width = log(0.5, 30)
        inner = log(0.5, 14)
        if rng.random() < (0.5 if method == "axial" else 0.85) or inner + width > 20:
            outline, numbers = "disc", rounded(width / 2 if width > 1 else 2 * width)
        else:
            outline, numbers = "ring", rounded(inner + width, inner)
        thickness, gap = rounded(thickness, gap)
        return Case(
            "axial", 360, radii, outline, numbers, 0.0, 0.0, float(f"{gap + thickness / 2:.6g}"), thickness, 0.0, 0.0,
            *rounded(conductivity, permeability, frequency),
        )  # fmt: skip
    width, length = log(0.5, 12), rng.uniform(6, 30)
    length = max(length, 1.5 * width)
    outline = ["disc", "ring", "rectangle", "slotted", "ell", "holed", "comb"][rng.integers(7)]
    numbers = rounded(*{
        "disc": (max(width, 1.0),),
        "ring": (width + length / 3, length / 3),
        "rectangle": (length, width),
        "slotted": (width + length / 3, length / 3, rng.uniform(0.02, 0.2) * length),
        "ell": (length, max(length * rng.uniform(0.5, 1), 1.5 * width), width),
        "holed": (length, 2 * width, width * rng.uniform(0.2, 0.7), (length / 2 - width) * rng.uniform(-0.9, 0.9), 0.0),
        "comb": (length, 2 * width, width * rng.uniform(0.1, 0.5), width * rng.uniform(0.5, 1.7)),
    }[outline])  # fmt: skip
    sides = int(rng.choice([4, 6, 360]))
    case = Case(
        method, sides, radii, outline, numbers, 0.0, 0.0, 0.0, thickness, 0.0, 0.0, conductivity, permeability, 1.0
    )
    inscribed = inscribed_radius(case.plate.outline) / MM
    if method == "thin":
        thickness = log(0.035, max(0.036, min(2, inscribed / 12, gap / 3)))
        product = MU_0 * conductivity * thickness * MM  # s/m
        # a skin depth of three thicknesses, and a length 2/ωµ0σt of 0.4 of the inscribed radius
        limits = 1 / (9 * np.pi * product * thickness * MM), 5 / (2 * np.pi * product * inscribed * MM)
        frequency = log(1e3, max(1e3, min(1e7, *limits)))
    tilt = rng.uniform(2, 25) if rng.random() < 0.5 else 0.0
    names = "x_mm", "y_mm", "thickness_mm", "tilt_deg", "towards_deg", "conductivity", "permeability", "frequency"
    values = *rng.uniform(-0.8, 0.8, 2) * radii[0], thickness, tilt, rng.uniform(0, 360), conductivity, permeability
    case = replace(case, **dict(zip(names, rounded(*values, frequency), strict=True)))
    return replace(case, z_mm=float(f"{gap - case.plate.heights[0] / MM:.5g}"))
