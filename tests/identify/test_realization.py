"""Realizations of impulse responses, free decays and general data: Ho-Kalman/Kung, ERA and OKID.

Figures of Example 3.1 of Miller (2012) are medians over seeds 0 to 99 of small independent prototypes.
"""

import numpy as np
import pytest
import scipy.linalg as la

from excite.errors import ExciteError, Unsupported
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import markov, observability, simulate
from excite.types.experiment import Experiment
from identify.examples import closed_loop
from identify.fit import fit
from identify.metrics.impulse import impulse_error
from identify.metrics.poles import pole_errors
from identify.registry import load_method
from identify.steps.hankel_svd import hankel_of, hankel_svd
from identify.steps.shift import Shift

ON_RESPONSES = ["ho_kalman", "era"]


def pole_error(truth, model):
    return pole_errors(truth.poles(), model.poles(), 1.0).z.max()


def impulse(truth, channel, at=0, height=1.0, samples=80):
    u = np.zeros((samples, len(truth.inputs)))
    u[at, channel] = height
    return Experiment(u, truth.simulate(u), dt=1.0)


def decay(truth, x0, samples=80):
    return Experiment(None, observability(truth.A, truth.C, samples) @ x0, dt=1.0)


def simulated(estimate, records):
    return [estimate.model.simulate(r.u, x0) for r, x0 in zip(records, estimate.x0, strict=True)]


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.parametrize("method", ON_RESPONSES)
def test_impulses_of_any_height_and_instant_are_realized_exactly(system, method, n):
    truth = system(n)
    records = [impulse(truth, 0, 3, -2.5), impulse(truth, 1, 10, 0.1)]
    estimate = fit(records, method)
    assert estimate.order == n and "largest singular-value gap" in estimate.warnings[0]
    assert pole_error(truth, estimate.model) < 1e-9
    assert impulse_error(estimate.model, truth) < 1e-9
    assert all(not x0.any() for x0 in estimate.x0) and len(estimate.x0) == 2


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.parametrize("method", ON_RESPONSES)
def test_free_decays_are_realized_exactly_and_return_their_initial_states(system, method, n):
    truth = system(n)
    records = [decay(truth, x0) for x0 in np.random.default_rng(1).standard_normal((3, n))]
    estimate = fit(records, method, n)
    assert pole_error(truth, estimate.model) < 1e-9
    assert not estimate.model.inputs and estimate.model.B.shape == (n, 0)
    for record, yhat in zip(records, simulated(estimate, records), strict=True):
        np.testing.assert_allclose(yhat, record.y, atol=1e-9)


@pytest.mark.parametrize("method", ON_RESPONSES)
def test_impulses_and_decays_are_columns_side_by_side(system, method):
    truth = system(6)
    x0 = np.random.default_rng(2).standard_normal(6)
    records = [decay(truth, x0, 60), impulse(truth, 1, 2), impulse(truth, 0), impulse(truth, 0, 4, 3.0)]
    records[0] = Experiment(np.zeros((60, 2)), records[0].y, dt=1.0)
    estimate = fit(records, method, 6)
    assert pole_error(truth, estimate.model) < 1e-9 and impulse_error(estimate.model, truth) < 1e-9
    for record, yhat in zip(records, simulated(estimate, records), strict=True):
        np.testing.assert_allclose(yhat, record.y, atol=1e-9)
    assert "lengths differ" in estimate.warnings[0]


def test_inputs_at_zero_make_a_decay_with_a_warning(system):
    truth = system(2)
    silent = Experiment(np.zeros((80, 2)), decay(truth, np.ones(2)).y, dt=1.0)
    estimate = fit(silent, "era", 2)
    assert not estimate.model.inputs and "every input is zero" in estimate.warnings[0]


