"""Scenes as pictures, films, windows, web pages and VTK files."""

from __future__ import annotations

import base64
import html
import io
import json
import re
import shutil
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from coilarray.compute.extras import import_extra
from coilarray.compute.files import hidden_prefix, remove_left, write_atomically, write_text, writing
from coilarray.errors import MissingDependencyError, OutputError
from coilarray.viz.datasets.meshes import VTK_SUFFIXES, vtk_text
from coilarray.viz.offscreen import rendering_problem, require_pyvista, silent_screen, window_problem, without_screen
from coilarray.viz.palette import INK
from coilarray.viz.scenes.draw import actor_of, bar_of, draw, draw_parts, gradient, pixel_of
from coilarray.viz.scenes.scene import SIDES, Scale, Scene, Side, aim

Image = npt.NDArray[np.uint8]

SIZE = (1600, 900)  # default width and height of a picture in pixels

# Pixels. VTK's anti-aliasing needs textures of more than twice this size, and 16384 is the limit of
# graphics cards and of Mesa. A larger picture is blank.
_LONGEST = 6000
_FINER = 2  # pixels rendered along each pixel of a picture


def save_picture(
    scene: Scene, path: str | Path, *, side: Side = "oblique", size: tuple[int, int] = SIZE, dark: bool = False
) -> None:
    """Render a scene off-screen into an image file.

    The suffix of the `path` (.png, .jpg, .bmp, .tif) sets the format, and the file appears only
    when it is complete. The `scene` is seen from the `side` "oblique", "top", "front" or "right",
    in a picture with the `size` of width and height in pixels, with light letters if `dark`. Raises
    MissingDependencyError with the system packages if this machine cannot render, and OutputError
    if the size is not allowed, or the file cannot be written.
    """
    from PIL import Image as Pillow

    with off_screen(size) as plotter:
        draw(scene, plotter, side=side, dark=dark)
        picture = Pillow.fromarray(picture_of(plotter, size))
        write_atomically(path, picture.save)


def check_rendering(size: tuple[int, int] = SIZE) -> None:
    """Raise the errors of `save_picture` before a scene is computed."""
    if not all(1 <= pixels <= _LONGEST for pixels in size):
        raise OutputError(f"a picture must have sides of 1 to {_LONGEST} pixels; got {size[0]}x{size[1]}.")
    problem = rendering_problem()
    if problem is not None:
        raise MissingDependencyError(problem)


@contextmanager
def off_screen(size: tuple[int, int]) -> Iterator[Any]:
    """Open a plotter without a window, or raise as `save_picture`."""
    check_rendering(size)
    from coilarray.viz.extra_3d import pyvista

    fine = _FINER if max(size) * _FINER <= _LONGEST else 1  # a larger picture shows its turns anyway
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[fine * pixels for pixels in size])
    try:
        plotter.enable_anti_aliasing("ssaa")
        yield plotter
    finally:
        plotter.close()


def picture_of(plotter: Any, size: tuple[int, int]) -> Image:
    """Picture of an off-screen plotter, without patterns of turns narrower than a pixel."""
    from PIL import Image as Pillow

    picture = np.asarray(plotter.screenshot(return_img=True))
    # Lanczos' filter leaves nothing that is finer than two pixels, which would show as moiré.
    return np.asarray(Pillow.fromarray(picture).resize(size, Pillow.Resampling.LANCZOS))


FILM_SIZE = (960, 540)  # default width and height of a film in pixels
_SAMPLED = 6  # pictures from which the colours of a GIF are chosen
_SLOWEST, _FASTEST = 0.1, 100.0  # pictures per second, as a GIF counts hundredths of a second
_RATE = 24  # constant rate factor of H.264; smaller is better, and 18 is visually lossless


def save_movie(
    still: Scene,
    moving: Iterable[Scene],
    path: str | Path,
    *,
    side: Side = "oblique",
    size: tuple[int, int] = FILM_SIZE,
    rate: float = 12.0,
) -> None:
    """Render scenes off-screen into a film.

    The `still` scene is in every picture, with one of the `moving` scenes, which are read as the
    film is made. All must have the same groups and scales. The camera is aimed at the first. The
    `path` ends in .gif or .mp4, and the file appears only when it is complete. `side` and `size`
    are as in `save_picture`, even for .mp4, and `rate` is in pictures per second. Raises
    MissingDependencyError as there, or without PyAV for .mp4, and OutputError if the suffix, size
    or rate is not allowed, there is no picture, or the file cannot be written.
    """
    check_movie(path, size, rate)
    with off_screen(size) as plotter:
        pictures = _pictures(plotter, still, moving, side, size)
        write = _write_gif if Path(path).suffix.lower() == ".gif" else _write_mp4
        write_atomically(path, lambda temporary: write(temporary, pictures, rate))


