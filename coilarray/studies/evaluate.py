"""Evaluate many designs: on a pool of workers, each design once, whatever was done before kept in a cache."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from typing import Any

from coilarray.compute.threads import Progress
from coilarray.compute.workers import Pool
from coilarray.design.model import Design, DesignFile, build_design
from coilarray.design.vary import plain, vary_document
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import DesignError
from coilarray.studies.cache import Outcome, PointCache, point_key
from coilarray.studies.quantities import canonical, evaluate

_SAYS_NOTHING = ("title", "source", "assumed")  # tables and values of a design that enter no quantity


def evaluate_points(
    design: Design | DesignFile,
    changes: Iterable[Mapping[str, Any]],
    quantities: Sequence[str | Mapping[str, Any]],
    pool: Pool,
    cache: PointCache | None = None,
    *,
    progress: Progress | None = None,
    accuracy: Accuracy = "full",
) -> Iterator[tuple[int, Outcome]]:
    """Evaluate quantities of variations of a design.

    Parameters
    ----------
    design : Design or DesignFile
        The design to be varied.
    changes : iterable of mapping
        Changed entries of each point, as `coilarray.design.vary.vary` takes them. They are read one by one as the pool
        has room, so that a generator may choose a point when it knows earlier outcomes.
    quantities : sequence of str or mapping
        Names of quantities, as `coilarray.studies.quantities.evaluate` takes them.
    pool : Pool
        Workers from `coilarray.compute.workers.workers`.
    cache : PointCache, optional
        Outcomes of earlier runs, from `coilarray.studies.cache.open_cache`; none are kept by default.
    progress : callable, optional
        Called with (done, total).
    accuracy : {"full", "screen"}
        Accuracy of the inductances: `coilarray.electromagnetics.inductance.Accuracy`.

    Yields
    ------
    index : int
        Index of the point, from 0; points come in the order in which they are done.
    outcome : dict of str to float, or str
        Quantities by their canonical names, or one line that says why the point has none: an impossible design, or a
        quantity that the design does not have.

    Raises
    ------
    GoalError
        A quantity that there is not.
    ClusterError
        As `Pool.run`.
    OutputError
        A cache that cannot be written.
    """
    how = {"quantities": [canonical(quantity) for quantity in quantities], "accuracy": accuracy}
    document = {key: plain(value) for key, value in as_file(design).document.items() if key not in _SAYS_NOTHING}
    items = (_item(document, change, how) for change in changes)
    total = len(changes) if isinstance(changes, Sized) else None
    return run_cached(evaluate_point, items, pool, cache, progress=progress, total=total)


def evaluate_point(item: Mapping[str, Any]) -> dict[str, float]:
    """Evaluate the quantities of a document; this is what workers run."""
    document = item["document"]
    design = build_design(document, document["name"])
    return evaluate(design, item["quantities"], accuracy=item["accuracy"])


def _item(document: Mapping[str, Any], change: Mapping[str, Any], how: Mapping[str, Any]) -> dict[str, Any] | str:
    """One point as plain data, or why it cannot be."""
    try:
        return {"document": vary_document(document, change), **how}
    except DesignError as error:
        return f"{document['name']}: {error}"


def run_cached(
    function: Callable[[Mapping[str, Any]], dict[str, float]],
    items: Iterable[Mapping[str, Any] | str],
    pool: Pool,
    cache: PointCache | None = None,
    *,
    progress: Progress | None = None,
    total: int | None = None,
) -> Iterator[tuple[int, Outcome]]:
    """Apply a function to items of plain data: once to equal items, and not to those whose outcome is known.

    Parameters
    ----------
    function : callable
        Function of a module that takes an item and returns numbers by name. Its name and the item are the key of the
        cache.
    items : iterable of mapping or str
        Items of plain tables, lists, texts and numbers; a text in place of an item is its outcome. They are read one
        by one as the pool has room.
    pool, cache, progress
        As in `evaluate_points`.
    total : int, optional
        Number of items, for `progress`; by default the number that was read.

    Yields
    ------
    index : int
        Index of the item, from 0; items come in the order in which they are done.
    outcome : dict of str to float, or str
        Result of the function, or the message of its CoilarrayError.
    """
    run = _Run(function, pool, cache, progress, total)
    todo = enumerate(items)
    try:
        while True:
            while pool.full:
                yield from run.collect()
            following = next(todo, None)
            if following is None:
                break
            known = run.submit(*following)
            if known is not None:
                yield following[0], known
        while pool.in_flight:
            yield from run.collect()
    finally:
        pool.drop()


class _Run:
    """The bookkeeping of `run_cached`: what is in flight, and for which items."""

    def __init__(
        self,
        function: Callable[[Mapping[str, Any]], dict[str, float]],
        pool: Pool,
        cache: PointCache | None,
        progress: Progress | None,
        total: int | None,
    ) -> None:
        self._function, self._pool, self._cache = function, pool, cache
        self._progress, self._total = progress, total
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._read = self._done = 0
        self._keys: dict[int, str] = {}  # of what is in flight, by index
        self._waiting: dict[str, list[int]] = {}  # indices of equal items, by key

    def submit(self, index: int, item: Mapping[str, Any] | str) -> Outcome | None:
        """Return the outcome of an item where it is known; else hand the item to the pool."""
        self._read += 1
        if isinstance(item, str):
            self._report()
            return item
        key = point_key(self._name, item)
        if key in self._waiting:
            self._waiting[key].append(index)
            return None
        known = None if self._cache is None else self._cache.get(key)
        if known is not None:
            self._report()
            return known
        self._keys[index], self._waiting[key] = key, [index]
        self._pool.submit(index, self._function, item)
        return None

    def collect(self) -> Iterator[tuple[int, Outcome]]:
        """Wait for one outcome, keep it, and give it to all equal items."""
        first, outcome = self._pool.collect()
        key = self._keys.pop(first)
        if self._cache is not None:
            self._cache.put(key, outcome)
        for index in self._waiting.pop(key):
            self._report()
            yield index, outcome

    def _report(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._total or self._read)
