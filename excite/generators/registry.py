"""The table of all generators, ours and those of installed packages (entry points `excite.generators`)."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from excite.errors import ExciteError, did_you_mean, placed
from excite.generators.compose import COMPOSITIONS
from excite.limits.limits import Limits
from excite.limits.shaping import shape
from excite.registry import Registry
from excite.types.recipe import Recipe
from excite.types.signal import Signal

Generator = Callable[..., Signal]
GIVEN = ("dt", "channels", "seed")  # what a scenario gives every generator, or reads of it


def _accepts(function: Any) -> str | None:
    """Return why something in an entry point is no generator, or None."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return "it is no function; give one that returns a Signal"
    returned = signature.return_annotation
    if returned is not Signal and str(returned).rpartition(".")[2] != "Signal":
        return "it does not say that it returns a Signal; annotate it with -> Signal"
    for name in GIVEN:
        if name not in signature.parameters:
            return f"it has no parameter '{name}'; every generator takes {', '.join(GIVEN)}"
    for name, parameter in signature.parameters.items():
        if parameter.annotation is parameter.empty:
            return f"its parameter '{name}' has no annotation; files and command line read the type from there"
        if parameter.kind not in (parameter.KEYWORD_ONLY, parameter.POSITIONAL_OR_KEYWORD):
            return f"its parameter '{name}' cannot be given by name; make it a keyword"
    return None


# One line adds a generator: name -> "module:function". It returns a Signal; its annotated parameters are the keys of a
# scenario's [excitation] and the options of the command line.
GENERATORS: Registry[Generator] = Registry(
    "generator",
    {
        "prbs": "excite.generators.prbs:prbs",
        "noise": "excite.generators.noise:noise",
        "multisine": "excite.generators.multisine:multisine",
        "sweep": "excite.generators.sweep:sweep",
        "multistep": "excite.generators.multistep:multistep",
    },
    _accepts,
)


def regenerate(recipe: Recipe | Mapping, made_by: Generator | None = None) -> Signal:
    """Return the signal that a recipe describes, bit for bit; the recipes inside a composition first, shaping last.

    A parameter that the recipe does not name, because it was written before there was one, keeps its default.

    Parameters
    ----------
    recipe : of a signal, or its plain values as a file holds them.
    made_by : the generator, where it is not in the table.

    Raises
    ------
    ExciteError when the recipe's kind is unknown (a plug-in that is not installed), or a parameter without default is
    missing.
    """
    recipe = recipe if isinstance(recipe, Recipe) else Recipe.from_dict(recipe)
    made_by, held = made_by or _maker(recipe.kind), recipe.parameters
    parameters = inspect.signature(made_by).parameters.values()
    missing = [p.name for p in parameters if p.default is p.empty and p.name not in held]
    if missing:
        raise ExciteError(f"recipe: {recipe.kind}: {', '.join(missing)} missing; the recipe must hold every parameter")
    given = {p.name: held[p.name] for p in parameters if p.name in held}
    for name in {"signals", "signal"} & given.keys():
        given[name] = _parts(given[name], f"recipe: {name}")
    signal, shaped = made_by(**given), recipe.shaped
    if shaped is None:
        return signal
    return shape(signal, Limits.from_dict(shaped["limits"]), shaped.get("band_hz")).signal


def _maker(kind: str) -> Generator:
    """Return the generator or composition of a recipe's kind: the name of the function, or its name in the table."""
    if kind in COMPOSITIONS:
        return COMPOSITIONS[kind]
    if kind in GENERATORS:
        return GENERATORS[kind]
    for generator in map(GENERATORS.__getitem__, GENERATORS):
        if generator.__name__ == kind:
            return generator
    raise ExciteError(f"recipe: kind: '{kind}'; {did_you_mean(kind, [*GENERATORS, *COMPOSITIONS])}")


def _parts(recipes: Recipe | Sequence[Recipe] | None, place: str) -> Signal | list:
    if isinstance(recipes, Sequence):
        return [_parts(recipe, f"{place}[{i}]") for i, recipe in enumerate(recipes)]
    if recipes is None:
        raise ExciteError(f"{place}: this part was not made by a generator; design it again")
    with placed(place):
        return regenerate(recipes)
