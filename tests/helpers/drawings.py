"""What every figure must stand: the three renderers tell the same, labelled and with units."""

import csv
import io
import json
import xml.etree.ElementTree as ET

import numpy as np

from excite.figures.csv import HEADER, to_csv
from excite.figures.figure import COLUMNS, Figure
from excite.figures.json import to_json
from excite.figures.svg import to_svg

SVG = "{http://www.w3.org/2000/svg}"
BRACKETS = "[", "]"


def strict(text):
    """JSON read by its grammar alone: NaN and Infinity are refused."""

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


def words(svg):
    """All text elements of an SVG."""
    return ["".join(text.itertext()) for text in ET.fromstring(svg).iter(f"{SVG}text")]


def table(text):
    """Rows of a CSV as dictionaries."""
    rows = list(csv.reader(io.StringIO(text)))
    assert tuple(rows[0]) == HEADER and all(len(row) == len(HEADER) for row in rows)
    return [dict(zip(HEADER, row, strict=True)) for row in rows[1:]]


def check_figure(figure, most=300_000):
    """Assert that a figure is told alike by SVG, JSON and CSV, that its axes have units, and that it says something."""
    assert isinstance(figure, Figure)
    assert figure.caption and figure.verdict.endswith(".") and "nan" not in figure.verdict
    check_axes(figure)
    svg = to_svg(figure)
    assert len(svg.encode()) < most and ET.fromstring(svg).tag == f"{SVG}svg"
    drawn = words(svg)
    for panel in figure.panels:
        for axis in (panel.x, panel.y):
            assert axis.shared or not axis.text or axis.text in drawn, axis.text
    check_numbers(figure)


def check_axes(figure):
    for panel in figure.panels:
        for axis in (panel.x, panel.y):
            places = axis.ticks is not None  # a list of names, or a panel with nothing but a note
            assert places or all(bracket in axis.text for bracket in BRACKETS), (figure.name, panel.title, axis)


def check_numbers(figure):
    told, rows = strict(to_json(figure)), iter(table(to_csv(figure)))
    assert len(told["panels"]) == len(figure.panels)
    for panel, drawn in zip(figure.panels, told["panels"], strict=True):
        assert (drawn["x"]["label"], drawn["x"]["unit"]) == (panel.x.label, panel.x.unit)
        assert len(drawn["marks"]) == len(panel.marks)
        for mark, plain in zip(panel.marks, drawn["marks"], strict=True):
            columns = mark.columns()
            count = max((np.size(values) for values in columns.values()), default=0)
            mine = [next(rows) for _ in range(count)]
            for name in COLUMNS:
                values = np.atleast_1d(columns.get(name, np.full(count, np.nan)))
                if name in columns:
                    given = np.array(np.atleast_1d(np.array(plain[name], object)), float)  # null becomes NaN
                    np.testing.assert_array_equal(given, np.where(np.isfinite(values), values, np.nan))
                cells = np.array([float(row[name]) if row[name] else np.nan for row in mine])
                np.testing.assert_array_equal(cells, np.where(np.isfinite(values), values, np.nan))
    assert next(rows, None) is None
