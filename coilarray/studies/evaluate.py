"""Evaluate many designs on a pool of workers, each design once, with earlier outcomes from the store."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from typing import Any

from coilarray.compute.store import Store, content_key
from coilarray.compute.threads import Progress
from coilarray.compute.workers import Pool
from coilarray.design.model import Design, DesignFile, build_design
from coilarray.design.vary import plain, vary_document
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import DesignError
from coilarray.studies.quantities import canonical, evaluate

_SAYS_NOTHING = ("title", "source", "assumed")  # tables and values of a design that enter no quantity

Outcome = dict[str, float] | str
"""Quantities of a point by name, or one line with the reason why it has none."""


def evaluate_points(
    design: Design | DesignFile,
    changes: Iterable[Mapping[str, Any]],
    quantities: Sequence[str | Mapping[str, Any]],
    pool: Pool,
    cache: Store | None = None,
    *,
    progress: Progress | None = None,
    accuracy: Accuracy = "full",
) -> Iterator[tuple[int, Outcome]]:
    """Evaluate quantities of variations of a design.

    Each variation is given by its changes, as in `coilarray.design.vary.vary`. Changes are read as the pool has room,
    so a generator may choose a point from earlier outcomes. The number and the outcome of each point are yielded as it
    is done. A `cache` keeps outcomes. `progress` is called with (done, total).

    Raises
    ------
    GoalError
        If a quantity is unknown.
    ClusterError
        If workers are lost, see `coilarray.compute.workers.Pool.run`.
    OutputError
        If the store cannot be written.
    """
    how = {"quantities": [canonical(quantity) for quantity in quantities], "accuracy": accuracy}
    document = {key: plain(value) for key, value in as_file(design).document.items() if key not in _SAYS_NOTHING}
    items = (_item(document, change, how) for change in changes)
    total = len(changes) if isinstance(changes, Sized) else None
    return run_cached(evaluate_point, items, pool, cache, progress=progress, total=total)


def evaluate_point(item: Mapping[str, Any]) -> dict[str, float]:
    """Evaluate the quantities of a document, on a worker."""
    document = item["document"]
    design = build_design(document, document["name"])
    return evaluate(design, item["quantities"], accuracy=item["accuracy"])


def _kept(entry: object) -> Outcome | None:
    """Return the outcome in an entry of the store.

    None if the entry is not an outcome.
    """
    match entry:
        case {"reason": str(reason)}:
            return reason
        case {"values": dict(values)} if all(isinstance(value, float) for value in values.values()):
            return values
    return None


def _item(document: Mapping[str, Any], change: Mapping[str, Any], how: Mapping[str, Any]) -> dict[str, Any] | str:
    """Make a point as plain data.

    For an impossible point it is the reason.
    """
    try:
        return {"document": vary_document(document, change), **how}
    except DesignError as error:
        return f"{document['name']}: {error}"


def run_cached(
    function: Callable[[Mapping[str, Any]], dict[str, float]],
    items: Iterable[Mapping[str, Any] | str],
    pool: Pool,
    cache: Store | None = None,
    *,
    progress: Progress | None = None,
    total: int | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """Apply a function to items, with a cache.

    The items are plain data. Equal items are computed once, and items with a kept outcome are not computed again. The
    function, defined in a module, returns numbers by name. Its name and the item, made of plain tables, lists, texts
    and numbers, are the key in the store. A text in place of an item is its outcome. Items are read as the pool has
    room. `total` is their number for `progress`, by default the number read so far. The number and the outcome of each
    item are yielded as it is done. The outcome is the result of the function, or the line of its CoilarrayError.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    keys: dict[int, str] = {}  # of the tasks in flight, by index
    waiting: dict[str, list[int]] = {}  # indices of equal items, by key
    read = done = 0

    def count() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total or read)

    def collect() -> Iterator[tuple[int, Outcome]]:
        """Wait for one outcome and keep it.

        It is given to all equal items.
        """
        first, outcome = pool.collect()
        key = keys.pop(first)
        if cache is not None:
            cache.put(key, {"reason" if isinstance(outcome, str) else "values": outcome})
        for index in waiting.pop(key):
            count()
            yield index, outcome

    todo = iter(items)
    try:
        while True:
            while pool.full:
                yield from collect()
            item = next(todo, None)
            if item is None:
                break
            index, read = read, read + 1
            known: Outcome | None = None
            if isinstance(item, str):
                known = item
            else:
                key = content_key(name, item)
                if key in waiting:
                    waiting[key].append(index)
                    continue
                known = None if cache is None else _kept(cache.get(key))
                if known is None:
                    keys[index], waiting[key] = key, [index]
                    pool.submit(index, function, item)
                    continue
            count()
            yield index, known
        while pool.in_flight:
            yield from collect()
    finally:
        pool.drop()
