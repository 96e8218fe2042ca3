"""Finite elements for thin plates of any outline: a stream function of the second order, with its own inductance.

K = ∇u × n on the sheet, u = 0 on the outer edge and one constant on each hole, with the flux through the hole:

    Z ∫ ∇u·∇v + jω M(u, v) = −jω ∫ B_n v,   M = µ0/4π ∬ K·K'/|x − x'|,
    ΔL − jΔR/ω = ∫ B_n u − t/µ0 (1 − tanh(kt/2)/(kt/2)) ∫ B_t²,   k = (1 + j)/δ;

the last term is what the field along the sheet drives along one face and back along the other. M is the mean of that of
one sheet, and of two at t/√3 from each other: as far as the second moment, that of a current spread over the thickness.
Z makes a wide plate exact, (k/2σ) coth(kt/2) for currents on both faces and −jωµ0 (t − t/√3)/4 for the difference of
M. At low frequencies this is Poisson's equation. Triangles are divided where K varies most.
"""

import math
from dataclasses import astuple, dataclass, fields, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
import shapely
from scipy.sparse.linalg import LinearOperator, gmres
from scipy.spatial import Delaunay
from skfem import Basis, BilinearForm, ElementTriP2, LinearForm, MeshTri
from skfem.helpers import dot, grad

from coilarray.constants import MU_0
from coilarray.electromagnetics.field import magnetic_field
from coilarray.electromagnetics.kernels.triangles import triangle_pairs
from coilarray.geometry.bodies import MATERIALS, Disc, FinitePlate, Material, Polygon, Rectangle, Ring
from coilarray.metal.half_body import pair_integrals
from coilarray.metal.plate_mesh import inscribed_radius
from support.axial_field import symmetric
from support.axial_plates import AxialPlate, axial_truth
from support.coil_paths import loop
from support.references import polygon

START = 12  # pieces of the side of a square of the plate's area, from which triangles are divided


def first_mesh(polygon):
    """Triangles of a polygon and of its holes, whose edges are theirs."""
    step = np.sqrt(polygon.area) / START
    rings = [np.array(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
    points, sides = [], []
    for ring in rings:
        count, first = 0, sum(map(len, points))
        for start, stop in pairwise(ring):
            pieces = max(1, int(np.ceil(np.hypot(*(stop - start)) / step)))
            points.append(start + (stop - start) * (np.arange(pieces) / pieces)[:, None])
            count += pieces
        own = first + np.arange(count)
        sides.append(np.column_stack((own, np.roll(own, -1))))
    points, sides = np.concatenate(points), np.concatenate(sides)
    x0, y0, x1, y1 = polygon.bounds
    x, y = np.meshgrid(np.arange(x0, x1, step), np.arange(y0, y1, step * np.sqrt(3) / 2))
    x[1::2] += step / 2
    lattice = np.column_stack((x.ravel(), y.ravel()))
    whole = shapely.Polygon(polygon.exterior)
    edges = shapely.MultiLineString([polygon.exterior, *polygon.interiors])
    kept = shapely.contains_xy(whole, lattice) & (shapely.distance(edges, shapely.points(lattice)) > 0.6 * step)
    lattice = lattice[kept]
    while True:
        triangles = Delaunay(np.concatenate((points, lattice))).simplices
        present = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1) @ [1, 10**9]
        missing = ~np.isin(np.sort(sides, axis=1) @ [1, 10**9], present)
        if not missing.any():
            break
        middles = points[sides[missing]].mean(axis=1)
        new = len(points) + np.arange(len(middles))
        halves = [np.column_stack((sides[missing, 0], new)), np.column_stack((new, sides[missing, 1]))]
        points, sides = np.concatenate((points, middles)), np.concatenate((sides[~missing], *halves))
    nodes = np.concatenate((points, lattice))
    corners = nodes[triangles]
    inside = shapely.contains_xy(whole, corners.mean(axis=1))
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    inside &= np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) > 1e-9 * step**2
    return MeshTri(*(np.ascontiguousarray(part.T) for part in (nodes, triangles[inside]))).remove_unused_nodes()


