"""A validation record and its simulation by the models."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.figures.colours import Role
from excite.figures.figure import Axis, Figure, Line, Mark, Panel
from excite.figures.thinning import MOST_POINTS_FIGURE, thin, window
from excite.models.model import Dynamic
from excite.types.experiment import Experiment
from excite.words import joined, number
from identify.compare import Comparison, Row
from identify.data.gaps import gap_free
from identify.figures.rows import best_rows, colours, estimates, title
from identify.metrics.fits import fit_percent
from identify.metrics.judgement import PART
from identify.steps.initial_state import initial_state
from identify.steps.threads import blas_threads

CAPTION = (
    "Left: the beginning of the validation run, measured and noise-free, with simulations driven by the inputs of the "
    "noise-free run. Right: their errors over the whole run. Axes keep to the range of the data."
)
CAPTION_MEASURED = (
    "Left: the beginning of the validation record as measured, with simulations driven by its inputs. Right: their "
    "errors over the whole record. Axes keep to the range of the data."
)
MOST_CHANNELS = 6


@dataclass(frozen=True, eq=False)
class _Judged:
    """What is simulated and drawn: the noise-free twin where there is one, beside the record as measured."""

    target: Experiment
    measured: Experiment | None
    simulated: Sequence[tuple[Row, np.ndarray]]
    shown: int
    points: int

    @property
    def name(self) -> str:
        return "measured" if self.measured is None else "noise-free"


def outputs(comparison: Comparison) -> Figure | None:
    """Return the noise-free validation run and its simulation by the best order of each label, with the errors.

    Simulated are the inputs of the noise-free run, since in closed loop those of the noisy one differ; without one, the
    measured run. Left a window, right the error over the whole run; the axes keep to the range of the data where a
    simulation diverges.
    """
    target = comparison.validation if comparison.clean is None else comparison.clean
    if target is None or (target.incomplete is not None and target.incomplete.all()):
        return None
    rows = best_rows(comparison, Dynamic)
    count = min(target.y.shape[1], MOST_CHANNELS)
    judged = _Judged(
        target=target,
        measured=None if comparison.clean is None else comparison.validation,
        simulated=[(row, _simulate(estimates(row)[0].dynamic, target)) for row in rows],
        shown=window(len(target), comparison.dt),
        points=MOST_POINTS_FIGURE // (count * (2 + 2 * len(rows))),
    )
    left_out = f", first {count} of {target.y.shape[1]} outputs" if count < target.y.shape[1] else ""
    run = "noise-free validation run" if judged.name == "noise-free" else "validation record"
    return Figure(
        name="outputs",
        title=f"{comparison.name}: simulation (unlimited horizon) of the {run}, first models{left_out}",
        panels=[panel for i in range(count) for panel in _row(judged, i, last=i == count - 1)],
        caption=CAPTION if judged.name == "noise-free" else CAPTION_MEASURED,
        verdict=_verdict(judged),
        height=1.1 + 1.55 * count,
        widths=(1.35, 1),
        colours=colours(comparison),
    )


def _simulate(model: Dynamic, record: Experiment) -> np.ndarray:
    """Return the simulation of each gap-free part from the initial state that fits best (N, ny), NaN in the gaps.

    It is finite however far it diverges.
    """
    yhat = np.full(record.y.shape, np.nan)
    for part in gap_free((record,), PART * len(model.poles())).parts:
        with np.errstate(over="ignore", invalid="ignore"), blas_threads(len(model.inputs) + len(model.outputs)):
            y = model.response(part, initial_state(model, part, predictor=False))
        at = int(np.searchsorted(record.time_s, part.time_s[0]))
        yhat[at : at + len(y)] = np.nan_to_num(y, nan=1e150, posinf=1e150, neginf=-1e150)
    return yhat


def _row(judged: _Judged, i: int, last: bool) -> list[Panel]:
    """Panels of one output: the beginning, and the errors over the whole record."""
    target, points, shown = judged.target, judged.points, judged.shown
    time, y, channel = target.time_s, target.y[:, i], target.outputs[i]
    seen = [y[:shown]]
    left: list[Mark] = []
    right: list[Mark] = []
    if judged.measured is not None:
        noisy = judged.measured.y[:shown, i]
        seen.append(noisy)
        x, thinned = thin(judged.measured.time_s[:shown], noisy, points)
        left.append(Line(x, thinned, width=0.8, label="measured", colour=Role.MEASURED))
    left.append(Line(*thin(time[:shown], y[:shown], points), width=1.6, label=judged.name, colour=Role.TRUTH))
    inside = np.concatenate(seen)
    low, high = (np.nanmin(inside), np.nanmax(inside)) if not np.isnan(inside).all() else (0.0, 1.0)
    span = max(high - low, 1e-12)
    floor, ceiling = np.nanmin(y) - 20 * span, np.nanmax(y) + 20 * span
    for row, yhat in reversed(judged.simulated):
        look = {"label": title(row), "colour": row.label}
        kept = np.clip(yhat[:, i], floor, ceiling)
        left.append(Line(*thin(time[:shown], kept[:shown], points), width=0.9, **look))
        right.append(Line(*thin(time, kept - y, points), width=0.8, **look))
    worst = [np.nanpercentile(np.abs(yhat[:, i] - y), 99) for _, yhat in judged.simulated] or [span]
    reach = float(np.clip(1.4 * np.max(worst), 1e-9 * span, 0.75 * span))
    beginning = Axis("time", "s", limits=(time[0], time[shown - 1]), shared=not last)
    whole = Axis("time", "s", limits=(time[0], time[-1]), shared=not last)
    range_y = Axis("", channel.unit, limits=(low - 0.1 * span, high + 0.1 * span))
    name = f"error: simulated − {judged.name}" if i == 0 else ""
    return [
        Panel(left, beginning, range_y, channel.name, i, 0),
        Panel(right, whole, Axis("", channel.unit, limits=(-reach, reach)), name, i, 1),
    ]


def _verdict(judged: _Judged) -> str:
    """Say which share of the outputs each row's simulation explains."""
    target = judged.target
    what = "noise-free outputs" if judged.name == "noise-free" else "measured outputs"
    if not judged.simulated:
        return "No method gave a model to simulate."
    told = []
    for row, yhat in judged.simulated:
        whole = ~(np.isnan(yhat) | np.isnan(target.y)).any(axis=1)
        fit = np.maximum(fit_percent(target.y[whole], yhat[whole]), 0)
        told.append(f"{title(row)} to {number(np.nanmean(fit), 1)} %")
    return f"Simulated from the inputs alone, the {what} are fitted by {joined(told)} (mean over the outputs)."
