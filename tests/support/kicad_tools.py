"""Run a real KiCad on a board: its design rule check and its Gerber plots.

Either ``kicad-cli`` (KiCad 8 and later) or the module ``pcbnew`` of the system's own python, for which this file is
also the script.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path


def find_kicad() -> Kicad | str:
    """Return a KiCad that can check boards, or the reason why there is none."""
    cli = shutil.which("kicad-cli")
    if cli is not None and int(_output(cli, "version").split(".")[0]) >= 8:  # older ones have no design rule check
        return _Cli(cli, _output(cli, "version"))
    python = shutil.which("python3", path=os.defpath)
    if python is None:
        return "there is neither kicad-cli 8 or later nor a python of the system"
    try:
        return _Pcbnew(python, _output(python, __file__, "version"))
    except subprocess.CalledProcessError:
        return f"there is no kicad-cli 8 or later, and {python} has no pcbnew"


@dataclass(frozen=True)
class _Cli:
    """A kicad-cli: the design rule check finds "kind: text", errors and warnings at the project's severities."""

    program: str
    version: str

    def findings(self, board: Path) -> list[str]:
        report = board.with_suffix(".json")
        _output(self.program, "pcb", "drc", "--severity-all", "--format", "json", "-o", str(report), str(board))
        found = json.loads(report.read_text(encoding="utf-8"))
        kinds = ("violations", "unconnected_items", "schematic_parity")
        return [f"{one['type']}: {one['description']}" for kind in kinds for one in found[kind]]

    def plot(self, board: Path, folder: Path) -> None:
        """Plot Gerber files and their job file into a new folder, from the drill origin."""
        options = ("--use-drill-file-origin", "--no-protel-ext", "-o", f"{folder}/")
        _output(self.program, "pcb", "export", "gerbers", *options, str(board))


@dataclass(frozen=True)
class _Pcbnew:
    python: str
    version: str

    def findings(self, board: Path) -> list[str]:
        report = board.with_suffix(".rpt")
        _output(self.python, __file__, "check", str(board), str(report))
        text = report.read_text(encoding="utf-8")
        if not text.rstrip().endswith("** End of Report **"):
            raise RuntimeError(f"KiCad's report on {board.name} is cut off: {text}")
        return [f"{kind}: {what}" for kind, what in re.findall(r"^\[(\w+)\]: (.*)", text, flags=re.MULTILINE)]

    def plot(self, board: Path, folder: Path) -> None:
        _output(self.python, __file__, "plot", str(board), str(folder))


Kicad = _Cli | _Pcbnew
"""A KiCad that is installed."""


def _output(*command: str) -> str:
    """What a command prints, with a folder of its own for KiCad's settings."""
    with tempfile.TemporaryDirectory() as settings:
        environment = {**os.environ, "KICAD_CONFIG_HOME": settings}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=True)
    return done.stdout.strip()


def _script(task: str, *arguments: str) -> None:
    """Run in the python that has ``pcbnew``."""
    import pcbnew

    if task == "version":
        sys.stdout.write(pcbnew.GetBuildVersion())
        return
    source, target = arguments
    board = pcbnew.LoadBoard(source)
    pcbnew.ZONE_FILLER(board).Fill(board.Zones())
    if task == "check":
        pcbnew.WriteDRCReport(board, target, pcbnew.EDA_UNITS_MILLIMETRES, True)
        return
    plotter = pcbnew.PLOT_CONTROLLER(board)
    options = plotter.GetPlotOptions()
    options.SetOutputDirectory(target)
    options.SetUseAuxOrigin(True)
    for layer in board.GetEnabledLayers().Seq():
        plotter.SetLayer(layer)
        plotter.OpenPlotfile(str(layer), pcbnew.PLOT_FORMAT_GERBER, "")
        plotter.PlotLayer()
    plotter.ClosePlot()
    pcbnew.GERBER_JOBFILE_WRITER(board).CreateJobFile(f"{target}/board-job.gbrjob")


if __name__ == "__main__":
    _script(*sys.argv[1:])
