"""Texts of TOML files made to say something else: comments, order and layout of all that stays are kept."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from functools import reduce
from itertools import accumulate, pairwise
from typing import Any

from coilarray.design.write import document_text

_Path = tuple[str | int, ...]

_STRING_OR_COMMENT = re.compile(
    r'"""(?:\\.|[^\\])*?"""|\'\'\'.*?\'\'\'|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|#[^\n]*', re.DOTALL
)
_VALUE = re.compile(r"[^\s,\[\]{}=]+(?=\s*(?:[,\]}]|$))")  # within a list or table of one value
_INLINE = 90  # characters of a list of tables that stands on one line


def edited_text(text: str, document: Mapping[str, Any]) -> str | None:
    r"""Return the text of a TOML file changed to say `document`; None if that needs a text of its own.

    Tables of a list are known by their name, else by their place. What is new stands at the end of its table.

    Examples
    --------
    >>> text = "# mine\n[board]\nmargin_mm = 2.0  # as wide as the seal\n"
    >>> print(edited_text(text, {"board": {"margin_mm": 3.5}}), end="")
    # mine
    [board]
    margin_mm = 3.5  # as wide as the seal
    """
    if not text:
        return None
    blocks = _with_parents(_in_new_order(_blocks(text), tomllib.loads(text), document))
    blocks = [block for block in blocks if isinstance(_at(document, block.path), Mapping)]
    for block in list(blocks):
        own, new = _split(_at(document, block.path), block, blocks)
        blocks[blocks.index(block)] = replace(block, body=_edited_body(block.body, own))
        for one in new:
            near = one.path[:-1] if isinstance(one.path[-1], int) else block.path
            behind = [k for k, other in enumerate(blocks) if other.path[: len(near)] == near] or [
                k for k, other in enumerate(blocks) if other.path[: len(block.path)] == block.path
            ]
            apart = _shown(blocks[behind[-1]]).endswith("\n\n")
            blocks.insert(behind[-1] + 1, replace(one, body="\n") if apart else replace(one, above="\n"))
    found = "".join(_shown(block) for block in blocks)
    try:
        return found if tomllib.loads(found) == document else None
    except tomllib.TOMLDecodeError:  # as of a table that has dotted keys and a header
        return None


@dataclass(frozen=True)
class _Block:
    """A table of the file: the comment above its header, the line of the header, and its own entries."""

    path: _Path
    above: str = ""
    header: str = ""
    body: str = ""


def _bare(text: str) -> str:
    """Return a text of the same length without comments and without what strings say."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " " if match[0].startswith("#") else "s", match[0])

    return _STRING_OR_COMMENT.sub(blank, text)


def _lines(text: str) -> Iterator[tuple[str, str, bool]]:
    """Give every line, also bare, and whether a header or an entry begins with it."""
    depth = 0
    for line, bare in zip(text.split("\n"), _bare(text).split("\n"), strict=True):
        yield f"{line}\n", bare, depth == 0 and bool(bare.strip())
        depth += sum(bare.count(sign) for sign in "[{") - sum(bare.count(sign) for sign in "]}")


def _blocks(text: str) -> list[_Block]:
    counts: dict[_Path, int] = {}
    blocks, lines = [_Block(())], list[str]()
    for line, bare, begins in _lines(text.rstrip("\n")):
        if not (begins and bare.lstrip().startswith("[")):
            lines.append(line)
            continue
        first = len(lines)
        while first and lines[first - 1].lstrip().startswith("#"):
            first -= 1
        blocks[-1] = replace(blocks[-1], body="".join(lines[:first]))
        blocks.append(_Block(_path(line, counts), "".join(lines[first:]), line))
        lines = []
    blocks[-1] = replace(blocks[-1], body="".join(lines))
    return blocks


def _path(header: str, counts: dict[_Path, int]) -> _Path:
    """Return the path of a header, the tables of lists by their numbers; a list's next table is counted."""
    table: Any = tomllib.loads(header)
    path: _Path = ()
    while table:
        ((name, table),) = table.items()
        path = (*path, name)
        if isinstance(table, list):
            counts[path] = counts.get(path, 0) + 1
            table = table[0]
        if path in counts:
            path = (*path, counts[path] - 1)
    return path


def _in_new_order(blocks: list[_Block], old: Mapping[str, Any], document: Mapping[str, Any]) -> list[_Block]:
    """Give the tables of lists the numbers that they have in the document, and leave out those that it lacks."""
    for path in {block.path[:k] for block in blocks for k, part in enumerate(block.path) if isinstance(part, int)}:
        place, numbers = len(path), _numbers(_at(old, path), _at(document, path))
        of_list = [block for block in blocks if block.path[:place] == path]
        first = blocks.index(of_list[0])
        kept = [
            replace(block, path=(*path, number, *block.path[place + 1 :]))
            for block in of_list
            if (number := numbers[int(block.path[place])]) is not None
        ]
        rest = [block for block in blocks if block not in of_list]
        blocks = [*rest[:first], *sorted(kept, key=lambda block: int(block.path[place])), *rest[first:]]
    return blocks


