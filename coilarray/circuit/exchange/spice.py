"""The array as a SPICE subcircuit.

It has inductors, ladders of resistance, capacitors and the complete set of couplings.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from coilarray.circuit.network import checked_network
from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.inductance import coupling_matrix

_NAME_LENGTH = 60  # FastHenry reads names into buffers of 80 bytes


def plain_names(names: Sequence[str], count: int | None = None) -> tuple[str, ...]:
    """Return distinct names of letters, digits and underscores.

    They stay distinct if case does not count.

    Parameters
    ----------
    names : sequence of str
        Names of the coils, all different.
    count : int, optional
        Required number of names.

    Returns
    -------
    tuple of str
        Every other character becomes ``_``. A name that is taken then gets ``_2``, ``_3``, …

    Raises
    ------
    ValueError
        The wrong number of names, no name at all, an empty name, or a name given twice.

    Examples
    --------
    >>> plain_names(["coil 1", "coil-1", "COIL_1"])
    ('coil_1', 'coil_1_2', 'COIL_1_3')
    """
    given = list(names)
    if not given or (count is not None and len(given) != count):
        raise ValueError(f"names must be {count or 'one or more'}; got {len(given)}.")
    taken: set[str] = set()
    result: list[str] = []
    for name in given:
        if not name.strip():
            raise ValueError("every coil needs a name; got an empty one.")
        if given.count(name) > 1:
            raise ValueError(f"names must be different; got {name!r} more than once.")
        stem = re.sub(r"[^A-Za-z0-9_]", "_", name.strip())[:_NAME_LENGTH]
        candidates = itertools.chain([stem], (f"{stem}_{k}" for k in itertools.count(2)))
        plain = next(candidate for candidate in candidates if candidate.lower() not in taken)
        taken.add(plain.lower())
        result.append(plain)
    return tuple(result)


def spice_subcircuit(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    *,
    capacitance: npt.ArrayLike | None = None,
    mutual_capacitance: npt.ArrayLike | None = None,
    sections: Sequence[Sequence[tuple[float, float]]] = (),
    title: str = "",
    comments: Sequence[str] = (),
) -> str:
    """Write the array as a SPICE subcircuit.

    Parameters
    ----------
    names : sequence of str, length n
        Names of the coils. `plain_names` makes node names of them.
    inductance : array_like, shape (n, n)
        Inductance matrix in H, symmetric and positive definite.
    resistance : array_like, shape (n,) or scalar
        Series resistance of each coil in Ω, at direct current if there are `sections`.
    capacitance : array_like, shape (n,) or scalar, optional
        Lumped winding capacitance of each coil in F, between its two pins. None by default.
    mutual_capacitance : array_like, shape (n, n), optional
        Capacitance C_ij between two coils in F, see `coilarray.circuit.network.Network`. None by default.
    sections : sequence of sequences of tuple, length n
        For each coil, pairs of a resistor in Ω and an inductor in H in parallel. The pairs are in series with the coil,
        as in `coilarray.circuit.exchange.ladder.Ladder`. None by default.
    title : str
        First comment, and as a plain name the name of the subcircuit. If empty, the name is ``coilarray``.
    comments : sequence of str
        Further comments, a line each.

    Returns
    -------
    str
        ``.subckt`` to ``.ends``, with the pins ``NAME_1 NAME_2`` of every coil in order.

    Raises
    ------
    ValueError
        Shapes that do not fit, values that are not allowed, names as in `plain_names`, or an inductance matrix that is
        not symmetric or not positive definite. Such an array could give out energy, and the simulation diverges.

    Notes
    -----
    From NAME_1 to NAME_2 a coil is R + jωL and its sections, in parallel with C. Current into NAME_1 is positive. All
    n (n − 1)/2 couplings k_ij = M_ij/√(L_i L_j) are written, every number with 17 digits (the full precision of a
    double). A set without the small couplings need not be positive
    definite. A resistance or capacitance of zero is not an element, since SPICE replaces R = 0 by a default. Between
    two coils there are four capacitors C_ij/4, from each pin of the first to each pin of the second, and C_ij/6 less
    across each coil.

    To leave a coil open, connect one pin to ground and nothing to the other. This is an ideal open, with a path for
    direct current through the coil. A coil with both pins free has no such path. Give one pin a large resistance (1 GΩ)
    to ground. A coil of no resistance has no operating point across a voltage source or an ideal short. Drive it by a
    current source, and short it through a resistance.

    Examples
    --------
    >>> print(spice_subcircuit(["A", "B"], [[2e-6, 1e-6], [1e-6, 2e-6]], [3.0, 0.0], capacitance=[0, 4e-12]))
    * coilarray: 2 coils; H, ohm, F
    .subckt coilarray A_1 A_2 B_1 B_2
    LA A_1 A_m 1.9999999999999999e-06
    RA A_m A_2 3.0000000000000000e+00
    LB B_1 B_2 1.9999999999999999e-06
    CB B_1 B_2 3.9999999999999999e-12
    K1_2 LA LB 5.0000000000000000e-01
    .ends coilarray
    <BLANKLINE>
    """
    L, R = checked_network(inductance, resistance)
    coils = plain_names(names, len(L))
    C = _capacitances("capacitance", capacitance, (len(L),))
    between = _capacitances("mutual_capacitance", mutual_capacitance, L.shape)
    between = between - np.diag(np.diag(between))
    C = C - between.sum(axis=1) / 6
    k = coupling_matrix(L)
    heading = " ".join(title.split())
    subcircuit = plain_names([heading or "coilarray"])[0]
    lines = [
        f"* {heading or 'coilarray'}: {len(L)} coil{'s' * (len(L) > 1)}; H, ohm, F",
        *(f"* {' '.join(comment.split())}" for comment in comments),
        " ".join([".subckt", subcircuit, *(f"{coil}_{pin}" for coil in coils for pin in (1, 2))]),
    ]
    ladders = sections or [()] * len(L)
    stem = "s"  # of the sections' names; no coil's name begins with it
    while any(coil.lower().startswith(stem) for coil in coils):
        stem += "s"
    own = zip(coils, np.diag(L).tolist(), R.tolist(), C.tolist(), ladders, strict=True)
    for number, (coil, L_own, R_own, C_own, ladder) in enumerate(own, start=1):
        parts = [[(f"L{coil}", L_own)], *([(f"R{coil}", R_own)] for _ in range(bool(R_own)))]
        parts += [
            [(f"{letter}{stem}{number}_{k}", value) for letter, value in zip("RL", pair, strict=True)]
            for k, pair in enumerate(ladder, start=1)
        ]
        inner = [f"{coil}_m", *(f"{coil}_m{k}" for k in range(2, len(parts)))][: len(parts) - 1]
        for part, nodes in zip(parts, itertools.pairwise([f"{coil}_1", *inner, f"{coil}_2"]), strict=True):
            lines += [f"{name} {' '.join(nodes)} {value:.16e}" for name, value in part]
        if C_own:
            lines.append(f"C{coil} {coil}_1 {coil}_2 {C_own:.16e}")
    for i, j in itertools.combinations(range(len(L)), 2):
        lines.append(f"K{i + 1}_{j + 1} L{coils[i]} L{coils[j]} {k[i, j]:.16e}")
    for i, j in np.argwhere(np.triu(between)).tolist():
        for a, b in itertools.product((1, 2), (1, 2)):
            lines.append(f"C{i + 1}_{j + 1}_{a}{b} {coils[i]}_{a} {coils[j]}_{b} {between[i, j] / 4:.16e}")
    return "\n".join([*lines, f".ends {subcircuit}", ""])


def _capacitances(name: str, given: npt.ArrayLike | None, shape: tuple[int, ...]) -> FloatArray:
    """Check capacitances and broadcast them to a shape."""
    C = np.asarray(0.0 if given is None else given, dtype=np.float64)
    if C.shape not in ((), shape):
        raise ValueError(f"{name} must be one number or {' × '.join(map(str, shape))}; got shape {C.shape}.")
    if not (np.isfinite(C).all() and (C >= 0).all()):
        raise ValueError(f"values of {name} must be finite and not negative; got {C.min()} F.")
    if C.ndim == 2 and not np.array_equal(C, C.T):
        raise ValueError(f"{name} must be symmetric.")
    return np.broadcast_to(C, shape)
