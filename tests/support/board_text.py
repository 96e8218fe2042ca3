"""KiCad boards as text, written here independently of the exporter: what the readers are tested with."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

KICAD_6, KICAD_7, KICAD_8, KICAD_9 = 20211014, 20221018, 20240108, 20241229


def mm(value: float) -> str:
    """Length in m as KiCad has it: mm to 1 nm."""
    return f"{round(value * 1e9) / 1e6:.6f}".rstrip("0").rstrip(".")


def pair(name: str, x: float, y: float, origin: tuple[float, float] = (0.1, 0.1)) -> str:
    """Place in m, y up, on KiCad's sheet, y down."""
    return f"({name} {mm(origin[0] + x)} {mm(origin[1] - y)})"


def layer_names(count: int) -> list[str]:
    """KiCad's names of the copper layers, top to bottom."""
    return ["F.Cu", *(f"In{k}.Cu" for k in range(1, count - 1)), "B.Cu"][:count]


def board(
    *items: str,
    version: int = KICAD_6,
    layers: int = 2,
    users: tuple[str, ...] = (),
    setup: str = "(aux_axis_origin 100 100)",
    nets: tuple[str, ...] = ("A", "B"),
    thickness: str = "1.6",
) -> str:
    """Board of these items; net k + 1 is called nets[k]."""
    rows = [
        f'({31 if name == "B.Cu" else k} "{name}" signal{f" {chr(34)}{users[k]}{chr(34)}" if users else ""})'
        for k, name in enumerate(layer_names(layers))
    ]
    table = [f'(net {k} "{name}")' for k, name in enumerate(("", *nets))]
    head = (f"(kicad_pcb (version {version}) (generator pcbnew)", f"(general (thickness {thickness}))", '(paper "A4")')
    layer_table = ("(layers", *rows, '(44 "Edge.Cuts" user)', ")")
    return "\n".join((*head, *layer_table, f"(setup {setup})", *table, *items, ")", ""))


def segment(start, end, *, width="0.2", layer="F.Cu", net="1"):
    """Track; places in mm, y up from the origin."""
    a, b = (pair(name, x * 1e-3, y * 1e-3) for name, (x, y) in (("start", start), ("end", end)))
    return f'(segment {a} {b} (width {width}) (layer "{layer}") (net {net}) (tstamp 0))'


def path(*points, **options):
    """Tracks from point to point."""
    return "\n".join(segment(a, b, **options) for a, b in pairwise(points))


def via(x, y, *, size="0.6", drill="0.3", layers=("F.Cu", "B.Cu"), net="1", kind=""):
    """Via; place in mm, y up from the origin."""
    names = " ".join(f'"{layer}"' for layer in layers)
    return f"(via {kind} {pair('at', x * 1e-3, y * 1e-3)} (size {size}) (drill {drill}) (layers {names}) (net {net}))"


def pads(*places, net='1 "A"', size="1 1", turn=0.0, at=(0.0, 0.0)):
    """Footprint of through-hole pads 1, 2, …, places in mm, y up, in the footprint's own frame."""
    inside = "\n".join(
        f'(pad "{k + 1}" thru_hole circle (at {x} {-y}) (size {size}) (drill 0.5) (layers *.Cu *.Mask) (net {net}))'
        for k, (x, y) in enumerate(places)
    )
    where = pair("at", at[0] * 1e-3, at[1] * 1e-3)[:-1]
    return f'(footprint "lib:coil" (layer "F.Cu")\n{where} {turn})\n{inside}\n)'


def square_spiral(turns=3, outer=10.0, pitch=1.0):
    """Corners of a square spiral from the outside inwards, in mm about the origin."""
    k = np.arange(4 * turns)
    sides = outer - pitch * np.maximum((k - 1) // 2, 0)
    steps = sides[:, None] * np.array(((0, -1), (1, 0), (0, 1), (-1, 0)))[k % 4]
    corners = np.vstack(([-outer / 2, outer / 2], steps)).cumsum(axis=0)
    return [tuple(corner) for corner in np.round(corners, 6).tolist()]
