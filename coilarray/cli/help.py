"""Commands of help: ``coilarray keys`` and ``coilarray docs``."""

import difflib
from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli import shared
from coilarray.compute.extras import python_command
from coilarray.compute.table import text_table
from coilarray.errors import DesignError, MissingDependencyError, OutputError

CLONE = Path(__file__).resolve().parents[2]  # folder of the package, the clone if installed from it
_BUILT = Path("docs", "_build", "html")  # of a clone, where the command of CONTRIBUTING.md writes them
_PAGE = ".html"


def keys(
    word: Annotated[
        str | None, typer.Argument(metavar="WORD", help="Only keys that have this word in their name or meaning.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the keys as JSON, and nothing else.")] = False,
) -> None:
    """List the keys of a design file and what they mean.

    NAME stands for a name of yours, and N for a number from 0: coils.hexagon.gap_mm,
    elastomer.0.thickness_mm. So a key is given to sweep, optimize and tolerance too. In brackets
    are the shapes or lattices that have it.

    Example: coilarray keys

    Example: coilarray keys trace_width
    """
    from coilarray.design.keys import keys_of
    from coilarray.design.tables import Document

    known = keys_of(Document)
    found = [key for key in known if word is None or word.lower() in f"{key.dotted} {key.meaning}".lower()]
    if not found:
        close = difflib.get_close_matches(str(word), {key.name for key in known}, n=1)
        hint = f"; did you mean {close[0]}?" if close else "; `coilarray keys` lists all."
        raise DesignError(f"no key of a design file has {word!r} in its name or meaning{hint}")
    if as_json:
        columns = ("kinds", "unit", "allowed", "default", "meaning")
        shared.print_json([{"key": key.dotted, **{name: getattr(key, name) for name in columns}} for key in found])
        return
    rows = [
        (
            f"{key.dotted} ({', '.join(key.kinds)})" if key.kinds else key.dotted,
            key.unit,
            key.allowed,
            key.default,
            key.meaning,
        )
        for key in found
    ]
    shared.say(text_table(("key", "unit", "allowed", "default", "meaning"), rows))


def docs(
    page: Annotated[
        str,
        typer.Argument(metavar="PAGE", help="Page to open, such as start/first_report, or a command such as report."),
    ] = "index",
    only_print: Annotated[bool, typer.Option("--print", help="Print the page's path and open nothing.")] = False,
) -> None:
    """Open the documentation in the browser, once it is built.

    The pages are in docs/_build/html of the clone of the package. PAGE is the end of a page's path:
    first_report and start/first_report name the same page.

    Example: coilarray docs start/first_report

    Example: coilarray docs report --print
    """
    path = find_page(CLONE, page)
    typer.echo(path)
    if not only_print:
        shared.open_page(path)


def find_page(clone: Path, page: str) -> Path:
    """Return a page by its path's end, the shortest path first."""
    built = clone / _BUILT
    if not (built / f"index{_PAGE}").is_file():
        where, python = "a clone of coilarray (an installed package has no pages)", "python"
        if (clone / "docs" / "conf.py").is_file():
            where, python = str(clone), python_command(clone)
        build = f'{python} -m pip install -e ".[docs]" && {python} -m sphinx docs docs/_build/html'
        raise MissingDependencyError(f"the pages are not built; in {where}: {build}")
    parts = tuple(page.strip("/").removesuffix(_PAGE).split("/"))
    paths = [path.relative_to(built).with_suffix("") for path in built.rglob(f"*{_PAGE}")]
    found = [path for path in paths if path.parts[-len(parts) :] == parts]
    if not found:
        close = difflib.get_close_matches(parts[-1], [path.name for path in paths], n=1)
        meant = f"; did you mean {close[0]}?" if close else "; `coilarray docs` opens the first one."
        raise OutputError(f"there is no page {page!r}{meant}")
    first = min(found, key=lambda path: (len(path.parts), str(path)))
    return built / first.with_name(first.name + _PAGE)