def check_movie(path: str | Path, size: tuple[int, int] = FILM_SIZE, rate: float = 12.0) -> None:
    """Refuse a film that `save_movie` would refuse."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise OutputError(f"a film must end in .gif or .mp4; got {path}.")
    if not _SLOWEST <= rate <= _FASTEST:
        raise OutputError(f"a film must have {_SLOWEST:g} to {_FASTEST:g} pictures a second; got {rate:g}.")
    if suffix == ".mp4":
        if any(pixels % 2 for pixels in size):
            raise OutputError(f"an MP4 film must have even sides; got {size[0]}x{size[1]} pixels.")
        import_extra("av", "MP4 films", package="PyAV", extra="movie")
    check_rendering(size)


def _pictures(
    plotter: Any, still: Scene, moving: Iterable[Scene], side: Side, size: tuple[int, int]
) -> Iterator[Image]:
    following = iter(moving)
    first = next(following, None)
    if first is None:
        raise OutputError("a film must have at least one picture; got none.")
    draw(still + first, plotter, side=side)
    plotter.remove_actor("shadow", render=False)  # whose greys are more than a GIF has
    for scene in chain((None,), following):
        if scene is not None:
            draw_parts(scene, plotter, pixel_of(plotter.window_size))
        plotter.render()  # which texts alone would cause
        yield picture_of(plotter, size)


def _write_gif(path: Path, pictures: Iterator[Image], rate: float) -> None:
    from PIL import Image as Pillow

    # One set of 256 colours for all pictures, chosen from some of them, so that nothing flickers.
    kept, shape = [], (0, 0, 0)
    for one in pictures:
        shape = one.shape
        kept.append(zlib.compress(one.tobytes(), 1))

    def picture(k: int) -> Pillow.Image:
        return Pillow.fromarray(np.frombuffer(zlib.decompress(kept[k]), dtype=np.uint8).reshape(shape))

    chosen = sorted(set(np.linspace(0, len(kept) - 1, _SAMPLED).round().astype(int).tolist()))
    # An octree keeps the colours of small things such as a colour bar. Pillow's median cut gives
    # them to the large areas.
    colours = Pillow.fromarray(np.vstack([np.asarray(picture(k)) for k in chosen])).quantize(
        colors=256, method=Pillow.Quantize.FASTOCTREE
    )
    first, *rest = (picture(k).quantize(palette=colours, dither=Pillow.Dither.NONE) for k in range(len(kept)))
    first.save(path, save_all=True, append_images=rest, duration=round(1000 / rate), loop=0, disposal=1)


def _write_mp4(path: Path, pictures: Iterator[Image], rate: float) -> None:
    from fractions import Fraction

    import av

    with av.open(str(path), "w") as film:
        first = next(pictures)
        stream = film.add_stream("libx264", rate=Fraction(rate).limit_denominator(1000))
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"  # every player shows it
        stream.options = {"crf": str(_RATE)}
        for one in chain((first,), pictures):
            film.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(one), format="rgb24")))
        film.mux(stream.encode())


_WINDOW = (1280, 800)  # pixels


def show(scene: Scene, *, side: Side = "oblique") -> None:
    """Open a window with a scene, or show its page in a notebook.

    The `scene` is seen from `side` ("oblique", "top", "front" or "right"). The function returns
    when the user closes the window. In a notebook the page turns in the browser, with a switch for
    every group, and needs no screen. Raises MissingDependencyError if no window can be opened or this
    machine cannot render.
    """
    if getattr(getattr(sys.modules.get("IPython"), "get_ipython", bool)(), "kernel", None) is not None:
        notebook: Any = import_module("IPython.display")
        page = html.escape(scene_page(scene, side=side))
        look = "width: 100%; height: 520px; border: 0"
        notebook.display(notebook.HTML(f'<iframe srcdoc="{page}" sandbox="allow-scripts" style="{look}"></iframe>'))
        return
    check_window()
    from coilarray.viz.extra_3d import pyvista

    scene = scene.still()
    plotter: Any = pyvista.Plotter(title="coilarray", window_size=list(_WINDOW))
    if without_screen(plotter.render_window.GetClassName()):  # the screen has gone since the check
        plotter.close()
        raise MissingDependencyError(silent_screen())
    plotter.enable_anti_aliasing("ssaa")
    draw(scene, plotter, side=side)
    plotter.show()


def check_window() -> None:
    """Raise MissingDependencyError before the scene of a window is computed."""
    problem = window_problem()
    if problem is not None:
        raise MissingDependencyError(problem)


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


def save_page(scene: Scene, path: str | Path, *, title: str = "coilarray", side: Side = "oblique") -> None:
    """Write a scene as a web page with a `title`.

    The `path` appears only when it is complete, and the `scene` is first seen from the `side`, as
    in `save_picture`. Raises MissingDependencyError if trame-vtk is not installed, and OutputError
    if the file cannot be written.
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
    mm_per_pixel = 2 * aim(scene.bounds, _SIZE, "oblique").scale / _SIZE[1]
    renderer = vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    for part in scene.parts:
        mesh: Any = part.mesh
        if part.line_width > _THIN and getattr(mesh, "n_lines", False):
            mesh = mesh.tube(radius=part.line_width * mm_per_pixel / 2, n_sides=_SIDES, capping=True)
        renderer.AddActor(actor_of(replace(part, mesh=mesh)))
    context = serializers.SynchronizationContext()
    name = serializers.reference_id(renderer)
    shown = serializers.serialize(None, renderer, name, context, 0)
    window: dict[str, Any] = {"parent": "0x0", "id": "window", "type": "vtkRenderWindow", "mtime": 1}
    window |= {"properties": {"numberOfLayers": 1}, "dependencies": [shown]}
    window["calls"] = [["addRenderer", [f"instance:${{{name}}}"]]]
    arrays = {}
    for array in serializers.extract_array_hash(window):
        arrays[array["hash"]] = {**array, "content": context.get_cached_data_array(array["hash"], False)}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"scene": window, "hashes": arrays}))
    return buffer.getvalue()


