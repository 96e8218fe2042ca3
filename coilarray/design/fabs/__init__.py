"""The table ``[fab]`` of a design file, and bundled profiles of board houses with sources and dates."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Annotated

from pydantic import Field, model_validator

from coilarray.design import fabs
from coilarray.design.keys import LimitMillimetres, Micrometres, Millimetres, Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DesignError
from coilarray.geometry import FabRules

PROFILES = TomlFiles("fab profile", DesignError, __name__)  # profiles of board houses
names, read = PROFILES.names, PROFILES.read


@dataclass(frozen=True)
class FabProfile:
    """Limits of a board house.

    `sources` are titles and addresses of pages, `read` on a date. `limits` are keys and values of
    ``[fab]``, and `assumed` the keys that no source gives, with the reason.
    """

    name: str
    title: str
    read: date
    sources: tuple[tuple[str, str], ...]
    limits: Mapping[str, object]
    assumed: Mapping[str, str]

    @property
    def rules(self) -> FabRules:
        """The limits in SI."""
        return FabRules(**FabTable.model_validate({"profile": self.name}).in_si(without=("profile",)))


@functools.cache
def load_profile(name: str) -> FabProfile:
    """Read a bundled profile."""
    if name not in fabs.names():
        raise DesignError(f"there is no fab profile {name!r}; there are {', '.join(fabs.names())}.")
    text = fabs.PROFILES.parse(fabs.read(name), name)
    return FabProfile(
        name=name,
        title=text["title"],
        read=text["read"],
        sources=tuple((source["title"], source["url"]) for source in text["sources"]),
        limits=text["limits"],
        assumed=text.get("assumed", {}),
    )


class FabTable(Table):
    """``[fab]``: limits of the board house; keys beside ``profile`` override those of the profile."""

    profile: str | None = None
    """Name of a bundled board house; `coilarray check --list-fabs` shows them."""
    min_trace_mm: LimitMillimetres = 0.1
    """Least width of a trace."""
    min_gap_mm: LimitMillimetres = 0.1
    """Least distance between copper and copper."""
    min_drill_mm: LimitMillimetres = 0.2
    """Least diameter of a drilled hole."""
    min_annular_ring_mm: LimitMillimetres = 0.1
    """Least width of the copper ring around a hole."""
    min_edge_clearance_mm: LimitMillimetres = 0.3
    """Least distance from copper to the edge of the board."""
    min_hole_spacing_mm: LimitMillimetres = 0.25
    """Least distance from the edge of one hole to that of the next."""
    max_layers: Annotated[int, Field(ge=1, le=1000)] | None = None
    """Largest number of copper layers."""
    max_outer_copper_um: Micrometres | None = None
    """Largest thickness of the outer copper layers."""
    max_inner_copper_um: Micrometres | None = None
    """Largest thickness of the inner copper layers."""
    max_aspect_ratio: Annotated[float, Field(gt=0, le=1000)] | None = None
    """Largest thickness of the board over the diameter of a hole."""
    max_board_mm: Annotated[list[Millimetres], Field(min_length=2, max_length=2)] | None = None
    """Largest size [x, y] of the board."""
    blind_holes: bool = True
    """Whether the board house makes blind and buried holes."""
    min_bend_ratio: Annotated[float, Field(gt=0, le=1000)] | None = None
    """Least inner radius of a bend over the thickness of the board; by default 10 for one or two
    copper layers and 20 for more, assumed."""

    @model_validator(mode="before")
    @classmethod
    def _profile_first(cls, table: object) -> object:
        """Add the limits of the profile that are not given."""
        name = table.get("profile") if isinstance(table, Mapping) else None
        if not isinstance(name, str) or not isinstance(table, Mapping):
            return table  # a profile that is not text is refused by its type
        if name not in fabs.names():
            raise ValueError(f"has no profile {name!r}; there are {', '.join(fabs.names())}")
        return {**load_profile(name).limits, **table}
