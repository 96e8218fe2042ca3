"""Pictures of a report as data URIs, without other files."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray import viz
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.compute.files import writing
from coilarray.compute.table import Picture, png_url
from coilarray.design.model import Design
from coilarray.errors import MissingDependencyError
from coilarray.geometry import Indenter
from coilarray.paper.ellipse_model import EllipseModel
from coilarray.report.position import MapPositions
from coilarray.response.dataset import middle_state

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from coilarray.viz.scenes.scene import Side


_SIZE = (1280, 720)  # pixels of a rendered picture, the page is 1100 wide
_DPI = 130
_RIM = 0.1  # inches of white around a picture
_WHITE = 0xFFFFFFFF  # a pixel of four bytes
_BESIDE = (1.5, 4.0, 1.2, 1.0)  # inches at the left, at the right, below and above a single pair of axes
_AXES_PART = 0.84  # of a figure's width and height


def board_picture(design: Design) -> list[Picture]:
    """Show the board, drawn from above if this machine cannot render it."""
    if viz.rendering_problem() is None:
        from coilarray.viz.scenes.design import View, scene_of_design  # all that a scene may compute

        scene = scene_of_design(design, View(show=("board", "plates") if design.plates else ("board",)))
        return [_render("board", "The board; lengths in mm.", scene)]
    caption = "The board from above; lengths in mm. This computer could not render it in three dimensions."
    return [draw("board", caption, viz.plot_board(design.array))]


def board_page(design: Design) -> str | None:
    """Return a page on which the board can be turned, None without the extra 3d."""
    from coilarray.viz.scenes.design import View, board_and_metal, scene_of_design
    from coilarray.viz.scenes.page import scene_page

    try:
        return scene_page(
            scene_of_design(design, View(show=board_and_metal(design))),
            title="Drag to turn, use the wheel to come nearer",
        )
    except MissingDependencyError:
        return None


def copper_pictures(design: Design) -> list[Picture]:
    """Show the copper of every layer that has any."""
    array = design.array
    used = [layer for layer in array.stackup.names if any(layer in place.layers for place in array.placements)]
    return [draw(f"copper_{layer}", f"Copper of layer {layer}.", viz.plot_copper(array, layer)) for layer in used]


def effective_inductance_picture(coupling: xr.Dataset) -> list[Picture]:
    """Draw L with the others open, and as terminated."""
    caption = "Inductance of each coil with all others open, and with the others as terminated."
    return [draw("effective_inductance", caption, viz.plot_effective_inductance(coupling))]


def matrix_pictures(coupling: xr.Dataset) -> list[Picture]:
    """Draw heat maps of k and L."""
    inductance = "Mutual inductance of the pairs, and for few coils the self-inductance on the diagonal."
    return [
        draw("coupling", "Coupling coefficients k = M/√(L L).", viz.plot_coupling(coupling)),
        draw("inductance", inductance, viz.plot_inductance(coupling)),
    ]


def current_picture(coupling: xr.Dataset) -> list[Picture]:
    """Draw the currents of the passive coils."""
    caption = "Current in each passive coil per ampere in the active one."
    return [draw("currents", caption, viz.plot_currents(coupling))]


def field_line_picture(design: Design, active: str, line: dict[str, xr.Dataset]) -> list[Picture]:
    """Draw B_z along a line through the active coil."""
    across = _outline(design, active)[:, 0]
    caption = f"B_z along x through {active}, {_field_words(design)}."
    drawn = viz.plot_field_lines(line, coil=(float(across.min()), float(across.max())))
    return [draw("field_line", caption, drawn)]


def field_map_pictures(design: Design, active: str, plane: dict[str, xr.Dataset]) -> list[Picture]:
    """Draw B_z on a plane above the board, a picture for each entry."""
    outlines = [_outline(design, name) for name in design.array.names]
    captions = {
        label: f"B_z of {active} {_field_words(design)}, per ampere{'' if len(plane) == 1 else f': {label}'}."
        for label in plane
    }
    return [
        draw(f"field_map_{k}", captions[label], viz.plot_field_map(field, outlines=outlines))
        for k, (label, field) in enumerate(plane.items())
    ]


def _field_words(design: Design) -> str:
    where = "beside the plates" if design.plates else "in free space"
    return f"{design.field_height * 1e3:g} mm above the board, {where}"


def sweep_pictures(sweep: xr.Dataset) -> list[Picture]:
    """Draw apparent inductance and resistance over frequency."""
    return [
        draw(
            "apparent_inductance",
            "Apparent inductance Im Z/ω of every state over frequency, tank capacitor left out.",
            viz.plot_frequency_sweep(sweep, "apparent_inductance"),
        ),
        draw(
            "resistance",
            "Effective resistance Re Z of every state over frequency, tank capacitor left out.",
            viz.plot_frequency_sweep(sweep, "impedance_real"),
        ),
    ]


def indentation_pictures(design: Design, indenter: Indenter, indentation: xr.Dataset, coil: str) -> list[Picture]:
    """Draw the deepest dent in section and, if this machine can render, over a coil, and the force over depth."""
    deepest = f"{float(indentation.depth[-1]) * 1e3:g} mm deep"
    caption = f"The sheets under the {indenter.name} in section, {deepest}; dashed where they lay flat."
    pictures = [draw("dent_section", caption, viz.plot_dent(indentation, indenter))]
    if viz.rendering_problem() is None:
        outline = _outline(design, coil)
        x, y = ((outline.min(axis=0) + outline.max(axis=0)) / 2).tolist()
        caption = f"The deformed sheets over {coil}, {deepest}; a quarter is cut out."
        scene = viz.dent_scene(design.array, design.sheets, indentation, indenter, centre=(x, y))
        pictures.append(_render("dent", caption, scene, "cut"))
    return [*pictures, draw("force_depth", "Force and contact over the depth.", viz.plot_force_depth(indentation))]


def response_map_pictures(design: Design, response: xr.Dataset) -> list[Picture]:
    """Draw δ as maps with the outlines of the coils, none for a single row of places."""
    if min(response.sizes["x"], response.sizes["y"]) == 1:
        return []
    deepest = f"{float(response.depth[-1]) * 1e3:g} mm deep"
    caption = f"δ of each state over the position of the indenter, {deepest}, with the outlines of the coils."
    return [draw("response_maps", caption, viz.response_figure(response, map_outlines(design, response)))]


def response_line_pictures(response: xr.Dataset) -> list[Picture]:
    """Draw δ along a line, and of one state for each depth."""
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


def target_pictures(design: Design, target: xr.Dataset) -> list[Picture]:
    """Draw the effect of a target over its distance, and as maps."""
    caption = (
        "|δ|, inductance, quality factor and frequency of the states over the distance of the target, where it moves "
        "each the most; dotted: the noise of δ, and the values without the target."
    )
    found = [draw("target", caption, viz.target_figure(target))]
    if min(target.sizes["x"], target.sizes["y"]) > 1:
        least = f"{float(target.distance[0]) * 1e3:g} mm"
        caption = f"δ of each state over the place of the target, {least} away, with the outlines of the coils."
        found.append(draw("target_maps", caption, viz.response_figure(target, map_outlines(design, target))))
    return found


def bounds_picture(design: Design, bounds: xr.Dataset) -> list[Picture]:
    """Draw the standard deviation of a position on the board."""
    outlines = [_outline(design, name) for name in design.array.names]
    caption = "Least standard deviation of a located position over the board, grey where it cannot be determined."
    return [draw("position_bounds", caption, viz.identifiability_figure(bounds, outlines))]


def ellipse_pictures(design: Design, positions: MapPositions, published: EllipseModel | None) -> list[Picture]:
    """Draw A, B and x0 of the middle coil over δ, and two ellipses that intersect."""
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


def position_error_picture(design: Design, positions: MapPositions) -> list[Picture]:
    """Draw the error of x over the map."""
    outlines = [_outline(design, name) for name in design.array.names]
    caption = "Error of x (found − true) over the map; grey where the model has no position."
    return [draw("x_error", caption, viz.plot_x_error(positions.error, outlines=outlines))]


def distortion_picture(distortion: xr.Dataset) -> list[Picture]:
    """Draw the motion of x0 with δ and its causes."""
    bands = "; bands: two standard deviations of the calibration" if "x0_std" in distortion else ""
    caption = f"Left: x0 over δ as predicted and as published. Right: what x0 loses without each cause{bands}."
    return [draw("distortion", caption, viz.distortion_figure(distortion))]


def comparison_pictures(comparison: xr.Dataset, outlines: Sequence[npt.ArrayLike] = ()) -> list[Picture]:
    """Draw the residuals between two responses."""
    deepest = f"{float(comparison.depth[-1]) * 1e3:g} mm deep"
    caption = f"Measured over simulated δ of every position, {deepest}; grey: equality."
    dots = draw("readings", caption, viz.plot_readings(comparison, -1))
    if min(comparison.sizes["x"], comparison.sizes["y"]) == 1:
        return [dots]
    maps = draw(
        "residuals",
        f"Measured less simulated δ {deepest}, as simulated and scaled and shifted, grey where nothing was compared, "
        "with the outlines of the coils.",
        viz.comparison_figure(comparison, -1, outlines),
    )
    return [maps, dots]


def map_outlines(design: Design, response: xr.Dataset) -> list[FloatArray]:
    """Outline of every coil in m from the origin of a map, each of shape (m, 2)."""
    shifts = np.column_stack((response.coil_x, response.coil_y)) - design.array.centres
    return [_outline(design, name) + shift for name, shift in zip(design.array.names, shifts, strict=True)]


def _outline(design: Design, coil: str) -> FloatArray:
    """Corners of a coil's outline in m on the board."""
    place = design.array.placements[design.array.names.index(coil)]
    return place.to_board(place.coil.outline)