def _view(scene: Scene, side: Side) -> dict[str, Any]:
    """Camera for a side in the script's terms."""
    camera = aim(scene.bounds, _SIZE, side)
    position, focus, up = (np.array(one) for one in (camera.position, camera.focus, camera.up))
    distance = float(np.linalg.norm(position - focus))
    out = (position - focus) / distance
    box = np.array(scene.bounds).reshape(3, 2)
    corners = np.stack(np.meshgrid(*box), axis=-1).reshape(-1, 3)
    extent = np.ptp(corners @ np.column_stack((np.cross(up, out), up)), axis=0)
    vectors = {"middle": focus, "out": out, "up": up, "extent": extent}
    return {"distance": distance, **{name: vector.tolist() for name, vector in vectors.items()}}


def _bar(scale: Scale) -> dict[str, Any]:
    title, colours, numbers = bar_of(scale, _STOPS)
    places = np.linspace(0.0, 100.0, len(numbers)).tolist()
    ticks = [{"at": at, "text": text} for at, text in zip(places, numbers, strict=True)]
    return {"title": title, "colours": gradient(colours, "top"), "ticks": ticks}


_UNSAFE = re.compile(r"[^0-9A-Za-z._-]+")


def save_vtk(scene: Scene, path: str | Path) -> tuple[Path, ...]:
    """Write a scene for ParaView, lengths in mm.

    The `scene` has its arrays in SI units, and not its colours. The multi-block file `path`, .vtm,
    is returned behind the folder of this name beside it with the files of its parts (.vtp, .vtu or
    .vtr). Raises OutputError if the files cannot be written. Earlier files are kept then.
    """
    path = Path(path)
    files = [
        f"{path.stem}/{k:02d}_{_UNSAFE.sub('_', part.name)}{VTK_SUFFIXES[type(part.mesh).__name__]}"
        for k, part in enumerate(scene.parts)
    ]
    blocks = [
        f"<DataSet index={quoteattr(str(k))} name={quoteattr(part.name)} file={quoteattr(file)}/>\n"
        for k, (part, file) in enumerate(zip(scene.parts, files, strict=True))
    ]
    kind = "vtkMultiBlockDataSet"
    index = f'<VTKFile type="{kind}" version="1.0">\n<{kind}>\n{"".join(blocks)}</{kind}>\n</VTKFile>\n'
    folder, placed = path.parent, (path.with_suffix(""), path)
    if placed[0].exists() and not path.exists():
        raise OutputError(f"cannot write {path}: there is a folder {placed[0]}, which is not of such a file.")
    with (
        writing(f"into {folder}"),
        tempfile.TemporaryDirectory(prefix=hidden_prefix("vtk"), dir=folder, ignore_cleanup_errors=True) as temporary,
    ):
        remove_left(folder)
        Path(temporary, path.stem).mkdir()
        for part, file in zip(scene.parts, files, strict=True):
            Path(temporary, file).write_text(vtk_text(part.mesh), encoding="utf-8")
        Path(temporary, path.name).write_text(index, encoding="utf-8")
        for target in placed:
            if target.is_dir():
                shutil.rmtree(target)
            Path(temporary, target.name).replace(target)
    return placed
