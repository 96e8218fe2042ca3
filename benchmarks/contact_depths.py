"""How deep each indenter goes under large strain: on every base and on one, two and three sheets.

    python benchmarks/contact_depths.py

Presses every indenter 1 mm into 8 mm of elastomer, and where that is refused writes the depth up to which the contact
converges. Prints a table and writes benchmarks/contact_depths.json; takes about five minutes.
"""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np

from coilarray.elastomer.contact import indent
from coilarray.errors import ElastomerError
from coilarray.geometry import Cone, CylinderEdge, FlatPunch, Hemisphere, Indenter, Paraboloid, Seat, Sheet
from coilarray.geometry.elastomer import Base

RESULTS = Path(__file__).with_suffix(".json")
DEPTH, THICKNESS = 1e-3, 8e-3
INDENTERS: dict[str, Indenter] = {
    "hemisphere of 2.5 mm": Hemisphere(2.5e-3),
    "paraboloid of 2.5 mm": Paraboloid(2.5e-3),
    "cylinder of 2.5 mm": CylinderEdge(2.5e-3),
    "cone of 80 degrees, 2.5 mm": Cone(np.radians(80), 2.5e-3),
    "cone of 60 degrees": Cone(np.radians(60)),
    "cone of 45 degrees": Cone(np.radians(45)),
    "flat punch of 2.5 mm": FlatPunch(2.5e-3),
    "flat punch of 1 mm": FlatPunch(1e-3),
}
BASES: dict[str, Base] = {"bonded": "bonded", "frictionless": "frictionless", "seat": Seat(4.3e6)}
STACKS = {
    "one": [Sheet("base", 8e-3, youngs_modulus=1e5)],
    "two": [Sheet("base", 6e-3, youngs_modulus=1e5), Sheet("magnetic", 2e-3, youngs_modulus=3e5)],
    "three": [
        Sheet("base", 4e-3, youngs_modulus=55e3),
        Sheet("magnetic", 2e-3, youngs_modulus=166e3),
        Sheet("cover", 2e-3, youngs_modulus=55e3),
    ],
}


def press(indenter: Indenter, base: Base, sheets: list[Sheet]) -> dict[str, Any]:
    """Depth reached in m and seconds that it took."""
    start = time.perf_counter()
    try:
        indent(sheets, indenter, DEPTH, base=base)
        reached = DEPTH
    except ElastomerError as refused:
        converged = re.search(r"up to a depth of (\S+) thicknesses", str(refused))
        if converged is None:
            raise
        reached = float(converged[1]) * THICKNESS
    return {"reached": reached, "seconds": round(time.perf_counter() - start, 2)}


def main() -> None:
    """Press, print, keep."""
    results: dict[str, Any] = {}
    for name, indenter in INDENTERS.items():
        for base, support in BASES.items():
            for count, sheets in STACKS.items():
                one = results[f"{name}, {base}, {count}"] = press(indenter, support, sheets)
                print(f"{name:28}{base:14}{count:7}{one['reached'] * 1e3:6.3f} mm{one['seconds']:7.2f} s", flush=True)
    RESULTS.write_text(json.dumps({"units": "m, s", "depth": DEPTH, "cases": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
