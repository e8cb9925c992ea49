"""README, "Which method when": every row measured, so that the table cannot drift from the truth.

A method's error is that of its impulse response (where there is no input, that of its worst pole): the median over seeds,
the geometric mean over a short and a long record. `python -m pytest -m study -s tests/test_which_method.py` prints them all.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest
import scipy.linalg as la
from paths import ROOT
from scipy.signal import lfilter

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import observability, simulate
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from identify.fit import fit
from identify.metrics.impulse import impulse_error
from identify.metrics.poles import pole_errors
from identify.registry import METHODS

# The README's promises, as multiples of the smallest error of all methods that take the data.
FIRST, USE, ALSO, AVOID = 1.2, 1.5, 3.0, 2.5
BIASED = 0.6  # error on the long record over that on the short one, eight times shorter; 0.35 when consistent
USEFUL = 0.1  # largest error of the best method

README = (ROOT / "README.md").read_text(encoding="utf-8")


def turn(r, w):
    return r * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]])


def plant(A, B, C):
    return StateSpaceModel(A, B, C, np.zeros((len(C), np.shape(B)[1])), 1.0)


MODES = plant(
    la.block_diag(turn(0.95, 0.4), turn(0.9, 1.2)),
    [[1.0], [0.5], [0.8], [-0.6]],
    [[1.0, 0, 0.5, 0.3], [0, 0.7, -0.6, 1]],
)
UNSTABLE = plant(la.block_diag(1.05, turn(0.9, 0.8)), [[0.3], [1.0], [0.5]], [[1.0, 0.5, 0.2], [0, 1, 0.4]])
HELD = la.expm(0.01 * np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, -20, 20], [0, 0, 0, 0]]))
ATTITUDE = plant(HELD[:3, :3], HELD[:3, 3:], np.eye(2, 3))  # angle and rate behind a 50 ms actuator, every 10 ms


def structure_with_49_sensors():
    rng = np.random.default_rng(7)
    w, zeta = np.array([0.19, 0.44, 0.75, 1.13, 1.63, 2.2]), np.array([0.02, 0.015, 0.02, 0.01, 0.015, 0.01])
    A = la.block_diag(*(turn(np.exp(-z * x), x) for x, z in zip(w, zeta, strict=True)))
    return plant(A, rng.standard_normal((12, 1)), rng.standard_normal((49, 12)))


def play(
    samples,
    seed,
    system=MODES,
    gain=None,
    noise=0.0,
    pole=0.0,
    process=0.0,
    on_input=0.0,
    hold=1,
    height=1.0,
    reference=False,
):
    """u = r - gain y on x+ = A x + B u + w, y = C x + v; gain None: open loop.

    r : random levels or, with hold above 1, signs held so long; noise, pole : v; process : w; on_input : noise of the
    measured u.
    """
    rng = np.random.default_rng(seed)
    n, nu, ny = system.order, len(system.inputs), len(system.outputs)
    r = rng.standard_normal((samples, nu)) if hold == 1 else rng.choice([-1.0, 1.0], (-(-samples // hold), nu))
    r = height * r.repeat(hold, axis=0)[:samples]
    v = noise * np.sqrt(1 - pole**2) * lfilter([1.0], [1.0, -pole], rng.standard_normal((samples, ny)), axis=0)
    w = process * rng.standard_normal((samples, n))
    A, B, C, F = system.A, system.B, system.C, np.zeros((nu, ny)) if gain is None else np.atleast_2d(gain)
    direct = np.block([[np.eye(nu), -F, np.zeros((nu, n))], [np.zeros((ny, nu)), np.eye(ny), np.zeros((ny, n))]])
    both = simulate(
        A - B @ F @ C, np.hstack([B, -B @ F, np.eye(n)]), np.vstack([-F @ C, C]), direct, np.hstack([r, v, w])
    )
    u = both[:, :nu] + on_input * rng.standard_normal((samples, nu))
    return Experiment(
        u, both[:, nu:], dt=1.0, reference=r if reference else None, loop=Loop("open" if gain is None else "closed")
    ), system


def prescribed(samples, seed, u, noise):
    """Response from rest to the input u(samples), with white noise."""
    u = u(samples)[:, None]
    y = MODES.simulate(u)
    return Experiment(u, y + noise * np.random.default_rng(seed).standard_normal(y.shape), dt=1.0), MODES


def staircase(samples):
    return np.repeat([0.0, 1, -1, 2, 0], -(-samples // 5))[:samples]


def free_decay(samples, seed):
    y = observability(MODES.A, MODES.C, samples) @ np.ones(4)
    return Experiment(None, y + 0.05 * np.random.default_rng(seed).standard_normal(y.shape), dt=1.0), MODES


def outputs_alone(samples, seed):
    data, truth = play(samples, seed, process=1.0, noise=0.3, height=0.0)
    return Experiment(None, data.y, dt=1.0), truth


def with_gaps(samples, seed):
    data, truth = play(samples, seed, noise=0.8)
    y = data.y.copy()
    y[np.random.default_rng(seed).random(samples) < 0.02] = np.nan
    return replace(data, y=y), truth


@dataclass(frozen=True, eq=False)
class Situation:
    """build(samples, seed) -> data and truth; order asked for (arx: lags); lags of the impulse response compared."""

    build: Callable[[int, int], tuple[Experiment, StateSpaceModel]]
    samples: tuple[int, ...] = (2000, 16_000)
    order: int = 4
    arx: int = 20
    lags: int = 200
    seeds: int = 8
    settings: dict[str, dict] = field(default_factory=dict)


SHORT_HORIZONS = {
    **{name: {"block_rows": 5} for name in ("moesp", "po_moesp", "pi_moesp", "io_realization")},
    **{name: {"past": 5, "future": 5} for name in ("cva", "iem", "n4sid", "parsim_k", "pbsid", "ssarx", "wfa")},
    "okid": {"lags": 15},
}
LOOP = {"gain": [0.25, 0.1], "noise": 1.5, "pole": 0.9}
# The README's rows in their order. Unless said otherwise: order of the plant, default settings, a short and a long record.
SITUATIONS = {
    "open loop, white noise on the outputs": Situation(partial(play, noise=0.8)),
    "open loop, white noise, eight times larger on one output": Situation(partial(play, noise=np.array([1.6, 0.2]))),
    "open loop, coloured noise on the outputs; order of the plant alone": Situation(partial(play, noise=0.8, pole=0.9)),
    "open loop, coloured noise on the outputs; order of plant and noise": Situation(
        partial(play, noise=0.8, pole=0.9), order=6, seeds=12
    ),
    "open loop, noise through the plant (gusts)": Situation(partial(play, process=0.5, noise=0.3)),
    "closed loop, no reference recorded; order of plant and noise": Situation(partial(play, **LOOP), order=6),
    "closed loop, reference recorded; order of the plant alone": Situation(partial(play, **LOOP, reference=True)),
    "closed loop, integrating plant": Situation(
        partial(play, system=ATTITUDE, gain=[16.0, 8.0], noise=0.1, hold=10, height=16.0, reference=True),
        order=3,
        lags=40,
    ),
    "closed loop, unstable plant": Situation(
        partial(play, system=UNSTABLE, gain=[0.5, 0.0], process=0.2, noise=0.3, reference=True), order=3, lags=20
    ),
    "closed loop, noise on the measured input, reference recorded": Situation(
        partial(play, gain=[0.25, 0.1], process=0.2, noise=0.5, on_input=0.6, reference=True)
    ),
    "impulse": Situation(partial(prescribed, u=lambda N: 1.0 * (np.arange(N) == 60), noise=0.05), (240,)),
    "free decay": Situation(free_decay, (200,)),
    "one step": Situation(partial(prescribed, u=lambda N: 1.0 * (np.arange(N) >= 15), noise=0.05), (200,)),
    "several steps": Situation(partial(prescribed, u=staircase, noise=0.1), (750,)),
    "outputs alone": Situation(outputs_alone),
    "49 outputs, short record": Situation(
        partial(play, system=structure_with_49_sensors(), noise=np.geomspace(2, 15, 49)),
        (1500,),
        order=12,
        arx=3,
        seeds=2,
        settings=SHORT_HORIZONS,
    ),
    "a very long record (300 000 samples)": Situation(partial(play, noise=0.8), (300_000,), seeds=2),
    "gaps: one sample in 50 missing": Situation(with_gaps, (2000,), seeds=5),
}


def measured(name, seeds=None):
    """Errors of all methods that take the data: name -> one for each record length."""
    situation = SITUATIONS[name]
    lengths = [
        [situation.build(samples, seed) for seed in range(seeds or situation.seeds)] for samples in situation.samples
    ]
    errors = {}
    for method in METHODS:
        try:
            error(situation, method, *lengths[0][0])
        except ExciteError:
            continue  # what takes the first record has to take them all
        errors[method] = np.array([np.median([error(situation, method, *run) for run in runs]) for runs in lengths])
    return errors


def error(situation, method, data, truth):
    order = situation.arx if method == "arx" else situation.order
    model = fit(data, method, order, **situation.settings.get(method, {})).model
    if data.inputs:
        return impulse_error(model, truth, situation.lags)
    return pole_errors(truth.poles(), model.poles(), 1.0).z.max()


def ratios(errors):
    """Geometric mean over the lengths, relative to the best method, best first."""
    mean = {method: np.exp(np.log(found).mean()) for method, found in errors.items()}
    best = min(mean.values())
    return {method: mean[method] / best for method in sorted(mean, key=mean.get)}


def table():
    """situation -> (use, also works, avoid) as the README has them: method, or "the rest" -> reason to avoid it."""
    section = README.split("## Which method when\n")[1].split("\n## ")[0]
    rows = {}
    for line in re.findall(r"^\| (.*) \|$", section, re.MULTILINE)[1:]:
        situation, *cells = (cell.strip() for cell in line.split(" | "))
        rows[situation] = tuple(
            {
                m: why
                for group, why in re.findall(r"([^;(]+)(?:\(([^)]*)\))?", cell)
                for m in re.findall(r"`\w+`|the rest", group)
            }
            for cell in cells
        )
    return rows


def named(cell):
    return [method.strip("`") for method in cell if method != "the rest"]


def test_the_table_has_every_situation_and_every_method():
    rows = table()
    assert list(rows) == list(SITUATIONS)
    assert {method for cells in rows.values() for cell in cells for method in named(cell)} == set(METHODS)
    assert all(all(avoid.values()) for *_, avoid in rows.values()), "a method to avoid without a reason"


def holds(name, errors):
    """Assert one row of the table and return the figures."""
    cells, ratio = table()[name], ratios(errors)
    shown = "\n".join(f"{m:15s} {ratio[m]:7.2f}   " + " ".join(f"{e:.5f}" for e in errors[m]) for m in ratio)
    mentioned = [method for cell in cells for method in named(cell)]
    rest = [method for method in errors if method not in mentioned]
    assert set(mentioned) <= set(errors) and len(set(mentioned)) == len(mentioned), f"{mentioned}\n{shown}"
    assert bool(rest) == (sum("the rest" in cell for cell in cells) == 1), f"{rest}\n{shown}"
    use, also, _ = ([*named(cell), *(rest if "the rest" in cell else ())] for cell in cells)
    assert errors[use[0]][-1] < USEFUL and ratio[use[0]] < FIRST, shown
    assert all(ratio[method] < USE for method in use), shown
    assert all(ratio[method] < ALSO for method in also), shown
    for key, why in cells[2].items():
        for method in rest if key == "the rest" else [key.strip("`")]:
            assert ratio[method] > AVOID, f"{method}\n{shown}"
            if "biased" in why:
                short, long = errors[method]
                assert long > BIASED * short, f"{method}\n{shown}"
    return shown


@pytest.mark.parametrize("name", SITUATIONS)
def test_row(name):
    holds(name, measured(name))


@pytest.mark.parametrize("method", ["ssinnov1", "ssinnov2"])
def test_without_their_guard_the_ssinnov_methods_find_an_unstable_plant(method):
    situation = replace(SITUATIONS["closed loop, unstable plant"], settings={method: {"stability_guard": False}})
    runs = [situation.build(16_000, seed) for seed in range(5)]
    ours, best = (np.median([error(situation, name, *run) for run in runs]) for name in (method, "ssarx"))
    assert ours < ALSO * best


@pytest.mark.study
@pytest.mark.parametrize("name", SITUATIONS)
def test_row_over_many_seeds(name):
    print(f"\n{name}\n{holds(name, measured(name, 40))}")
