"""How Sphinx builds these pages: ``python -m sphinx -W docs docs/_build/html``."""

import sys
import warnings
from importlib import metadata
from pathlib import Path

import matplotlib
import pyvista
from PIL import Image
from sphinx.application import Sphinx

from coilarray.cli import shared

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "extensions"))

project = "coilarray"
author = "The coilarray developers"
project_copyright = author
release = version = metadata.version("coilarray")

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "cheat_sheet",
    "command_pages",
    "figures",
    "file_pages",
    "link_check",
    "name_pages",
    "native_math",
    "quantities",
    "report_pages",
    "result_pages",
    "validation_pages",
]
exclude_patterns = ["_build", "extensions", "gallery", "tutorials", "made/validation/summary.md"]
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3

smartquotes_action = "qe"  # quotes and ellipses: two hyphens begin an option

default_role = "py:obj"  # a name in backticks is code, and a link where it has a page

html_theme = "pydata_sphinx_theme"
html_title = "coilarray"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False
html_context = {"default_mode": "auto"}  # light or dark as the reader's system; without it the theme complains
html_show_search_summary = False  # it fetches the pages found, which a browser refuses from a folder
html_math_renderer = "native"
html_sidebars = {"contributing": []}  # a page without pages beneath it
html_theme_options = {
    "navigation_with_keys": True,
    "show_toc_level": 2,
    "header_links_before_dropdown": 8,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}

rst_prolog = r"""
.. |k| replace:: \|k\|
.. |B| replace:: \|B\|
.. |δ| replace:: \|δ\|
"""  # bars in docstrings are absolute values

numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
autosummary_generate = False  # `name_pages` writes them
autodoc_typehints = "none"  # the docstrings say types
autodoc_member_order = "bysource"

warnings.filterwarnings("ignore", message=".*is non-interactive")
matplotlib.use("agg")
pyvista.OFF_SCREEN = True
pyvista.BUILDING_GALLERY = True
pyvista.global_theme.anti_aliasing = "ssaa"
shared._PIPE_WIDTH = 122  # characters of a line of a page, so that tables of commands fit
# of each program that is not run: scaled once
THUMBNAIL = HERE / "made" / "thumbnail.png"
THUMBNAIL.parent.mkdir(exist_ok=True)
with Image.open(HERE / "board.png") as board:
    board.thumbnail((400, 280))
    board.save(THUMBNAIL)
sphinx_gallery_conf = {
    "examples_dirs": ["gallery", "tutorials"],
    "gallery_dirs": ["made/gallery", "made/tutorials"],
    "filename_pattern": ".*",
    "image_scrapers": ("figures.of_program", "pyvista"),
    "capture_repr": (),
    "within_subsection_order": "FileNameSortKey",
    "remove_config_comments": True,
    "show_memory": False,
    "min_reported_time": 1e9,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "plot_gallery": "True",
    "abort_on_example_error": True,
    "default_thumb_file": str(THUMBNAIL),
}

# files outside of docs/ that are pages here too
_ELSEWHERE = {"firmware": "hardware/firmware/README.md", "protocol": "hardware/firmware/PROTOCOL.md"}


def _link(app: Sphinx, page: str, source: list[str]) -> None:
    """Take a page from the file that it names, and point links to such files to their pages."""
    if page in _ELSEWHERE:
        source[0] = (HERE.parent / _ELSEWHERE[page]).read_text(encoding="utf-8").replace("](../../docs/", "](/")
    for own, path in _ELSEWHERE.items():
        source[0] = source[0].replace(f"](../../{path})", f"](/{own}.md)")
        if page in _ELSEWHERE:  # all of them are in one folder
            source[0] = source[0].replace(f"]({Path(path).name})", f"](/{own}.md)")


def setup(app: Sphinx) -> None:
    """Add the hook."""
    app.connect("source-read", _link)
