"""The figures of a run, and their files: what is drawn stands in the rooms whose objects are drawn."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from excite.figures.colours import palette
from excite.figures.csv import to_csv
from excite.figures.figure import Figure
from excite.figures.json import to_json
from excite.figures.signal import signal_figure
from excite.figures.svg import to_svg
from identify.figures.registry import figure_names, figures_of
from scenarios.run.executor import Executor
from scenarios.run.results import RunResult
from scenarios.run.store import write_text


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure with its picture."""

    figure: Figure
    svg: str


def stems(result: RunResult) -> tuple[str, ...]:
    """Return a distinct, file-safe name for each view."""
    names: list[str] = []
    for view in result.views:
        base = name = _safe(view.name)[:60] or "view"
        count = 2
        while name.casefold() in [n.casefold() for n in names]:
            name, count = f"{base}_{count}", count + 1
        names.append(name)
    return tuple(names)


def _safe(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name)


def of_view(stem: str) -> list[str]:
    """Return the stems that the figures of one view have, whether or not its data allow them, in their order."""
    return [f"{stem}-{_safe(name)}" for name in figure_names()]


def all_figures(result: RunResult) -> dict[str, Figure]:
    """Return every figure of a run that its data allow, by file stem: "excitation", "<view>-poles", …"""
    comparisons = [view.comparison for view in result.views]
    colours = palette(row.label for comparison in comparisons for row in comparison.rows)
    figures = {"excitation": signal_figure(result.signal, panels=("time", "spectrum"), windowed=True)}
    for stem, comparison in zip(stems(result), comparisons, strict=True):
        found = figures_of(comparison, colours)
        figures |= {f"{stem}-{_safe(name)}": figure for name, figure in found.items()}
    return figures


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure to be drawn into a folder: a piece for an executor."""

    name: str
    figure: Figure

    def make(self, folder: str) -> None:
        """Write the picture (.svg), and the data beside it (.json, .csv)."""
        for suffix, write in ((".svg", to_svg), (".json", to_json), (".csv", to_csv)):
            write_text(Path(folder) / f"{self.name}{suffix}", write(self.figure))


def write_figures(figures: Mapping[str, Figure], folder: Path, executor: Executor) -> dict[str, Drawn]:
    """Draw figures into a folder, several at once where the executor can, and return them with their pictures."""
    pictures = [Picture(name, figure) for name, figure in figures.items()]
    with executor.each(str(folder), len(pictures)) as each:
        for _ in each(pictures):
            pass
    return {name: Drawn(each, (folder / f"{name}.svg").read_text(encoding="utf-8")) for name, each in figures.items()}
