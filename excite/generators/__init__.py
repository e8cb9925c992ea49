"""Generators: functions that return a Signal; one line in the table adds one everywhere."""

import inspect
from collections.abc import Callable, Mapping

from excite.errors import ExciteError, did_you_mean
from excite.generators.prbs import prbs
from excite.types.signal import Signal

GENERATORS: dict[str, Callable[..., Signal]] = {"prbs": prbs}

__all__ = ["GENERATORS", "prbs", "regenerate"]


def regenerate(recipe: Mapping) -> Signal:
    """Return the signal that a recipe describes, bit for bit.

    Raises ExciteError when the recipe's kind is unknown or one of its parameters is missing.
    """
    kind = str(recipe.get("kind"))
    if kind not in GENERATORS:
        raise ExciteError(f"recipe: kind: '{kind}'; {did_you_mean(kind, GENERATORS)}")
    names = inspect.signature(GENERATORS[kind]).parameters
    missing = [name for name in names if name not in recipe]
    if missing:
        raise ExciteError(f"recipe: {kind}: {', '.join(missing)} missing; the recipe must hold every parameter")
    return GENERATORS[kind](**{name: recipe[name] for name in names})