class Sheet:
    """A mesh of a plate with its holes, and the fluxes of coils through it."""

    def __init__(self, mesh, plate, paths):
        polygon = shapely.Polygon(plate.outline.exterior, plate.outline.holes)
        self.mesh = mesh
        self.metal = np.flatnonzero(shapely.contains_xy(polygon, mesh.p[:, mesh.t].mean(axis=1).T))
        everything = Basis(mesh, ElementTriP2(), intorder=6)
        self.basis = Basis(mesh, ElementTriP2(), intorder=6, elements=self.metal)
        x = np.asarray(everything.global_coordinates())
        self.B = sum(magnetic_field(path, plate.on_board(x.reshape(2, -1).T)) for path in paths)
        self.B = (self.B @ plate.axes.T).T.reshape(3, *x.shape[1:])
        load = LinearForm(lambda v, w: w.B * v).assemble(everything, B=self.B[2])
        stiffness = BilinearForm(lambda u, v, w: dot(grad(u), grad(v))).assemble(self.basis)
        # unknowns: one constant a hole, and those within the metal
        at, columns = everything.doflocs.T, np.full(everything.N, -1)
        columns[self.basis.element_dofs] = 0
        columns[everything.get_dofs().flatten()] = -1
        holes = [shapely.intersects_xy(shapely.Polygon(hole).buffer(1e-9), at) for hole in plate.outline.holes]
        within = (columns == 0) & ~np.any([np.zeros(len(at), bool), *holes], axis=0)
        columns[within] = len(holes) + np.arange(within.sum())
        for number, hole in enumerate(holes):
            columns[hole] = number
        used = np.flatnonzero(columns >= 0)
        self.unknowns = sp.csr_array((np.ones(len(used)), (used, columns[used])), (everything.N, columns.max() + 1))
        self.load = self.unknowns.T @ load
        self.factors = symmetric(sp.csc_array(self.unknowns.T @ stiffness @ self.unknowns))
        along = (self.B[:2, self.metal] ** 2).sum(axis=0)
        self.along = float((along * self.basis.dx).sum())

    def pieces(self):
        """Corners (4k, 3, 3) in m of the quarters of all triangles of the metal, and ∂u/∂x and ∂u/∂y on each."""
        middles = np.array([[1, 4, 1, 2], [1, 1, 4, 2]]) / 6
        basis = Basis(self.mesh, ElementTriP2(), elements=self.metal, quadrature=(middles, np.full(4, 0.125)))
        rows = np.arange(4 * len(self.metal)).reshape(-1, 4)
        slopes = []
        for axis in (0, 1):
            parts = [
                sp.coo_array(
                    (one[0].grad[axis].ravel(), (rows.ravel(), np.repeat(dofs, 4))), (rows.size, self.unknowns.shape[0])
                )
                for one, dofs in zip(basis.basis, basis.element_dofs, strict=True)
            ]
            slopes.append(sp.csr_array(sum(parts) @ self.unknowns))
        a, b, c = self.mesh.p[:, self.mesh.t[:, self.metal]].transpose(1, 2, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        flat = np.stack(
            [np.stack(one, axis=1) for one in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))], axis=1
        )
        return np.pad(flat.reshape(-1, 3, 2), ((0, 0), (0, 0), (0, 1))), slopes

    def own_inductance(self, thickness):
        """The function u ↦ M u in Wb, with the mean current of each triangle, but of its quarters for neighbours."""
        apart = np.array([0.0, 0.0, thickness / math.sqrt(3)])
        quarters, slopes = self.pieces()
        k = len(self.metal)
        parts = quarters.reshape(k, 4, 3, 3)
        whole = np.ascontiguousarray(np.stack((parts[:, 0, 0], parts[:, 1, 1], parts[:, 2, 2]), axis=1))
        pairs = (pair_integrals(whole) + pair_integrals(whole, whole + apart, mirrored=True)) / 2
        nodes = sp.csr_array((np.ones(3 * k), (np.repeat(np.arange(k), 3), self.mesh.t[:, self.metal].T.ravel())))
        touching = sp.csr_array(nodes @ nodes.T)
        rows, columns, values = [], [], []
        for one in range(k):
            others = touching.indices[touching.indptr[one] : touching.indptr[one + 1]]
            pairs[one, others] = 0.0
            beside = np.ascontiguousarray(parts[others].reshape(-1, 3, 3))
            found = np.zeros((2, 4, len(beside)))
            for lift, integrals in zip((0.0, apart), found, strict=True):
                triangle_pairs(np.ascontiguousarray(parts[one]), beside + lift, len(beside), integrals)
            at = (4 * others[:, None] + np.arange(4)).ravel()
            rows.append(np.repeat(4 * one + np.arange(4), len(at)))
            columns.append(np.tile(at, 4))
            values.append(found.mean(axis=0).ravel())
        rows, columns, values = map(np.concatenate, (rows, columns, values))
        near = sp.csr_array((values, (rows, columns)), (4 * k, 4 * k))
        near = (near + near.T) / 2
        mean = sp.csr_array((np.full(4 * k, 0.25), (np.repeat(np.arange(k), 4), np.arange(4 * k))), (k, 4 * k))
        means = [mean @ slope for slope in slopes]

        def inductance(u):
            far = sum(G.T @ (pairs @ (G @ u)) for G in means)
            return MU_0 / (4 * np.pi) * (far + sum(G.T @ (near @ (G @ u)) for G in slopes))

        return inductance

    def solved(self, plate, frequency):
        """The stream function in A of 1 A in the coils, and ΔL − jΔR/ω in H."""
        t, sigma = plate.thickness, plate.material.conductivity
        omega = 2 * np.pi * frequency
        k = (1 + 1j) / plate.material.skin_depth(frequency)
        Z = k / (2 * sigma) / np.tanh(k * t / 2) - 1j * omega * MU_0 * (t - t / math.sqrt(3)) / 4
        inductance = self.own_inductance(t)

        def applied(u):
            answer = self.factors.solve(inductance(np.column_stack((u.real, u.imag))))
            return u + 1j * omega / Z * (answer[:, 0] + 1j * answer[:, 1])

        n = self.unknowns.shape[1]
        first = -1j * omega / Z * self.factors.solve(self.load)
        u, failed = gmres(LinearOperator((n, n), applied, dtype=complex), first, rtol=1e-7, restart=200, maxiter=5)
        if failed:
            raise ArithmeticError("the currents of a sheet did not converge")
        along = t / MU_0 * (1 - np.tanh(k * t / 2) / (k * t / 2)) * self.along
        return u, self.load @ u - along

    def to_divide(self, u):
        """Triangles in which K is least constant, by the energy of what it is beside its mean."""
        slopes = np.asarray(self.basis.interpolate(self.unknowns @ u).grad)
        areas = self.basis.dx.sum(axis=1)
        mean = (slopes * self.basis.dx).sum(axis=2) / areas
        share = (np.abs(slopes - mean[..., None]) ** 2 * self.basis.dx).sum(axis=(0, 2)) * np.sqrt(areas)
        order = np.argsort(share)[::-1]
        return self.metal[order[: np.searchsorted(np.cumsum(share[order]), 0.7 * share.sum()) + 1]]


