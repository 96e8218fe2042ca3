"""Pictures that code makes: of gallery programs, of programs in a page as ``{picture}``, and films of tutorials."""

from __future__ import annotations

import ast
import hashlib
import re
import shlex
import tempfile
import textwrap
from collections.abc import Mapping
from contextlib import chdir
from pathlib import Path
from typing import TYPE_CHECKING, Any

from docutils import nodes
from docutils.parsers.rst import Directive
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from sphinx.errors import ExtensionError
from sphinx_gallery.scrapers import figure_rst

from coilarray.cli.main import main
from coilarray.compute.store import code_version
from coilarray.viz.plots.style import save

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.config import Config
    from sphinx.environment import BuildEnvironment

_DPI = 110
_FOLDER = "made/pictures"
_BROKEN = re.compile(r"^```\{picture\}.*`.*$", re.MULTILINE)  # Markdown then takes the line for text
_PROGRAM = re.compile(r"^```\{picture\}[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
_OF_GALLERY = re.compile(r"gallery/\S+\.py")
_FILM = re.compile(r"^# \.\. film::\n((?:#(?: .*)?\n)+)", re.MULTILINE)


def _figures(last: object) -> list[Figure]:
    """Return the figures that pyplot knows, and the one that the last line returned."""
    found = [pyplot.figure(number) for number in pyplot.get_fignums()]
    figure = last.get_figure(root=True) if isinstance(last, Axes) else last
    if isinstance(figure, Figure) and not isinstance(figure, SubFigure) and figure not in found:
        found.append(figure)
    return found


def of_program(block: tuple[Any, ...], block_vars: Mapping[str, Any], gallery_conf: Mapping[str, Any]) -> str:
    """Save the figures of a block of code and return what shows them."""
    paths = []
    names = block_vars["example_globals"]
    last, names["___"] = names.get("___"), None  # a later block without a value would show the figure again
    for one in _figures(last):
        path = next(block_vars["image_path_iterator"])
        save(one, path, dpi=_DPI)
        paths.append(path)
    pyplot.close("all")
    _, text, _ = Path(block_vars["src_file"]).read_text(encoding="utf-8").split('"""', 2)
    return figure_rst(paths, gallery_conf["src_dir"], fig_titles=text.strip().partition("\n")[0])


def figures_of(code: str) -> list[Figure]:
    """Run a program, and return the figures that it draws or that its last line returns."""
    *body, last = ast.parse(code).body
    names: dict[str, Any] = {}
    exec(compile(ast.Module(body, []), "<picture>", "exec"), names)
    if isinstance(last, ast.Expr):
        value = eval(compile(ast.Expression(last.value), "<picture>", "eval"), names)
    else:
        value = exec(compile(ast.Module([last], []), "<picture>", "exec"), names)
    return _figures(value)


def figure_of(code: str) -> Figure:
    """Run a program, and return its only figure."""
    (figure,) = figures_of(code)
    return figure


def _program(content: str) -> str:
    """Return the program of a picture: its content, or that of the gallery which it names, from its imports on."""
    if not _OF_GALLERY.fullmatch(content.strip()):
        return content
    return (Path(__file__).parents[1] / content.strip()).read_text(encoding="utf-8").split('"""', 2)[2].lstrip()


def _path(app: Sphinx | BuildEnvironment, code: str, suffix: str = ".png") -> Path:
    """Return where the picture of a program is kept: another place when the program changes, or what it computes."""
    name = hashlib.sha256(f"{code_version()}\n{code.strip()}".encode()).hexdigest()[:12]
    return Path(app.srcdir) / _FOLDER / f"{name}{suffix}"


def _make(app: Sphinx) -> None:
    """Make the pictures of all pages, in the process that may also use threads."""
    (Path(app.srcdir) / _FOLDER).mkdir(parents=True, exist_ok=True)
    for page in sorted(Path(app.srcdir).glob("*/*.md")) + sorted(Path(app.srcdir).glob("*.md")):
        text = page.read_text(encoding="utf-8")
        if wrong := _BROKEN.search(text):
            raise ExtensionError(f"{page.name}: the caption of a picture must have no backticks: {wrong[0]}")
        for code in map(_program, _PROGRAM.findall(text)):
            if not (path := _path(app, code)).exists():
                try:
                    save(figure_of(code), path, dpi=_DPI)
                except Exception as error:
                    raise ExtensionError(f"{page.name}: the program of a picture fails: {error}\n{code}") from error
                finally:
                    pyplot.close("all")


def films_of(text: str) -> list[str]:
    """Return the programs and commands of the films in a tutorial's text."""
    return [textwrap.dedent(re.sub("^#", "", code, flags=re.MULTILINE)).strip() for code in _FILM.findall(text)]


def film_of(code: str, path: Path) -> None:
    """Run a program, or a command of coilarray, that writes one film, and take it to a path."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder, chdir(folder):
        if code.startswith("coilarray "):
            if main(shlex.split(code)[1:]):
                raise ExtensionError(f"a film fails: {code}")
        else:
            exec(compile(code, "<film>", "exec"), {})
        (film,) = Path(folder).glob("*.gif")
        film.replace(path)


def _make_films(app: Sphinx) -> None:
    """Make the films of tutorials and gallery, unless the gallery is left out."""
    folders = ("tutorials", "gallery") if _with_films(app.config) else ()
    for page in sorted(page for folder in folders for page in (Path(app.srcdir) / folder).rglob("*.py")):
        for code in films_of(page.read_text(encoding="utf-8")):
            if not (path := _path(app, code, ".gif")).exists():
                film_of(code, path)


def _with_films(config: Config) -> bool:
    return str(config.plot_gallery) not in ("0", "False")


class _Film(Directive):
    """A command, or a program, and the film that it writes."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        code = "\n".join(self.content)
        shown = nodes.literal_block(code, code, language="shell" if code.startswith("coilarray ") else "python")
        env = self.state.document.settings.env
        if not _with_films(env.config):
            return [shown]
        return [shown, nodes.image(uri=f"/{_FOLDER}/{_path(env, code, '.gif').name}", alt="The film.")]


class _Picture(Directive):
    """The figure of a program, which is its content, with a caption; the program itself can be unfolded."""

    required_arguments = 1
    final_argument_whitespace = True
    has_content = True

    def run(self) -> list[nodes.Node]:
        code = _program("\n".join(self.content))
        caption = self.arguments[0]
        text, messages = self.state.inline_text(caption, self.lineno)
        image = nodes.image(
            uri=f"/{_FOLDER}/{_path(self.state.document.settings.env, code).name}", alt=caption.replace("$", "")
        )
        shown = nodes.literal_block(code, code, language="python")
        summary = nodes.raw("", "<details><summary>The program of this picture</summary>", format="html")
        figure = nodes.figure("", image, nodes.caption("", "", *text))
        return [figure, summary, shown, nodes.raw("", "</details>", format="html"), *messages]


_IMAGE = re.compile(r'(<a\b.*?</a>)|(<img\b[^>]*\bsrc="([^"]+)"[^>]*>)', re.DOTALL)


def opened_by_a_click(body: str) -> str:
    """Return a page's text in which every picture leads to its file; thumbnails lead elsewhere already."""

    def link(found: re.Match[str]) -> str:
        anchor, image, path = found.groups()
        if anchor or "_thumb." in path:
            return found[0]
        return f'<a class="picture" href="{path}" title="Open the picture">{image}</a>'

    return _IMAGE.sub(link, body)


def _link(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: object) -> None:
    if "body" in context:
        context["body"] = opened_by_a_click(context["body"])


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive, and make the pictures before Sphinx looks for them."""
    app.add_directive("picture", _Picture)
    app.add_directive("film", _Film)
    app.connect("builder-inited", _make)
    app.connect("builder-inited", _make_films)
    app.connect("html-page-context", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
