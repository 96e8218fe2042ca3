"""Films: the response along the way of an indenter, and files that players read."""

import functools
import sys
from dataclasses import replace

import numpy as np
import pytest
import pyvista
from PIL import Image, ImageSequence
from support.contacts import IDEAL

from coilarray import load_design
from coilarray.design.vary import vary
from coilarray.errors import ElastomerError, MetalError, MissingDependencyError, OutputError
from coilarray.geometry import MATERIALS, Ball, Plate, Target
from coilarray.response.map import response_map
from coilarray.response.target import target_map
from coilarray.viz.offscreen import NO_RENDERING
from coilarray.viz.scenes.design import target_along, touch_along
from coilarray.viz.scenes.draw import shown_units
from coilarray.viz.scenes.pictures import save_movie
from coilarray.viz.scenes.scene import Part, Scene

renders = pytest.mark.usefixtures("rendering")
SIZE = (160, 90)


@pytest.fixture(scope="module")
def design():
    quick = vary(load_design("starter"), {"array.columns": 1, "coils.hexagon.turns_per_layer": 4})
    return replace(quick, indentation=replace(quick.indentation, origin=None, origin_point=(1e-3, 0.0)))


def parts_of(scene):
    return {part.name: part for part in scene.parts}


@pytest.mark.slow
def test_a_touch_has_the_response_along_its_way(design, monkeypatch):
    ideal_map = functools.partial(response_map, imperfections=IDEAL)  # the true circuit takes seconds
    monkeypatch.setattr("coilarray.viz.scenes.design.response_map", ideal_map)
    touch = touch_along(design, count=5, depth=0.6e-3)
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in design.array.placements])
    np.testing.assert_allclose(touch.places[:, 0], np.linspace(outlines[:, 0].min(), outlines[:, 0].max(), 5))
    np.testing.assert_allclose(touch.places[:, 1], design.array.centres[0, 1])
    x, y, _ = touch.places[1]
    exact = ideal_map(design, depths=[0.6e-3], x=[x - 1e-3], y=[y]).delta.values.ravel()
    # splines through positions a fifth of the sheets' thickness apart: 1e-6 on gast2020
    np.testing.assert_allclose(touch.delta[1], exact, atol=2e-6)
    frames = list(touch.scenes())
    assert len(frames) == 5
    copper = parts_of(frames[1])["copper L1"].mesh
    np.testing.assert_allclose(copper.cell_data["delta (1)"], touch.delta[1][copper.cell_data["coil"]])
    (names,) = {frozenset(parts_of(frame)) for frame in frames}
    assert not names & set(parts_of(touch.board()))
    assert np.abs(touch.delta).max() <= touch.scale.high <= 1.5 * np.abs(touch.delta).max()
    # the numbers under the coils are δ in the unit of the bar, to three digits of the largest
    factor, title = shown_units(touch.scale)
    assert title.startswith("δ (10⁻")
    texts = [text.text for frame in frames for text in frame.texts]
    values = [float(text.replace("−", "-")) for text in texts]
    np.testing.assert_allclose(values, touch.delta.ravel() * factor, atol=0.0051 * max(map(abs, values)))
    assert max(map(abs, values)) >= 1
    tips = [parts_of(frame)["indenter"].mesh for frame in frames]
    lowest = [mesh.points[mesh.points[:, 2].argmin(), 0] * 1e-3 for mesh in tips]
    np.testing.assert_allclose(lowest, touch.places[:, 0], atol=1e-8)


def test_a_design_without_an_indenter_has_no_film(design):
    with pytest.raises(ElastomerError, match=r"has no \[indenter\] and \[indentation\]"):
        touch_along(replace(design, indentation=None))


def numbers_of(frame):
    return [float(text.text.replace("−", "-")) for text in frame.texts]


