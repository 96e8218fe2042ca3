"""Metals and ferrites near the coils: conductivity, permeability and skin depth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from coilarray.constants import MU_0
from coilarray.errors import GeometryError


@dataclass(frozen=True)
class Material:
    """Uniform, linear material that carries eddy currents.

    Parameters
    ----------
    name : str
        Name of the material, as in `MATERIALS` or your own.
    conductivity : float
        Conductivity in S/m, at least 0. inf is a perfect conductor.
    relative_permeability : float
        Relative permeability, at least 1.

    Raises
    ------
    GeometryError
        If a value is not allowed, or the material has neither conductivity nor permeability and would be air.

    Examples
    --------
    >>> round(MATERIALS["copper"].skin_depth(1e6) * 1e6, 1)
    66.1
    """

    name: str
    conductivity: float
    relative_permeability: float = 1.0

    def __post_init__(self) -> None:
        if not self.conductivity >= 0:
            raise GeometryError(f"conductivity of {self.name!r} must be at least 0; got {self.conductivity} S/m.")
        if not (math.isfinite(self.relative_permeability) and self.relative_permeability >= 1):
            raise GeometryError(
                f"relative permeability of {self.name!r} must be at least 1; got {self.relative_permeability}."
            )
        if self.conductivity == 0 and self.relative_permeability == 1:
            raise GeometryError(
                f"{self.name!r} must have a conductivity above 0 or a permeability above 1; it has neither."
            )

    @property
    def words(self) -> str:
        """Name for people, such as "stainless steel"."""
        return self.name.replace("_", " ")

    def skin_depth(self, frequency: float) -> float:
        """Skin depth in m at a frequency in Hz.

        At this depth, 1/√(π f µ σ), a field has fallen by e. It is inf without conductivity.

        Returns
        -------
        float
            Skin depth in m.
        """
        product = math.pi * frequency * MU_0 * self.relative_permeability * self.conductivity
        return math.inf if product == 0 else 1 / math.sqrt(product)


_IACS = 58.0e6  # S/m, 100 % IACS
_SOURCES: tuple[tuple[Material, str], ...] = (
    (Material("copper", _IACS), "annealed copper, 100 % IACS (IEC 60028)"),
    (Material("aluminium", 0.61 * _IACS), "EN AW-1050A, 61 % IACS (ASM Handbook vol. 2)"),
    (Material("aluminium_6061", 0.43 * _IACS), "EN AW-6061-T6, 43 % IACS (ASM Handbook vol. 2)"),
    (Material("brass", 0.28 * _IACS), "C26000, CuZn30, 28 % IACS (Copper Development Association)"),
    (Material("stainless_steel", 1 / 0.72e-6), "AISI 304, 0.72 µΩm, annealed, taken as not magnetic (ASM Handbook)"),
    (Material("steel", 1 / 0.143e-6, 200.0), "AISI 1010, 0.143 µΩm (ASM Handbook); its µr of 200 is assumed"),
    (Material("bearing_steel", 1 / 0.22e-6, 100.0), "AISI 52100, 0.22 µΩm (ASM Handbook); its µr of 100 is assumed"),
    (Material("titanium", 1 / 0.56e-6), "grade 2, 0.56 µΩm (ASM Handbook vol. 2)"),
    (Material("ferrite", 0.1, 2200.0), "MnZn N87, initial µr 2200 and 10 Ωm at 25 °C (TDK)"),
)
MATERIALS: Mapping[str, Material] = MappingProxyType({material.name: material for material, _ in _SOURCES})
"""Materials by their names in files, at 20 °C unless stated otherwise."""
MATERIAL_SOURCES: Mapping[str, str] = MappingProxyType({material.name: source for material, source in _SOURCES})
"""Grade of every named material, source of its values, and assumptions."""