def test_repetitions_are_averaged_by_least_squares(system):
    """Heights 1 and 3: h = (1 y_1 + 3 y_2) / (1 + 9)."""
    truth = system(2)
    rng = np.random.default_rng(3)
    noisy = [
        Experiment(r.u, r.y + 0.1 * rng.standard_normal(r.y.shape), dt=1.0)
        for r in (impulse(truth, 0), impulse(truth, 0, 0, 3.0), impulse(truth, 1))
    ]
    mean = Experiment(impulse(truth, 0).u, (noisy[0].y + 3 * noisy[1].y) / 10, dt=1.0)
    np.testing.assert_allclose(
        fit(noisy, "era", 2).model.impulse(30), fit([mean, noisy[2]], "era", 2).model.impulse(30), atol=1e-12
    )


def test_kung_and_era_differ_as_stated(system):
    """Kung: least squares on the shift of Gamma alone. ERA: S^-1/2 U^T H(1) V S^-1/2, the minimiser of
    ||Gamma A Delta - H(1)|| (Miller 2012, eq. 3.12), which uses one more parameter. Equal without noise only.
    """
    rng = np.random.default_rng(4)
    h = system(4).impulse(41)[1:]
    for noise, equal in ((0, True), (0.05, False)):
        noisy = h + noise * rng.standard_normal(h.shape)
        H, shifted = hankel_svd(noisy[:-1], 15), hankel_of(noisy[1:], 15)
        ours, theirs = (np.poly(found.A) for found in (Shift.of_pair(H, shifted, 4), Shift.of_gamma(H.gamma(4), H.ny)))
        assert np.allclose(ours, theirs, atol=1e-10) is equal
        A = Shift.of_pair(H, shifted, 4).A
        best = la.pinv(H.gamma(4)) @ shifted @ la.pinv(H.delta(4))
        np.testing.assert_allclose(A, best, atol=1e-10)


@pytest.mark.parametrize(("sigma", "bar"), [(0.001, 3.6e-4), (0.01, 3.5e-3)])
@pytest.mark.parametrize("method", ON_RESPONSES)
def test_impulse_response_of_example_3_1(miller_31, method, sigma, bar):
    clean = impulse(miller_31, 0, samples=149)  # k = 30, l = 119
    errors = [
        pole_error(miller_31, fit(Experiment(clean.u, y, dt=1.0), method, 4, block_rows=30).model)
        for y in (clean.y + sigma * np.random.default_rng(seed).standard_normal(clean.y.shape) for seed in range(100))
    ]
    assert np.median(errors) == pytest.approx(bar, rel=0.15)


def test_the_example_is_the_shared_one(miller_31, cases):
    for ours, theirs in ((miller_31.A, cases.A31), (miller_31.B, cases.B31), (miller_31.C, cases.C31)):
        np.testing.assert_array_equal(ours, theirs)


def test_responses_refuse_what_they_cannot_use(system):
    truth = system(2)
    one, two = impulse(truth, 0), impulse(truth, 1)
    refused = {
        "record 1: the input is not an impulse": ([one, Experiment(np.ones((80, 2)), one.y, dt=1.0)], {}),
        "input 'u2' has no impulse in any record": (one, {}),
        "give at most 79": ([one, two], {"block_rows": 400}),
        "record more samples": ([Experiment(one.u[::-1], one.y, dt=1.0), two], {}),
    }
    for message, (data, settings) in refused.items():
        with pytest.raises((Unsupported, ExciteError), match=message):
            fit(data, "ho_kalman", 2, **settings)
    with pytest.raises(Unsupported, match="block_columns 70 with block_rows 20: the records allow at most 59"):
        fit([one, two], "era", 2, block_columns=70)
    with pytest.raises(ExciteError, match="block_columns: 0; give a whole number"):
        load_method("era", block_columns=0)
    with pytest.raises(ExciteError, match="largest possible, 57"):
        fit([one, two], "ho_kalman", 58)
    with pytest.raises(ExciteError, match="its outputs differ"):
        fit([one, Experiment(two.u, two.y[:, :2], dt=1.0)], "era", 2)
    with pytest.raises(ExciteError, match="not real numbers"):
        fit(Experiment(one.u, one.y * 1j, dt=1.0), "era", 2)
    with pytest.raises(ExciteError, match="shows no gap"):
        fit(Experiment(None, 0.5 ** np.arange(3.0), dt=1.0), "ho_kalman", block_rows=3)