@pytest.mark.slow
def test_a_target_has_its_response_along_its_way(design):
    ball = Target(Ball(3e-3, MATERIALS["steel"]), (1e-3, 2e-3), (-4e-3, 0.0, 4e-3), (0.0,), origin_point=(0.5e-3, 1e-3))
    bare = replace(design, sheets=(), indentation=None, target=ball)
    touch = target_along(bare, count=5)
    np.testing.assert_allclose(touch.places, [(x, 1e-3, 1e-3) for x in np.linspace(-3.5e-3, 4.5e-3, 5)])
    exact = target_map(bare, distances=[1e-3], x=[-2e-3], y=[0.0]).delta.values.ravel()
    np.testing.assert_allclose(touch.delta[1], exact, rtol=1e-3)  # the band of frequencies is another
    frames = list(touch.scenes())
    assert numbers_of(frames[1])[0] == pytest.approx(exact[0] * shown_units(touch.scale)[0], rel=0.01)
    assert frames[1].notes == ("The target is at x = −1.5 mm, y = 1.0 mm, 1 mm from the board.",)
    bounds = parts_of(frames[1])["target"].mesh.bounds
    np.testing.assert_allclose(bounds, [-4.5, 1.5, -2.0, 4.0, 1.0, 7.0], atol=0.02)  # a ball of 48 meridians
    # room for the ball at all places
    np.testing.assert_allclose(parts_of(touch.board())["room"].mesh.bounds[:2], [-6.5, 7.5], atol=0.02)
    # an infinite plate comes closer
    lid = replace(bare, target=Target(Plate("lid", 0.0, 1e-3, MATERIALS["aluminium"]), (1e-3, 2e-3), (0.0,), (0.0,)))
    closer = target_along(lid, count=3, distance=0.5e-3)
    np.testing.assert_allclose(closer.places[:, 2], [2e-3, 1e-3, 0.5e-3])
    assert (np.diff(np.abs(closer.delta[:, 0])) > 0).all()
    with pytest.raises(MetalError, match=r"has no \[target\]"):
        target_along(design)


FLOOR = Scene((Part("floor", pyvista.Box((0, 16, 0, 9, -1, 0)), colour="#00ff00", lit=False),))


def steps(count=4, *, noted=True):
    """A red box that moves to the right, a quarter of the floor each time."""
    for k in range(count):
        box = pyvista.Box((4 * k, 4 * k + 4, 0, 9, 0, 1))
        yield Scene((Part("box", box, colour="#ff0000", lit=False),), notes=(f"step {k}",) if noted else ())


def in_quarters(pictures):
    """Compare the mean columns of the red pixels with the middles of the four quarters of the floor."""
    red = [(one[..., 0] > 200) & (one[..., 1] < 80) for one in pictures]
    found = [float(np.nonzero(one)[1].mean() / one.shape[1]) for one in red]
    # the floor fills 0.88 of the width: from 0.06 on
    np.testing.assert_allclose(found, 0.06 + 0.88 * (np.arange(4) + 0.5) / 4, atol=0.03)  # some pixels of 160


@pytest.mark.slow
@renders
@pytest.mark.parametrize("noted", [True, False])
def test_a_gif_shows_every_step(tmp_path, noted):
    path = tmp_path / "film.gif"
    save_movie(FLOOR, steps(noted=noted), path, side="top", size=SIZE, rate=20)
    with Image.open(path) as film:
        assert (film.n_frames, film.size, film.info["duration"], film.info["loop"]) == (4, SIZE, 50, 0)
        pictures = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(film)]
    in_quarters(pictures)
    assert [entry.name for entry in tmp_path.iterdir()] == ["film.gif"]


@pytest.mark.slow
@renders
def test_an_mp4_shows_every_step(tmp_path):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    path = tmp_path / "film.mp4"
    save_movie(FLOOR, steps(), path, side="top", size=SIZE, rate=12.5)
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height, float(stream.average_rate)) == (*SIZE, 12.5)
        assert stream.codec_context.name == "h264"
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == 4
    in_quarters(pictures)


@pytest.mark.parametrize(
    ("name", "size", "rate", "message"),
    [
        ("film.avi", SIZE, 12, "must end in .gif or .mp4"),
        ("film.gif", SIZE, 0, "0.1 to 100 pictures a second; got 0"),
        ("film.gif", (100_000, 90), 12, "sides of 1 to 6000 pixels"),
        ("film.mp4", (161, 90), 12, "even sides; got 161x90"),
    ],
)
def test_films_that_cannot_be_are_refused(tmp_path, name, size, rate, message):
    with pytest.raises(OutputError, match=message):
        save_movie(FLOOR, steps(), tmp_path / name, size=size, rate=rate)
    assert not list(tmp_path.iterdir())


@renders
def test_a_film_that_breaks_off_leaves_nothing(tmp_path):
    def broken():
        yield from steps(2)
        raise ElastomerError("no more")

    with pytest.raises(ElastomerError, match="no more"):
        save_movie(FLOOR, broken(), tmp_path / "film.gif", size=SIZE)
    with pytest.raises(OutputError, match="at least one picture"):
        save_movie(FLOOR, [], tmp_path / "film.gif", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_what_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingDependencyError, match=r'MP4 films need PyAV, .*-m pip install .*\[movie\]"'):
        save_movie(FLOOR, steps(), tmp_path / "film.mp4", size=SIZE)
    monkeypatch.setenv(NO_RENDERING, "1")
    with pytest.raises(MissingDependencyError, match=NO_RENDERING):
        save_movie(FLOOR, steps(), tmp_path / "film.gif", size=SIZE)
    assert not list(tmp_path.iterdir())
