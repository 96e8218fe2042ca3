"""Designs evaluated on an executor, each once, and quantities over a grid or over samples."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import FloatArray
from coilarray.compute.store import Store, content_key, store_to_keep
from coilarray.compute.threads import Progress
from coilarray.compute.workers import open_executor, outcomes
from coilarray.design.keys import entry_unit
from coilarray.design.model import Design, DesignFile, build_design, content_of, with_paths
from coilarray.design.toml_file import TomlFiles
from coilarray.design.vary import plain, vary, vary_document
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import DesignError, GoalError, shown
from coilarray.geometry import Array
from coilarray.studies.quantities import Request, canonical, evaluate, request

SAYS_NOTHING = ("title", "source", "assumed")  # tables and values of a design that enter no result
Outcome = dict[str, float] | str  # quantities of a point by name, or a reason
MOST_POINTS = 100_000  # largest number of points of a sweep
RULES = "fab_broken"  # quantity of every sweep, the number of broken fabrication rules
UNREAD = "converter_unread"  # quantity of a sweep, the number of unreadable values
_VALUES = TomlFiles("value", GoalError)
_LOOKED_AT = 200  # most points that are built before work begins, at 10 ms each
_STEPS = 9  # values of an interval in a grid
_DIGITS = 12  # of the values of a range, so that steps of 0.1 have short names
_RANGE = re.compile(r"([^:,\[\"']+):([^:,\[\"']+)(?::([^:,\[\"']+))?")


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
    """Evaluate variations of a design, and yield numbers and outcomes."""
    # GoalError: unknown quantity; ClusterError: lost workers; OutputError: store that cannot be written
    how = {"quantities": [canonical(quantity) for quantity in quantities], "accuracy": accuracy}
    document = decisive(as_file(design).document)

    def items() -> Iterator[Mapping[str, Any] | str]:
        for change in changes:
            try:
                yield {"document": vary_document(document, change), **how}
            except DesignError as error:
                yield f"{document['name']}: {error}"

    total = len(changes) if isinstance(changes, Sized) else None
    return run_cached(evaluate_point, items(), executor, cache, progress=progress, total=total)


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
    name with the item, its ``document`` with the content of the files that it refers to. `total` is
    for `progress`, by default the items read so far.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    known: deque[tuple[int, Outcome]] = deque()
    equal: dict[str, list[int]] = {}  # numbers of equal items in flight, by key
    keys: list[str] = []  # of all tasks
    content = lru_cache(content_of)  # files are read once
    read = done = 0

    def tasks() -> Iterator[Mapping[str, Any]]:
        nonlocal read
        for item in items:
            number, read = read, read + 1
            if isinstance(item, str):
                known.append((number, item))
                continue
            what = {"document": with_paths(item["document"], content)} if "document" in item else {}
            key = content_key(name, {**item, **what})
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


@dataclass(frozen=True)
class Axis:
    """Entry of a design with its values in a sweep."""

    key: str
    values: tuple[Any, ...]  # all different
    interval: bool = False  # whether the values are its ends, with samples anywhere between them, or on whole numbers

    def __post_init__(self) -> None:
        if not self.values:
            raise GoalError(f"{self.key} must have at least one value.")
        for value in self.values:
            if isinstance(value, float) and not math.isfinite(value):
                raise GoalError(f"{self.key} must have finite values; got {value}.")
        seen = set()
        for text in self.labels:
            if text in seen:
                raise GoalError(f"{self.key} must have each value once; got {text} again.")
            seen.add(text)
        if self.interval and not (len(self.values) == 2 and self.numeric and self.values[0] < self.values[1]):
            raise GoalError(f"{self.key} must have an interval from low to high; got {', '.join(self.labels)}.")

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in self.values)

    @property
    def labels(self) -> list[str]:
        """Values as texts: a text unchanged, anything else as JSON."""
        return [_label(value) for value in self.values]

    def spread(self, parts: Sequence[float] | None, *, whole: bool) -> list[Any]:
        """Values at fractions (below 1) of the interval, or from end to end for a grid."""
        # GoalError if the interval has no whole number for an entry that takes no others
        if not self.interval:
            return list(self.values) if parts is None else [self.values[int(part * len(self.values))] for part in parts]
        low, high = self.values
        if not whole:
            return [*_evenly(low, high, _STEPS)] if parts is None else [low + part * (high - low) for part in parts]
        first, last = math.ceil(low), math.floor(high)
        if last < first:
            raise GoalError(f"{self.key} takes whole numbers; there is none from {low} to {high}.")
        if parts is None:
            return [int(value) for value in np.unique(np.linspace(first, last, _STEPS).round())]
        return [first + int(part * (last - first + 1)) for part in parts]


def parse_axis(text: str, option: str = "--vary") -> Axis:
    """Read an axis: ``KEY=START:STOP:COUNT``, ``KEY=A,B,…`` or ``KEY=START:STOP``.

    The last form is for samples, or a grid of nine values. Texts need no quotes.

    >>> parse_axis("array.pitch_mm=10:15:3").values
    (10.0, 12.5, 15.0)
    >>> parse_axis("circuit.terminations.coil2=short,open").values
    ('short', 'open')
    >>> parse_axis('array.layers=[["L1","L2"],["L3","L4"]],[["L1","L2"]]').values
    ([['L1', 'L2'], ['L3', 'L4']], [['L1', 'L2']])
    """
    key, equals, values = (part.strip() for part in text.partition("="))
    if not key or not equals:
        raise GoalError(f"{option} must be KEY=START:STOP:COUNT or KEY=A,B,…; got {text!r}.")
    found = _RANGE.fullmatch(values)
    if found is None:  # a TOML list, or texts without quotes
        try:
            document = _VALUES.parse(f"values = [{values}]", "--vary")
        except GoalError:
            document = {}
        if list(document) == ["values"] and all(map(_is_plain, document["values"])):
            return Axis(key, tuple(document["values"]))
        return Axis(key, tuple(part.strip() for part in values.split(",") if part.strip()))
    start, stop, count = found.groups()
    try:
        ends = float(start), float(stop)
        number = None if count is None else int(count)
    except ValueError:
        raise GoalError(f"{key} must be a range of numbers, START:STOP:COUNT; got {values!r}.") from None
    if number is None:
        return Axis(key, ends, interval=True)
    if not 2 <= number <= MOST_POINTS or ends[0] == ends[1] or not all(map(math.isfinite, ends)):
        raise GoalError(f"{key} must have a range of 2 to {MOST_POINTS} different values; got {values!r}.")
    if not math.isfinite(ends[1] - ends[0]):
        raise GoalError(f"{key} must have a range of finite length; got {values!r}.")
    return Axis(key, _evenly(*ends, number))


def _evenly(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(float(f"{value:.{_DIGITS}g}") for value in np.linspace(low, high, count))


@dataclass(frozen=True, eq=False)
class Sweep:
    """Checked sweep that is ready to run, made by `plan_sweep`."""

    file: DesignFile
    axes: tuple[Axis, ...]
    points: tuple[Mapping[str, Any], ...]  # changes of every point, with the last axis of a grid running fastest
    requests: tuple[Request, ...]
    sampling: str = "grid"
    accuracy: Accuracy = "full"


def sweep(
    design: Design | DesignFile | Array,
    entries: Mapping[str, Sequence[Any]],
    quantities: Sequence[str | Mapping[str, Any]],
    *,
    accuracy: Accuracy = "full",
    keep: bool | str | Path = False,
    workers: int | Executor = 1,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Evaluate quantities of a design over a grid of its entries.

    Parameters
    ----------
    design : Design, DesignFile or Array
        Design to vary.
    entries : mapping of str to sequence
        Values of each entry by its dotted key, in the unit of the key.
    quantities : sequence of str or mapping
        Names of quantities, in the form read by `coilarray.studies.quantities.request`.
    accuracy : {"full", "screen"}
        Accuracy of the inductances, see `coilarray.electromagnetics.inductance.Accuracy`.
    keep : bool, str or Path
        Whether points are kept for later runs: in the user's cache folder, or in the given folder.
    workers : int or concurrent.futures.Executor
        Number of local processes, or an executor that computes the points. With 1 they are computed
        in this process.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    xarray.Dataset
        A variable for each quantity over the entries in the units of their keys. A point without a
        value is NaN, and ``reason`` gives the cause.

    Raises
    ------
    GoalError
        If the design does not have an entry or a quantity, or values are not allowed.

    Examples
    --------
    >>> from coilarray import load_design
    >>> wide = sweep(load_design("starter"), {"array.pitch_mm": [12, 16]}, ["span_mm"])
    >>> dict(wide.sizes), wide.span_mm.attrs["units"], round(float(wide.span_mm.diff("array.pitch_mm")[0]), 6)
    ({'array.pitch_mm': 2}, 'mm', 8.0)
    >>> keeps_rules(wide).values.tolist()
    [True, True]
    """
    for key, values in entries.items():
        if isinstance(values, str) or not isinstance(values, Iterable):
            raise GoalError(f"{key} must have a list of values; got {shown(values)}.")
    axes = [Axis(key, tuple(values)) for key, values in entries.items()]
    plan = plan_sweep(design, axes, quantities, accuracy=accuracy)
    return run_sweep(plan, workers, store_to_keep(keep), progress=progress)


