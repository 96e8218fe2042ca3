"""HTML pages of sections, and their pictures as data URIs."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import jinja2
import numpy as np
import xarray as xr

from coilarray import viz
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.compute.files import writing
from coilarray.compute.table import Block, Group, Picture, Section, html_blocks, png_url, text_table
from coilarray.design.boards import named_boards
from coilarray.design.model import Board, Design
from coilarray.errors import MissingDependencyError
from coilarray.geometry import Indenter
from coilarray.paper.ellipse_model import EllipseModel
from coilarray.report.position import MapPositions
from coilarray.response.dataset import middle_state

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from coilarray.viz.scenes.scene import Side


def html_page(
    heading: str,
    lead: Sequence[Block],
    sections: Sequence[Section],
    *,
    title: str = "",
    top: Sequence[Block] = (),
    scene: str | None = None,
    contents: bool = False,
) -> str:
    """Return a self-contained page.

    `lead` comes before the list of contents, `top` after it. `scene` is a page with a turnable
    board, in place of the first picture of `top`.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("coilarray.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        title=title or heading, heading=heading, lead=html_blocks(lead), top=html_blocks(top), scene=scene,
        sections=sections, contents=contents, blocks=html_blocks,
    )  # fmt: skip


def provenance_section(made: Mapping[str, object], *notes: str) -> Section:
    """Return the origin of a page as its last section."""
    names = {"design_hash": "design hash (SHA-256)", "coilarray_version": "coilarray"}
    rows = [(names.get(key, key.replace("_", " ")), str(value)) for key, value in made.items()]
    return Section("Provenance", (Group("text", (text_table(("made", "with"), rows),)), *notes))


