"""All quantities by name, and their values for a design."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import GoalError, listed, shown
from coilarray.studies.quantities.coils import COILS
from coilarray.studies.quantities.evaluation import Evaluation
from coilarray.studies.quantities.quantity import Quantity, Request
from coilarray.studies.quantities.responses import RESPONSES

QUANTITIES: Mapping[str, Quantity] = MappingProxyType({one.name: one for one in (*COILS, *RESPONSES)})
"""Every quantity by its name, the cheap quantities first."""
_TEXT = re.compile(r"([^\[\]]*)(?:\[([^\[\]]*)\])?")


def request(asked: str | Mapping[str, Any]) -> Request:
    """Read a quantity with options from a text or table.

    Missing coils of a design are found when it is evaluated.

    >>> request({"quantity": "k", "coils": ["coil1", "coil2"]}).key
    'k[coil1,coil2]'
    >>> request("position_error_mm[noise=0.00001,depth_mm=1.0]").key
    'position_error_mm[depth_mm=1,noise=1e-05]'
    """
    if isinstance(asked, Mapping):
        options = dict(asked)
        name = options.pop("quantity", None)
        return _quantity(name).asked(options)
    if not isinstance(asked, str) or (found := _TEXT.fullmatch(asked.strip())) is None:
        raise GoalError(f"a quantity must be a name, with options in brackets, such as k[coil1,coil2]; got {asked!r}.")
    quantity = _quantity(found[1].strip())
    return quantity.asked({} if found[2] is None else _options(quantity, found[2]))


def canonical(asked: str | Mapping[str, Any]) -> str:
    """Canonical text of a request, the key of `evaluate`."""
    return request(asked).key


def evaluate(
    design: Design, asked: Iterable[str | Mapping[str, Any]], *, accuracy: Accuracy = "full"
) -> dict[str, float]:
    """Compute quantities of a design by key, always finite.

    >>> from coilarray import load_design
    >>> found = evaluate(load_design("gast2020"), ["worst_k", "k[coil1,coil3]", "span_mm"])
    >>> {key: round(value, 3) for key, value in found.items()}
    {'worst_k': 0.081, 'k[coil1,coil3]': -0.027, 'span_mm': 89.4}
    """
    requests = [request(one) for one in asked]
    evaluation = Evaluation(design, accuracy)
    return {one.key: one.value(evaluation) for one in requests}


def _quantity(name: object) -> Quantity:
    """Quantity of a name, or GoalError with a hint."""
    if isinstance(name, str) and name in QUANTITIES:
        return QUANTITIES[name]
    if not name:
        raise GoalError(f"the name of a quantity is missing; there are {listed(QUANTITIES)}.")
    meant = _meant(str(name))
    hint = f"; did you mean {', '.join(meant)}?" if meant else "."
    known = f"coilarray optimize --list-quantities shows all {len(QUANTITIES)}."
    raise GoalError(f"there is no quantity {shown(name)}{hint} {known}")


_SYMBOLS = {"L": "inductance_uH", "f": "frequency_MHz", "R": "effective_resistance_ohm", "δ": "peak_delta"}
"""Quantities by their letters in reports, for hints."""


def _meant(name: str) -> list[str]:
    """Quantities with a similar name."""
    if name in _SYMBOLS:
        return [_SYMBOLS[name]]
    text = name.casefold()
    within = [key for key in QUANTITIES if text == key.casefold() or (len(text) > 2 and text in key.casefold())]
    close = within or difflib.get_close_matches(text, list(QUANTITIES), n=1)
    return sorted(close, key=lambda key: (key.startswith("target_"), len(key)))[:3]


def _options(quantity: Quantity, text: str) -> dict[str, Any]:
    """Options of the text in brackets, the bare without name."""
    options: dict[str, Any] = {}
    nameless: list[str] = []
    for part in (part.strip() for part in text.split(",")):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            nameless.append(part)
        elif name in options:
            raise GoalError(f"{quantity.name}: {name} must be given once; got {text!r}.")
        else:
            options[name] = value
    bare = [option.name for option in quantity.options if option.bare]
    if nameless:
        if not bare or bare[0] in options:
            raise GoalError(f"{quantity.name}: options must be given as name=value; got {nameless[0]!r}.")
        options[bare[0]] = nameless if len(nameless) > 1 else nameless[0]
    return options
