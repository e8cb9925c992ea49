"""Choosing among the rows of a view."""

from collections.abc import Mapping

import numpy as np

from identify.estimate import Estimate
from scenarios.run.results import Row, ViewResult
from scenarios.scenario.spec import statistics

MOST_METHODS = 6  # so many lines can be told apart in one figure
DIVERGED = -100.0  # %, unclipped fit of a simulation that leaves the range of the data


def spread(row: Row, metric: str) -> Mapping[str, float]:
    """Return median, quartiles, … of a metric over the runs; NaN where it is absent."""
    if metric in row.summary:
        return row.summary[metric]
    return statistics([s.values.get(metric, np.nan) for s in row.scores])


def first_estimate(row: Row) -> Estimate | None:
    """Return the estimate of the first run that gave one."""
    return next((e for e in row.estimates if e is not None), None)


def diverging(row: Row) -> int:
    """Return in how many runs the simulation leaves the range of the validation data."""
    return sum(s.values.get("fit_simulation_unclipped", 0.0) < DIVERGED for s in row.scores)


def best_rows(view: ViewResult) -> list[Row]:
    """Return the best row of each method that gave a model, best first, at most MOST_METHODS."""
    best: dict[str, Row] = {}
    for row in view.rows:
        if first_estimate(row) is not None:
            best.setdefault(row.method, row)
    return list(best.values())[:MOST_METHODS]


def sound(view: ViewResult) -> list[Row]:
    """Return the rows that gave a model in every run and are consistent for the loop the data come from, best first."""
    closed = view.spec.roles.closed
    return [row for row in view.rows if row.reason is None and (row.closed_loop or not closed)]


def trusted(view: ViewResult) -> Row | None:
    """Return the best sound row; failing that, the best that gave a model."""
    return next(iter([*sound(view), *(row for row in view.rows if row.reason is None)]), None)
