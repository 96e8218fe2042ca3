"""Every definition has a use: in the product itself, or as documented API."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("coilarray", "geometry", "viz", "hardware")
# Names that a library calls, not we.
CALLED_BY_LIBRARIES: set[str] = set()


def sources():
    """Every module and stub once; coilarray/ holds links to the other folders."""
    links = [ROOT / "coilarray" / name for name in FOLDERS[1:]]
    for folder in FOLDERS:
        for pattern in ("*.py", "*.pyi"):
            for path in (ROOT / folder).rglob(pattern):
                if not any(path.is_relative_to(link) for link in links):
                    yield path


def definitions(tree):
    """Public functions, classes and methods with their line."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node
        if isinstance(node, ast.ClassDef):
            for part in node.body:
                if isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef) and not part.name.startswith("_"):
                    yield part.name, part


def test_every_definition_is_used():
    texts = {path: path.read_text(encoding="utf-8") for path in sources()}
    words = Counter()
    for path, text in texts.items():
        code = ast.unparse(_without_docstrings(ast.parse(text)))
        if path.name == "__init__.py" and path.parent.name != "cli":
            code = ""  # what only hands names on uses nothing
        words.update(re.findall(r"\w+", code))
    api = {word for path in texts if path.name in ("__init__.pyi",) for word in re.findall(r"\w+", texts[path])}
    templates = "".join(path.read_text(encoding="utf-8") for path in ROOT.glob("coilarray/report/*.j2"))
    unused = []
    for path, text in texts.items():
        for name, node in definitions(ast.parse(text)):
            if (
                words[name] < 2
                and name not in api | CALLED_BY_LIBRARIES
                and name not in templates
                and not _registered(node)
            ):
                unused.append(f"{path.relative_to(ROOT)}:{node.lineno} {name}")
    assert not unused, "\n".join(unused)


def _registered(node):
    """A decorator hands the function to somebody who calls it: a command, a validator."""
    return any(
        "property" not in ast.unparse(decorator)
        and "dataclass" not in ast.unparse(decorator)
        and "cache" not in ast.unparse(decorator)
        and "method" not in ast.unparse(decorator)
        for decorator in node.decorator_list
    )


def _without_docstrings(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body = node.body[1:] or [ast.Pass()]
    return tree