def plan_sweep(
    design: Design | DesignFile | Array,
    axes: Sequence[Axis],
    quantities: Sequence[str | Mapping[str, Any]],
    samples: int | None = None,
    seed: int = 0,
    accuracy: Accuracy = "full",
) -> Sweep:
    """Choose the points of a sweep, and check it.

    They are all combinations of the axes' values, or `samples` points that cover the axes evenly: a
    Sobol sequence scrambled by `seed`, which a larger number continues. The sweep is refused if
    none of up to 200 points spread over it gives a design.
    """
    keys = [axis.key for axis in axes]
    if not keys:
        raise GoalError("a sweep must have at least one entry to vary.")
    if len(set(keys)) != len(keys):
        raise GoalError(f"a sweep must vary each entry once; got {', '.join(keys)}.")
    if isinstance(quantities, str):
        raise GoalError(f"quantities must be a list of names, as [{quantities!r}]; got a text.")
    requests = {one.key: one for one in map(request, quantities)}
    if not requests:
        raise GoalError("a sweep must have at least one quantity or goal.")
    if any(one.quantity.is_read for one in requests.values()):
        requests[UNREAD] = request(UNREAD)  # after the others, which decide what is read
    requests.setdefault(RULES, request(RULES))
    file = as_file(design)
    whole = [isinstance(own := file.values.get(key), int) and not isinstance(own, bool) for key in keys]
    parts: Sequence[Sequence[float] | None] = [None] * len(axes)
    if samples is not None:
        _check_number(samples)
        if seed < 0:
            raise GoalError(f"the seed must not be negative; got {seed}.")
        from scipy.stats import qmc  # half a second, for samples alone

        sequence = qmc.Sobol(len(axes), scramble=True, seed=np.random.default_rng(seed))
        # the sequence is balanced for powers of two, and gives a warning for other counts
        parts = sequence.random_base2((samples - 1).bit_length())[:samples].T.tolist()
    columns = [axis.spread(part, whole=its) for axis, part, its in zip(axes, parts, whole, strict=True)]
    if samples is None:
        _check_number(math.prod(map(len, columns)))
        axes = [Axis(key, tuple(column)) for key, column in zip(keys, columns, strict=True)]
    rows = itertools.product(*columns) if samples is None else zip(*columns, strict=True)
    sampling = "grid" if samples is None else f"{samples} points of a Sobol sequence, seed {seed}"
    points = [dict(zip(keys, row, strict=True)) for row in rows]
    _check_designs(file, points, tuple(requests.values()))
    return Sweep(file, tuple(axes), tuple(points), tuple(requests.values()), sampling, accuracy)


