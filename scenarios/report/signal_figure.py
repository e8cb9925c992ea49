"""One signal on one page: time, spectrum, autocorrelation and amplitude histogram, with its limits."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from excite.errors import ExciteError
from excite.files.atomic import written
from excite.limits.limits import Limits
from excite.types.signal import Signal
from scenarios.report.drawing import MOST_POINTS_FIGURE, PALETTE, canvas, legible, log_scale, plain, styled, thin, unit

MOST_CHANNELS = 6
LIMIT = "#b03a2e"
LABELS = (
    ("", "time [s]"),
    ("line amplitude", "frequency [Hz]"),
    ("autocorrelation", "lag [s]"),
    ("histogram", "samples [–]"),
)


@styled
def signal_figure(signal: Signal, limits: Limits | None = None) -> Figure:
    """Return a row a channel: samples with the amplitude limits, line amplitudes, circular autocorrelation, histogram.

    The samples are those that can be told apart, from the first.
    """
    count = min(signal.u.shape[1], MOST_CHANNELS)
    left_out = f" (first {count} of {signal.u.shape[1]} channels)" if count < signal.u.shape[1] else ""
    figure = canvas(
        0.9 + 1.5 * count, f"Signal: {'from a file' if signal.recipe is None else signal.recipe.kind}{left_out}"
    )
    axes = figure.subplots(count, 4, squeeze=False, sharex="col", width_ratios=(1.6, 1.2, 1, 0.7))
    points = MOST_POINTS_FIGURE // (4 * count)
    length = signal.period if signal.period and signal.period <= len(signal.u) else len(signal.u)
    f, time_s, shown = np.fft.rfftfreq(length, signal.dt)[1:], signal.time_s, legible(signal, len(signal.u))
    bounds = None if limits is None else limits.bounds(signal)
    for i, (time, spectrum, correlation, histogram) in enumerate(axes):
        u, colour = signal.u[:, i], PALETTE[i % len(PALETTE)]
        time.plot(*thin(time_s[:shown], u[:shown], points), drawstyle="steps-post", color=colour)
        for side in () if bounds is None else bounds:
            if np.isfinite(side[i]):
                time.axhline(side[i], color=LIMIT, lw=0.9, ls="--")
        time.set_title(plain(signal.channels[i].name))
        time.set_ylabel(unit(signal.channels[i].unit))
        transform = np.fft.rfft(u[:length])
        lines = 2 * np.abs(transform[1:]) / length
        full = lines > 1e-9 * lines.max(initial=0)
        if full.any():
            spectrum.plot(*thin(f[full], lines[full], points, log=True), color=colour, lw=0.9)
            log_scale(spectrum, "y", max(lines[full].min() / 1.5, lines.max() * 1e-4), lines.max() * 2)
        log_scale(spectrum, "x", f[0], f[-1])
        power = np.abs(transform) ** 2
        power[0] = 0
        circular = np.fft.irfft(power, length)
        if circular[0] > 0:
            half = length // 2 + 1
            correlation.plot(*thin(time_s[:half], circular[:half] / circular[0], points), color=colour)
        correlation.set_ylim(-1.05, 1.05)
        histogram.hist(u, bins=min(60, max(10, len(np.unique(u[:5000])))), orientation="horizontal", color=colour)
    if shown < len(signal.u):
        axes[0, 0].set_title(f"{axes[0, 0].get_title(loc='left')} (the first {shown * signal.dt:.3g} s)")
    for column, (title, label) in enumerate(LABELS):
        if title:
            axes[0, column].set_title(title)
        axes[-1, column].set_xlabel(label)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure atomically; the extension says how: .png, .svg or .pdf."""
    extension = Path(path).suffix.lower()
    if extension not in (".png", ".svg", ".pdf"):
        raise ExciteError(f"--plot {path}: extension '{extension}'; name a .png, .svg or .pdf file")
    with written(path) as temporary:
        figure.savefig(temporary, format=extension[1:])
