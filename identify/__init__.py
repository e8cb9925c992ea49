"""Identification methods, their metrics and scores. `from identify import list_methods, fit, score, compare`."""

from typing import TYPE_CHECKING

from excite.lazy import face

if TYPE_CHECKING:
    from identify.compare import compare
    from identify.fit import fit
    from identify.registry import list_methods, load_method
    from identify.score import score

__all__ = ["compare", "fit", "list_methods", "load_method", "score"]
__getattr__, __dir__ = face(
    __name__,
    {
        "compare": "identify.compare",
        "fit": "identify.fit",
        "list_methods": "identify.registry",
        "load_method": "identify.registry",
        "score": "identify.score",
    },
)
