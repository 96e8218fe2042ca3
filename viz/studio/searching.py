"""Optimisations, exports and response maps for the page.

All run in processes of their own.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.compute.threads import Progress
from coilarray.design.export import export
from coilarray.design.export_formats import Format
from coilarray.design.model import build_design, build_design_file
from coilarray.viz.studio.services import Document

if TYPE_CHECKING:
    import xarray as xr


def search_goal(document: Document, name: str, goal: str, trials: int, folder: Path, progress: Progress) -> str:
    """Search as ``coilarray optimize`` does, into a folder.

    One line about the result is returned.
    """
    from coilarray.studies.optimize.derive import derive_goal
    from coilarray.studies.optimize.run import optimize_design
    from coilarray.studies.optimize.write import write_optimization

    file = build_design_file(document, name)
    wanted = derive_goal([goal], file).goal
    wanted = wanted.model_copy(update={"search": wanted.search.model_copy(update={"trials": trials})})
    found = optimize_design(file, wanted, folder, progress=lambda done, total, _: progress(done, total))
    write_optimization(found, folder)
    better = len(found.front)
    return f"{goal}: {better or 'no'} better design{'' if better == 1 else 's'} than this one"


def write_board(document: Document, name: str, path: Path, to: Format, _: Progress) -> str:
    """Write the board for fabrication or another program.

    One line about it is returned.
    """
    written = export(build_design(document, name), path, to).files
    return f"wrote {path}" if len(written) == 1 else f"wrote {len(written)} files into {path}"


def map_of(document: Document, name: str, progress: Progress) -> xr.Dataset:
    """Compute the response map of a design on the board.

    It is the same map as in the design's report.
    """
    from coilarray.response.dataset import on_board
    from coilarray.response.map import response_map

    return on_board(response_map(build_design(document, name), reach="auto", progress=progress))