def _render(name: str, caption: str, scene: viz.Scene, side: Side = "oblique") -> Picture:
    with writing("temporary files"), tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.png"
        viz.save_picture(scene, path, side=side, size=_SIZE)
        return Picture(name, caption, png_url(path.read_bytes()))


def draw(name: str, caption: str, drawn: Axes | Figure) -> Picture:
    """Return a drawn figure as a picture with caption."""
    return Picture(name, caption, png_url(png_of(drawn)))


def png_of(drawn: Axes | Figure) -> bytes:
    """Draw a figure without its white rim, and close it.

    Matplotlib's own tight box would draw it twice.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    from coilarray.viz.plots.style import close

    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert isinstance(figure, Figure)  # plots draw on figures, never on sub-figures
    close(figure)
    buffer = io.BytesIO()
    figure.set_dpi(_DPI)
    _lay_out(figure)
    canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    inked = pixels.view(np.uint32)[..., 0] != _WHITE
    if any(edge.any() for edge in (inked[0], inked[-1], inked[:, 0], inked[:, -1])):  # it may extend beyond the figure
        figure.savefig(buffer, format="png", dpi=_DPI, bbox_inches="tight")
        return buffer.getvalue()
    rim = round(_RIM * _DPI)
    rows, columns = (np.flatnonzero(inked.any(axis=k)) for k in (1, 0))
    cut = tuple(slice(max(0, at[0] - rim), at[-1] + 1 + rim) for at in (rows, columns))
    # Matplotlib's own imsave would first search the pixels for colours, which takes as long
    Image.fromarray(np.ascontiguousarray(pixels[cut][..., :3])).save(
        buffer, format="png", dpi=(_DPI, _DPI), compress_level=3
    )
    return buffer.getvalue()


def _lay_out(figure: Figure) -> None:
    """Lay out single axes with a rim for their labels.

    Matplotlib's layout measures every text first, which takes as long as drawing. Several axes need it.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if len(figure.axes) != 1 or not isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
        return
    (axes,), (width, height) = figure.axes, figure.get_size_inches().tolist()
    left, right, low, high = _BESIDE
    share = _AXES_PART
    figure.set_layout_engine("none")
    figure.set_size_inches(width + left + right, height + low + high)
    whole = figure.get_size_inches()
    axes.set_position((left / whole[0], low / whole[1], share * width / whole[0], share * height / whole[1]))
