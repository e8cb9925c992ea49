"""A wing of two modes with hostile channel names, records of it, and methods compared on them."""

from functools import cache

import numpy as np

from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.truth import Truth
from identify.compare import Comparison, Failure, Row, Trial
from identify.method import fit, method_class
from identify.metrics.metrics import default_band
from identify.score import score

DT = 0.05
EVIL = "<script>alert(1)</script>"
OUTPUTS = (f"{EVIL} [deg]", 'cost $a$ & "b" [m/s]')
RANK_BY = ("pole_error_max", "frf_error_h2")
METHODS = (("po_moesp", 4, {"block_rows": 12}), ("ssarx", 4, {"past": 12, "future": 12}), ("arx", 8, {}))


def block(wn, zeta):
    """Continuous modal block, discretised exactly: exp(-zeta wn dt) times a rotation."""
    angle, decay = wn * np.sqrt(1 - zeta**2) * DT, np.exp(-zeta * wn * DT)
    return decay * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


@cache
def truth():
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = block(1.0, 0.2), block(12.0, 0.1)
    B, C = np.array([[0.2, 0.1], [0, 0.3], [0.4, 0], [0.1, 0.5]]), np.array([[1.0, 0, 0.5, 0.2], [0.3, 1, 0, 0.6]])
    model = StateSpaceModel(A, B, C, np.zeros((2, 2)), DT, inputs=["flap [deg]", "tab [deg]"], outputs=list(OUTPUTS))
    return Truth(model, "exact", {"mass": (1.5, "kg")}, "any")


def data(seed, noise, loop=None):
    u = np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], (400, 2)), 2, axis=0)
    model = truth().model
    y = model.simulate(u)
    y = y + noise * y.std(0) * np.random.default_rng(seed + 100).standard_normal(y.shape)
    return Experiment(u, y, dt=DT, inputs=model.inputs, outputs=model.outputs, loop=loop)


def validation(loop=None):
    """A record to judge by, and its noise-free twin."""
    return data(50, 0.05, loop), data(50, 0.0, loop)


def judged(method, order, runs, loop=None, **settings):
    """Estimates of so many runs, and their scores."""
    record, clean = validation(loop)
    estimates = tuple(fit(data(k, 0.05, loop), method, order=order, **settings) for k in range(runs))
    return estimates, tuple(score(e, record, truth(), horizons=(4,), clean=clean) for e in estimates)


def statistics(values):
    q25, median, q75 = np.percentile(values, [25, 50, 75])
    return {"median": median, "q25": q25, "q75": q75, "min": min(values), "max": max(values), "mean": np.mean(values)}


def row(label, method, order, runs, **settings):
    estimates, scores = judged(method, order, runs, **settings)
    trials = [
        Trial(label, method, order, f"run {k}", e, s) for k, (e, s) in enumerate(zip(estimates, scores, strict=True))
    ]
    summary = {name: statistics([s.values[name] for s in scores]) for name in scores[0].values}
    rank = float(np.sqrt(np.prod([summary[m]["median"] for m in RANK_BY])))
    return Row(label, method, order, method_class(method).closed_loop, tuple(trials), summary, rank)


@cache
def comparison(runs=2):
    """Three methods on the wing, one of them under a label, and one that failed."""
    record, clean = validation()
    rows = [row("short" if name == "ssarx" else name, name, order, runs, **more) for name, order, more in METHODS]
    rows.sort(key=lambda r: r.rank_value)
    why = "too few samples"
    trials = tuple(Trial("iem", "iem", 4, f"run {k}", failure=Failure(why)) for k in range(runs))
    rows.append(Row("iem", "iem", 4, True, trials, {}, np.inf, why))
    return Comparison(
        name="wing / open",
        dt=DT,
        closed=False,
        rows=tuple(rows),
        validation=record,
        rank_by=RANK_BY,
        truth=truth(),
        truth_score=score(truth().model, record, truth(), clean=clean),
        clean=clean,
        band_hz=default_band(truth().poles, DT),
        horizons_s=(0.2,),
    )


def loop_of(closed):
    return Loop("closed" if closed else "open")
