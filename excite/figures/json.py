"""A figure as strict JSON, for a page in a browser: everything it is made of, with the colours resolved."""

import json
from dataclasses import fields
from typing import Any

from excite.figures.colours import Role
from excite.figures.figure import Axis, Figure, Mark, Panel
from excite.plain import plain

SCHEMA_VERSION = 1


def to_json(figure: Figure) -> str:
    """Return the figure as one strict JSON object; numbers that are not finite become null."""
    return json.dumps(to_dict(figure), allow_nan=False, ensure_ascii=False) + "\n"


def to_dict(figure: Figure) -> dict[str, Any]:
    """Return the figure as plain values.

    Each mark names its kind ("line", "points", …), its colour "#rrggbb", and beside it what the colour stands for: a
    role ("truth", "measured", …) or a label.
    """
    rows, columns = figure.grid
    return {
        "schema_version": SCHEMA_VERSION,
        "kind": "figure",
        "name": figure.name,
        "title": figure.title,
        "caption": figure.caption,
        "verdict": figure.verdict,
        "grid": {"rows": rows, "columns": columns, "widths": figure.widths, "heights": figure.heights},
        "height": plain(figure.height),
        "panels": [_panel(panel, figure) for panel in figure.panels],
    }


def _panel(panel: Panel, figure: Figure) -> dict[str, Any]:
    rest = {key: getattr(panel, key) for key in ("title", "row", "column", "rows", "columns", "legend")}
    return {**rest, "x": _axis(panel.x), "y": _axis(panel.y), "marks": [_mark(mark, figure) for mark in panel.marks]}


def _axis(axis: Axis) -> dict[str, Any]:
    return {f.name: plain(getattr(axis, f.name)) for f in fields(axis)}


def _mark(mark: Mark, figure: Figure) -> dict[str, Any]:
    values = {f.name: plain(getattr(mark, f.name)) for f in fields(mark) if f.name != "colour"}
    stands_for = {"role": mark.colour.name.lower()} if isinstance(mark.colour, Role) else {"of": mark.colour}
    return {"mark": type(mark).__name__.lower(), "colour": figure.colour(mark.colour), **stands_for, **values}