def now() -> str:
    """Return the date and time in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


_SIZE = (1280, 720)  # pixels of a rendered picture, the page is 1100 wide
_DPI = 130


def board_picture(design: Design) -> list[Picture]:
    """Show the board, drawn from above if not rendered."""
    if viz.rendering_problem() is None:
        from coilarray.viz.scenes.design import View, scene_of_design  # all that a scene may compute

        scene = scene_of_design(design, View(show=("board", "plates") if design.plates else ("board",)))
        return [_render("board", f"The board{'s' if design.boards else ''}; lengths in mm.", scene)]
    pictures = []
    for board in named_boards(design):
        which = f"The board {board.name} by itself" if board.name else "The board"
        caption = f"{which} from above; lengths in mm. This computer could not render it in three dimensions."
        pictures.append(draw(picture_name("board", board), caption, viz.plot_board(board.array)))
    return pictures


def board_page(design: Design) -> str | None:
    """Return a page with a turnable board, None without PyVista."""
    from coilarray.viz.scenes.design import View, board_and_metal, scene_of_design
    from coilarray.viz.scenes.pictures import scene_page

    try:
        return scene_page(
            scene_of_design(design, View(show=board_and_metal(design))),
            title="Drag to turn, use the wheel to come nearer",
        )
    except MissingDependencyError:
        return None


def plotted(plot: str, name: str, caption: str, *arguments: Any, **options: Any) -> list[Picture]:
    """Draw a picture by the name of a `coilarray.viz` function."""
    return [draw(name, caption, getattr(viz, plot)(*arguments, **options))]


def indentation_pictures(design: Design, indenter: Indenter, indentation: xr.Dataset, coil: str) -> list[Picture]:
    """Draw the deepest dent, and the force over depth."""
    deepest = f"{float(indentation.depth[-1]) * 1e3:g} mm deep"
    caption = f"The sheets under the {indenter.name} in section, {deepest}; dashed where they lay flat."
    pictures = [draw("dent_section", caption, viz.plot_dent(indentation, indenter))]
    if viz.rendering_problem() is None:
        outline = board_outlines(design)[coil]
        x, y = ((outline.min(axis=0) + outline.max(axis=0)) / 2).tolist()
        caption = f"The deformed sheets over {coil}, {deepest}; a quarter is cut out."
        scene = viz.dent_scene(design.array, design.sheets, indentation, indenter, centre=(x, y))
        pictures.append(_render("dent", caption, scene, "cut"))
    return [*pictures, draw("force_depth", "Force and contact over the depth.", viz.plot_force_depth(indentation))]


def response_line_pictures(response: xr.Dataset) -> list[Picture]:
    """Draw δ along a line, and one state by depth."""
    deepest = f"{float(response.depth[-1]) * 1e3:g} mm deep"
    along: Literal["x", "y"] = "y" if response.sizes["x"] == 1 else "x"
    caption = f"δ along {along}, {deepest}; dotted lines are the centres of the coils."
    pictures = [draw("response_profile", caption, viz.plot_response_profile(response, depth=-1, along=along))]
    state = middle_state(response)
    if response.sizes[along] > 1:
        caption = f"δ of {state} along {along} for each depth, with its width at half the peak."
        pictures.append(draw("response_depths", caption, viz.plot_bell_curve(response, state, along=along)))
    elif response.sizes["depth"] > 1:
        depths = viz.plot_response_profile(response, state, None, along=along)
        pictures.append(draw("response_depths", f"δ of {state} along {along} for each depth.", depths))
    return pictures


def ellipse_pictures(design: Design, positions: MapPositions, published: EllipseModel | None) -> list[Picture]:
    """Draw A, B and x0 over δ, and two ellipses."""
    names = positions.model.names
    coil = design.array.middle_coil if design.array.middle_coil in names else names[0]
    beside = "" if published is None or coil not in published.names else "; grey: Table A1 of the paper"
    place = positions.example()
    at = true_minus(f"({place[0] * 1e3:.4g}, {place[1] * 1e3:.4g})")
    at += f" mm{positions.axis.removeprefix('x').removesuffix(' (mm)')}"
    parameters = viz.plot_ellipse_parameters(positions.fits, positions.model, coil, published=published)
    parameters.set_ylabel(f"A, B, $x_0$: {positions.axis}")
    ellipses = viz.plot_ellipses(positions.ellipses(place), positions.found[place], place)
    ellipses.set_xlabel(positions.axis)
    fitted = f"Semi-axes and centre of the ellipses of {coil} over δ, and the polynomials fitted to them{beside}."
    crossed = f"Ellipses for the readings at {at}. They meet where the indenter may be."
    return [draw("ellipse_parameters", fitted, parameters), draw("ellipses", crossed, ellipses)]


def map_outlines(design: Design, response: xr.Dataset) -> list[FloatArray]:
    """Coil outlines (m, 2) in m from a map's origin."""
    shifts = np.column_stack((response.coil_x, response.coil_y)) - design.centres[:, :2]
    return [outline + shift for outline, shift in zip(board_outlines(design).values(), shifts, strict=True)]


def board_outlines(design: Design) -> dict[str, FloatArray]:
    """Coil outlines (m, 2) in m, from above, on all boards."""
    outlines = {}
    for board in design.placed:
        for name, place in zip(board.coil_names, board.array.placements, strict=True):
            flat = place.to_board(place.coil.outline)
            outlines[name] = board.in_space(np.column_stack((flat, np.zeros(len(flat)))))[:, :2]
    return outlines


def picture_name(start: str, board: Board) -> str:
    """Name of a picture of a board."""
    return f"{start}_{board.name.replace('/', '_')}" if board.name else start


def _render(name: str, caption: str, scene: viz.Scene, side: Side = "oblique") -> Picture:
    with writing("temporary files"), tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.png"
        viz.save_picture(scene, path, side=side, size=_SIZE)
        return Picture(name, caption, png_url(path.read_bytes()))


def draw(name: str, caption: str, drawn: Axes | Figure) -> Picture:
    """Return a drawn figure as a picture with caption."""
    return Picture(name, caption, png_url(png_of(drawn)))


def png_of(drawn: Axes | Figure) -> bytes:
    """Draw a figure without its white rim, and close it."""
    from matplotlib.figure import Figure

    from coilarray.viz.plots.style import close

    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert isinstance(figure, Figure)  # plots draw on figures, never on sub-figures
    close(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, bbox_inches="tight", pil_kwargs={"compress_level": 3})
    return buffer.getvalue()
