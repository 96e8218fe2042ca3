"""Pictures of gallery programs: matplotlib figures that pyplot knows, and the one that the last line returns."""

from collections.abc import Mapping
from typing import Any

from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from sphinx_gallery.scrapers import figure_rst

_DPI = 110


def of_program(block: tuple[Any, ...], block_vars: Mapping[str, Any], gallery_conf: Mapping[str, Any]) -> str:
    """Save the figures of a block of code and return what shows them."""
    found = [pyplot.figure(number) for number in pyplot.get_fignums()]
    last = block_vars["example_globals"].get("___")
    figure = last.get_figure(root=True) if isinstance(last, Axes) else last
    if isinstance(figure, Figure) and not isinstance(figure, SubFigure) and figure not in found:
        found.append(figure)
    paths = []
    for one in found:
        path = next(block_vars["image_path_iterator"])
        one.savefig(path, dpi=_DPI)
        paths.append(path)
    pyplot.close("all")
    return figure_rst(paths, gallery_conf["src_dir"])