def thin_truth(paths, plate, frequency, sizes=(250, 1000)):
    """ΔL − jΔR/ω in H of paths in series by a thin plate, and its own error, of the real part and of the imaginary one.

    On two meshes with at least so many triangles in the metal; what M takes as constant on a triangle errs as their
    number to the power −3/2, by which the finer one is extrapolated. That step is the error of the mesh. What a sheet
    leaves out errs besides, as measured against finite elements about the axis for 22 discs and rings of up to an
    eighth of the inscribed radius and a third of the skin depth in thickness, with 2/ωµ0σt above 0.4 of that radius.
    """
    mesh = first_mesh(shapely.Polygon(plate.outline.exterior, plate.outline.holes))
    found = []
    for size in sizes:
        while True:
            sheet = Sheet(mesh, plate, paths)
            u, change = sheet.solved(plate, frequency)
            count = len(sheet.metal)
            mesh = mesh.refined(sheet.to_divide(u))
            if count >= size:
                break
        found.append((count, change))
    (few, coarse), (many, fine) = found
    step = (fine - coarse) / ((many / few) ** 1.5 - 1)
    best = fine + step
    slender, inductive = plate.thickness / inscribed_radius(plate.outline), abs(best.real / best.imag)
    of_inductance = 1e-3 + 1e-2 * slender
    of_resistance = 2e-4 + 0.14 * slender**2 + 1e-3 * inductive
    return best, complex(
        abs(step.real) + of_inductance * abs(best.real), abs(step.imag) + of_resistance * abs(best.imag)
    )


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
