"""Films of scenes as GIF (Pillow) or MP4 (PyAV)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.extras import import_extra
from coilarray.compute.files import write_atomically
from coilarray.errors import OutputError
from coilarray.viz.scenes.camera import Side
from coilarray.viz.scenes.draw import draw, draw_parts, pixel_of
from coilarray.viz.scenes.pictures import check_rendering, off_screen
from coilarray.viz.scenes.scene import Scene

Image = npt.NDArray[np.uint8]

SIZE = (960, 540)
"""Default width and height of a film in pixels."""

_SAMPLED = 6  # pictures from which the colours of a GIF are chosen
_SLOWEST, _FASTEST = 0.1, 100.0  # pictures per second, as a GIF counts hundredths of a second
_RATE = 24  # constant rate factor of H.264; smaller is better, and 18 is visually lossless


def save_movie(
    still: Scene,
    moving: Iterable[Scene],
    path: Path,
    *,
    side: Side = "oblique",
    size: tuple[int, int] = SIZE,
    rate: float = 12.0,
) -> None:
    """Render scenes off-screen into a film.

    Parameters
    ----------
    still : Scene
        Scene in every picture.
    moving : iterable of Scene
        Additional scene of each picture, read as the film is made. All must have the same groups and scales. The camera
        is aimed at the first.
    path : Path
        File to write, .gif or .mp4. It appears only when it is complete.
    side, size
        As in `save_picture`. For .mp4 both sides of a picture must be even.
    rate : float
        Pictures per second.

    Raises
    ------
    MissingDependencyError
        If this machine cannot render, or PyAV is not installed for .mp4.
    OutputError
        If the suffix, size or rate is not allowed, there is no picture, or the file cannot be written.
    """
    check_movie(path, size, rate)
    with off_screen(size) as plotter:
        pictures = _pictures(plotter, still, moving, side)
        write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
        write_atomically(path, lambda temporary: write(temporary, pictures, rate))


def check_movie(path: Path, size: tuple[int, int] = SIZE, rate: float = 12.0) -> None:
    """Refuse a film that `save_movie` would refuse."""
    suffix = path.suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise OutputError(f"a film must end in .gif or .mp4; got {path}.")
    if not _SLOWEST <= rate <= _FASTEST:
        raise OutputError(f"a film must have {_SLOWEST:g} to {_FASTEST:g} pictures a second; got {rate:g}.")
    if suffix == ".mp4":
        if any(pixels % 2 for pixels in size):
            raise OutputError(f"an MP4 film must have even sides; got {size[0]}x{size[1]} pixels.")
        import_extra("av", "MP4 films", package="PyAV", extra="movie")
    check_rendering(size)


def _pictures(plotter: Any, still: Scene, moving: Iterable[Scene], side: Side) -> Iterator[Image]:
    """Draw one picture after the other."""
    following = iter(moving)
    first = next(following, None)
    if first is None:
        raise OutputError("a film must have at least one picture; got none.")
    draw(still + first, plotter, side=side)
    for scene in chain((None,), following):
        if scene is not None:
            draw_parts(scene, plotter, pixel_of(plotter.window_size))
        yield np.asarray(plotter.screenshot(return_img=True))


def _write_gif(path: Path, pictures: Iterator[Image], rate: float) -> None:
    """Write pictures as an animated GIF."""
    from PIL import Image as Pillow

    # One set of 256 colours for all pictures, chosen from some of them, so that nothing flickers.
    kept, shape = [], (0, 0, 0)
    for one in pictures:
        shape = one.shape
        kept.append(zlib.compress(one.tobytes(), 1))

    def picture(k: int) -> Pillow.Image:
        return Pillow.fromarray(np.frombuffer(zlib.decompress(kept[k]), dtype=np.uint8).reshape(shape))

    chosen = sorted(set(np.linspace(0, len(kept) - 1, _SAMPLED).round().astype(int).tolist()))
    # An octree keeps the colours of small things such as a colour bar. Pillow's median cut gives them to the large
    # areas.
    colours = Pillow.fromarray(np.vstack([np.asarray(picture(k)) for k in chosen])).quantize(
        colors=256, method=Pillow.Quantize.FASTOCTREE
    )
    first, *rest = (picture(k).quantize(palette=colours, dither=Pillow.Dither.NONE) for k in range(len(kept)))
    first.save(path, save_all=True, append_images=rest, duration=round(1000 / rate), loop=0, disposal=1)


def _write_mp4(path: Path, pictures: Iterator[Image], rate: float) -> None:
    """Write pictures as an MP4 with H.264."""
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
