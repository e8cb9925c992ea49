"""One plant on one page: step response, Bode diagram and poles of the truth of each view."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from excite.models.modes import continuous_poles
from excite.types.truth import Truth
from identify.metrics.frequency import default_band
from identify.metrics.poles import INTEGRATOR
from scenarios.report.drawing import PALETTE, TRUTH, canvas, log_scale, plain, styled

MOST_PAIRS = 8  # input-output pairs drawn in one panel: those of largest gain
MOST_SAMPLES = 4000
POINTS = 400


@styled
def plant_figure(name: str, truths: Mapping[str, Truth]) -> Figure:
    """Return a row a view: unit-step responses, magnitude, phase, poles in the s-plane."""
    figure = canvas(0.6 + 2.6 * len(truths), f"{name}: truth of each view")
    panels = figure.subplots(len(truths), 4, squeeze=False)
    for (view, truth), (step, magnitude, phase, poles) in zip(truths.items(), panels, strict=True):
        model = truth.model
        low, nyquist = default_band(truth.poles, model.dt)[0] / 2, 0.5 / model.dt
        f = np.geomspace(low, nyquist, POINTS)
        G = model.frf(f)
        gains = np.abs(G).max(0)
        pairs = [divmod(int(k), gains.shape[1]) for k in np.argsort(-gains.ravel(), kind="stable")]
        pairs = [pair for pair in pairs if gains[pair] > 1e-12 * gains.max(initial=0)]
        drawn = pairs[:MOST_PAIRS]
        time_s, steps = _steps(truth, {j for _, j in drawn})
        for k, (i, j) in enumerate(drawn):
            look = {
                "color": PALETTE[k % len(PALETTE)],
                "label": plain(f"{model.inputs[j].name} → {model.outputs[i].name}", 26),
            }
            step.plot(time_s, steps[j][:, i], drawstyle="steps-post", **look)
            magnitude.plot(f, 20 * np.log10(np.maximum(np.abs(G[:, i, j]), 1e-15)), **look)
            phase.plot(f, np.degrees(np.unwrap(np.angle(G[:, i, j]))), **look)
        left_out = f" ({len(drawn)} of {len(pairs)} pairs)" if len(drawn) < len(pairs) else ""
        step.set(xlabel="time [s]", title=plain(f"{view}: unit step{left_out}"))
        magnitude.set(xlabel="frequency [Hz]", title="magnitude [dB]")
        phase.set(xlabel="frequency [Hz]", title="phase [deg]")
        for axis in (magnitude, phase):
            log_scale(axis, "x", low, nyquist)
        step.legend(fontsize=6)
        _poles(poles, truth)
    return figure


def _steps(truth: Truth, inputs: set[int]) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Return time and the response to a unit step in each of the inputs, over six slowest time constants."""
    model = truth.model
    decay = -continuous_poles(truth.poles, model.dt).real * model.dt
    slowest = decay[decay > INTEGRATOR].min(initial=1.0)
    count = int(np.clip(6 / slowest, 50, 10**6))
    every = -(-count // MOST_SAMPLES)
    lifted = model.lift(every)
    count = count // every + 1
    responses = {}
    for j in inputs:
        u = np.zeros((count, len(model.inputs)))
        u[:, j] = 1.0
        responses[j] = lifted.simulate(u)
    return np.arange(count) * lifted.dt, responses


def _upper(s: np.ndarray) -> tuple[float, float]:
    top = 1.1 * max(s.imag.max(initial=0), 0.3 * np.abs(s.real).max(initial=1))
    return -0.06 * top, top


def _poles(axis: Axes, truth: Truth) -> None:
    """Draw the poles in the upper half of the s-plane."""
    s = continuous_poles(truth.poles, truth.model.dt)
    s = s[(s.imag > -1e-9 * np.abs(s).max(initial=1)) & (np.abs(s) * truth.model.dt < 10)]
    axis.plot(s.real, s.imag, "x", color=TRUTH, ms=7, mew=1.3)
    axis.axvline(0, color="#888888", lw=0.8)
    axis.set(xlabel="real part [rad/s]", title="poles: imaginary part", ylim=_upper(s))
