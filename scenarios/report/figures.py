"""Figures of a run: each function takes data and returns a matplotlib Figure, without global state."""

import re
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from excite.models.model import Model
from excite.types.experiment import Experiment
from excite.types.signal import Signal
from identify.steps.initial_state import initial_state
from scenarios.report.columns import number
from scenarios.report.drawing import (
    FEWEST,
    MEASURED,
    MOST_POINTS_FIGURE,
    MOST_RUNS,
    PALETTE,
    TRUTH,
    WINDOW_S,
    Colours,
    canvas,
    colours,
    legend,
    legible,
    log_scale,
    palette_of,
    plain,
    styled,
    thin,
    unit,
)
from scenarios.report.model_figures import bode, poles
from scenarios.report.rows import best_rows, first_estimate, spread
from scenarios.run.results import Row, RunResult, ViewResult

MOST_CHANNELS, MOST_ROWS = 6, 24


def stems(result: RunResult) -> tuple[str, ...]:
    """Return a distinct, file-safe name for each view."""
    names: list[str] = []
    for view in result.views:
        base = name = re.sub(r"[^A-Za-z0-9_-]+", "_", view.spec.name)[:60] or "view"
        count = 2
        while name.casefold() in [n.casefold() for n in names]:
            name, count = f"{base}_{count}", count + 1
        names.append(name)
    return tuple(names)


def all_figures(result: RunResult) -> dict[str, Figure]:
    """Return every figure of a run that its data allow, by file stem: "excitation", "<view>-poles", …"""
    palette = colours(row.method for view in result.views for row in view.rows)
    figures = {"excitation": excitation(result.signal)}
    for stem, view in zip(stems(result), result.views, strict=True):
        for name, draw in VIEW_FIGURES.items():
            if (figure := draw(view, palette)) is not None:
                figures[f"{stem}-{name}"] = figure
    return figures


@styled
def excitation(signal: Signal) -> Figure:
    """Return each channel over time (as much of it as can be told apart) beside its spectral lines (of one period)."""
    count = min(signal.u.shape[1], MOST_CHANNELS)
    shown = legible(signal, max(round(WINDOW_S / signal.dt), FEWEST))
    length = signal.period if signal.period and signal.period <= len(signal.u) else len(signal.u)
    f = np.fft.rfftfreq(length, signal.dt)[1:]
    lines = 2 * np.abs(np.fft.rfft(signal.u[:length], axis=0))[1:] / length
    if length % 2 == 0:
        lines[-1] /= 2
    left_out = f" (first {count} of {signal.u.shape[1]} channels)" if count < signal.u.shape[1] else ""
    figure = canvas(0.9 + 1.25 * count, f"Excitation and its spectrum{left_out}")
    axes = figure.subplots(count, 2, sharex="col", squeeze=False, width_ratios=(1.35, 1))
    points = MOST_POINTS_FIGURE // (4 * count)
    for i, (time, spectrum) in enumerate(axes):
        u = signal.u[:shown, i]
        time.plot(*thin(signal.time_s[:shown], u, points), drawstyle="steps-post", color=PALETTE[0])
        margin = 0.08 * (np.ptp(u) or abs(u[0]) or 1.0)
        time.set_ylim(u.min() - margin, u.max() + margin)
        time.set_title(plain(signal.channels[i].name))
        time.set_ylabel(unit(signal.channels[i].unit))
        full = lines[:, i] > 1e-9 * np.abs(signal.u[:length, i]).max()
        spectrum.plot(*thin(f[full], lines[full, i], points, log=True), color=PALETTE[0], lw=0.9)
        spectrum.set_ylabel(unit(signal.channels[i].unit))
        if full.any():
            top = lines[full, i].max()
            log_scale(spectrum, "y", max(lines[full, i].min() / 1.5, top * 1e-4), top * 2)
        else:
            spectrum.set_yticks([])
            spectrum.text(
                0.5, 0.5, "constant: no line above 0 Hz", transform=spectrum.transAxes, ha="center", color="#777777"
            )
        log_scale(spectrum, "x", f[0], f[-1])
    if shown < len(signal.u):
        axes[0, 0].set_title(f"{axes[0, 0].get_title(loc='left')} (the first {number(shown * signal.dt)} s)")
    axes[0, 1].set_title("line amplitude" + (" (one period)" if length == signal.period else " (whole record)"))
    axes[-1, 0].set_xlabel("time [s]")
    axes[-1, 0].set_xlim(0, shown * signal.dt)
    axes[-1, 1].set_xlabel("frequency [Hz]")
    return figure


