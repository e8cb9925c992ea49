"""Choosing among the rows of a comparison."""

from identify.compare import Comparison, Row
from identify.estimate import Estimate

DIVERGED = -100.0  # %, unclipped fit of a simulation that leaves the range of the data


def first_estimate(row: Row) -> Estimate | None:
    """Return the estimate of the first trial that gave one."""
    return next(iter(row.estimates), None)


def diverging(row: Row) -> int:
    """Return in how many trials the simulation leaves the range of the validation data."""
    return sum(score.values.get("fit_simulation_unclipped", 0.0) < DIVERGED for score in row.scores)


def sound(found: Comparison) -> list[Row]:
    """Return the rows that gave a model in every trial and are consistent for the loop the data come from, best first."""
    consistent = (row for row in found.rows if row.consistent_in_closed_loop or not found.closed)
    return [row for row in consistent if row.reason is None]


def trusted(found: Comparison) -> Row | None:
    """Return the best sound row; failing that, the best that gave a model."""
    return next(iter([*sound(found), *(row for row in found.rows if row.reason is None)]), None)
