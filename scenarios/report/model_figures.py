"""Figures of the models themselves: poles in the s-plane and frequency response."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from excite.models.model import Model
from excite.models.modes import continuous_poles
from identify.metrics.frequency import default_band
from identify.metrics.poles import INTEGRATOR
from scenarios.report.drawing import (
    BAND,
    MOST_POINTS_FIGURE,
    MOST_RUNS,
    TRUTH,
    Colours,
    canvas,
    legend,
    log_scale,
    palette_of,
    plain,
    styled,
)
from scenarios.report.rows import best_rows, first_estimate
from scenarios.run.results import Row, ViewResult

Range = tuple[float, float]


@styled
def poles(view: ViewResult, palette: Colours | None = None) -> Figure | None:
    """Return truth and estimates (all runs) in the s-plane, s = log(z) / dt, upper half; beside it the slow ones."""
    palette, rows = palette or palette_of(view), best_rows(view)
    if view.truth is None and not rows:
        return None
    leading = first_estimate(rows[0]).model.poles() if view.truth is None else view.truth.poles
    true = continuous_poles(leading, view.dt)
    views = {f"poles of {'the truth' if view.truth is not None else rows[0].label}": _window(true, view.dt)}
    slow = _slow(true, view.dt)
    if slow.size:
        views["the slow ones"] = _window(slow, view.dt, np.abs(true), room=0.5)
    figure = canvas(4.2, f"{view.spec.name}: poles in the s-plane (upper half), all runs")
    axes = figure.subplots(1, len(views), squeeze=False)[0]
    found = {}
    for row in rows:
        of_runs = [e.model.poles() for e in row.estimates[:MOST_RUNS] if e is not None]
        found[row] = _upper(continuous_poles(np.concatenate(of_runs), view.dt))
    for axis, (name, (x, y)) in zip(axes, views.items(), strict=True):
        if (true.imag[(true.real > x[0]) & (true.imag < y[1])] > 0).any():
            _damping_lines(axis, x, y)
        outside = 0
        for row in reversed(rows):
            s = found[row]
            inside = (s.real > x[0]) & (s.real < x[1]) & (s.imag < y[1])
            outside += int((~inside).sum())
            colour, s = palette[row.method], s[inside]
            axis.plot(s.real, s.imag, "o", color=colour, ms=4.5, mew=0, alpha=0.6, label=plain(row.label))
        if view.truth is not None:
            axis.plot(_upper(true).real, _upper(true).imag, "x", color=TRUTH, ms=8, mew=1.4, label="truth")
        axis.set(xlim=x, ylim=y, xlabel="real part [rad/s]", ylabel="imaginary part [rad/s]")
        axis.axvline(0, color="#888888", lw=0.8)
        note = f" ({outside} estimated ones outside)" if outside and axis is axes[0] else ""
        axis.set_title(plain(name + note, 64))
    if len(views) > 1:
        (left, right), (_, top) = views["the slow ones"]
        frame = ([left, left, right, right], [axes[0].get_ylim()[0], top, top, axes[0].get_ylim()[0]])
        axes[0].plot(*frame, color="#777777", lw=0.7, ls=":")
    legend(figure, axes[0])
    return figure


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


def _window(s: np.ndarray, dt: float, among: np.ndarray | None = None, room: float = 0.15) -> tuple[Range, Range]:
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


def _damping_lines(axis: Axes, x: Range, y: Range) -> None:
    """Draw rays of constant damping ratio, labelled where they leave the view."""
    labelled = np.inf
    for zeta in (0.1, 0.2, 0.4, 0.6, 0.8, 0.95):
        run, rise = -zeta, np.sqrt(1 - zeta**2)
        reach = min(x[0] / run, y[1] / rise)
        axis.plot([0, reach * run], [0, reach * rise], color="#d4d4d4", lw=0.7, zorder=0.5)
        place = 0.93 * reach * run, 0.93 * reach * rise
        around = place[1] / y[1] + place[0] / x[0] * (-1 if reach * rise > 0.99 * y[1] else 1)
        if abs(labelled - around) > 0.08:
            axis.text(*place, f"ζ {zeta:g}", fontsize=6.5, color="#8a8a8a", ha="center", va="center", zorder=0.6)
            labelled = around


@styled
def bode(view: ViewResult, palette: Colours | None = None) -> Figure | None:
    """Return the magnitudes of the input-output pairs (all up to 3 x 3, else the diagonal) above the relative error.

    Magnitudes are of the first run. The error is the spectral norm of the difference over that of the truth, median and
    quartiles over the runs; the band of the score is shaded.
    """
    palette, rows = palette or palette_of(view), best_rows(view)
    if not rows:
        return None
    models = [first_estimate(row).model for row in rows]
    truth = None if view.truth is None else view.truth.model
    band = view.band_hz or (None if truth is None else default_band(view.truth.poles, view.dt))
    pairs = _pairs(len(models[0].outputs), len(models[0].inputs))
    nyquist = 0.5 / view.dt
    low = band[0] / 2 if band else nyquist / 1000
    lines = sum(map(len, pairs)) * (len(rows) + 1) + 3 * len(rows)
    f = _frequencies([m for m in (truth, *models) if m is not None], low, nyquist, MOST_POINTS_FIGURE // lines)
    G = None if truth is None else truth.frf(f)
    responses = [model.frf(f) for model in models]

    figure = canvas(0.9 + 1.55 * len(pairs) + (0 if G is None else 1.6), f"{view.spec.name}: frequency response")
    grid = figure.add_gridspec(len(pairs) + (G is not None), len(pairs[0]))
    for r, line in enumerate(pairs):
        limits = _decibel_limits(responses[0] if G is None else G, line)
        for c, (i, j) in enumerate(line):
            axis = figure.add_subplot(grid[r, c])
            for row, response in zip(reversed(rows), reversed(responses), strict=True):
                axis.plot(f, _decibel(response[:, i, j]), color=palette[row.method], label=plain(row.label))
            if G is not None:
                axis.plot(f, _decibel(G[:, i, j]), color=TRUTH, lw=1.6, ls=(0, (4, 2)), label="truth")
                if not np.abs(G[:, i, j]).any():
                    axis.text(0.97, 0.9, "truth: 0", transform=axis.transAxes, ha="right", va="top", color="#666666")
            axis.set_title(plain(f"{models[0].inputs[j]} → {models[0].outputs[i]}", 46), fontsize=7.5)
            _frequency_axis(axis, (low, nyquist), band)
            axis.set_ylim(limits)
            axis.tick_params(labelbottom=r == len(pairs) - 1, labelleft=c == 0)
            if c == 0:
                axis.set_ylabel("magnitude [dB]")
            if r == len(pairs) - 1 and G is None:
                axis.set_xlabel("frequency [Hz]")
    if G is not None:
        errors = [_error_quartiles(row, f, G) for row in rows]
        axis = figure.add_subplot(grid[-1, :])
        _frequency_axis(axis, (low, nyquist), band)
        _relative_errors(axis, f, errors, [palette[row.method] for row in rows])
    legend(figure, figure.axes[0])
    return figure


def _pairs(ny: int, nu: int) -> list[list[tuple[int, int]]]:
    """Rows of (output, input): every pair up to 3 x 3, else up to six of the diagonal."""
    if ny <= 3 and nu <= 3:
        return [[(i, j) for j in range(nu)] for i in range(ny)]
    diagonal = [(i, i) for i in range(min(ny, nu, 6))]
    return [diagonal] if len(diagonal) <= 3 else [diagonal[: len(diagonal) // 2], diagonal[len(diagonal) // 2 :]][:2]


def _frequency_axis(axis: Axes, limits: Range, band: Range | None) -> None:
    log_scale(axis, "x", *limits)
    if band:
        axis.axvspan(*band, color=BAND, lw=0, zorder=0, label="band of the score")


def _error_quartiles(row: Row, f: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Quartiles (3, F) over the runs of the relative error of the frequency response."""
    errors = [np.linalg.norm(e.model.frf(f) - G, 2, axis=(1, 2)) for e in row.estimates[:MOST_RUNS] if e is not None]
    return np.percentile(errors, [25, 50, 75], axis=0) / np.linalg.norm(G, 2, axis=(1, 2))


