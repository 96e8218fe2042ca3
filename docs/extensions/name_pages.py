"""A page for every public name, in groups, from the docstrings, to which every mention of the name leads."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import itertools
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from command_pages import FOLDER as COMMAND_PAGES
from command_pages import write_page
from docutils import nodes
from sphinx import addnodes
from sphinx.transforms import SphinxTransform
from sphinx.util.nodes import make_refnode

import coilarray
from coilarray.cli.main import COMMANDS
from coilarray.geometry import MATERIAL_SOURCES, MATERIALS

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

_DOCS = Path(__file__).parents[1]
_FOLDER = "reference/python"
# module of a name, its beginning → group
_GROUPS: Mapping[str, str] = {
    "coilarray.design": "Designs",
    "coilarray.geometry": "Geometry",
    "coilarray.electromagnetics": "Fields and inductance",
    "coilarray.circuit": "Circuit",
    "coilarray.elastomer": "Response",
    "coilarray.response": "Response",
    "coilarray.localize": "Position",
    "coilarray.paper.two_dimensional": "Response",
    "coilarray.paper": "Position",
    "coilarray.studies.comparison": "Position",
    "coilarray.studies": "Studies and report",
    "coilarray.report": "Studies and report",
}
_ORDER = (*dict.fromkeys(_GROUPS.values()), "Errors")
_ROOMS = {"coilarray.viz": "Pictures", "coilarray.hardware": "Boards"}
_BEYOND = "Beyond the top level"
_RETURNED = "What functions return"
_COMMAND = "command"
_NO_PARAMETERS = "self", "cls", "args", "kwargs"  # the last two of a protocol, which nobody makes
_BEYOND_ROW = re.compile(r"^\| `(coilarray\.[\w.]+)\.(\w+)`((?:, `\w+`)*) \|", re.MULTILINE)


@cache
def names() -> dict[str, list[str]]:
    """Full names of everything public by group."""
    groups: dict[str, list[str]] = {group: [] for group in (*_ORDER, *_ROOMS.values(), _BEYOND)}
    for name in coilarray.__all__:
        value = getattr(coilarray, name)
        if inspect.ismodule(value):
            continue
        module = getattr(value, "__module__", "coilarray.geometry")
        group = next((words for start, words in _GROUPS.items() if module.startswith(start)), "Geometry")
        groups[group].append(f"coilarray.{name}")
    raised = inspect.getmembers(coilarray.errors, lambda value: inspect.isclass(value) and issubclass(value, Exception))
    groups["Errors"] += [f"coilarray.errors.{name}" for name, _ in raised]
    for room, group in _ROOMS.items():
        groups[group] += [f"{room}.{name}" for name in importlib.import_module(room).__all__]
    for module, first, others in _BEYOND_ROW.findall((_DOCS / "helpers.md").read_text(encoding="utf-8")):
        groups[_BEYOND] += [f"{module}.{name}" for name in (first, *re.findall(r"\w+", others))]
    groups[_RETURNED] = list(_classes_returned([*itertools.chain(*groups.values())]))
    return groups


def _classes_returned(public: list[str]) -> Iterator[str]:
    """Yield the full names of the package's classes that public code returns and that are not public themselves."""
    found = [value for full in public if inspect.isclass(value := _value(full))]
    for _, code, _ in _code_of(public):
        for word in re.findall(r"\b[A-Z]\w+", str(inspect.signature(code).return_annotation)):
            value = code.__globals__.get(word)
            if inspect.isclass(value) and value.__module__.startswith("coilarray.") and value not in found:
                if hasattr(value, "model_fields"):
                    continue  # a file, whose keys have a page
                found.append(value)
                yield f"{value.__module__}.{value.__qualname__}"


def _code_of(public: Iterable[str]) -> Iterator[tuple[str, Callable[..., object], bool]]:
    """Yield name, function, and whether it is a property, of public functions and of all methods of public classes."""
    for full in public:
        value = _value(full)
        members = {full: value}
        if inspect.isclass(value):
            members = {f"{full}.{name}": one for name, one in vars(value).items() if not name.startswith("_")}
        for name, one in members.items():
            is_property = isinstance(one, property | cached_property)
            code = one.fget if isinstance(one, property) else getattr(one, "func", getattr(one, "__func__", one))
            if inspect.isfunction(code := inspect.unwrap(code)):
                yield name, code, is_property


def returning() -> Iterator[tuple[str, bool, str, str]]:
    """Yield name, whether a property, return annotation and docstring of everything public that returns something."""
    for name, code, is_property in _code_of(itertools.chain(*names().values())):
        annotation = str(inspect.signature(code).return_annotation)
        if annotation not in ("None", "NoReturn"):
            yield name, is_property, annotation, inspect.getdoc(code) or ""


def taking() -> Iterator[tuple[str, list[str], str]]:
    """Yield name, names of the parameters and docstring of all public functions, methods and classes."""
    public = [*itertools.chain(*names().values())]
    made = [(full, value, False) for full in public if inspect.isclass(value := _value(full))]
    for name, code, is_property in (*made, *_code_of(public)):
        if is_property or (inspect.isclass(code) and issubclass(code, BaseException)):
            continue
        parameters = [one for one in inspect.signature(code).parameters if one not in _NO_PARAMETERS and one[0] != "_"]
        yield name, parameters, inspect.getdoc(code) or ""


def _value(full: str) -> object:
    module, _, name = full.rpartition(".")
    return getattr(importlib.import_module(module), name)


