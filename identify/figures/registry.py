"""The figures of a comparison: one line each; installed packages add theirs by entry points of group excite.figures."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from excite.errors import in_words
from excite.figures.colours import Role
from excite.figures.csv import to_csv
from excite.figures.figure import Axis, Figure, Panel, Text
from excite.figures.json import to_json
from excite.figures.svg import to_svg
from excite.registry import Registry
from identify.compare import Comparison

Draw = Callable[[Comparison], Figure | None]  # None where the data do not allow the figure

FIGURES: Registry[Draw] = Registry(
    "figure",
    {
        "ranking": "identify.figures.ranking:ranking",
        "poles": "identify.figures.poles:poles",
        "bode": "identify.figures.bode:bode",
        "outputs": "identify.figures.outputs:outputs",
        "singular-values": "identify.figures.singular_values:singular_values",
    },
    accepts=lambda draw: None if callable(draw) else "it is not a function from a Comparison to a Figure or None",
)


def figure_names() -> list[str]:
    """Return the names of all figures: ours in their order, then those of plug-ins."""
    return [*FIGURES.ours, *(name for name in FIGURES if name not in FIGURES.ours)]


def figures_of(comparison: Comparison, colours: Mapping[str, str] | None = None) -> dict[str, Figure]:
    """Return every registered figure that a comparison allows, by name, in the order of `figure_names`.

    Parameters
    ----------
    colours : label -> "#rrggbb", where labels look alike in several comparisons; else each label of this one has its own.
    """
    found = {}
    for name in figure_names():
        figure = _drawn(name, comparison)
        if figure is not None:
            found[name] = replace(figure, name=name, colours={**figure.colours, **(colours or {})})
    return found


def _drawn(name: str, comparison: Comparison) -> Figure | None:
    """Draw one figure; that of a plug-in shows, where it fails, why, and takes nothing else with it."""
    draw = FIGURES[name]
    if name in FIGURES.ours:
        return draw(comparison)
    try:
        figure = draw(comparison)
        if figure is None:
            return None
        if isinstance(figure, Figure):
            for render in (to_svg, to_json, to_csv):  # what cannot be shown is found here
                render(figure)
            return figure
        reason = f"it returned a {type(figure).__name__}, not a Figure"
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plug-in may raise anything, an exit among it
        reason = in_words(error)
    said = f"{name} could not be drawn: {reason}"
    note = Text(0.5, 0.5, reason, frame="panel", across="center", colour=Role.NOTE)
    panel = Panel((note,), Axis(ticks=()), Axis(ticks=()))
    return Figure(name, f"{comparison.name}: {name} could not be drawn", (panel,), verdict=f"{said}.", height=1.5)