def _numbers(kept: Sequence[Mapping[str, Any]], wanted: Any) -> list[int | None]:
    """Return for each table of a list its new number: by its name, or by its place where there are as many."""
    there = wanted if isinstance(wanted, list) else []
    named = {item.get("name"): k for k, item in enumerate(there)}
    if None in named or len(named) < len(there):
        return [k if k < len(there) else None for k in range(len(kept))]
    found = [named.get(item.get("name")) for item in kept]
    renamed = len(kept) == len(there)
    return [k if renamed and number is None and k not in found else number for k, number in enumerate(found)]


def _with_parents(blocks: Sequence[_Block]) -> list[_Block]:
    """Put a block without a header before the first of those whose table has none of its own."""
    known, found = {block.path for block in blocks}, list[_Block]()
    for block in blocks:
        for k in range(1, len(block.path)):
            parent = block.path[:k]
            if parent not in known and not isinstance(block.path[k], int):
                known.add(parent)
                found.append(_Block(parent))
        found.append(block)
    return found


def _split(wanted: Mapping[str, Any], block: _Block, blocks: Sequence[_Block]) -> tuple[dict[str, Any], list[_Block]]:
    """Return the entries of a table that stand in its own block, and blocks for new tables below it."""
    depth = len(block.path)
    written = {names[0] for names, *_ in _entries(block.body)}
    below = {other.path[depth] for other in blocks if len(other.path) > depth and other.path[:depth] == block.path}
    own, new = dict[str, Any](), list[_Block]()
    for key, value in wanted.items():
        path = (*block.path, key)
        if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
            if key in written:
                own[key] = value
            else:
                taken = {other.path[: depth + 2] for other in blocks}
                new += [_new((*path, k), item) for k, item in enumerate(value) if (*path, k) not in taken]
        elif not isinstance(value, Mapping) or key in written:
            own[key] = value
        elif key not in below:
            new.append(_new(path, value))
    return own, new


def _new(path: _Path, table: Mapping[str, Any]) -> _Block:
    """Return a block of a new table with those below it."""
    text = _text_of(path, table)
    return _Block(path, header=re.sub(r"^\[(.*)\]", r"[[\1]]", text, count=1) if isinstance(path[-1], int) else text)


def _text_of(path: _Path, table: Mapping[str, Any]) -> str:
    """Return the text of a table with its header."""
    names = [name for name in path if isinstance(name, str)]
    return document_text(reduce(lambda inner, name: {name: inner}, reversed(names), table))


def _entries(body: str) -> Iterator[tuple[_Path, slice, slice]]:
    """Give the names of every entry of a block, the places of its lines, and those of its value."""
    bare, at = _bare(body), 0
    starts = []
    for line, _, begins in _lines(body):
        starts += [at] if begins else []
        at += len(line)
    for begin, end in pairwise([*starts, len(body)]):
        value = bare.index("=", begin) + 1
        stop = value + len(bare[value:end].rstrip())
        line_end = body.find("\n", stop) + 1 or len(body)
        names, counts = _path(f"[{body[begin : value - 1].strip()}]", {}), bare[value:stop]
        yield names, slice(begin, line_end), slice(value + len(counts) - len(counts.lstrip()), stop)


def _edited_body(body: str, wanted: Mapping[str, Any]) -> str:
    """Make the entries of a block say what is wanted; what is not there is added at the end."""
    old, entries = tomllib.loads(body), list(_entries(body))
    new = dict[int, str]()  # behind an entry by its number, which is the last one of a table of dotted keys
    added = ""
    for path, value in _missing(wanted, [names for names, *_ in entries]):
        if len(path) == 1:
            added += document_text({str(path[0]): value})
        else:
            last = max(k for k, (names, *_) in enumerate(entries) if names[: len(path) - 1] == path[:-1])
            new[last] = f"{new.get(last, '')}{'.'.join(map(_key, path))} = {_inline(value)}\n"
    for k, (names, lines, place) in list(enumerate(entries))[::-1]:
        before, after = _at(old, names), _at(wanted, names)
        body = body[: lines.stop] + new.get(k, "") + body[lines.stop :]
        if after is None:
            body = body[: lines.start] + body[lines.stop :]
        elif _is_other(before, after):
            body = body[: place.start] + _changed(body[place], before, after) + body[place.stop :]
    end = len(body.rstrip())
    return f"{body[:end]}\n{added}{body[end + 1 :]}" if added and end else added + body


def _missing(wanted: Mapping[str, Any], written: Sequence[_Path], path: _Path = ()) -> Iterator[tuple[_Path, Any]]:
    """Give what is not written of a table, by its path; what a table of dotted keys lacks entry by entry."""
    for key, value in wanted.items():
        below = (*path, key)
        if below in written:
            continue
        if isinstance(value, Mapping) and any(names[: len(below)] == below for names in written):
            yield from _missing(value, written, below)
        else:
            yield below, value


