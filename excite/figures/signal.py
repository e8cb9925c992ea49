"""One signal on one page: time, spectral lines, autocorrelation and amplitude histogram, with its limits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.figures.colours import Role
from excite.figures.figure import Axis, Bars, Figure, Line, Mark, Panel, Range, Rule, Text
from excite.figures.thinning import MOST_POINTS_FIGURE, legible, thin, window
from excite.limits.limits import Limits
from excite.types.signal import Signal
from excite.words import extent, joined, number

MOST_CHANNELS = 6
SHARE = 0.9  # of the power, below the frequency that the verdict names
ROUNDING = 1e-9  # relative; lines below that of the largest are rounding
CAPTIONS = {
    "time": "each channel over time, limits dashed where there are any",
    "spectrum": "its spectral lines",
    "correlation": "its circular autocorrelation",
    "histogram": "how often it takes each value",
}
LESSON = "Where lines are missing or weak, little is learnt about the plant."


@dataclass(frozen=True, eq=False)
class _Channel:
    """One channel as all its panels see it.

    u : (N,); length : samples of one period, or all; shown : samples over time; most : samples in the fullest bin of any
    channel's histogram; bounds : low and high, infinite where free; points : of a line.
    """

    u: np.ndarray
    dt: float
    unit: str
    title: str
    first: bool
    length: int
    periodic: bool
    shown: int
    most: int
    bounds: Range
    points: int

    def range(self, count: int) -> Range:
        """Range of the first `count` samples and of the limits, with room around."""
        seen = np.concatenate([self.u[:count], [side for side in self.bounds if np.isfinite(side)]])
        margin = 0.08 * (np.ptp(seen) or abs(seen[0]) or 1.0)
        return float(seen.min() - margin), float(seen.max() + margin)


def signal_figure(
    signal: Signal, limits: Limits | None = None, *, panels: Sequence[str] = (*CAPTIONS,), windowed: bool = False
) -> Figure:
    """Return one row per channel (of the first six): samples with their limits, line amplitudes, autocorrelation, histogram.

    The samples drawn are those that can be told apart, from the first. Line amplitudes are 2 |U_k| / N over one period,
    or over the whole record.

    Parameters
    ----------
    limits : of the hardware, drawn beside the samples.
    panels : which of "time", "spectrum", "correlation", "histogram".
    windowed : show at most 20 s.
    """
    count = min(signal.u.shape[1], MOST_CHANNELS)
    left_out = f" (first {count} of {signal.u.shape[1]} channels)" if count < signal.u.shape[1] else ""
    kind = "from a file" if signal.recipe is None else signal.recipe.kind
    drawn = []
    for i, channel in enumerate(_channels(signal, limits, count, windowed)):
        for k, name in enumerate(panels):
            panel = PANELS[name](channel)
            drawn.append(replace(panel, row=i, column=k, x=replace(panel.x, shared=i < count - 1)))
    said = "; ".join(CAPTIONS[name] for name in panels)
    return Figure(
        name="signal",
        title=f"Excitation: {kind}{left_out}",
        panels=drawn,
        caption=f"From left to right: {said}. {LESSON}",
        verdict=_verdict(signal, limits),
        height=0.9 + 1.3 * count,
        widths=[WIDTHS[name] for name in panels],
    )


def _channels(signal: Signal, limits: Limits | None, count: int, windowed: bool) -> list[_Channel]:
    samples, free = len(signal.u), np.full(signal.u.shape[1], np.inf)
    shown = legible(signal, window(samples, signal.dt) if windowed else samples)
    low, high = (-free, free) if limits is None else limits.bounds(signal)
    periodic = signal.period is not None and signal.period <= samples
    most = max(int(_histogram(u)[0].max()) for u in signal.u.T[:count])
    cut = f" (the first {number(shown * signal.dt)} s)" if shown < samples else ""
    return [
        _Channel(
            u=signal.u[:, i],
            dt=signal.dt,
            unit=signal.channels[i].unit,
            title=signal.channels[i].name + (cut if i == 0 else ""),
            first=i == 0,
            length=(signal.period if periodic else None) or samples,
            periodic=periodic,
            shown=shown,
            most=most,
            bounds=(float(low[i]), float(high[i])),
            points=MOST_POINTS_FIGURE // (4 * count),
        )
        for i in range(count)
    ]


def _time(channel: _Channel) -> Panel:
    time_s = np.arange(channel.shown) * channel.dt
    x, y = thin(time_s, channel.u[: channel.shown], channel.points)
    marks: list[Mark] = [Line(x, y, steps=True, colour=Role.SIGNAL)]
    marks += [Rule(y=side, colour=Role.LIMIT, style="dashed") for side in channel.bounds if np.isfinite(side)]
    limits = 0.0, channel.shown * channel.dt
    return Panel(
        marks,
        Axis("time", "s", limits=limits),
        Axis("", channel.unit, limits=channel.range(channel.shown)),
        channel.title,
    )


def _spectrum(channel: _Channel) -> Panel:
    f, lines = _lines(channel.u[: channel.length], channel.dt)
    full = lines > ROUNDING * np.abs(channel.u).max()
    title = f"line amplitude ({'one period' if channel.periodic else 'whole record'})" if channel.first else ""
    ends = (f[0], f[-1]) if len(f) > 1 else (0.1 / channel.dt, 1 / channel.dt)
    x = Axis("frequency", "Hz", "log", limits=ends)
    if not full.any():
        note = Text(0.5, 0.5, "constant: no line above 0 Hz", frame="panel", across="center", colour=Role.NOTE)
        return Panel((note,), x, Axis("", channel.unit, ticks=()), title)
    line = Line(*thin(f[full], lines[full], channel.points, log=True), width=0.9, colour=Role.SIGNAL)
    top = lines[full].max()
    limits = max(lines[full].min() / 1.5, top * 1e-4), top * 2
    return Panel((line,), x, Axis("", channel.unit, "log", limits=limits), title)


def _correlation(channel: _Channel) -> Panel:
    power = np.abs(np.fft.rfft(channel.u[: channel.length])) ** 2
    power[0] = 0
    circular = np.fft.irfft(power, channel.length)
    half = channel.length // 2 + 1
    lags, marks = np.arange(half) * channel.dt, []
    if circular[0] > 0:
        marks.append(Line(*thin(lags, circular[:half] / circular[0], channel.points), colour=Role.SIGNAL))
    reach = max(half - 1, 1) * channel.dt
    x = Axis("lag", "s", limits=(-0.02 * reach, reach))
    return Panel(marks, x, Axis("", "", limits=(-1.05, 1.05)), "autocorrelation" if channel.first else "")


def _histogram_panel(channel: _Channel) -> Panel:
    counts, edges = _histogram(channel.u)
    bars = Bars(np.zeros(len(counts)), counts, edges[:-1], edges[1:], colour=Role.SIGNAL)
    x = Axis("samples", "", limits=(0, 1.05 * channel.most))
    y = Axis("", channel.unit, limits=channel.range(len(channel.u)))
    return Panel((bars,), x, y, "histogram" if channel.first else "")


WIDTHS = {"time": 1.6, "spectrum": 1.2, "correlation": 1.0, "histogram": 0.7}
PANELS: Mapping[str, Callable[[_Channel], Panel]] = {
    "time": _time,
    "spectrum": _spectrum,
    "correlation": _correlation,
    "histogram": _histogram_panel,
}


def _lines(u: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz above 0, and the amplitudes of the lines there."""
    amplitudes = 2 * np.abs(np.fft.rfft(u))[1:] / len(u)
    if len(u) % 2 == 0:
        amplitudes[-1:] /= 2  # the line at the Nyquist frequency has no mirror image
    return np.fft.rfftfreq(len(u), dt)[1:], amplitudes


