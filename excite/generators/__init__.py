"""Generators: functions that return a Signal; one line in the table adds one everywhere."""

import inspect
from collections.abc import Callable, Mapping, Sequence

from excite.errors import ExciteError, did_you_mean, placed
from excite.generators.compose import COMPOSITIONS, in_sequence, rest, side_by_side, with_ramps
from excite.generators.multisine import multisine
from excite.generators.multistep import log_times, multistep
from excite.generators.noise import noise
from excite.generators.prbs import prbs
from excite.generators.sweep import sweep
from excite.limits.limits import Limits
from excite.limits.shaping import shape
from excite.types.recipe import Recipe
from excite.types.signal import Signal

GENERATORS: dict[str, Callable[..., Signal]] = {
    "prbs": prbs,
    "noise": noise,
    "multisine": multisine,
    "sweep": sweep,
    "multistep": multistep,
}

__all__ = [
    "GENERATORS",
    "in_sequence",
    "log_times",
    "multisine",
    "multistep",
    "noise",
    "prbs",
    "regenerate",
    "rest",
    "side_by_side",
    "sweep",
    "with_ramps",
]


def regenerate(recipe: Recipe | Mapping) -> Signal:
    """Return the signal that a recipe describes, bit for bit; the recipes inside a composition first, shaping last.

    A parameter that the recipe does not name, because it was written before there was one, keeps its default. Raises
    ExciteError when the recipe's kind is unknown, or a parameter without default is missing.
    """
    recipe, known = recipe if isinstance(recipe, Recipe) else Recipe.from_dict(recipe), {**GENERATORS, **COMPOSITIONS}
    kind, held = recipe.kind, recipe.parameters
    if kind not in known:
        raise ExciteError(f"recipe: kind: '{kind}'; {did_you_mean(kind, known)}")
    parameters = inspect.signature(known[kind]).parameters.values()
    missing = [p.name for p in parameters if p.default is p.empty and p.name not in held]
    if missing:
        raise ExciteError(f"recipe: {kind}: {', '.join(missing)} missing; the recipe must hold every parameter")
    given = {p.name: held[p.name] for p in parameters if p.name in held}
    for name in {"signals", "signal"} & given.keys():
        given[name] = _parts(given[name], f"recipe: {name}")
    signal, shaped = known[kind](**given), recipe.shaped
    if shaped is None:
        return signal
    return shape(signal, Limits.from_dict(shaped["limits"]), shaped.get("band_hz")).signal


def _parts(recipes: Recipe | Sequence[Recipe] | None, place: str) -> Signal | list[Signal]:
    if isinstance(recipes, (list, tuple)):
        return [_parts(recipe, f"{place}[{i}]") for i, recipe in enumerate(recipes)]
    if recipes is None:
        raise ExciteError(f"{place}: this part was not made by a generator; design it again")
    with placed(place):
        return regenerate(recipes)