def general(truth, seed, samples=1500, noise=0.0):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, len(truth.inputs)))
    y = truth.simulate(u, rng.standard_normal(truth.order))
    return Experiment(u, y + noise * y.std(0) * rng.standard_normal(y.shape), dt=1.0)


@pytest.mark.parametrize("n", [1, 2, 6, 12])
def test_okid_is_exact_without_noise(system, n):
    truth = system(n)
    records = [general(truth, 0, 700), general(truth, 1, 800)]
    estimate = fit(records, "okid", feedthrough=True)
    assert estimate.order == n
    assert pole_error(truth, estimate.model) < 1e-9
    assert impulse_error(estimate.model, truth) < 1e-9
    for record, yhat in zip(records, simulated(estimate, records), strict=True):
        np.testing.assert_allclose(yhat, record.y, atol=1e-8)


def test_okid_stands_beside_po_moesp_on_white_noise_data(cases):
    """W1: two lightly damped modes, random +-1 input, 20 dB; python-control's era has 3.1e-4, po_moesp 3.5e-4."""
    A, B, C, D, *_ = cases.w1_to_w4()["W1"]
    truth = StateSpaceModel(A, B, C, D, 1.0)
    errors = {"okid": [], "po_moesp": []}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = np.sign(rng.standard_normal((10_000, 1)))
        y = truth.simulate(u)
        data = Experiment(u, y + 0.1 * y.std() * rng.standard_normal(y.shape), dt=1.0)
        for method, found in errors.items():
            found.append(pole_error(truth, fit(data, method, 4).model))
    medians = {method: np.median(found) for method, found in errors.items()}
    assert medians["okid"] < 1.15 * medians["po_moesp"] < 6e-4, medians


def test_okid_finds_the_gain_and_the_innovations():
    rng = np.random.default_rng(5)
    A = la.block_diag([[0.8, 0.3], [-0.3, 0.8]], [[0.5, 0.4], [-0.4, 0.5]])
    C, B, K = rng.standard_normal((2, 4)), rng.standard_normal((4, 1)), 0.1 * rng.standard_normal((4, 2))
    cov = np.array([[0.2, 0.05], [0.05, 0.1]])
    assert np.abs(la.eigvals(A - K @ C)).max() < 1
    truth = StateSpaceModel(A, B, C, np.zeros((2, 1)), 1.0, K=K, innovation_cov=cov)
    u, e = rng.standard_normal((20_000, 1)), rng.standard_normal((20_000, 2)) @ la.cholesky(cov)
    model = fit(Experiment(u, truth.simulate(u) + simulate(A, K, C, np.eye(2), e), dt=1.0), "okid", 4).model
    np.testing.assert_allclose(model.innovation_cov, cov, rtol=0.05, atol=0.003)
    noise, expected = (markov(m.A, m.K, m.C, np.eye(2), 20)[1:] for m in (model, truth))
    assert np.linalg.norm(noise - expected) < 0.1 * np.linalg.norm(expected)


def test_okid_converges_in_closed_loop_even_where_the_order_leaves_no_states_for_the_noise():
    """Mercère et al. (2016), V-B: the path from u to y has 2 states, the noise 2 more."""
    for order in (2, 4):
        errors = [
            np.median([impulse_error(fit(d, "okid", order).model, t) for d, t in map(closed_loop, [N] * 12, range(12))])
            for N in (1000, 16_000)
        ]
        assert errors[1] < 0.4 * errors[0] and errors[1] < 0.012, errors


def test_okid_refuses_an_input_too_poor_for_its_lags(system):
    t = np.arange(2000)
    u = np.column_stack([np.sin(0.3 * t), np.sin(1.1 * t)])
    y = system(2).simulate(u)
    with pytest.raises(ExciteError, match="persistently exciting of order 2, but 41 rows of lags need order 41"):
        fit(Experiment(u, y, dt=1.0), "okid", 2)
    with pytest.raises(Unsupported, match="the largest possible lags \\+ 1 is 33"):
        fit(general(system(2), 0, 200), "okid", 2, lags=50)