@styled
def ranking(view: ViewResult, palette: Colours | None = None) -> Figure | None:
    """Return pole and frequency-response error of every row, best first: median, quartiles and the single runs."""
    palette, rows = palette or palette_of(view), view.rows[:MOST_ROWS]
    metrics = {"pole_error_max": "worst pole error [%]", "frf_error_h2": "frequency-response error over the band [%]"}
    metrics = {m: text for m, text in metrics.items() if any(np.isfinite(spread(r, m)["median"]) for r in rows)}
    if not metrics:
        return None
    figure = canvas(1.0 + 0.3 * len(rows), f"{view.spec.name}: errors against the truth (median, quartiles, runs)")
    axes = figure.subplots(1, len(metrics), sharey=True, squeeze=False)[0]
    for axis, (metric, text) in zip(axes, metrics.items(), strict=True):
        _bars(axis, rows, metric, palette)
        axis.set_xlabel(text)
    axes[0].set_yticks(range(len(rows)), [plain(row.label, 30) for row in rows])
    axes[0].set_ylim(len(rows) - 0.4, -0.6)
    return figure


def _bars(axis: Axes, rows: Sequence[Row], metric: str, palette: Colours) -> None:
    """Draw one metric in % on a logarithmic axis, a row of the view on each line."""
    runs = [100 * np.array([s.values.get(metric, np.nan) for s in row.scores]) for row in rows]
    positive = np.concatenate([[*r, 100 * spread(row, metric)["median"]] for r, row in zip(runs, rows, strict=True)])
    positive = positive[np.isfinite(positive) & (positive > 0)]
    low, high = (positive.min() / 2, positive.max() * 4) if positive.size else (0.1, 10.0)
    for place, (row, values) in enumerate(zip(rows, runs, strict=True)):
        statistic = {k: np.clip(100 * v, low, high) for k, v in spread(row, metric).items()}
        median, colour = statistic["median"], palette[row.method]
        if not np.isfinite(median):
            axis.text(low * 1.1, place, "failed" if row.reason else "no value", va="center", color="#777777")
            continue
        axis.barh(place, median - low, left=low, height=0.6, color=colour, alpha=0.3, lw=0)
        single = values[:MOST_RUNS]
        axis.plot(single, np.full(len(single), place), "|", color=colour, ms=8, mew=0.8, alpha=0.6)
        axis.plot([statistic["q25"], statistic["q75"]], [place, place], color=colour, lw=2.2)
        axis.plot(median, place, "o", color=colour, ms=5)
        end, text = np.nanmax([statistic["q75"], *single]), number(100 * spread(row, metric)["median"])
        axis.annotate(text, (end, place), (7, 0), textcoords="offset points", va="center")
    log_scale(axis, "x", low, high)
    axis.grid(axis="y", visible=False)


@styled
def singular_values(view: ViewResult, palette: Colours | None = None) -> Figure | None:
    """Return the singular values of each method's first run, relative to the largest, with the order that was used."""
    palette = palette or palette_of(view)
    rows = [row for row in best_rows(view) if first_estimate(row).singular_values is not None]
    if not rows:
        return None
    figure = canvas(3.2, f"{view.spec.name}: singular values (first run); the ring marks the order used")
    axis = figure.subplots()
    longest = max(24, *(2 * row.order + 4 for row in rows))
    lowest = 1.0
    for row in reversed(rows):
        s = np.asarray(first_estimate(row).singular_values, float)[:longest]
        s = np.maximum(s / s[0], 1e-14)
        lowest = min(lowest, s.min())
        k = np.arange(1, len(s) + 1)
        axis.plot(k, s, ".-", color=palette[row.method], ms=4, lw=0.9, label=plain(row.label))
        if row.order <= len(s):
            axis.plot(row.order, s[row.order - 1], "o", color=palette[row.method], mfc="none", ms=9, mew=1.5)
    if view.truth is not None:
        axis.axvline(view.truth.model.order + 0.5, color=TRUTH, lw=0.9, ls="--", label="order of the truth")
    log_scale(axis, "y", lowest / 2, 2)
    axis.set_xlim(0.5, longest + 0.5)
    axis.set(xlabel="index [–]", ylabel="singular value / largest [–]")
    legend(figure, axis)
    return figure


