"""Neumann sums over the turns of a winding by quadrature.

A few turns represent all of them. The same side of successive turns is a *series* of segments whose
ends step evenly. A sum over a series is replaced by a sum over a few of its members, with the
weights that are exact for polynomials of the index (`series_rules`):

- two series that lie apart: a few members of each,
- two series that run beside or across each other: the pairs of one difference (or one sum) of the
  indices have equal positions, and their sum is taken by the rule, halved wherever a rule with
  fewer members disagrees.

Errors are about 1e-5 of the own inductance of a winding of 30 turns, less between distant windings.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.electromagnetics.kernels import kernel
from coilarray.electromagnetics.kernels.paths import RULE_SIZE, bar_pair, closest_offset
from coilarray.electromagnetics.kernels.segments import norm

_MEMBERS, _CHECK = 5, 4  # members that represent a series, and those in the rule that checks them
_APART = 0.3  # of a series' width; distance from which two series are taken as a whole
_FEW = 49  # pairs of series that are never taken as a whole
_AGREE = 1e-2  # of a sum; largest difference of its two rules, of which the better errs far less
_STEP = 1e-10  # of the path's size; evenness of the steps


@cache
def series_rules(longest: int) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Rules for sums over 1 … `longest` equidistant indices, by row.

    The result is members, weights, check (longest + 1, 5) and counts. Weights are exact for
    polynomials of degree 4, `check` for degree 3 without the middle member.
    """
    members = np.zeros((longest + 1, _MEMBERS), dtype=np.int64)
    weights, check = np.zeros((longest + 1, _MEMBERS)), np.zeros((longest + 1, _MEMBERS))
    counts = np.minimum(np.arange(longest + 1), _MEMBERS)
    fewer = np.array([0, 1, 3, 4])
    for n in range(1, longest + 1):
        if n <= _MEMBERS:
            members[n, :n] = np.arange(n)
            weights[n, :n] = check[n, :n] = 1.0
            continue
        chosen = np.round((n - 1) / 2 * (1 - np.cos(np.pi * np.arange(_MEMBERS) / (_MEMBERS - 1)))).astype(int)
        powers = np.polynomial.legendre.legvander(2 * np.arange(n) / (n - 1) - 1, _MEMBERS - 1)
        members[n] = chosen
        weights[n] = np.linalg.solve(powers[chosen].T, powers.sum(axis=0))
        part = powers[:, :_CHECK]
        check[n, fewer] = np.linalg.solve(part[chosen[fewer]].T, part.sum(axis=0))
    return members, weights, check, counts


