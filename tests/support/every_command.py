"""A short run of every command that writes a file, with what it reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomli_w

from coilarray.compute.netcdf import save_dataset
from coilarray.design.bundled import read
from support.board_text import board as kicad_text
from support.board_text import path
from support.quick_recordings import GRID, campaign_file, quick_map, stream_file
from support.recorded_boards import WIRING_TEXT, two_coils_document

BOARD = ("two.toml", "--wiring", "wiring.toml")
AT = ("--x-mm", "-6.64", "--y-mm", "0", "--depth-mm", "0.5")
PITCH = ("--vary", "array.pitch_mm=12:14:3", "--workers", "1")
PLAN = ("--plan", "plan.toml")
FAST = ("--settings", "fast.toml", "--no-locate")
FIELD = ("view", "bare.toml", "--spacing-mm", "4", "--out")
TARGET = ("target", "ball.toml", "--ideal", "--distance-mm", "1:4:4")
CALIBRATE = ("calibrate", "gast2020", "published", "--unknown", "coils.hexagon.gap_mm=0.05:0.1", "--workers", "1")
FILM = ("--depth-mm", "0.3", "--size", "160x90")
# whether it writes more than 6 kB in one file, and the command
WRITES = [
    (True, "init", "new.toml", "--from", "starter"),
    (False, "check", "starter", "--out", "rules.csv"),
    (True, "export", "starter", "--to", "svg", "--out", "b.svg"),
    (True, "export", "starter", "--to", "kicad", "--out", "board"),
    (True, "export", "starter", "--to", "gerber", "--out", "b.zip"),
    (True, "export", "starter", "--to", "dxf", "--out", "b.dxf"),
    (True, "export", "starter", "--to", "stl", "--out", "b.stl"),
    (False, "init", "--from", "two.kicad_pcb", "new.toml"),
    (True, "check", "starter", "--picture", "rules.png"),
    (True, "view", "starter", "--out", "v.vtm"),
    (True, "impedance", "bare.toml", "--out", "m.nc"),
    (True, "impedance", "bare.toml", "--out", "m.s1p"),
    (True, *FIELD, "f.nc"),
    (False, *FIELD, "f.vtr"),
    (False, "impedance", "bare.toml", "--out", "i.csv"),
    (True, "response", "two.toml", "--dent", "--depth-mm", "0.5", "--out", "d.nc"),
    (True, "response", "two.toml", *AT, "--out", "r.nc"),
    (True, "response", "two.toml", *AT, "--plot", "r.png"),
    (True, "response", "two.toml", "--dent", "--depth-mm", "0.5", "--plot", "d.png"),
    (True, "impedance", "bare.toml", "--plot", "i.png"),
    (False, *TARGET, "--out", "t.csv"),
    (True, *TARGET, "--plot", "t.png"),
    (True, *TARGET, "--maps", "m.png"),
    (True, *CALIBRATE, "--out", "folder"),
    (True, *CALIBRATE, "--plot", "c.png"),
    (True, "paper", "distortion", "gast2020", "--out", "d.nc"),
    (True, "paper", "distortion", "gast2020", "--plot", "d.png"),
    (False, "paper", "fit", "quick.nc", "--out", "model.json"),
    (True, "paper", "fit", "quick.nc", "--plot", "fit.svg"),
    (False, "sweep", "starter", *PITCH, "--quantity", "span_mm", "--out", "s.csv"),
    (True, "sweep", "starter", *PITCH, "--quantity", "span_mm", "--plot", "s.png"),
    (True, "optimize", "starter", *PITCH, "--goal", "minimize span_mm", "--trials", "3"),
    (False, "optimize", "starter", "worst_k", "--template", "goal.toml"),
    (True, "tolerance", "starter", "-q", "span_mm", "--samples", "8", "--out", "t.json", "--workers", "1"),
    (True, "tolerance", "starter", "-q", "span_mm", "--samples", "8", "--plot", "t.png", "--workers", "1"),
    (False, "tolerance", "--template", "tolerance.toml"),
    (True, "board", "info", "rest.sqlite", "--noise", "--plot", "n.png"),
    (True, "board", "measure", *BOARD, "--scans", "5", "--out", "run.sqlite"),
    (True, "board", "campaign", *BOARD, *PLAN, "--out", "run.sqlite"),
    (True, "board", "info", "campaign.sqlite", "--out", "c.nc"),
    (False, "board", "info", "rest.sqlite", "--out", "c.csv"),
    (False, "board", "calibrate", "rest.sqlite", "--out", "board.toml"),
    (True, "board", "compare", "campaign.sqlite", "quick.nc", "--out", "folder"),
    (True, "board", "live", *BOARD, *FAST, "--scans", "12", "--out", "live.sqlite"),
    (True, "board", "compare", "campaign.sqlite", "quick.nc", "--picture", "c.png"),
    (True, "view", "starter", "--out", "v.png"),
    (True, "view", "two.toml", *FILM, "--out", "v.gif"),
    (True, "report", "bare.toml", "--out", "folder"),
    (True, "view", "starter", "--out", "v.html"),
]
# these take long to draw, and are only stopped later: s.png and n.png, which are written alike, at their first byte too
PICTURES = {"c.png", "d.png", "i.png", "m.png", "r.png", "rules.png", "t.png"}
SLOW = PICTURES | {"folder", "m.s1p", "r.nc", "v.gif", "v.html", "v.png"}
WRITES_NOTHING = {"locate", "studio", "docs", "keys", "board test"}
BALL = """[target]
shape = "sphere"
diameter_mm = 8
material = "aluminium"
distances_mm = [1, 2, 3, 4]
x_mm = [-2, 2]
y_mm = [-2, 2]
step_mm = 2
"""


def command_of(arguments):
    """Name of the command of a command line."""
    return " ".join(arguments[: 2 if arguments[0] in ("board", "paper") else 1])


def write_inputs(folder: Path) -> None:
    """Write the files that the commands read."""
    text = read("gast_fem")  # one coil, without elastomer: the quickest of all
    bare = text[: text.index("[[elastomer]]")] + text[text.index("[circuit]") : text.index("[assumed]")]
    (folder / "bare.toml").write_text(bare, encoding="utf-8")
    (folder / "ball.toml").write_text(bare + BALL, encoding="utf-8")
    (folder / "two.toml").write_text(tomli_w.dumps(two_coils_document()), encoding="utf-8")
    (folder / "wiring.toml").write_text(WIRING_TEXT, encoding="utf-8")
    (folder / "plan.toml").write_text("x_mm = [-6.64]\ny_mm = [0]\ndepth_mm = [0.5]\n", encoding="utf-8")
    (folder / "fast.toml").write_text("baseline_scans = 4\n", encoding="utf-8")
    stream_file(folder / "rest.sqlite", 30, noise=1e-7)
    campaign_file(folder / "campaign.sqlite", noise=1e-7)
    spiral = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 1), (3, 1), (3, 3), (1, 3), (1, 2)]
    two = path(*spiral), path(*[(x + 8, y) for x, y in spiral], net="2")
    (folder / "two.kicad_pcb").write_text(kicad_text(*two), encoding="utf-8")
    save_dataset(quick_map(np.array(GRID.x), np.array(GRID.y)), folder / "quick.nc")