def _relative_errors(axis: Axes, f: np.ndarray, errors: Sequence[np.ndarray], colours: Sequence[str]) -> None:
    """Draw relative errors in %, quartiles (3, F) each, the best on top; the axis ends at 1000 %."""
    shown = 100 * np.clip(errors, 1e-12, 1e12)
    for (low, median, high), colour in reversed(list(zip(shown, colours, strict=True))):
        axis.fill_between(f, low, high, color=colour, alpha=0.2, lw=0)
        axis.plot(f, median, color=colour)
    bottom = max(np.percentile(shown, 1) / 2, 1e-8)
    log_scale(axis, "y", bottom, max(min(2 * shown.max(), 1e3), 10 * bottom))
    axis.set(xlabel="frequency [Hz]", ylabel="error [%]")
    axis.set_title(
        "relative error over all pairs, |Ĝ − G| / |G| (largest singular values); median and quartiles of the runs"
    )


def _frequencies(models: Sequence[Model], low: float, high: float, count: int) -> np.ndarray:
    """Return about `count` frequencies in Hz, evenly over the logarithm and closer at lightly damped poles."""
    s = np.concatenate([continuous_poles(model.poles(), model.dt) for model in models])
    s = s[(s.imag > 0) & (np.abs(s.real) < 0.1 * s.imag)]
    s = s[np.argsort(np.abs(s.real) / s.imag)][: count // 20]
    near = (s.imag[:, None] + s.real[:, None] * np.array([-3, -1, 0, 1, 3])).ravel() / (2 * np.pi)
    even = np.geomspace(low, high, min(max(count - near.size, 60), 400))
    return np.unique(np.concatenate([even, near[(near > low) & (near < high)]]))


def _decibel(response: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.clip(np.abs(response), 1e-15, 1e15))


def _decibel_limits(G: np.ndarray, line: Sequence[tuple[int, int]]) -> Range:
    """Return the range of the pairs that are not zero, at most 60 dB below each pair's peak."""
    sizes = [_decibel(G[:, i, j]) for i, j in line if np.abs(G[:, i, j]).any()] or [np.zeros(1)]
    low = min(max(size.min(), size.max() - 60) for size in sizes)
    return low - 6, max(size.max() for size in sizes) + 6
