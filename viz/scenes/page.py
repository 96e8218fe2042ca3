"""Scene as a web page by vtk.js, without network."""

from __future__ import annotations

import base64
import io
import json
import re
import zipfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from coilarray.compute.extras import import_extra
from coilarray.compute.files import write_text
from coilarray.errors import MissingDependencyError
from coilarray.viz.offscreen import require_pyvista
from coilarray.viz.palette import INK
from coilarray.viz.scenes.draw import actor_of, bar_of, gradient
from coilarray.viz.scenes.scene import SIDES, Part, Scale, Scene, Side, aim

_SIZE = (1600, 900)  # size of the picture to which line widths refer
_STOPS = 32  # colours of a bar
_THIN = 2.0  # line width above which a line becomes a tube, as browsers draw all lines one pixel wide
_SIDES = 8  # sides of such a tube
_ICONS = re.compile(r"https://kitware\.github\.io/vtk-js/icon/[^`\"']*")
# The browser contacts no host, whatever the viewer may try.
_POLICY = (
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:\">"
)


def save_page(scene: Scene, path: Path, *, title: str = "coilarray", side: Side = "oblique") -> None:
    """Write a scene as a web page.

    The text comes from `scene_page`. Raises MissingDependencyError if trame-vtk is not installed.
    Raises OutputError if the file cannot be written.

    Parameters
    ----------
    scene : Scene
        Scene that is shown.
    path, title : Path and str
        File to write, which appears only when it is complete, and title of the page.
    side : {"oblique", "top", "front", "right"}
        Side from which it is seen first.
    """
    write_text(path, scene_page(scene, title=title, side=side))


def scene_page(scene: Scene, *, title: str = "coilarray", side: Side = "oblique") -> str:
    """Make a web page with a scene to turn, or raise MissingDependencyError."""
    from jinja2 import Environment, PackageLoader
    from markupsafe import escape

    viewer = _viewer()
    loader = PackageLoader("coilarray.viz", "scenes")
    template = Environment(loader=loader, autoescape=True, keep_trailing_newline=True).get_template("page.html.j2")
    texts = sorted(scene.texts, key=lambda text: not text.always)  # the first text stays if two overlap
    keys = ("text", "position", "height", "bold", "group")
    addition = template.render(
        title=title,
        ink=INK,
        groups={group: gradient(colours) for group, colours in scene.groups.items()},
        notes=scene.notes,
        texts=[{**{key: getattr(text, key) for key in keys}, "hiddenFrom": text.hidden_from} for text in texts],
        group_of_actor=[part.group for part in scene.parts],
        step_of_actor=[part.step for part in scene.parts],
        slider=None if scene.slider is None else asdict(scene.slider),
        bars=[_bar(scale) for scale in scene.scales],
        views={name: _view(scene, name) for name in SIDES},
        first_side=side,
        data=base64.b64encode(_archive(scene)).decode("ascii"),
    )
    head, body = viewer.split("</body>")
    head = re.sub("<title>.*?</title>", lambda _: f"<title>{escape(title)}</title>{_POLICY}", head, count=1)
    return _ICONS.sub("data:,", head) + addition + "</body>" + body


def check_page() -> None:
    """Raise MissingDependencyError before a scene is made for a page."""
    require_pyvista("pages", "3d")
    _viewer()


def _viewer() -> str:
    """Page of trame-vtk that shows scenes of vtk.js."""
    tools = import_extra("trame_vtk.tools.vtksz2html", "pages", package="trame-vtk", extra="3d")
    text = Path(tools.HTML_VIEWER_PATH).read_text(encoding="utf-8")
    if text.count("</body>") != 1 or "OfflineLocalView" not in text:
        raise MissingDependencyError(
            "pages need a trame-vtk whose viewer this version knows; install trame-vtk 2.8 to 2.11."
        )
    return text


def _archive(scene: Scene) -> bytes:
    """Meshes and colours in the format of the viewer."""
    from vtkmodules.vtkRenderingCore import vtkRenderer

    serializers = import_extra("trame_vtk.modules.vtk.serializers", "pages", package="trame-vtk", extra="3d")
    serializers.initialize_serializers()
    camera = aim(scene.bounds, _SIZE, "oblique")
    renderer = vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    for part in scene.parts:
        renderer.AddActor(actor_of(_thick(part, 2 * camera.scale / _SIZE[1])))
    context = serializers.SynchronizationContext()
    name = serializers.reference_id(renderer)
    window: dict[str, Any] = {
        "parent": "0x0",
        "id": "window",
        "type": "vtkRenderWindow",
        "properties": {"numberOfLayers": 1},
        "dependencies": [serializers.serialize(None, renderer, name, context, 0)],
        "calls": [["addRenderer", [f"instance:${{{name}}}"]]],
        "mtime": 1,
    }
    arrays = {}
    for array in serializers.extract_array_hash(window):
        arrays[array["hash"]] = {**array, "content": context.get_cached_data_array(array["hash"], False)}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"scene": window, "hashes": arrays}))
    return buffer.getvalue()


def _thick(part: Part, mm_per_pixel: float) -> Part:
    """Turn thick lines into tubes."""
    mesh: Any = part.mesh
    if part.line_width <= _THIN or not getattr(mesh, "n_lines", 0):
        return part
    tube = mesh.tube(radius=part.line_width * mm_per_pixel / 2, n_sides=_SIDES, capping=True)
    return replace(part, mesh=tube)


def _view(scene: Scene, side: Side) -> dict[str, Any]:
    """Camera for a side in the script's terms."""
    camera = aim(scene.bounds, _SIZE, side)
    position, focus, up = (np.array(one) for one in (camera.position, camera.focus, camera.up))
    distance = float(np.linalg.norm(position - focus))
    out = (position - focus) / distance
    box = np.array(scene.bounds).reshape(3, 2)
    corners = np.stack(np.meshgrid(*box), axis=-1).reshape(-1, 3)
    extent = np.ptp(corners @ np.column_stack((np.cross(up, out), up)), axis=0)
    return {
        "middle": focus.tolist(), "out": out.tolist(), "up": up.tolist(), "distance": distance,
        "extent": extent.tolist(),
    }  # fmt: skip


def _bar(scale: Scale) -> dict[str, Any]:
    """Title, colours and numbers of a colour bar."""
    title, colours, numbers = bar_of(scale, _STOPS)
    places = np.linspace(0.0, 100.0, len(numbers)).tolist()
    ticks = [{"at": at, "text": text} for at, text in zip(places, numbers, strict=True)]
    return {"title": title, "colours": gradient(colours, "top"), "ticks": ticks}
