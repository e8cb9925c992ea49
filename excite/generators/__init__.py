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
from excite.limits import Limits
from excite.shaping import shape
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


def regenerate(recipe: Mapping) -> Signal:
    """Return the signal that a recipe describes, bit for bit; the recipes inside a composition first, shaping last.

    A parameter that the recipe does not name, because it was written before there was one, keeps its default. Raises
    ExciteError when the recipe's kind is unknown, or a parameter without default is missing.
    """
    kind, known = str(recipe.get("kind")), {**GENERATORS, **COMPOSITIONS}
    if kind not in known:
        raise ExciteError(f"recipe: kind: '{kind}'; {did_you_mean(kind, known)}")
    parameters = inspect.signature(known[kind]).parameters.values()
    missing = [p.name for p in parameters if p.default is p.empty and p.name not in recipe]
    if missing:
        raise ExciteError(f"recipe: {kind}: {', '.join(missing)} missing; the recipe must hold every parameter")
    given = {p.name: recipe[p.name] for p in parameters if p.name in recipe}
    for name in {"signals", "signal"} & given.keys():
        given[name] = _parts(given[name], f"recipe: {name}")
    signal, shaped = known[kind](**given), recipe.get("shaped")
    if shaped is None:
        return signal
    return shape(signal, Limits.from_dict(shaped["limits"]), shaped.get("band_hz")).signal


def _parts(recipes: Mapping | Sequence[Mapping], place: str) -> Signal | list[Signal]:
    if not isinstance(recipes, Mapping):
        return [_parts(recipe, f"{place}[{i}]") for i, recipe in enumerate(recipes)]
    with placed(place):
        return regenerate(recipes)
