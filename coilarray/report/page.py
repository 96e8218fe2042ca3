"""HTML pages of sections, and their pictures as data URIs."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
import tempfile
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import jinja2
import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray import viz
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import true_minus
from coilarray.compute.files import is_own, writing
from coilarray.compute.table import Block, Group, Picture, Section, data_url, html_blocks, text_table
from coilarray.design.model import Board, Design
from coilarray.errors import MissingDependencyError, OutputError
from coilarray.geometry import Indenter
from coilarray.paper.ellipse_model import EllipseModel
from coilarray.report.position import MapPositions
from coilarray.response.dataset import middle_state

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    from coilarray.viz.scenes.scene import Side

_DATA = re.compile(r'(?<=base64Str: ")[^"]+')  # of a scene's page: a ZIP file of index.json
_STEPS = (3, 4, 24)  # distances of like numbers: in points, in lines of two, in the triangles of prisms
_SIZE = (1280, 720)  # pixels of a rendered picture, the page is 1100 wide
_QUALITY = 80  # of its JPEG
_RIM = 16  # white pixels above and below what it shows
FULL, HALF = 8.6, 5.2
"""Inches of a figure as wide as the page, and of a figure that shares the width with another."""
_LAYOUTS = 5  # most of a figure
_DPI = 130  # of maps in figures, and of figures of too many paths
_MOST_BYTES = 250_000  # of a figure of paths
_UNDER_AXES = 2.4  # height of what becomes an image in a figure of too many paths, below axes, rulers and texts
_DARK = {  # colours of figures that a dark page replaces
    "#202020": "ink",
    "#000000": "ink",
    "#606060": "axis",
    "#ffffff": "paper",
    "#e4e4e4": "faint",
    "#ededed": "shade",
}


def html_page(
    heading: str,
    lead: Sequence[Block],
    sections: Sequence[Section],
    *,
    title: str = "",
    top: Sequence[Block] = (),
    scene: str | None = None,
    contents: bool = False,
    foot: str = "",
) -> str:
    """Return a self-contained page.

    `lead` comes before the list of contents, `top` after it. `scene` is a page with a turnable
    board, in place of the first picture of `top`. `foot` stands at the foot of printed pages.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("coilarray.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        title=title or heading, heading=heading, lead=html_blocks(lead), top=html_blocks(top),
        scene=scene and _packed(scene),
        sections=sections, contents=contents, blocks=html_blocks,
        foot='"' + re.sub(r'["\\<\n]', " ", foot or heading) + '"',
    )  # fmt: skip


def _packed(scene: str) -> str:
    """Pack the page of a scene a sixth as large; the page's script unpacks it.

    A line of JSON, and the arrays as differences of numbers some places apart, byte for byte, all as base64 of gzip.
    """
    found = _DATA.search(scene)
    assert found is not None
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(found[0]))) as archive:
        index = json.loads(archive.read("index.json"))
    arrays, parts = [], []
    for name, array in index["hashes"].items():
        content = base64.b64decode(array.pop("content"))
        parts.append(content)
        steps = (0,)
        if len(content) % 4 == 0:
            numbers = np.frombuffer(content, np.uint32)
            planes = {step: _planes(numbers, step) for step in _STEPS}
            steps, parts[-1:] = zip(*[min(planes.items(), key=lambda one: len(zlib.compress(one[1])))], strict=True)
        arrays.append((name, *steps, len(content)))
    head = {"page": scene[: found.start()] + "§" + scene[found.end() :], "index": index, "arrays": arrays}
    packed = b"\n".join((json.dumps(head).encode(), b"".join(parts)))
    return base64.b64encode(gzip.compress(packed, 9, mtime=0)).decode("ascii")


def _planes(numbers: npt.NDArray[np.uint32], step: int) -> bytes:
    """Differences of numbers, first the lowest bytes of all."""
    differences = numbers.copy()
    differences[step:] -= numbers[:-step]
    return differences.view(np.uint8).reshape(-1, 4).T.tobytes()


def provenance_section(made: Mapping[str, object], *notes: str) -> Section:
    """Return the origin of a page as its last section."""
    names = {"design_hash": "design hash (SHA-256)", "coilarray_version": "coilarray"}
    rows = [(names.get(key, key.replace("_", " ")), str(value)) for key, value in made.items()]
    return Section("Provenance", (Group("text", (text_table(("made", "with"), rows),)), *notes))


