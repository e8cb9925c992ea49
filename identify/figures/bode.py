"""Frequency responses, and how far they are off."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from excite.figures.colours import Role
from excite.figures.figure import Axis, Band, Figure, Line, Mark, Panel, Range, Span, Text
from excite.figures.thinning import MOST_POINTS_FIGURE
from excite.models.model import Model
from excite.words import joined, number
from identify.compare import Comparison, Row
from identify.figures.rows import best_rows, colours, estimates, s_plane, title, true_poles
from identify.metrics.frequency import default_band

CAPTION = (
    "Magnitude of the frequency response, truth dashed, first run of the best order of each method; below, the relative "
    "error, median (line) and quartiles (shaded) over the runs. The band over which the score is taken is shaded."
)
ERROR = "relative error over all pairs, |Ĝ − G| / |G| (largest singular values); median and quartiles of the runs"
NEAR = 0.1  # relative error below which the verdict calls a response nearly right
Pairs = list[list[tuple[int, int]]]


def bode(comparison: Comparison) -> Figure | None:
    """Return the magnitudes of the input-output pairs (all up to 3 x 3, else the diagonal) above the relative error.

    Magnitudes are of the first run. The error is the spectral norm of the difference over that of the truth, median and
    quartiles over the runs; the band of the score is shaded.
    """
    rows = best_rows(comparison)
    models = [estimates(row)[0].model for row in rows]
    if not models or not models[0].inputs:
        return None
    truth = None if comparison.truth is None else comparison.truth.model
    band = comparison.band_hz
    if band is None and comparison.truth is not None and true_poles(comparison) is not None:
        band = default_band(comparison.truth.poles, comparison.truth.model.dt)
    pairs = _pairs(len(models[0].outputs), len(models[0].inputs))
    nyquist = 0.5 / comparison.uniform_dt
    low = band[0] / 2 if band else nyquist / 1000
    lines = sum(map(len, pairs)) * (len(rows) + 1) + 3 * len(rows)
    f = _frequencies([m for m in (truth, *models) if m is not None], low, nyquist, MOST_POINTS_FIGURE // lines)
    G = None if truth is None else truth.frf(f)
    responses = [model.frf(f) for model in models]
    frequency = Axis("frequency", "Hz", "log", limits=(low, nyquist))
    panels = _magnitudes(rows, f, responses, G, pairs, frequency, band)
    errors = [] if G is None else [_error_quartiles(row, f, G) for row in rows]
    if G is not None:
        panels.append(_errors(rows, f, errors, frequency, band, len(pairs), len(pairs[0])))
    return Figure(
        name="bode",
        title=f"{comparison.name}: frequency response",
        panels=panels,
        caption=CAPTION,
        verdict=_verdict(rows, f, errors, responses, band),
        height=1.1 + 1.55 * len(pairs) + (0 if G is None else 1.6),
        colours=colours(comparison),
    )


def _pairs(ny: int, nu: int) -> Pairs:
    """Rows of (output, input): every pair up to 3 x 3, else up to six of the diagonal."""
    if ny <= 3 and nu <= 3:
        return [[(i, j) for j in range(nu)] for i in range(ny)]
    diagonal = [(i, i) for i in range(min(ny, nu, 6))]
    return [diagonal] if len(diagonal) <= 3 else [diagonal[: len(diagonal) // 2], diagonal[len(diagonal) // 2 :]][:2]


def _magnitudes(
    rows: Sequence[Row],
    f: np.ndarray,
    responses: Sequence[np.ndarray],
    G: np.ndarray | None,
    pairs: Pairs,
    frequency: Axis,
    band: Range | None,
) -> list[Panel]:
    """One panel per pair, the lines of the best row on top of the others, the truth on top of all."""
    model, panels = estimates(rows[0])[0].model, []
    for r, line in enumerate(pairs):
        limits = _decibel_limits(responses[0] if G is None else G, line)
        for c, (i, j) in enumerate(line):
            marks: list[Mark] = _shaded(band)
            for row, response in zip(reversed(rows), reversed(responses), strict=True):
                marks.append(Line(f, _decibel(response[:, i, j]), label=title(row), colour=row.label))
            if G is not None:
                marks.append(Line(f, _decibel(G[:, i, j]), width=1.6, style="dashed", label="truth", colour=Role.TRUTH))
                if not np.abs(G[:, i, j]).any():
                    place: dict[str, Any] = {"frame": "panel", "across": "right", "up": "top"}
                    marks.append(Text(0.97, 0.9, "truth: 0", colour=Role.NOTE, **place))
            x = Axis("frequency", "Hz", "log", limits=frequency.limits, shared=r < len(pairs) - 1)
            y = Axis("magnitude", "dB", limits=limits, shared=c > 0)
            panels.append(Panel(marks, x, y, f"{model.inputs[j]} → {model.outputs[i]}", r, c))
    return panels


def _shaded(band: Range | None) -> list[Mark]:
    return [Span(*band, label="band of the score", colour=Role.BAND)] if band else []


def _error_quartiles(row: Row, f: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Quartiles (3, F) over the runs of the relative error of the frequency response, NaN where one is not known."""
    errors = [_gain(estimate.model.frf(f) - G) for estimate in estimates(row)]
    return np.percentile(errors, [25, 50, 75], axis=0) / _gain(G)


