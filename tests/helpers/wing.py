"""A wing of two modes with hostile channel names, records of it, and methods compared on them."""

from dataclasses import replace
from functools import cache

import numpy as np

from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.truth import Truth
from identify.compare import Entry, Failure, Judge, Trial, compared, run_trials
from identify.data.records import Records
from identify.registry import load_method

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


def judge(loop=None):
    record, clean = validation(loop)
    return Judge([record], truth(), clean=[clean], horizons=(4,))


@cache
def comparison(runs=2, closed=False, name="wing / open"):
    """Three methods on the wing, one of them under a label, and one that failed."""
    loop = loop_of(closed)
    chosen = [Entry("short" if m == "ssarx" else m, load_method(m, **more), (order,)) for m, order, more in METHODS]
    trials = []
    for k in range(runs):
        trials += run_trials(chosen, Records.of(data(k, 0.05, loop)), judge(loop), name=f"run {k}")
        trials.append(Trial("iem", "iem", 4, f"run {k}", failure=Failure("too few samples")))
    found = compared(trials, judge(loop), name=name, rank_by=RANK_BY, closed=closed)
    return replace(found, rows=tuple(without_floor(row) for row in found.rows))


def without_floor(row):
    """A row without the distance from the floor, whose column would make the terminal's table wider than it may be."""
    return replace(row, summary={name: s for name, s in row.summary.items() if name != "fit_below_floor"})


def loop_of(closed):
    return Loop("closed" if closed else "open")