def find_series(path: FloatArray) -> IntArray:
    """Cut a path into evenly stepping series: first row, stride and number of rows of each."""
    ends = path[:, :3] + path[:, 3:6] * path[:, 6:7]
    places, sizes = np.hstack((path[:, :3], ends)), path[:, 10:12]
    tolerance = _STEP * float(np.ptp(path[:, :3], axis=0).max() + path[:, 6].max())
    free = np.ones(len(path), dtype=bool)
    found = []
    for first in range(len(path)):
        if not free[first]:
            continue
        strides = np.arange(1, (len(path) - 1 - first) // 2 + 1)
        even = _step_evenly(places, sizes, free, first, first + strides, first + 2 * strides, tolerance)
        step, count = 1, 1
        if even.any():
            step = int(strides[even.argmax()])
            rows = np.arange(first, len(path), step)
            even = _step_evenly(places, sizes, free, rows[:-2], rows[1:-1], rows[2:], tolerance)
            count = 2 + (len(even) if even.all() else int(even.argmin()))
        free[first : first + count * step : step] = False
        found.append((first, step, count))
    return np.array(found, dtype=np.int64)


def _step_evenly(
    places: FloatArray, sizes: FloatArray, free: BoolArray, i: IntArray | int, j: IntArray, k: IntArray,
    tolerance: float,
) -> BoolArray:  # fmt: skip
    """Mask of the triples of free, alike, equidistant segments."""
    alike = (sizes[i] == sizes[j]).all(axis=-1) & (sizes[j] == sizes[k]).all(axis=-1)
    bend = np.abs(places[i] - 2.0 * places[j] + places[k]).max(axis=-1)
    return np.asarray(alike & (bend <= tolerance) & free[i] & free[j] & free[k])


def series_members(
    series: IntArray, members: IntArray, weights: FloatArray, check: FloatArray, counts: IntArray
) -> tuple[IntArray, FloatArray]:
    """Rows and weights (n,) that represent a whole path."""
    rows = [first + step * members[n, : counts[n]] for first, step, n in series]
    return np.concatenate(rows), np.concatenate([weights[n, : counts[n]] for n in series[:, 2]])


@kernel
def _distance(a: FloatArray, b: FloatArray, shift: FloatArray) -> float:
    apart = b[0] + shift[0] - a[0], b[1] + shift[1] - a[1], b[2] + shift[2] - a[2]
    return norm(closest_offset(apart, a, b))


@kernel
def _width(path: FloatArray, series: IntArray) -> float:
    """Distance from the first to the last of a series."""
    last = series[0] + (series[2] - 1) * series[1]
    p, q = path[series[0]], path[last]
    return norm((q[0] - p[0], q[1] - p[1], q[2] - p[2]))


@kernel
def _sum_two_series(
    first: FloatArray, second: FloatArray, shift: FloatArray, a: IntArray, b: IntArray, own: bool, near_widths: float,
    members: IntArray, weights: FloatArray, check: FloatArray, counts: IntArray, rule: FloatArray,
) -> float:  # fmt: skip
    """Sum of two series (`own`: pairs i < j) by lines, halved where their two rules disagree."""
    m, n = a[2], b[2]
    a_last, b_last = a[0] + (m - 1) * a[1], b[0] + (n - 1) * b[1]
    near, far = _distance(first[a[0]], second[b[0]], shift), _distance(first[a[0]], second[b_last], shift)
    near_too, far_too = _distance(first[a_last], second[b_last], shift), _distance(first[a_last], second[b[0]], shift)
    nearest = min(near, far, near_too, far_too)
    apart = m * n > _FEW and min(m, n) > 2 and nearest > _APART * max(_width(first, a), _width(second, b))
    # Pairs of one difference, or one sum, of the indices have equal positions, whichever leads
    # along the nearness.
    alike = near + near_too <= far + far_too
    j_begin, dj = (b[0], b[1]) if alike or apart else (b_last, -b[1])
    begins, lengths = np.empty(64, np.int64), np.empty(64, np.int64)
    total = 0.0
    # Nothing is called at two places, as it would be compiled into this twice.
    for line in range(m if own else int(0.0), counts[m] if apart else m + n - 1):
        if apart:  # some members of the first series, each with the second
            i, di, j, weight = a[0] + members[m, line] * a[1], int(0.0), j_begin, weights[m, line]
            lengths[0] = n
        else:
            difference = line + 1 - m
            start = max(int(0.0), -difference)
            i, di, j, weight = a[0] + start * a[1], a[1], j_begin + (start + difference) * dj, 1.0
            lengths[0] = min(m, n - difference) - start
        begins[0] = 0
        left = 1
        while left > 0:
            left -= 1
            begin, count = begins[left], lengths[left]
            better, worse = 0.0, 0.0
            for k in range(counts[count]):
                t = begin + members[count, k]
                value = bar_pair(first[i + t * di], second[j + t * dj], shift, near_widths, int(0.0), rule)
                better += weights[count, k] * value
                worse += check[count, k] * value
            if count <= _MEMBERS or abs(better - worse) <= _AGREE * abs(better):  # all of a few are taken
                total += weight * better
            else:
                half = count // 2
                begins[left], lengths[left] = begin, half
                begins[left + 1], lengths[left + 1] = begin + half, count - half
                left += 2
    return total


@kernel
def series_sum(
    first: FloatArray, second: FloatArray, shift: FloatArray, of_first: IntArray, of_second: IntArray, own: bool,
    near_widths: float, members: IntArray, weights: FloatArray, check: FloatArray, counts: IntArray,
) -> float:  # fmt: skip
    """Sum `bar_pair` over the series of two paths.

    These are rows of `first` and of `second` moved by `shift`, or the pairs i < j of one path's
    `own` rows. The last four arguments are `series_rules`.
    """
    rule = np.empty((RULE_SIZE, 4))
    total = 0.0
    for a in range(of_first.shape[0]):
        for b in range(a if own else int(0.0), of_second.shape[0]):
            total += _sum_two_series(
                first, second, shift, of_first[a], of_second[b], own and a == b, near_widths,
                members, weights, check, counts, rule,
            )  # fmt: skip
    return total
