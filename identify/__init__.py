"""Identification methods, their metrics and scores. `from identify import list_methods, fit, score, compare`."""

from identify.fit import fit
from identify.registry import list_methods, load_method
from identify.score import score

__all__ = ["fit", "list_methods", "load_method", "score"]
