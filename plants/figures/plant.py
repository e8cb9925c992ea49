"""One plant on one page: step response, Bode diagram and poles of the truth of each view."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from excite.figures.colours import PALETTE, Role
from excite.figures.figure import Axis, Figure, Line, Panel, Points, Range, Rule
from excite.models.modes import continuous_poles
from excite.types.truth import Truth
from excite.words import number

MOST_PAIRS = 8  # input-output pairs drawn in one panel: those of largest gain
MOST_SAMPLES = 4000
POINTS = 400
INTEGRATOR = 1e-6  # |s| dt below which a pole integrates
CAPTION = (
    "One row per view, from left to right: outputs after a unit step of one input, each in its own unit; magnitude and "
    "phase of the frequency response up to the Nyquist frequency; poles in the upper half of the s-plane."
)


def plant_figure(name: str, truths: Mapping[str, Truth]) -> Figure:
    """Return one row per view: unit-step responses, magnitude, phase, poles in the s-plane.

    truths : by view, at the view's rate. Of many input-output pairs, the eight of largest gain are drawn.
    """
    panels = [panel for row, (view, truth) in enumerate(truths.items()) for panel in _row(row, view, truth)]
    return Figure(
        name="plant",
        title=f"{name}: truth of each view",
        panels=panels,
        caption=CAPTION,
        verdict="; ".join(f"{view}: {_character(truth)}" for view, truth in truths.items()) + ".",
        height=0.6 + 2.6 * len(truths),
        colours={_key(k): PALETTE[k] for k in range(MOST_PAIRS)},
    )


def _key(k: int) -> str:
    return f"pair {k + 1}"


def _row(row: int, view: str, truth: Truth) -> list[Panel]:
    model = truth.model
    low, nyquist = _slowest_hz(truth) / 6, 0.5 / model.dt
    f = np.geomspace(low, nyquist, POINTS)
    G = model.frf(f)
    gains = np.abs(G).max(0)
    pairs = [divmod(int(k), gains.shape[1]) for k in np.argsort(-gains.ravel(), kind="stable")]
    pairs = [pair for pair in pairs if gains[pair] > 1e-12 * gains.max(initial=0)]
    drawn = pairs[:MOST_PAIRS]
    looks: list[dict[str, Any]] = [
        {"colour": _key(k), "label": f"{model.inputs[j].name} → {model.outputs[i].name}"}
        for k, (i, j) in enumerate(drawn)
    ]
    time_s, steps = _steps(truth, {j for _, j in drawn})
    curves = {
        "step": [Line(time_s, steps[j][:, i], steps=True, **l) for (i, j), l in zip(drawn, looks, strict=True)],
        "magnitude": [Line(f, _decibel(G[:, i, j]), **l) for (i, j), l in zip(drawn, looks, strict=True)],
        "phase": [Line(f, _phase(G[:, i, j]), **l) for (i, j), l in zip(drawn, looks, strict=True)],
    }
    left_out = f" ({len(drawn)} of {len(pairs)})" if len(drawn) < len(pairs) else ""
    frequency = Axis("frequency", "Hz", "log", limits=(low, nyquist))
    return [
        Panel(
            curves["step"],
            Axis("time", "s"),
            Axis("", "output's unit"),
            f"{view}: unit step{left_out}",
            row,
            0,
            legend="inside",
        ),
        Panel(curves["magnitude"], frequency, Axis("", "dB"), "magnitude", row, 1, legend="none"),
        Panel(curves["phase"], frequency, Axis("", "deg"), "phase", row, 2, legend="none"),
        _poles(truth, row),
    ]


def _slowest_hz(truth: Truth) -> float:
    """Natural frequency of the slowest pole that does not integrate, in Hz, at most 0.12 of the rate."""
    s = np.abs(continuous_poles(truth.poles, truth.model.dt)) / (2 * np.pi)
    s = s[s * truth.model.dt > INTEGRATOR]
    return min(s.min(initial=np.inf), 0.12 / truth.model.dt)


def _decibel(response: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.maximum(np.abs(response), 1e-15))


def _phase(response: np.ndarray) -> np.ndarray:
    return np.degrees(np.unwrap(np.angle(response)))


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


def _poles(truth: Truth, row: int) -> Panel:
    """Draw the poles in the upper half of the s-plane."""
    s = continuous_poles(truth.poles, truth.model.dt)
    s = s[(s.imag > -1e-9 * np.abs(s).max(initial=1)) & (np.abs(s) * truth.model.dt < 10)]
    marks = (
        Rule(x=0.0, colour=Role.AXIS, width=0.8),
        Points(s.real, s.imag, marker="cross", size=7, width=1.3, colour=Role.TRUTH, label="poles"),
    )
    x, y = Axis("real part", "rad/s"), Axis("imaginary part", "rad/s", limits=_upper(s))
    return Panel(marks, x, y, "poles", row, 3, legend="none")


def _upper(s: np.ndarray) -> Range:
    top = 1.1 * max(s.imag.max(initial=0), 0.3 * np.abs(s.real).max(initial=1))
    return -0.06 * top, top


def _character(truth: Truth) -> str:
    """Say how many poles there are, and which lets the response ring longest or decay slowest."""
    s = continuous_poles(truth.poles, truth.model.dt)
    lasting = s[np.abs(s) * truth.model.dt < 10]
    if not lasting.size:
        return "no poles but delays"
    parts = [f"{len(lasting)} pole{'s' if len(lasting) > 1 else ''}", *_worst(lasting, truth.model.dt)]
    return ", ".join(parts)


def _worst(s: np.ndarray, dt: float) -> Sequence[str]:
    moving = s[np.abs(s) * dt > INTEGRATOR]
    if (moving.real > 0).any():
        return [f"unstable, the fastest growing at {number(moving.real.max())} rad/s"]
    parts = ["integrating"] if len(moving) < len(s) else []
    ringing = moving[moving.imag > 1e-9 * np.abs(moving)]
    if ringing.size:
        p = ringing[np.argmin(-ringing.real / np.abs(ringing))]
        parts.append(f"the least damped at {number(abs(p) / (2 * np.pi))} Hz (ζ {number(-p.real / abs(p))})")
    elif moving.size:
        parts.append(f"the slowest with {number(1 / np.abs(moving.real).min())} s")
    return parts