def require_own(page: Path) -> None:
    """Raise OutputError for a file that is no report of coilarray."""
    if not is_own(page):
        raise OutputError(f"{page} exists and is not a report of coilarray; move it, or choose another folder.")


def now() -> str:
    """Return the date and time in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def board_picture(design: Design, coil: str, dent: xr.Dataset | None) -> list[Picture]:
    """Render the board if possible, under its elastomer and with a `dent` over a coil."""
    if viz.rendering_problem() is not None:
        return []
    from coilarray.viz.scenes.board import VEILED, scene_of_dent, sheets_in_space
    from coilarray.viz.scenes.design import View, scene_of_design  # all that a scene may compute

    scene = scene_of_design(design, View(show=("board", "plates") if design.plates else ("board",)))
    under = ""
    if dent is not None and design.indentation is not None:
        indenter, centre = design.indentation.indenter, _centre(design, coil)
        scene = scene_of_dent(design.array, design.sheets, dent, indenter, centre, opacity=VEILED) + scene
        under = f" under the elastomer, and a {indenter.name} that is pressed into it over {coil}"
    elif design.sheets:
        scene, under = sheets_in_space(design.placed) + scene, " under the elastomer"
    return [_render("board", f"The board{'s' if design.boards else ''}{under}; lengths in mm.", scene)]


def _centre(design: Design, coil: str) -> tuple[float, float]:
    outline = board_outlines(design)[coil]
    x, y = ((outline.min(axis=0) + outline.max(axis=0)) / 2).tolist()
    return x, y


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


def plotted(plot: str, name: str, caption: str, *arguments: Any, width: float = FULL, **options: Any) -> list[Picture]:
    """Draw a picture by the name of a `coilarray.viz` function."""
    return [draw(name, caption, getattr(viz, plot)(*arguments, **options), width)]


def indentation_pictures(design: Design, indenter: Indenter, indentation: xr.Dataset, coil: str) -> list[Picture]:
    """Draw the deepest dent, and the force over depth."""
    deepest = f"{float(indentation.depth[-1]) * 1e3:g} mm deep"
    caption = f"The sheets under the {indenter.name} in section, {deepest}; dashed where they lay flat."
    pictures = [draw("dent_section", caption, viz.plot_dent(indentation, indenter), HALF)]
    if viz.rendering_problem() is None:
        caption = f"The deformed sheets over {coil}, {deepest}; a quarter is cut out."
        scene = viz.dent_scene(design.array, design.sheets, indentation, indenter, centre=_centre(design, coil))
        pictures.append(_render("dent", caption, scene, "cut"))
    return [
        *pictures,
        draw("force_depth", "Force and contact over the depth.", viz.plot_force_depth(indentation), HALF),
    ]


def response_line_pictures(response: xr.Dataset) -> list[Picture]:
    """Draw δ along a line, and one state by depth."""
    deepest = f"{float(response.depth[-1]) * 1e3:g} mm deep"
    along: Literal["x", "y"] = "y" if response.sizes["x"] == 1 else "x"
    caption = f"δ along {along}, {deepest}; dotted lines are the centres of the coils."
    pictures = [draw("response_profile", caption, viz.plot_response_profile(response, depth=-1, along=along), HALF)]
    state = middle_state(response)
    if response.sizes[along] > 1:
        caption = f"δ of {state} along {along} for each depth, with its width at half the peak."
        pictures.append(draw("response_depths", caption, viz.plot_bell_curve(response, state, along=along), HALF))
    elif response.sizes["depth"] > 1:
        depths = viz.plot_response_profile(response, state, None, along=along)
        pictures.append(draw("response_depths", f"δ of {state} along {along} for each depth.", depths, HALF))
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
    return [draw("ellipse_parameters", fitted, parameters, HALF), draw("ellipses", crossed, ellipses, HALF)]


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
    from PIL import Image, ImageChops

    with writing("temporary files"), tempfile.TemporaryDirectory() as folder:
        path, buffer = Path(folder) / f"{name}.png", io.BytesIO()
        viz.save_picture(scene, path, side=side, size=_SIZE)
        with Image.open(path) as image:
            whole = image.convert("RGB")
            _, top, _, bottom = ImageChops.invert(whole).getbbox() or (0, 0, *whole.size)  # of all that is not white
            rows = max(top - _RIM, 0), min(bottom + _RIM, whole.height)
            whole.crop((0, rows[0], whole.width, rows[1])).save(buffer, "JPEG", quality=_QUALITY)
        url = data_url(buffer.getvalue(), "jpeg")
        return Picture(name, caption, f'<img src="{url}" alt="{escape(caption)}">')


def draw(name: str, caption: str, drawn: Axes | Figure, width: float = FULL) -> Picture:
    """Return a drawn figure as a picture with caption, at most `width` inches wide."""
    from matplotlib.figure import Figure

    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert isinstance(figure, Figure)  # plots draw on figures, never on sub-figures
    across, up = figure.get_size_inches()
    if across > width:  # letters keep their size
        figure.set_size_inches(width, up * width / across)
    return Picture(name, caption, *image_of(figure, name, caption))


def image_of(figure: Figure, name: str, alt: str) -> tuple[str, str]:
    """Draw a figure without its white rim, and close it.

    Returns SVG for a page, with areas and lines as an image if there are too many paths, and JSON about its axes.
    """
    from coilarray.viz.plots.style import close, described_axes, lay_out

    close(figure)
    edges: list[float] = []
    for _ in range(_LAYOUTS):  # axes of equal scales move with every layout until they rest
        lay_out(figure)
        before, edges = edges, list(figure.get_tightbbox().extents)
        if before and np.allclose(before, edges, atol=0.01):
            break
    box = figure.get_tightbbox().padded(0.04)
    axes = described_axes(figure, box)
    if len(svg := _page_svg(figure, box, name, alt)) > _MOST_BYTES:
        for ax in figure.axes:
            ax.set_rasterization_zorder(_UNDER_AXES)
            ax.patch.set_visible(False)  # the colour of the page shows
        svg = _page_svg(figure, box, name, alt)
    return svg, json.dumps(axes, ensure_ascii=False, separators=(",", ":")) if axes else ""


def _page_svg(figure: Figure, box: Bbox, name: str, alt: str) -> str:
    """Draw a figure as part of a page: own names, the page's colours, short paths."""
    import matplotlib

    buffer, none = io.BytesIO(), dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata=none, dpi=_DPI, bbox_inches=box)
    svg = buffer.getvalue().decode()
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r' id="(?:\w+_\d+|\w*text\w*)"', "", svg)  # of groups that nothing refers to
    svg = re.sub(r'( id="|url\(#|href="#)', rf"\1{name}-", svg)
    svg = re.sub(r' d="([^"]*)"', lambda found: f' d="{_short_path(found[1])}"', svg)
    svg = re.sub(r' (x|y|points|transform)="[^"]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), svg)
    svg = re.sub(r"(font: [^;\"]*?px) [^;\"]*", r"\1 sans-serif", svg)
    svg = re.sub(r' transform="rotate\(-0 [^"]*"|font-family: [^;"]*;? ?|<g/>', "", svg)
    for colour, own in _DARK.items():
        svg = svg.replace(colour, f"var(--{own}, {colour})")
    size = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    assert size is not None
    width = round(float(size[1]) * 96 / 72)
    svg = svg.replace(
        size[0],
        f'role="img" aria-label="{escape(alt)}" font-family="sans-serif" style="--w: {width}px; width: {width}px"',
        1,
    )
    return re.sub(r">\s+<", "><", svg)


def _short_path(path: str) -> str:
    """Write a path of absolute lines with relative lines, to hundredths.

    >>> _short_path("M 10 20.004 L 10.501 20 z")
    'M10 20l.5 0z'
    """
    parts, at = [], (0, 0)
    for letter, texts in re.findall("([A-Za-z])([^A-Za-z]*)", path):
        values = [round(100 * float(text)) for text in texts.split()]
        shown = [value - start for value, start in zip(values, at, strict=True)] if letter == "L" else values
        at = (values[-2], values[-1]) if values else at
        numbers = " ".join(re.sub(r"(?<!\d)0\.", ".", f"{value / 100:g}") for value in shown)
        parts.append(f"{'l' if letter == 'L' else letter}{numbers}")
    return "".join(parts)
