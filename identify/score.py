"""Score: every metric of one estimate on one record, and against the truth where it is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Dynamic, Model, Predictor
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.metrics import metrics
from identify.steps.initial_state import initial_state

PART = 10  # samples a state in a gap-free part, lest the initial state alone explain it

# Metrics that the scenario file and tables may name, with their unit and whether smaller is better.
METRICS: dict[str, tuple[str, bool]] = {
    "pole_error_max": ("relative s-plane distance of the worst matched pole (a missing pole counts 1)", True),
    "pole_error_mean": ("mean relative s-plane distance of the matched poles (a missing pole counts 1)", True),
    "pole_error_frequency_percent": ("worst natural-frequency error of the oscillatory poles, %", True),
    "pole_error_damping": ("worst damping-ratio error of the oscillatory poles", True),
    "pole_error_time_constant_percent": ("worst time-constant error of the real poles, %", True),
    "pole_error_integrator_rad_s": ("worst distance of the integrators from s = 0, rad/s", True),
    "pole_error_z_max": ("worst |lambda - lambdahat|", True),
    "pole_error_z_mean": ("mean |lambda - lambdahat|", True),
    "poles_missing": ("true poles without a partner", True),
    "poles_surplus": ("estimated poles without a partner", True),
    "frf_error_h2": ("relative H2-type error of the frequency response over the band", True),
    "frf_error_peak": ("worst relative error of the frequency response over the band", True),
    "impulse_error": ("relative error of the first 200 Markov parameters (e_h)", True),
    "fit_simulation": ("fit of the simulated output on the validation record, %", False),
    "fit_one_step": ("fit of the one-step prediction on the validation record, %", False),
    "fit_clean": ("fit of the simulated output on the noise-free twin of the validation run, %", False),
    "fit_below_floor": (
        "points by which the fit on the noise-free twin stays below that of the linearised truth",
        True,
    ),
    "vaf_simulation": ("variance accounted for by the simulated output, %", False),
    "vaf_one_step": ("variance accounted for by the one-step prediction, %", False),
}


@dataclass(frozen=True)
class Score:
    """Metrics by full name: overall values, and (for fit and VAF) one value an output.

    Fit and VAF are clipped at 0; `…_unclipped` beside them are not. reason : why a score is absent, or None.
    """

    values: Mapping[str, float]
    per_output: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    reason: str | None = None


def score(
    estimate: Estimate | Model,
    validation: Experiment,
    truth: Truth | None = None,
    *,
    horizons: Sequence[int] = (),
    band_hz: tuple[float, float] | None = None,
    clean: Experiment | None = None,
) -> Score:
    """Score an estimate (or a model) on a validation record, and against the truth when it is given.

    Simulation and one-step prediction start from the initial state that fits the record best; where samples are missing,
    each gap-free part does, of at least PART samples a state (or the longest). horizons : further prediction horizons in
    samples, reported as fit_<h>_step. A model without noise part is not scored on prediction. clean : the noise-free twin
    of a simulated validation run, scored as fit_clean (simulation) and, at the longest horizon, fit_clean_<h>_step.
    """
    model = estimate.model if isinstance(estimate, Estimate) else estimate
    check_same_system(model, validation)
    values, per_output = {}, {}
    parts = gap_free((validation,), PART * model.to_state_space().order).parts
    y, predicted = np.concatenate([part.y for part in parts]), [predictions(model, part, horizons) for part in parts]
    for name in predicted[0]:
        yhat = np.concatenate([each[name] for each in predicted])
        for metric, function in (("fit", metrics.fit_percent), ("vaf", metrics.vaf_percent)):
            raw = function(y, yhat)
            per_output[f"{metric}_{name}"] = tuple(np.maximum(raw, 0).tolist())
            per_output[f"{metric}_{name}_unclipped"] = tuple(raw.tolist())
    values |= {name: float(np.mean(each)) for name, each in per_output.items()}
    if clean is not None:
        values |= clean_fits(model, clean, horizons)
    if truth is not None:
        values |= truth_errors(model, truth, band_hz)
    return Score(values, per_output)


def clean_fits(model: Model, clean: Experiment, horizons: Sequence[int] = ()) -> dict[str, float]:
    """Mean clipped fits on a noise-free run, by simulation and at the longest horizon.

    For the linearised truth itself they are the linearisation floor: what nonlinearity alone costs.
    """
    yhat = predictions(model, clean, [max(horizons)] if horizons else [])
    yhat.pop("one_step", None)
    fits = {name: float(np.mean(np.maximum(metrics.fit_percent(clean.y, each), 0))) for name, each in yhat.items()}
    return {"fit_clean" if name == "simulation" else f"fit_clean_{name}": fit for name, fit in fits.items()}


def floor_metric(truth: Truth, horizons: Sequence[int] = ()) -> str:
    """Return the metric in which models are compared with the floor.

    Simulation where the truth forgets its past; the longest prediction horizon where it integrates: a simulation of
    integrators over minutes judges luck.
    """
    forgets = np.abs(truth.poles).max(initial=0) < 1 - 1e-9
    return "fit_clean" if forgets or not horizons or truth.model.K is None else f"fit_clean_{max(horizons)}_step"


def predictions(model: Dynamic, experiment: Experiment, horizons: Sequence[int] = ()) -> dict[str, np.ndarray]:
    """Return yhat (N, ny) by name: simulation, one_step, and <h>_step for the further horizons."""
    x0 = initial_state(model, experiment, predictor=False)
    with np.errstate(over="ignore", invalid="ignore"):
        yhat = {"simulation": model.response(experiment, x0)}
        if isinstance(model, Predictor) and model.predicts:
            x0 = initial_state(model, experiment, predictor=True)
            ahead = model.predictions(experiment, (1, *horizons), x0)
            yhat |= dict(zip(("one_step", *(f"{h}_step" for h in horizons)), ahead, strict=True))
    return yhat


def truth_errors(model: Model, truth: Truth, band_hz: tuple[float, float] | None = None) -> dict[str, float]:
    """Return pole, frequency-response and impulse-response errors of a model against the truth."""
    true = truth.model
    if abs(model.dt / true.dt - 1) > 1e-6:
        raise ExciteError(f"truth has dt {true.dt} s, the model {model.dt} s; lift the truth to the model's rate")
    p = metrics.pole_errors(truth.poles, model.poles(), true.dt)
    relative = np.concatenate([p.relative, np.ones(p.missing)])
    h2, peak = metrics.frf_errors(model, true, band_hz or metrics.default_band(truth.poles, true.dt))

    def worst(errors: np.ndarray) -> float:
        return float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan")

    return {
        "pole_error_max": float(relative.max(initial=0)),
        "pole_error_mean": float(relative.mean()),
        "pole_error_frequency_percent": worst(p.frequency_percent),
        "pole_error_damping": worst(p.damping),
        "pole_error_time_constant_percent": worst(p.time_constant_percent),
        "pole_error_integrator_rad_s": worst(p.integrator_rad_s),
        "pole_error_z_max": float(p.z.max(initial=0)),
        "pole_error_z_mean": float(p.z.mean()),
        "poles_missing": p.missing,
        "poles_surplus": p.surplus,
        "frf_error_h2": h2,
        "frf_error_peak": peak,
        "impulse_error": metrics.impulse_error(model, true),
    }


def check_same_system(model: Model, experiment: Experiment) -> None:
    """Refuse to score a model on a record of another rate or other channel counts."""
    if experiment.dt is None or abs(model.dt / experiment.dt - 1) > 1e-6:
        raise ExciteError(f"the model has dt {model.dt} s, the record {experiment.dt} s; resample the record")
    for what, columns in (("inputs", experiment.u), ("outputs", experiment.y)):
        if len(getattr(model, what)) != columns.shape[1]:
            raise ExciteError(
                f"the model has {len(getattr(model, what))} {what}, the record {columns.shape[1]}; choose the channels"
            )