def _is_other(before: Any, after: Any) -> bool:
    """Whether a value is another one: 23.0 is 23, but 1 is not true."""
    return bool(before != after) or isinstance(before, bool) != isinstance(after, bool)


def _changed(text: str, before: Any, after: Any) -> str:
    """Return the text of a value for another one: with all between its numbers and words where it is built alike."""
    old, new = list(_leaves(before)), list(_leaves(after))
    places = list(_VALUE.finditer(_bare(text)))
    if len(places) != len(old) or [path for path, _ in old] != [path for path, _ in new]:
        in_lines = isinstance(before, list) and isinstance(after, list) and before and after and "\n" in text
        return _changed_lines(text, before, after) if in_lines else _inline(after)
    for (_, was), (_, value), place in list(zip(old, new, places, strict=True))[::-1]:
        if _is_other(was, value):
            text = text[: place.start()] + _inline(value) + text[place.end() :]
    return text


def _changed_lines(text: str, before: Sequence[Any], after: Sequence[Any]) -> str:
    """Return the text of a list of several lines for another one; an item that stays keeps its lines."""
    head, items, tail = _items(text)
    if len(items) != len(before):
        return _inline(list(after))
    space = re.split(r"(?<=\n)", items[0][0])[-1] if "\n" in f"{head}{items[0][0]}" else ""
    found = list[tuple[str, str, str]]()
    matches = SequenceMatcher(None, [_known_by(item) for item in before], [_known_by(item) for item in after], False)
    for _, first, end, start, stop in matches.get_opcodes():
        if end - first == stop - start:
            pairs = zip(items[first:end], before[first:end], after[start:stop], strict=True)
            found += [
                (lead, value if was == item else _changed(value, was, item), behind)
                for (lead, value, behind), was, item in pairs
            ]
        else:
            found += [
                (space if not found or found[-1][2].endswith("\n") else " ", _inline(item), "\n")
                for item in after[start:stop]
            ]
    return head + "".join(f"{lead}{value},{behind}" for lead, value, behind in found) + tail


def _items(text: str) -> tuple[str, list[tuple[str, str, str]], str]:
    """Split the text of a list: its start; of each item what is before it, itself, and what is behind its comma."""
    bare = _bare(text)
    depths = list(accumulate((sign in "[{") - (sign in "]}") for sign in bare))
    commas = [k for k, sign in enumerate(bare) if sign == "," and depths[k] == 1]
    first = text.find("\n") + 1 if not bare[1 : text.find("\n")].strip() else 1
    items, at = list[tuple[str, str, str]](), first
    for stop in [*commas, len(text) - 1]:
        value = bare[at:stop].strip()
        if not value:
            break
        begin = at + bare[at:stop].index(value)
        end = begin + len(value)
        behind = stop + 1 if bare[stop] == "," else end
        line_end = text.find("\n", behind) + 1 or len(text) - 1
        rest = line_end if not bare[behind:line_end].strip() else behind
        between = text[end:stop] if bare[stop] == "," else ""
        items.append((text[at:begin], text[begin:end], between + text[behind:rest]))
        at = rest
    return text[:first], items, text[at:]


def _known_by(item: Any) -> str:
    """Return what an item of a list is known by: its name, else what it says."""
    return str(item["name"]) if isinstance(item, Mapping) and "name" in item else repr(item)


def _leaves(value: Any, path: _Path = ()) -> Iterator[tuple[_Path, Any]]:
    """Give the plain values of a value with their places in it."""
    parts = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    if not isinstance(value, Mapping | list):
        yield path, value
    for key, item in parts:
        yield from _leaves(item, (*path, key))


def _inline(value: Any) -> str:
    """Return a value, which may be a table, as it stands behind its key."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(_entry(key, item) for key, item in value.items())} }}"
    if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        items = [_inline(item) for item in value]
        short = f"[{', '.join(items)}]"
        return short if len(short) < _INLINE else "[\n" + "".join(f"  {item},\n" for item in items) + "]"
    return document_text({"k": value}).partition("=")[2].strip()


def _entry(key: str, value: Any) -> str:
    return f"{_key(key)} = {_inline(value)}"


def _key(name: str | int) -> str:
    """Return a key as it stands in a file."""
    return document_text({str(name): 0}).partition("=")[0].strip()


def _at(document: Any, path: _Path) -> Any:
    """Return what stands at a path, or None."""
    for part in path:
        try:
            document = document[part]
        except (KeyError, IndexError, TypeError):
            return None
    return document


def _shown(block: _Block) -> str:
    header = block.header
    if not header and block.path and block.body.strip():
        header = _text_of(block.path, {})
    return f"{block.above}{header}{block.body}"