def run_sweep(
    plan: Sweep,
    workers: int | Executor = 1,
    cache: Store | None = None,
    *,
    progress: Progress | None = None,
    watch: Callable[[Callable[[], xr.Dataset]], None] | None = None,
) -> xr.Dataset:
    """Evaluate all new points, as a dataset over entries or ``sample``."""
    # After every point `watch` gets a function that returns the result so far, NaN without a reason for points to
    # come. ClusterError if workers are lost, OutputError if the store cannot be written.
    values = np.full((len(plan.requests), len(plan.points)), np.nan)
    reasons = np.full(len(plan.points), "", dtype=object)
    keys = [one.key for one in plan.requests]
    with open_executor(workers) as executor:
        for index, outcome in evaluate_points(
            plan.file, plan.points, keys, executor, cache, progress=progress, accuracy=plan.accuracy
        ):
            if isinstance(outcome, str):
                reasons[index] = outcome
            else:
                values[:, index] = [outcome[key] for key in keys]
            if watch is not None:
                watch(lambda: _dataset(plan, values.copy(), reasons.copy()))
    return _dataset(plan, values, reasons)


def keeps_rules(result: xr.Dataset) -> xr.DataArray:
    """Whether points have a result and keep every fabrication rule."""
    return result[RULES] == 0


