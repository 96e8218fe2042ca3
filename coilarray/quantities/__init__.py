"""Quantities of a design by name: what goals, sweeps and tolerances speak of."""

from __future__ import annotations

from coilarray.quantities.catalogue import QUANTITIES, canonical, evaluate, request
from coilarray.quantities.evaluation import Evaluation
from coilarray.quantities.quantity import Option, Quantity, Request

__all__ = ["QUANTITIES", "Evaluation", "Option", "Quantity", "Request", "canonical", "evaluate", "request"]
