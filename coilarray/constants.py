"""Physical constants in SI."""

from __future__ import annotations

from typing import Final

MU_0: Final = 4e-7 * 3.141592653589793
"""Vacuum permeability in H/m before 2019, as in the references (1.3e-10 off CODATA 2022)."""

RESISTIVITY_COPPER: Final = 1.724e-8
"""Resistivity of annealed copper at 20 °C in Ω·m (IEC 60028)."""

COPPER_PER_KELVIN: Final = 3.93e-3
"""Temperature coefficient of annealed copper's resistance at 20 °C in 1/K (IEC 60028)."""

EPSILON_0: Final = 1 / (MU_0 * 299792458.0**2)
"""Vacuum permittivity in F/m (of the same µ0, 1.3e-10 off CODATA 2022)."""
