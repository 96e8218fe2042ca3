"""Live δ, relative to a baseline, and position of the indentation, scan by scan, without I/O."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from coilarray.errors import HardwareError, require_positive
from coilarray.hardware.record.recorded_response import less_reference
from coilarray.hardware.scan.readings import ScanReading, StateReading, Verdict
from coilarray.localize.presses import Press, PressDetector

if TYPE_CHECKING:
    from coilarray.circuit.noise_budget import NoiseBudget
    from coilarray.localize.forward import ForwardModel
    from coilarray.localize.inverse import Location

BASELINE_SCANS = 10  # number of scans without an indentation whose mean is L_0
_PATIENCE = 3  # multiple of the scans of a baseline after which a state without values is left out
_RATE_SCANS = 20  # over which the rate is averaged
_LARGEST = 0.5  # |δ| above which a reading is implausible


@dataclass(frozen=True)
class LiveState:
    """One state of a scan."""

    name: str
    delta: float | None  # (L − L_0)/L_0. None while the baseline is measured, or without a value
    verdict: Verdict
    reasons: tuple[str, ...] = ()  # why the reading is not good or has no δ


@dataclass(frozen=True, eq=False)
class LiveReading:
    """Evaluation of one scan."""

    sequence: int
    time: float  # of the scan in s by the board's clock
    elapsed: float  # s since the first scan of this session of the board
    states: tuple[LiveState, ...]  # in the order of the scan
    waiting: int  # scans that the baseline still needs
    location: Location | None  # of the indentation. None if it was not requested or cannot be found
    problem: str  # why there is no location although requested, or ""
    noise: float | None  # standard deviation of each δ alone. None without a baseline
    rate: float | None  # scans per second over the latest scans, by the board's clock
    lost: int  # scans missing so far
    press: Press | None = None  # press during this scan, or press that has ended with it
    received: float | None = None  # arrival in s since the epoch by the computer's clock
    temperature: float | None = None  # of the board in °C, if known
    common_noise: float | None = None  # standard deviation common to all states. None if unknown


class LiveTracker:
    """Tracker that converts scans into δ and positions.

    Without a `model` nothing is located. `baseline_scans` without an indentation give L_0 and the
    noise of a scan. The `budget`, see `coilarray.hardware.scan.settings.board_budget`, gives the
    changes since L_0, separate and common. Without it the measured noise is added to the noise of
    the model. `noise`, a standard deviation of δ independent from state to state, replaces the
    budget and the noise of the model. `reference` coils are touched by nothing. Their mean δ is
    subtracted from all other states, and they take no part in locations and presses.
    """

    def __init__(
        self,
        model: ForwardModel | None,
        *,
        baseline_scans: int = BASELINE_SCANS,
        budget: NoiseBudget | None = None,
        noise: float | None = None,
        reference: Sequence[str] = (),
    ) -> None:
        if baseline_scans < 2:
            raise HardwareError(f"a baseline must have at least 2 scans; got {baseline_scans}.")
        if noise is not None:
            require_positive("noise", noise, "", HardwareError)
        self._whole, self._budget, self._given = model, budget, noise
        self._scans, self._reference = baseline_scans, tuple(reference)
        self._model = model if model is None or not reference else model.referenced(reference)
        if self._model is not None and noise is not None:
            self._model = replace(self._model, common=())
        if budget is not None and reference:
            budget.referenced(reference)  # refuses unknown references
        self._models: dict[tuple[str, ...], ForwardModel] = {}
        self._times: deque[float] = deque(maxlen=_RATE_SCANS)
        self._last: tuple[int, int] | None = None  # session and sequence
        self._start = 0.0
        self._lost = self._states = 0
        self._presses: PressDetector | None = None
        self.rezero()

    def rezero(self) -> None:
        """Measure the baseline again from the next scan on."""
        self._rest: list[tuple[float, Mapping[str, float]]] = []  # times in s, and L in H by state
        self._waiting = self._scans
        self._base: dict[str, float] | None = None
        self._noise = math.nan
        self._common: float | None = None

    def take(self, scan: ScanReading, *, at_rest: bool = True, want_location: bool = True) -> LiveReading:
        """Evaluate the next scan."""
        self._count(scan)
        self._states = len(scan.states)
        elapsed = scan.time - self._start
        if self._base is None and at_rest:
            self._measure_baseline(elapsed, scan.inductances)
        base = self._base
        states = tuple(_live_state(state, base) for state in scan.states)
        if base is not None and self._reference:
            left = self._less({state.name: state.delta for state in states if state.delta is not None})
            states = tuple(self._corrected(state, left) for state in states)
        location, problem = None, ""
        if base is not None and want_location and self._model is not None:
            location, problem = self._located(self._model, states)
        press, times = None, self._times
        if self._presses is not None and base is not None:
            press = self._presses.take(elapsed, self._touchable(states), location)
        return LiveReading(
            sequence=scan.sequence,
            time=scan.time,
            elapsed=elapsed,
            states=states,
            waiting=0 if base is not None else self._waiting,
            location=location,
            problem=problem,
            noise=None if base is None else self._noise,
            rate=(len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else None,
            lost=self._lost,
            press=press,
            received=scan.received,
            temperature=scan.temperature,
            common_noise=None if base is None else self._common,
        )

    def _measure_baseline(self, elapsed: float, values: Mapping[str, float]) -> None:
        self._rest.append((elapsed, values))
        counts = Counter(name for _, one in self._rest for name in one)
        enough = {name for name, count in counts.items() if count >= self._scans}
        self._waiting = max(self._scans - min(counts.values(), default=0), 1)
        everything = len(enough) == self._states
        late = len(self._rest) >= _PATIENCE * self._scans and enough > set(self._reference)
        if not (everything or late):
            return
        rest = [(time, {name: one[name] for name in enough if name in one}) for time, one in self._rest]
        self._base = base = {name: float(np.mean([one[name] for _, one in rest if name in one])) for name in enough}
        deltas = [
            (time, self._less({name: value / base[name] - 1 for name, value in one.items()})) for time, one in rest
        ]
        rows = [[one[name] for _, one in deltas if name in one] for name in enough if name not in self._reference]
        variances = [float(np.var(row, ddof=1)) for row in rows if len(row) > 1]
        variance = float(np.mean(variances)) if variances else 0.0
        own = math.sqrt(variance * (1 + 1 / self._scans))  # of a scan and of the baseline itself
        self._assume(own, [name for name in enough if name not in self._reference])
        self._rest = []
        self._presses = PressDetector(deltas, 0 if self._presses is None else self._presses.number)

    def _assume(self, measured: float, names: Sequence[str]) -> None:
        """Set the noise of δ of the named states."""
        self._models = {}  # they have the noise
        if self._given is not None:
            self._noise = math.hypot(self._given, measured)
            return
        model, budget, references = self._whole, self._budget, len(self._reference)
        # A difference scatters by both of its sides. All differences share the noise of the
        # references.
        white = measured / math.sqrt(1 + 1 / references) if references else measured
        if budget is None:
            self._noise = white if model is None else math.hypot(model.noise, white)
        else:
            white = white or float(budget.noise.max())  # unseen below a converter's step
            self._noise = math.hypot(white, float(budget.own_change.max()))
            less = budget.referenced(self._reference) if references else budget
            kept = [k for k, name in enumerate(less.states) if name in names]
            squares = sum((change[kept] ** 2 for change in less.common.values()), np.zeros(len(kept)))
            of_references = self._noise**2 / references if references else 0.0
            self._common = math.sqrt(float(squares.max(initial=0.0)) + of_references)
        if model is not None:
            if budget is not None:
                model = replace(model, common=tuple(budget.select(model.states).common.values()))
            model = replace(model, noise=self._noise)
            self._model = model.referenced(self._reference) if references else model

    def _less(self, delta: Mapping[str, float]) -> dict[str, float]:
        """Return δ of the other states less the references."""
        if not self._reference:
            return dict(delta)
        if not set(self._reference) <= set(delta):
            return {}
        return {name: float(value) for name, value in less_reference(delta, self._reference).items()}

    def _corrected(self, state: LiveState, left: Mapping[str, float]) -> LiveState:
        """Return a state with δ less the references, which keep their own."""
        if state.name in self._reference or state.delta is None:
            return state
        if state.name in left:
            return replace(state, delta=left[state.name])
        return replace(state, delta=None, reasons=(*state.reasons, "the reference coil has no value"))

    def _located(self, model: ForwardModel, states: Sequence[LiveState]) -> tuple[Location | None, str]:
        from coilarray.localize.inverse import locate  # slow, only with a model

        delta = {name: value for name, value in self._touchable(states).items() if name in model.states}
        if len(delta) < model.unknowns:
            return None, f"{len(delta)} states have a value that the table knows; {model.unknowns} are needed"
        used = tuple(delta)
        if used not in self._models:
            chosen = model if set(used) == set(model.states) else model.select(used)
            self._models[used] = replace(chosen, noise=self._noise)
        return locate(self._models[used], delta), ""

    def _touchable(self, states: Sequence[LiveState]) -> dict[str, float]:
        """Return plausible values of δ without the references."""
        return {
            state.name: state.delta
            for state in states
            if state.delta is not None and abs(state.delta) < _LARGEST and state.name not in self._reference
        }

    def _count(self, scan: ScanReading) -> None:
        if self._last is not None and self._last[0] == scan.boot and scan.sequence > self._last[1]:
            self._lost += scan.sequence - self._last[1] - 1
        if self._last is None or self._last[0] != scan.boot:
            self._times.clear()
            self._start = scan.time
        elif self._times and scan.time <= self._times[-1]:
            self._times.clear()
        self._last = scan.boot, scan.sequence
        self._times.append(scan.time)


def _live_state(state: StateReading, base: Mapping[str, float] | None) -> LiveState:
    reasons = tuple(str(reason) for reason in state.reasons)
    if state.inductance is None or base is None:
        return LiveState(state.name, None, state.verdict, reasons)
    if state.name not in base:
        return LiveState(state.name, None, state.verdict, (*reasons, "no baseline"))
    return LiveState(state.name, state.inductance / base[state.name] - 1, state.verdict, reasons)