def _histogram(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.histogram(u, bins=min(60, max(10, len(np.unique(u[:5000])))))


def _verdict(signal: Signal, limits: Limits | None) -> str:
    length = signal.period if signal.period and signal.period <= len(signal.u) else len(signal.u)
    moving = [i for i in range(signal.u.shape[1]) if np.ptp(signal.u[:, i]) > 0]
    parts = []
    if moving:
        u = signal.u[:, moving]
        crest = np.abs(u).max(0) / np.sqrt((u**2).mean(0))
        below = []
        for column in u[:length].T:
            f, lines = _lines(column, signal.dt)
            power = np.cumsum(lines**2)
            below.append(f[np.searchsorted(power, SHARE * power[-1])] if power.size and power[-1] > 0 else 0.0)
        parts.append(f"crest factor {extent(crest)}")
        parts.append(f"{100 * SHARE:.0f} % of the power (mean aside) lies below {extent(below)} Hz")
    if len(moving) < signal.u.shape[1]:
        still = [c.name for i, c in enumerate(signal.channels) if i not in moving]
        parts.append(f"{joined(still)} {'is' if len(still) == 1 else 'are'} constant")
    if limits is not None:
        low, high = limits.bounds(signal)
        room = ROUNDING * np.abs(signal.u).max()
        beyond = ((signal.u < low - room) | (signal.u > high + room)).any(axis=0)
        names = [c.name for c, b in zip(signal.channels, beyond, strict=True) if b]
        parts.append(f"{joined(names)} beyond its limits" if names else "all samples within the limits")
    text = "; ".join(parts)
    return text[0].upper() + text[1:] + "."
