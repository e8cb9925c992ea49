"""Closed loop: the joint information of lagged outputs and inputs, on simulated loops around an ARX(2, 2) plant."""

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.generators.prbs import prbs
from excite.persistency.certificate import certify
from excite.persistency.regressors import information
from excite.types.experiment import Experiment

A, B = (-1.5, 0.7), (1.0, 0.5)


def closed_loop(reference, gain=0.1, noise=0.02, seed=0):
    """y(t) = 1.5 y(t-1) - 0.7 y(t-2) + u(t-1) + 0.5 u(t-2) + e(t) under static feedback u = r - gain y."""
    e = noise * np.random.default_rng(seed).standard_normal(len(reference))
    y, u = np.zeros(len(e) + 2), np.zeros(len(e) + 2)
    for t in range(2, len(y)):
        y[t] = e[t - 2] - A[0] * y[t - 1] - A[1] * y[t - 2] + B[0] * u[t - 1] + B[1] * u[t - 2]
        u[t] = reference[t - 2] - gain * y[t]
    return Experiment(u[2:], y[2:], dt=0.1, reference=reference)


N = 10_000
QUIET, STEP = np.zeros(N), (np.arange(N) >= 10) * 1.0
PRBS = np.resize(prbs(order=9, dt=0.1).u[:, 0], N)


def test_static_feedback_without_a_reference_is_rejected_though_the_input_is_rich():
    data = closed_loop(QUIET)
    assert certify(data, block_rows=50).order == 50
    verdict = information(data, 2, 2)
    assert verdict.singular and verdict.status == "rejected" and verdict.path == "blocked-qr" and not verdict.ok
    assert verdict.condition == np.inf and verdict.to_dict()["condition"] is None
    assert {name for name, _ in verdict.weakest} <= {"u1(t-1)", "u1(t-2)", "y1(t-1)", "y1(t-2)"}
    assert "linearly dependent" in str(verdict)


def test_a_step_is_accepted_with_a_warning_and_its_condition():
    verdict = information(closed_loop(STEP), 2, 2)
    assert verdict.status == "accepted with a warning" and 2e4 < verdict.condition < 5e5
    assert f"{verdict.condition:.2g}" in verdict.text


def test_a_prbs_is_accepted():
    verdict = information(closed_loop(PRBS), 2, 2)
    assert verdict.status == "accepted" and 5 < verdict.condition < 40


def test_a_structure_too_small_to_see_the_feedback_is_not_singular():
    """u(t) = -K y(t) ties u(t-1) to y(t-1); with outputs from t-1 and inputs from t-2 and no overlap nothing is tied."""
    assert information(closed_loop(QUIET), 1, 1).singular
    assert not information(closed_loop(QUIET), 1, 1, delay=2).singular


def test_condition_equals_that_of_the_explicit_regression():
    rng = np.random.default_rng(3)
    data = Experiment(rng.standard_normal((400, 2)) * [1, 50], rng.standard_normal((400, 1)).cumsum(0), dt=1.0)
    columns = [data.y[3 - i : 400 - i] for i in (1, 2)] + [data.u[3 - i : 400 - i] for i in (1, 2, 3)]
    R = np.hstack(columns)
    s = np.linalg.svd(R / np.linalg.norm(R, axis=0), compute_uv=False)
    verdict = information(data, 2, 3)
    assert verdict.condition == pytest.approx((s[0] / s[-1]) ** 2, rel=1e-6) and verdict.equations == 397


def test_missing_samples_part_a_record_in_two():
    data = closed_loop(PRBS)
    y = data.y.copy()
    y[5000] = np.nan
    parted = information(Experiment(data.u, y, dt=0.1), 2, 2)
    whole = information([data.window(0, 5000), data.window(5001)], 2, 2)
    assert parted.condition == pytest.approx(whole.condition) and parted.equations == N - 1 - 2 * 2


@pytest.mark.parametrize(
    ("views", "message"),
    [
        ((-1, 2), "na -1"),
        ((2, 2.0), "nb 2.0"),
        ((0, 0), "no lags"),
        ((2, 2, -1), "delay -1"),
        ((30, 30), "needs 62 rows"),
    ],
)
def test_structures_that_cannot_be_judged_are_refused(views, message):
    with pytest.raises(ExciteError, match=message):
        information(closed_loop(PRBS).window(0, 60), *views)