def _gain(G: np.ndarray) -> np.ndarray:
    """Largest singular value (F,) of responses (F, ny, nu), NaN where a response is not known."""
    gain, known = np.full(len(G), np.nan), np.isfinite(G).all(axis=(1, 2))
    gain[known] = np.linalg.norm(G[known], 2, axis=(1, 2))
    return gain


def _errors(
    rows: Sequence[Row],
    f: np.ndarray,
    errors: Sequence[np.ndarray],
    frequency: Axis,
    band: Range | None,
    place: int,
    columns: int,
) -> Panel:
    """Relative errors in %, the best row on top; the axis ends at 1000 %."""
    shown = 100 * np.clip(errors, 1e-12, 1e12)
    marks: list[Mark] = _shaded(band)
    for row, (low, median, high) in reversed(list(zip(rows, shown, strict=True))):
        marks.append(Band(f, low, high, alpha=0.2, colour=row.label))
        marks.append(Line(f, median, label=title(row), colour=row.label))
    known = shown[np.isfinite(shown)] if np.isfinite(shown).any() else np.array([100.0])
    bottom = max(np.percentile(known, 1) / 2, 1e-8)
    y = Axis("error", "%", "log", limits=(bottom, max(min(2 * known.max(), 1e3), 10 * bottom)))
    return Panel(marks, frequency, y, ERROR, place, 0, columns=columns)


def _verdict(
    rows: Sequence[Row],
    f: np.ndarray,
    errors: Sequence[np.ndarray],
    responses: Sequence[np.ndarray],
    band: Range | None,
) -> str:
    """Say where each row's response is nearly right, or how far the first two are apart where no truth is known."""
    inside = np.ones(len(f), bool) if band is None else (f >= band[0]) & (f <= band[1])
    if not inside.any():
        inside[:] = True
    if errors:
        near = [
            (row, _widest(f[inside], median[inside] < NEAR)) for row, (_, median, _) in zip(rows, errors, strict=True)
        ]
        told = [f"{where} for {title(row)}" for row, where in near]
        return f"The frequency response is off by less than {100 * NEAR:.0f} % {joined(told)}."
    if len(responses) > 1:
        size = _gain(responses[0])
        apart = _gain(responses[1] - responses[0])[inside] / np.where(size > 0, size, 1)[inside]
        apart = apart[np.isfinite(apart)]
        two = f"{title(rows[0])} and {title(rows[1])}"
        where = "" if band is None else " within the band"
        return f"{two} are at most {number(100 * apart.max(initial=0.0))} % apart{where}; no truth is known."
    gain = np.nan_to_num(_gain(responses[0]))
    peak = f"{number(20 * np.log10(max(gain.max(), 1e-15)))} dB at {number(f[gain.argmax()])} Hz"
    return f"The largest gain of {title(rows[0])} is {peak}; no truth is known."


def _widest(f: np.ndarray, near: np.ndarray) -> str:
    """Return the widest range of frequencies (on a logarithmic axis) that are all near, in words."""
    if near.all():
        return "over the whole band"
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]))).reshape(-1, 2)
    if not edges.size:
        return "nowhere"
    first, last = max(((a, b - 1) for a, b in edges), key=lambda ends: f[ends[1]] / f[ends[0]])
    return f"from {number(f[first])} to {number(f[last])} Hz"


def _frequencies(models: Sequence[Model], low: float, high: float, count: int) -> np.ndarray:
    """Return about `count` frequencies in Hz, evenly over the logarithm and closer at lightly damped poles."""
    s = np.concatenate([s_plane(model) for model in models])
    s = s[(s.imag > 0) & (np.abs(s.real) < 0.1 * s.imag)]
    s = s[np.argsort(np.abs(s.real) / s.imag)][: count // 20]
    near = (s.imag[:, None] + s.real[:, None] * np.array([-3, -1, 0, 1, 3])).ravel() / (2 * np.pi)
    even = np.geomspace(low, high, min(max(count - near.size, 60), 400))
    return np.unique(np.concatenate([even, near[(near > low) & (near < high)]]))


def _decibel(response: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.clip(np.abs(response), 1e-15, 1e15))


def _decibel_limits(G: np.ndarray, line: Sequence[tuple[int, int]]) -> Range:
    """Return the range of the pairs that are not zero, at most 60 dB below each pair's peak."""
    known = [G[np.isfinite(G[:, i, j]), i, j] for i, j in line]
    sizes = [_decibel(response) for response in known if np.abs(response).any()] or [np.zeros(1)]
    low = min(max(size.min(), size.max() - 60) for size in sizes)
    return low - 6, max(size.max() for size in sizes) + 6
