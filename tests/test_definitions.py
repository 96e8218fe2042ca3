"""Every definition has a use: in the product itself, or as documented API."""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = ("coilarray", "geometry", "viz", "hardware")


def sources():
    """Every module and stub once; coilarray/ holds links to the other folders."""
    links = [ROOT / "coilarray" / name for name in FOLDERS[1:]]
    for folder in FOLDERS:
        for pattern in ("*.py", "*.pyi"):
            for path in (ROOT / folder).rglob(pattern):
                if not any(path.is_relative_to(link) for link in links):
                    yield path


def definitions(tree):
    """Public functions, classes and methods with their line; those that another library's base class calls left out."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node
        if isinstance(node, ast.ClassDef) and not any(isinstance(base, ast.Attribute) for base in node.bases):
            for part in node.body:
                if isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef) and not part.name.startswith("_"):
                    yield part.name, part


def test_every_definition_is_used():
    trees = {path: without_docstrings(ast.parse(path.read_text(encoding="utf-8"))) for path in sources()}
    words = Counter()
    for path, tree in trees.items():
        if path.name != "__init__.py" or any(definitions(tree)):  # what only hands names on uses nothing
            words.update(words_of(tree))
    pages = [path for path in trees if path.suffix == ".pyi"]
    pages += [
        ROOT / "README.md",
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("docs/*/*.md"),
        *ROOT.glob("coilarray/report/*.j2"),
    ]
    documented = {word for page in pages for word in re.findall(r"\w+", page.read_text(encoding="utf-8"))}
    unused = [
        f"{path.relative_to(ROOT)}:{node.lineno} {name}"
        for path, tree in trees.items()
        for name, node in definitions(tree)
        if words[name] < 2 and name not in documented and not registered(node)
    ]
    assert not unused, "\n".join(unused)


def registered(node):
    """Whether a decorator hands the function to a library that calls it, such as a validator."""
    plain = ("property", "dataclass", "cache", "method", "overload")
    return any(not any(word in ast.unparse(one) for word in plain) for one in node.decorator_list)


def words_of(tree):
    """Words of all names and texts in a module."""
    fields = (value for node in ast.walk(tree) for value in vars(node).values())
    texts = (one for value in fields for one in (value if isinstance(value, list) else [value]) if isinstance(one, str))
    return re.findall(r"\w+", "\n".join(texts))


def without_docstrings(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body = node.body[1:] or [ast.Pass()]
    return tree