def is_read(result: xr.Dataset) -> xr.DataArray:
    """Whether a converter, if needed, can read a point."""
    return result[UNREAD] == 0 if UNREAD in result else xr.ones_like(result[RULES], dtype=bool)


def _dataset(plan: Sweep, values: FloatArray, reasons: npt.NDArray[np.object_]) -> xr.Dataset:
    grid = plan.sampling == "grid"
    dims = tuple(axis.key for axis in plan.axes) if grid else ("sample",)
    shape = tuple(len(axis.values) for axis in plan.axes) if grid else (len(plan.points),)
    variables = {
        one.key: (dims, row.reshape(shape), {"units": one.quantity.unit, "long_name": one.quantity.says})
        for one, row in zip(plan.requests, values, strict=True)
    }
    reason = (dims, reasons.reshape(shape), {"long_name": "why the point has no quantities"})
    coordinates = {}
    for axis in plan.axes:
        at = axis.values if grid else [point[axis.key] for point in plan.points]
        said: dict[str, Any] = {"long_name": axis.key}
        own = plan.file.values.get(axis.key)
        if own is not None:
            said["design_value"] = own if axis.numeric and isinstance(own, int | float) else _label(own)
        if axis.numeric:
            said["units"] = entry_unit(axis.key)
        array = np.array(at) if axis.numeric else np.array([_label(value) for value in at], dtype=object)
        coordinates[axis.key] = xr.Variable(axis.key if grid else "sample", array, said)
    return xr.Dataset(
        {**variables, "reason": reason},
        coordinates,
        {**provenance(plan.file.design), "sampling": plan.sampling, "accuracy": plan.accuracy},
    )


def _check_number(points: int) -> None:
    if not 1 <= points <= MOST_POINTS:
        raise GoalError(f"a sweep must have 1 to {MOST_POINTS} points; got {points}.")


def _check_designs(file: DesignFile, points: Sequence[Mapping[str, Any]], requests: Sequence[Request]) -> None:
    """Build designs until one is possible, and check coils."""
    missing = {name: one.key for one in requests for name in one.coils}
    names: tuple[str, ...] = ()
    reason = ""
    for point in points[:: -(-len(points) // _LOOKED_AT)]:  # rounded up, to stay within the limit
        try:
            names = vary(file, point).coil_names
        except DesignError as error:
            reason = reason or str(error)
            continue
        missing = {name: key for name, key in missing.items() if name not in names}
        if not missing:
            return
    if not names:
        raise GoalError(f"no point of the sweep gives a design; the first one: {reason}")
    name, key = next(iter(missing.items()))
    raise GoalError(f"{key}: no design of the sweep has a coil {name!r}; there are {', '.join(names)}.")


def _is_plain(value: object) -> bool:
    return all(map(_is_plain, value)) if isinstance(value, list) else isinstance(value, str | int | float)


def _label(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