@styled
def outputs(view: ViewResult, palette: Colours | None = None) -> Figure | None:
    """Return the noise-free validation run and its simulation by the best order of each method, with the errors.

    Simulated are the inputs of the noise-free run, since in closed loop those of the noisy one differ. Left a window,
    right the error over the whole run; the axes keep to the range of the data where a simulation diverges.
    """
    palette = palette or palette_of(view)
    clean, measured = view.clean, view.validation
    count, rows = min(clean.y.shape[1], MOST_CHANNELS), best_rows(view)
    shown = min(len(clean), max(round(WINDOW_S / view.dt), FEWEST))
    left_out = f", first {count} of {clean.y.shape[1]} outputs" if count < clean.y.shape[1] else ""
    figure = canvas(
        1.1 + 1.55 * count,
        f"{view.spec.name}: simulation (unlimited horizon) of the noise-free validation run, first models{left_out}",
    )
    axes = figure.subplots(count, 2, sharex="col", squeeze=False, width_ratios=(1.35, 1))
    points = MOST_POINTS_FIGURE // (count * (2 + 2 * len(rows)))
    simulated = [(row, _simulate(first_estimate(row).model, clean)) for row in rows]
    time = clean.time_s
    for i, (axis, error) in enumerate(axes):
        y, channel = clean.y[:, i], clean.outputs[i]
        noisy = measured.y[:shown, i]
        axis.plot(*thin(measured.time_s[:shown], noisy, points), color=MEASURED, lw=0.8, label="measured")
        axis.plot(*thin(time[:shown], y[:shown], points), color=TRUTH, lw=1.6, label="noise-free")
        low, high = np.nanmin([y[:shown].min(), np.nanmin(noisy)]), np.nanmax([y[:shown].max(), np.nanmax(noisy)])
        span = max(high - low, 1e-12)
        for row, yhat in reversed(simulated):
            style = {"color": palette[row.method], "label": plain(row.label)}
            kept = np.clip(yhat[:, i], y.min() - 20 * span, y.max() + 20 * span)
            axis.plot(*thin(time[:shown], kept[:shown], points), lw=0.9, **style)
            error.plot(*thin(time, kept - y, points), lw=0.8, **style)
        axis.set_ylim(low - 0.1 * span, high + 0.1 * span)
        worst = [np.percentile(np.abs(yhat[:, i] - y), 99) for _, yhat in simulated] or [span]
        reach = float(np.clip(1.4 * np.max(worst), 1e-9 * span, 0.75 * span))
        error.set_ylim(-reach, reach)
        axis.set_title(plain(channel.name))
        axis.set_ylabel(unit(channel.unit))
        error.set_ylabel(unit(channel.unit))
    axes[0, 1].set_title("error: simulated − noise-free")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    axes[0, 0].set_xlim(time[0], time[shown - 1])
    axes[0, 1].set_xlim(time[0], time[-1])
    legend(figure, axes[0, 0])
    return figure


def _simulate(model: Model, experiment: Experiment) -> np.ndarray:
    """Return the simulation from the initial state that fits best, finite however far it diverges."""
    model = model.to_state_space()
    with np.errstate(over="ignore", invalid="ignore"):
        yhat = model.simulate(experiment.u, initial_state(model, experiment, predictor=False))
    return np.nan_to_num(yhat, nan=1e150, posinf=1e150, neginf=-1e150)


VIEW_FIGURES: dict[str, Callable[[ViewResult, Colours], Figure | None]] = {
    "ranking": ranking,
    "poles": poles,
    "bode": bode,
    "outputs": outputs,
    "singular-values": singular_values,
}
