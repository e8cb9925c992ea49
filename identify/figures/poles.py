"""Poles of truth and estimates in the s-plane."""

import numpy as np

from excite.figures.colours import Role
from excite.figures.figure import Axis, Figure, Line, Mark, Panel, Points, Range, Rule, Text
from excite.models.model import Dynamic
from excite.words import joined, number
from identify.compare import Comparison, Row
from identify.figures.rows import best_rows, colours, estimates, median, s_plane, title, true_poles
from identify.metrics.poles import INTEGRATOR

CAPTION = (
    "Poles of the truth (crosses) and of every run's estimate (dots) for the best order of each method, with rays of "
    "constant damping ratio ζ. The dotted frame on the left is the view on the right."
)
Window = tuple[Range, Range]


def poles(comparison: Comparison) -> Figure | None:
    """Return truth and estimates (all runs) in the s-plane, s = log(z) / dt, upper half; beside it the slow ones."""
    rows, truth, dt = best_rows(comparison, Dynamic), true_poles(comparison), comparison.dt
    if dt is None or (truth is None and not rows):
        return None
    leading = s_plane(estimates(rows[0])[0].model) if truth is None else truth
    found = {title(row): (row, _upper(_of_runs(row))) for row in rows}
    windows = {f"poles of {'the truth' if truth is not None else title(rows[0])}": _window(leading, dt)}
    slow = _slow(leading, dt)
    if slow.size:
        windows["the slow ones"] = _window(slow, dt, np.abs(leading), room=0.5)
    panels = []
    for column, (name, (x, y)) in enumerate(windows.items()):
        marks: list[Mark] = [Rule(x=0.0, colour=Role.AXIS, width=0.8)]
        if (leading.imag[(leading.real > x[0]) & (leading.imag < y[1])] > 0).any():
            marks += _damping_lines(x, y)
        outside = 0
        for label, (row, s) in reversed(found.items()):
            inside = (s.real > x[0]) & (s.real < x[1]) & (s.imag < y[1])
            outside += int((~inside).sum())
            s = s[inside]
            marks.append(Points(s.real, s.imag, size=4.5, alpha=0.6, label=label, colour=row.label))
        if truth is not None:
            s = _upper(leading)
            marks.append(Points(s.real, s.imag, marker="cross", size=8, width=1.4, label="truth", colour=Role.TRUTH))
        if column == 0 and slow.size:
            marks.append(_frame(windows["the slow ones"], y[0]))
        note = f" ({outside} estimated ones outside)" if outside and column == 0 else ""
        axes = Axis("real part", "rad/s", limits=x), Axis("imaginary part", "rad/s", limits=y)
        panels.append(Panel(marks, *axes, name + note, column=column))
    return Figure(
        name="poles",
        title=f"{comparison.name}: poles in the s-plane (upper half), all runs",
        panels=panels,
        caption=CAPTION,
        verdict=_verdict(rows, comparison),
        height=4.2,
        colours=colours(comparison),
    )


def _of_runs(row: Row) -> np.ndarray:
    return np.concatenate([s_plane(estimate.model) for estimate in estimates(row)])


def _verdict(rows: list[Row], comparison: Comparison) -> str:
    """Say how far each row's worst pole is off, or what the best row's least damped pole is where no truth is known."""
    if true_poles(comparison) is not None:
        errors = {title(row): 100 * median(row, "pole_error_max") for row in rows}
        told = [f"{number(error)} % for {name}" for name, error in errors.items() if np.isfinite(error)]
        return f"The worst pole is off by {joined(told)}." if told else "No estimate has poles to compare."
    s = _upper(s_plane(estimates(rows[0])[0].model))
    moving = s[np.abs(s) * comparison.dt > INTEGRATOR]
    if not moving.size:
        return f"No truth is known; {title(rows[0])} only integrates or delays."
    damping = -moving.real / np.abs(moving)
    p = moving[np.argmin(damping)]
    where = f"{number(abs(p) / (2 * np.pi))} Hz with ζ {number(damping.min())}"
    return f"No truth is known; the least damped pole of {title(rows[0])} lies at {where}."


def _upper(s: np.ndarray) -> np.ndarray:
    return s[s.imag > -1e-9 * np.maximum(np.abs(s), 1)]


def _slow(s: np.ndarray, dt: float) -> np.ndarray:
    """Return the poles below the widest gap in |s| when it is wider than a factor 2.5, else none."""
    size = np.abs(s)
    order = np.argsort(size)
    moving = size[size * dt > INTEGRATOR]
    if not moving.size:
        return s[:0]
    ratios = np.diff(np.log(np.maximum(size[order], 0.02 * moving.min())))
    if not ratios.size or ratios.max() < np.log(2.5):
        return s[:0]
    return s[order[: int(np.argmax(ratios)) + 1]]


def _window(s: np.ndarray, dt: float, among: np.ndarray | None = None, room: float = 0.15) -> Window:
    """Return ranges of real and imaginary part around poles; deadbeat ones left out, integrators given room."""
    s = s[np.abs(s) * dt < 10]
    reach = np.abs(s).max(initial=0.0)
    if reach * dt <= INTEGRATOR:
        others = np.abs(s if among is None else among)
        reach = 0.2 * others[others * dt > INTEGRATOR].min(initial=1.0 / dt)
    left, right = min(s.real.min(initial=0.0), -0.25 * reach), max(s.real.max(initial=0.0), 0.0)
    top = max(s.imag.max(initial=0.0), 0.35 * reach)
    width = right - left
    return (left - room * width, right + 0.8 * room * width), (-0.06 * top, 1.15 * top)


def _frame(window: Window, bottom: float) -> Line:
    """Outline of the second view in the first."""
    (left, right), (_, top) = window
    return Line([left, left, right, right], [bottom, top, top, bottom], width=0.7, style="dotted", colour=Role.NOTE)


def _damping_lines(x: Range, y: Range) -> list[Mark]:
    """Rays of constant damping ratio, labelled where they leave the view."""
    marks: list[Mark] = []
    labelled = np.inf
    for zeta in (0.1, 0.2, 0.4, 0.6, 0.8, 0.95):
        run, rise = -zeta, np.sqrt(1 - zeta**2)
        reach = min(x[0] / run, y[1] / rise)
        marks.append(Line([0, reach * run], [0, reach * rise], width=0.7, colour=Role.GUIDE))
        place = 0.93 * reach * run, 0.93 * reach * rise
        around = place[1] / y[1] + place[0] / x[0] * (-1 if reach * rise > 0.99 * y[1] else 1)
        if abs(labelled - around) > 0.08:
            marks.append(Text(*place, f"ζ {zeta:g}", size=6.5, across="center", colour=Role.NOTE))
            labelled = around
    return marks
