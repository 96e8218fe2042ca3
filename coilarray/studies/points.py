"""Evaluate designs on an executor, each once, by the store."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from concurrent.futures import Executor
from typing import Any

from coilarray.compute.store import Store, content_key
from coilarray.compute.threads import Progress
from coilarray.compute.workers import outcomes
from coilarray.design.model import Design, DesignFile, build_design
from coilarray.design.vary import plain, vary_document
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import DesignError
from coilarray.studies.quantities import canonical, evaluate

SAYS_NOTHING = ("title", "source", "assumed")
"""Tables and values of a design that enter no result."""
Outcome = dict[str, float] | str
"""Quantities of a point by name, or a reason."""


def evaluate_points(
    design: Design | DesignFile,
    changes: Iterable[Mapping[str, Any]],
    quantities: Sequence[str | Mapping[str, Any]],
    executor: Executor,
    cache: Store | None = None,
    *,
    progress: Progress | None = None,
    accuracy: Accuracy = "full",
) -> Iterator[tuple[int, Outcome]]:
    """Evaluate variations of a design, and yield numbers and outcomes.

    Raises GoalError for an unknown quantity, ClusterError if workers are lost, and OutputError if
    the store cannot be written.
    """
    how = {"quantities": [canonical(quantity) for quantity in quantities], "accuracy": accuracy}
    document = decisive(as_file(design).document)
    items = (_item(document, change, how) for change in changes)
    total = len(changes) if isinstance(changes, Sized) else None
    return run_cached(evaluate_point, items, executor, cache, progress=progress, total=total)


def decisive(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a design's document as plain data, without `SAYS_NOTHING`."""
    return {key: plain(value) for key, value in document.items() if key not in SAYS_NOTHING}


def evaluate_point(item: Mapping[str, Any]) -> dict[str, float]:
    """Evaluate the quantities of a document, on a worker."""
    document = item["document"]
    design = build_design(document, document["name"])
    return evaluate(design, item["quantities"], accuracy=item["accuracy"])


def _kept(entry: object) -> Outcome | None:
    """Outcome in an entry of the store, None if damaged."""
    match entry:
        case {"reason": str(reason)}:
            return reason
        case {"values": dict(values)} if all(isinstance(value, float) for value in values.values()):
            return values
    return None


def _item(document: Mapping[str, Any], change: Mapping[str, Any], how: Mapping[str, Any]) -> dict[str, Any] | str:
    """Point as plain data, or why it is impossible."""
    try:
        return {"document": vary_document(document, change), **how}
    except DesignError as error:
        return f"{document['name']}: {error}"


def run_cached(
    function: Callable[[Mapping[str, Any]], dict[str, float]],
    items: Iterable[Mapping[str, Any] | str],
    executor: Executor,
    cache: Store | None = None,
    *,
    progress: Progress | None = None,
    total: int | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """Apply a function to items, and yield numbers and outcomes.

    An outcome is the function's result, or the line of its CoilarrayError. A text in place of an
    item is its outcome. Equal items are computed once. The key in the `cache` is the function's
    name with the item. `total` is for `progress`, by default the items read so far.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    known: deque[tuple[int, Outcome]] = deque()
    equal: dict[str, list[int]] = {}  # numbers of equal items in flight, by key
    keys: list[str] = []  # of all tasks
    read = done = 0

    def tasks() -> Iterator[Mapping[str, Any]]:
        nonlocal read
        for item in items:
            number, read = read, read + 1
            if isinstance(item, str):
                known.append((number, item))
                continue
            key = content_key(name, item)
            if key in equal:
                equal[key].append(number)
            elif (kept := None if cache is None else _kept(cache.get(key))) is not None:
                known.append((number, kept))
            else:
                equal[key] = [number]
                keys.append(key)
                yield item

    def counted() -> Iterator[tuple[int, Outcome]]:
        nonlocal done
        while known:
            done += 1
            if progress is not None:
                progress(done, total or read)
            yield known.popleft()

    for task, outcome in outcomes(executor, function, tasks()):
        key = keys[task]
        if cache is not None:
            cache.put(key, {"reason" if isinstance(outcome, str) else "values": outcome})
        known.extend((number, outcome) for number in equal.pop(key))
        yield from counted()
    yield from counted()
