"""The copper layers and dielectrics of a board."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

from coilarray.errors import GeometryError, require_positive
from coilarray.geometry.usual_values import THICKEST_DIELECTRIC, THINNEST_COPPER, warn_unusual

COPPER_THICKNESS = 35e-6  # usual thickness in m of a copper layer, 1 oz
EPSILON_R = 4.5  # usual relative permittivity of FR-4
PREPREG = 0.2e-3  # usual thickness in m of the dielectric between two neighbouring layers
BOARD_THICKNESS = 1.6e-3  # usual thickness in m of a board


@dataclass(frozen=True)
class Stackup:
    """Copper layers and the dielectrics between them.

    The copper layers have different `names`, top to bottom, and each a `copper_thickness` in m.
    Below each but the last is a dielectric with a `dielectric_thickness` in m and a relative
    permittivity `epsilon_r`. Heights are measured from the top face of the top copper layer, where
    the elastomer lies. There z = 0, and every layer has z < 0. Raises GeometryError if a tuple has
    a wrong length, a name is repeated, or a thickness or permittivity is not allowed.

    >>> board = Stackup(("L1", "L2"), (35e-6, 35e-6), (0.2e-3,), (4.5,))
    >>> round(board.centre("L2") * 1e3, 4)
    -0.2525
    """

    names: tuple[str, ...]
    copper_thickness: tuple[float, ...]
    dielectric_thickness: tuple[float, ...]
    epsilon_r: tuple[float, ...]

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, tuple(getattr(self, field.name)))
        n = len(self.names)
        if n == 0:
            raise GeometryError("a stack-up must have at least one copper layer; got none.")
        if len(set(self.names)) != n:
            raise GeometryError(f"copper layer names must differ; got {', '.join(self.names)}.")
        for what, values, expected in (
            ("copper thicknesses", self.copper_thickness, n),
            ("dielectric thicknesses", self.dielectric_thickness, n - 1),
            ("dielectric permittivities", self.epsilon_r, n - 1),
        ):
            if len(values) != expected:
                raise GeometryError(f"{n} copper layers need {expected} {what}; got {len(values)}.")
        for thickness in (*self.copper_thickness, *self.dielectric_thickness):
            require_positive("a layer thickness", thickness)
        for copper in self.copper_thickness:
            if copper < THINNEST_COPPER:
                raise GeometryError(
                    f"a copper thickness must be at least 1 µm; got {copper * 1e6:g} µm: {copper * 1e9:.4g} µm?"
                )
        for dielectric in self.dielectric_thickness:
            if dielectric > THICKEST_DIELECTRIC:
                raise GeometryError(
                    f"a dielectric thickness must be at most {THICKEST_DIELECTRIC * 1e3:g} mm; "
                    f"got {dielectric * 1e3:g} mm: {dielectric:.4g} mm?"
                )
        warn_unusual(
            [("copper_thickness_um", copper) for copper in self.copper_thickness]
            + [("dielectric_thickness_mm", dielectric) for dielectric in self.dielectric_thickness]
        )
        for epsilon in self.epsilon_r:
            if not (math.isfinite(epsilon) and epsilon >= 1):
                raise GeometryError(f"a relative permittivity must be at least 1; got {epsilon}.")

    @classmethod
    def uniform(
        cls,
        names: Sequence[str],
        *,
        thickness: float = BOARD_THICKNESS,
        copper: float = COPPER_THICKNESS,
        epsilon_r: float = EPSILON_R,
    ) -> Stackup:
        """Make a stack-up of equal layers with `names`, top to bottom.

        `thickness` in m is of the whole board, `copper` of every copper layer. The dielectrics
        share the rest equally, with the relative permittivity `epsilon_r`.

        >>> board = Stackup.uniform(("top", "bottom"))
        >>> [round(thickness * 1e3, 6) for thickness in board.dielectric_thickness]
        [1.53]
        """
        gaps = len(names) - 1
        dielectric = (thickness - len(names) * copper) / gaps if gaps else 0.0
        return cls(tuple(names), (copper,) * len(names), (dielectric,) * gaps, (epsilon_r,) * gaps)

    @classmethod
    def usual(cls, layers: int, sets: int = 1) -> Stackup:
        """Make the usual stack-up L1, L2, … for sets of coils that overlap.

        There are `sets` of `layers` copper layers of one coil. Layers of one set are 0.2 mm apart,
        so coils of all sets are alike. The dielectrics between the sets share the rest of a board
        of 1.6 mm, and are at least 0.2 mm thick. Copper has 35 µm, the dielectric is FR-4.

        >>> [round(thickness * 1e3, 6) for thickness in Stackup.usual(2, sets=2).dielectric_thickness]
        [0.2, 1.06, 0.2]
        """
        count = layers * sets
        rest = BOARD_THICKNESS - count * COPPER_THICKNESS - sets * (layers - 1) * PREPREG
        between = max(rest / (sets - 1), PREPREG) if sets > 1 else PREPREG
        gaps = [PREPREG if (k + 1) % layers else between for k in range(count - 1)]
        names = tuple(f"L{k + 1}" for k in range(count))
        return cls(names, (COPPER_THICKNESS,) * count, tuple(gaps), (EPSILON_R,) * len(gaps))

    @property
    def thickness(self) -> float:
        """Total thickness of the board in m, copper included."""
        return sum(self.copper_thickness) + sum(self.dielectric_thickness)

    def index(self, name: str) -> int:
        """Position of the copper layer `name`, 0 on top."""
        if name not in self.names:
            raise GeometryError(f"there is no copper layer {name!r}; the stack-up has {', '.join(self.names)}.")
        return self.names.index(name)

    def span(self, name: str) -> tuple[float, float]:
        """Heights (z_bottom, z_top) in m of the copper layer `name`."""
        i = self.index(name)
        z_top = -sum(self.copper_thickness[:i]) - sum(self.dielectric_thickness[:i])
        return z_top - self.copper_thickness[i], z_top

    def centre(self, name: str) -> float:
        """Height in m of the middle plane of copper layer `name`."""
        bottom, top = self.span(name)
        return 0.5 * (bottom + top)

    def between(self, first: str, last: str) -> tuple[str, ...]:
        """Names of the copper layers from `first` to `last`."""
        i, j = sorted((self.index(first), self.index(last)))
        return self.names[i : j + 1]
