"""S-expressions of KiCad's files as nodes that know their lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from coilarray.compute.files import text_of_file
from coilarray.errors import BoardError

_TOKEN = re.compile(r'[()]|"(?:[^"\\]|\\.)*"|[^\s()"]+|"', re.DOTALL)  # last: an open quote
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPED = {"n": "\n", "r": "\r", "t": "\t"}


class Quoted(str):
    """String in quotes: ``"1"`` is a name, ``1`` a number."""

    __slots__ = ()


@dataclass(frozen=True, eq=False)
class Node:
    """List ``(name item …)`` of an s-expression.

    `name` is empty if it has no first word. Words that stood in quotes are `Quoted`. `where` is
    "file:line" of its opening parenthesis.
    """

    name: str
    items: tuple[Node | str, ...]
    where: str

    @property
    def words(self) -> tuple[str, ...]:
        """Items that are words."""
        return tuple(item for item in self.items if isinstance(item, str))

    def children(self, *names: str) -> Iterator[Node]:
        """Yield the inner lists of some names, in order."""
        return (item for item in self.items if isinstance(item, Node) and item.name in names)

    def child(self, *names: str) -> Node | None:
        """Return the first list of a name, or nested names."""
        found: Node | None = self
        for name in names:
            found = None if found is None else next(found.children(name), None)
        return found

    def need(self, name: str) -> Node:
        """Return the first list of a name, or raise BoardError."""
        found = self.child(name)
        if found is None:
            raise BoardError(f"{self.where}: ({self.name} …) must have a ({name} …).")
        return found

    def text(self, index: int = 0) -> str:
        """Return a word, or raise BoardError if it is missing."""
        words = self.words
        if index >= len(words):
            raise BoardError(f"{self.where}: ({self.name} …) must have {index + 1} words; got {len(words)}.")
        return words[index]

    def number(self, index: int = 0) -> float:
        """Return a word as a finite number, or raise BoardError."""
        word = self.text(index)
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not abs(value) < float("inf"):
            raise BoardError(f"{self.where}: ({self.name} …) must have a number; got {word!r}.")
        return value


def read_sexpr(path: Path) -> Node:
    """Read the only s-expression of a file of UTF-8 text.

    Raises BoardError if the file cannot be read, ends too early, or has more than one list.
    """
    try:
        text = text_of_file(path)
    except UnicodeDecodeError:
        raise BoardError(f"{path}: the file is not UTF-8 text.") from None
    except OSError as error:
        raise BoardError(f"{path}: cannot be read: {error.strerror}.") from None
    return parse_sexpr(text, str(path))


def parse_sexpr(text: str, name: str = "text") -> Node:
    r"""Read one s-expression from a text.

    `name` stands for the text in messages. See `read_sexpr`.

    >>> node = parse_sexpr('(via (at 1 2.5)\n (net "a b"))')
    >>> node.name, node.need("at").number(1), node.need("net").text(), node.need("net").where
    ('via', 2.5, 'a b', 'text:2')
    """
    open_lists: list[tuple[str, list[Node | str]]] = []
    root: Node | None = None
    line, done = 1, 0
    for match in _TOKEN.finditer(text):
        token = match[0]
        line += text.count("\n", done, match.start())
        done = match.start()
        where = f"{name}:{line}"
        if token == '"':
            raise BoardError(f"{where}: the file ends inside the text that begins here.")
        if root is not None:
            raise BoardError(f"{where}: nothing may follow the last parenthesis; got {token[:40]!r}.")
        if token == "(":
            open_lists.append((where, []))
        elif not open_lists:
            raise BoardError(f"{where}: the file must begin with a parenthesis; got {token[:40]!r}.")
        elif token == ")":
            node = _node(*open_lists.pop())
            if open_lists:
                open_lists[-1][1].append(node)
            else:
                root = node
        elif token.startswith('"'):
            word = _ESCAPE.sub(lambda match: _ESCAPED.get(match[1], match[1]), token[1:-1])
            open_lists[-1][1].append(Quoted(word))
        else:
            open_lists[-1][1].append(token)
    if open_lists:
        innermost = _node(*open_lists[-1])
        last = text.count("\n", 0, len(text.rstrip())) + 1
        begun = innermost.where.rpartition(":")[2]
        raise BoardError(f"{name}:{last}: the file ends inside ({innermost.name} …) of line {begun}.")
    if root is None:
        raise BoardError(f"{name}: the file is empty.")
    return root


def _node(where: str, items: list[Node | str]) -> Node:
    if items and isinstance(items[0], str):
        return Node(str(items[0]), tuple(items[1:]), where)
    return Node("", tuple(items), where)