_MATERIALS = "Mapping of materials by their names in files, at 20 °C where nothing else is said."


def _materials() -> list[str]:
    lines = [
        ".. py:data:: coilarray.MATERIALS",
        "",
        f"   {_MATERIALS}",
        "",
        ".. list-table::",
        "   :header-rows: 1",
        "",
    ]
    rows = [("name", "conductivity (MS/m)", "µr", "grade, source and what is assumed")]
    for name, one in MATERIALS.items():
        conductivity, mu = f"{one.conductivity / 1e6:.4g}", f"{one.relative_permeability:g}"
        rows.append((f"``{name}``", conductivity, mu, MATERIAL_SOURCES[name]))
    return lines + [f"   {'  -' if column else '* -'} {cell}" for row in rows for column, cell in enumerate(row)]


def _page(full: str) -> str:
    value = _value(full)
    kind = "autoclass" if inspect.isclass(value) else "autofunction"
    lines = [full, "=" * len(full), "", *([f".. {kind}:: {full}"] if callable(value) else _materials())]
    if inspect.isclass(value) and not issubclass(value, BaseException | tuple):
        lines.append("   :members:")
        ours = [base for base in value.__mro__[1:] if base.__module__.startswith("coilarray.")]
        if ours and not any(hasattr(base, "model_fields") for base in ours):
            lines.append("   :inherited-members: object")
    return "\n".join([*lines, ""])


def _first_line(full: str) -> str:
    value = _value(full)
    text = inspect.getdoc(value) if callable(value) else _MATERIALS
    return (text or "").split("\n\n")[0].replace("\n", " ")


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    words = "``import coilarray as ca`` offers all but the last four groups. Everything takes and returns SI units."
    lines = ["Python", "======", "", words, ""]
    for group, members in names().items():
        lines += [group, "-" * len(group), "", ".. list-table::", "   :widths: 30 70", ""]
        links = {full: f"{full.removeprefix('coilarray.')} <{full}>" for full in sorted(members)}
        for full, link in links.items():
            write_page(folder / f"{full}.rst", _page(full))
            lines += [f"   * - :doc:`{link}`", f"     - {_first_line(full)}"]
        lines += ["", ".. toctree::", "   :hidden:", "", *(f"   {link}" for link in links.values()), ""]
    write_page(folder / "index.rst", "\n".join(lines))
    written = {"index", *itertools.chain(*names().values())}
    for path in folder.glob("*.rst"):
        if path.stem not in written:  # a name that is public no longer
            path.unlink()


@cache
def _aliases() -> tuple[dict[str, str], dict[int, str]]:
    """Full names of everything public by what it is called in text, and by what it is, under whichever module."""
    called, things = {}, {}
    for group, members in names().items():
        for full in members:
            name, value = full.rpartition(".")[2], _value(full)
            called |= dict.fromkeys((full, f"ca.{name}"), full)
            if callable(value):
                things[id(value)] = full
            if group == _BEYOND or not name.islower() or "_" in name:  # another single word may be anything
                called.setdefault(name, full)
    return called, things


def public_name(text: str) -> str | None:
    """Return the name on its page of what a text names, a member of a class for example; None for another text."""
    called, things = _aliases()
    head, tail = text.removesuffix("()"), ""
    if not re.fullmatch(r"[\w.]+", head):  # a call with its arguments
        return None
    while head:
        full = called.get(head)
        if full is None and head.startswith("coilarray."):
            with contextlib.suppress(ImportError, AttributeError):
                full = things.get(id(pkgutil.resolve_name(head)))
        if full:
            return full + tail
        head, _, last = head.rpartition(".")
        tail = f".{last}{tail}"
    return None


def _find(app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, shown: nodes.Element) -> nodes.Node | None:
    """Resolve a reference to a command, or one that names something public otherwise than its page does."""
    if node["reftype"] == _COMMAND:
        return make_refnode(app.builder, node["refdoc"], node["reftarget"], "", shown)
    if node["refdomain"] != "py" or not (full := public_name(node["reftarget"])):
        return None
    return env.domains["py"].resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, shown)


class _Links(SphinxTransform):
    """Public names and commands that stand as code in a page of words lead to their pages."""

    default_priority = 500
    _command = re.compile(rf"coilarray ({'|'.join(COMMANDS)})(?![\w-]).*")

    def apply(self, **_: object) -> None:
        """Put a reference about each of them."""
        page = self.env.docname
        for code in list(self.document.findall(nodes.literal)):
            if isinstance(code.parent, nodes.reference | addnodes.pending_xref) or "xref" in code["classes"]:
                continue
            text = code.astext()
            command = self._command.fullmatch(text)
            if page.startswith("guide/"):  # which leave the program's name out
                command = command or self._command.fullmatch(f"coilarray {text}")
            what: dict[str, object]
            if command:
                what = {
                    "refdomain": "",
                    "reftype": _COMMAND,
                    "reftarget": f"{COMMAND_PAGES}/{command[1].replace(' ', '_')}",
                }
            elif not page.startswith("reference/") and (full := public_name(text)):  # there code is keys and variables
                what = {"refdomain": "py", "reftype": "obj", "reftarget": full}
            else:
                continue
            reference = addnodes.pending_xref("", refexplicit=True, refwarn=True, refdoc=page, **what)
            code.replace_self(reference)
            reference += code


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them, and link to them."""
    app.connect("builder-inited", _write)
    app.connect("missing-reference", _find)
    app.add_transform(_Links)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
