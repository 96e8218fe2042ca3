"""Quantities of a design by name."""

from coilarray.studies.quantities.catalogue import QUANTITIES, canonical, evaluate, request
from coilarray.studies.quantities.evaluation import Evaluation, Option, Quantity, Request

__all__ = ["QUANTITIES", "Evaluation", "Option", "Quantity", "Request", "canonical", "evaluate", "request"]
