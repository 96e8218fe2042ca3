"""Ports of coils: source, load and the capacitors between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from coilarray.errors import DesignError, require_positive

_UNITS = {
    "source_resistance": " Ω", "load_resistance": " Ω", "series_capacitance": " F", "parallel_capacitance": " F",
    "capacitor_quality": "",
}  # fmt: skip


@dataclass(frozen=True)
class Port:
    """Own circuit of a coil, apart from switches and converter.

    The parallel capacitor lies across the coil or across the terminals, where the source or load
    is, and the series capacitor between the coil and the terminals. Without source and load the
    terminals are open, and the coil with its parallel capacitor resonates by itself.

    `coil` is the name of the coil, and of its port in results. `source_resistance` and
    `load_resistance` are in Ω, `series_capacitance` and `parallel_capacitance` in F, None for what
    there is not. `parallel_at`, "coil" or "terminals", only matters beside a series capacitor.
    `capacitor_quality` is the quality factor of both capacitors at the frequency of the link, C (1
    − j/Q), None without losses. Raises DesignError for a value that is not positive, both source
    and load, a series capacitor without them, or another place.

    >>> Port("coil1", source_resistance=50.0, series_capacitance=-1e-12)
    Traceback (most recent call last):
    coilarray.errors.DesignError: series_capacitance of the port at coil1 must be positive and finite; got -1e-12 F.
    """

    coil: str
    source_resistance: float | None = None
    load_resistance: float | None = None
    series_capacitance: float | None = None
    parallel_capacitance: float | None = None
    parallel_at: Literal["coil", "terminals"] = "coil"
    capacitor_quality: float | None = None

    def __post_init__(self) -> None:
        for name, unit in _UNITS.items():
            if (value := getattr(self, name)) is not None:
                require_positive(f"{name} of the port at {self.coil}", value, unit, DesignError)
        if self.source_resistance is not None and self.load_resistance is not None:
            raise DesignError(
                f"the port at {self.coil} must have a source or a load; got source_resistance "
                f"{self.source_resistance:g} Ω and load_resistance {self.load_resistance:g} Ω."
            )
        if self.series_capacitance is not None and self.resistance is None:
            raise DesignError(
                f"the port at {self.coil} must have a source or a load behind its series capacitor, which carries no "
                f"current otherwise; got series_capacitance {self.series_capacitance:g} F alone."
            )
        if self.parallel_at not in ("coil", "terminals"):
            raise DesignError(
                f"parallel_at of the port at {self.coil} must be 'coil' or 'terminals'; got {self.parallel_at!r}."
            )

    @property
    def resistance(self) -> float | None:
        """Resistance of source or load in Ω, None without them."""
        return self.load_resistance if self.source_resistance is None else self.source_resistance

    @property
    def capacitances(self) -> tuple[float | None, float | None]:
        """Series and parallel capacitance in F, None for none."""
        return self.series_capacitance, self.parallel_capacitance

    def with_capacitors(self, series: float | None, parallel: float | None) -> Port:
        """Return the port with other `series` and `parallel` capacitances in F, None for none."""
        return replace(self, series_capacitance=series, parallel_capacitance=parallel)


def check_ports(ports: Sequence[Port], link_frequency: float | None, names: Sequence[str]) -> None:
    """Refuse ports of unknown coils, twice at a coil, or without a frequency."""
    for k, port in enumerate(ports):
        if port.coil not in names:
            raise DesignError(f"circuit.ports.{k}.coil names no coil; there are {', '.join(names)}; got {port.coil!r}.")
        if port.coil in (other.coil for other in ports[:k]):
            raise DesignError(f"circuit.ports.{k}.coil must name a coil without a port; got {port.coil!r} once more.")
    if link_frequency is not None:
        require_positive("circuit.link_frequency", link_frequency, " Hz", DesignError)
    elif ports:
        raise DesignError(
            "circuit.link_frequency_MHz is missing; [[circuit.ports]] need the frequency at which they work."
        )
