"""Fit, VAF, pole and frequency-response errors against hand-made cases."""

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.estimate import Estimate
from identify.estimate_json import estimate_from_dict, estimate_to_dict
from identify.metrics.fits import fit_percent
from identify.metrics.frequency import frf_errors
from identify.metrics.impulse import impulse_error
from identify.metrics.poles import pole_errors
from identify.metrics.vaf import vaf_percent
from identify.score import score
from identify.steps.initial_state import initial_state


def test_fit_and_vaf_of_seed_003_equation_40():
    y = np.array([[0.0, 1], [2, 1], [4, 4], [6, 4]])
    yhat = y + np.array([[1, 0], [1, 0], [1, 0], [1, 0.0]])
    np.testing.assert_allclose(fit_percent(y, yhat), [100 * (1 - 2 / np.sqrt(20)), 100])
    np.testing.assert_allclose(vaf_percent(y, yhat), [100, 100])  # an offset has no variance
    np.testing.assert_allclose(fit_percent(y, np.broadcast_to(y.mean(0), y.shape)), [0, 0], atol=1e-12)
    assert (fit_percent(y, -5 * y) < 0).all()


def test_constant_outputs_and_diverging_models_stay_numbers():
    y = np.column_stack([np.ones(5), np.arange(5.0)])
    fit = fit_percent(y, np.full((5, 2), np.inf))
    assert np.isnan(fit[0]) and fit[1] < -1e100 and np.isfinite(fit[1])


def test_pole_errors_in_engineering_terms():
    dt, true_s = 0.01, np.array([-1 + 20j, -1 - 20j, -0.5, 0])
    found_s = np.array([0.02, -0.6, -1.1 + 21j, -1.1 - 21j])
    p = pole_errors(np.exp(true_s * dt), np.exp(found_s * dt), dt)
    assert sorted(p.kind) == ["integrator", "oscillatory", "oscillatory", "real"] and (p.missing, p.surplus) == (0, 0)
    wn, wn_hat = abs(true_s[0]), abs(found_s[2])
    assert np.nanmax(p.frequency_percent) == pytest.approx(100 * (wn_hat / wn - 1))
    assert np.nanmax(p.damping) == pytest.approx(abs(1.1 / wn_hat - 1 / wn))
    assert np.nanmax(p.time_constant_percent) == pytest.approx(100 * (1 - 0.5 / 0.6))
    assert np.nanmax(p.integrator_rad_s) == pytest.approx(0.02)
    assert p.relative[p.kind.index("integrator")] == pytest.approx(0.02 / 0.5)
    assert p.z.max() == pytest.approx(abs(np.exp(true_s[0] * dt) - np.exp(found_s[2] * dt)))


def test_assignment_is_optimal_and_counts_what_is_left_over():
    true, found = np.exp([-1.0, -2.0, -3.0]), np.exp([-2.9, -1.05, -2.1, -9.0])
    p = pole_errors(true, found, 1.0)
    np.testing.assert_allclose(np.sort(p.estimated), np.sort(found[:3]))
    assert (p.missing, p.surplus) == (0, 1)
    assert pole_errors(found, true, 1.0).missing == 1


def first_order(pole=0.9, gain=1.0, K=None):
    return StateSpaceModel([[pole]], [[gain]], [[1]], [[0]], 0.1, K=K)


def test_frequency_response_errors_of_a_gain_error_are_that_error():
    h2, peak = frf_errors(first_order(gain=1.1), first_order(), (0.1, 4.0))
    assert h2 == pytest.approx(0.1) and peak == pytest.approx(0.1)
    assert impulse_error(first_order(gain=1.1), first_order()) == pytest.approx(0.1)


def test_a_missing_pole_counts_as_a_whole_error():
    two = StateSpaceModel(np.diag([0.9, 0.5]), [[1], [1]], [[1, 1]], [[0]], 0.1)
    values = score(first_order(), None, Truth(two, "exact")).values
    assert values["poles_missing"] == 1 and values["pole_error_max"] == 1.0


def test_the_truth_scores_perfectly_and_better_than_anything_else():
    rng = np.random.default_rng(0)
    truth, u = first_order(K=[[0.5]]), rng.standard_normal((2000, 1))
    data = Experiment(u, truth.simulate(u, [3.0]), dt=0.1)
    values = score(truth, data, Truth(truth, "exact"), horizons=[5], clean=data).values
    for name in ("fit_simulation", "fit_one_step", "fit_5_step", "fit_clean", "fit_clean_5_step"):
        assert values[name] == pytest.approx(100, abs=1e-6), name
    assert values["pole_error_max"] == values["frf_error_h2"] == values["impulse_error"] == 0
    worse = score(first_order(0.8, K=[[0.5]]), data, Truth(truth, "exact")).values
    assert worse["fit_simulation"] < 90 and worse["frf_error_peak"] > 0.1


def test_scores_are_clipped_and_unclipped_per_output_and_overall():
    rng = np.random.default_rng(1)
    model = StateSpaceModel(0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 1.0)
    u = rng.standard_normal((300, 2))
    y = model.simulate(u) * [1.0, -3.0]
    result = score(model, Experiment(u, y, dt=1.0))
    clipped, raw = result.per_output["fit_simulation"], result.per_output["fit_simulation_unclipped"]
    assert clipped[0] == pytest.approx(100, abs=1e-6) and clipped[1] == 0 > raw[1]
    assert result.values["fit_simulation"] == pytest.approx(np.mean(clipped))
    assert "fit_one_step" not in result.values


def test_models_are_scored_only_on_data_of_their_own_rate_and_shape():
    u = np.ones((20, 1)) * np.arange(20)[:, None]
    with pytest.raises(ExciteError, match=r"dt 0\.1 s, the record 0\.2 s"):
        score(first_order(), Experiment(u, u, dt=0.2))
    with pytest.raises(ExciteError, match="the model has 1 inputs, the record 2"):
        score(first_order(), Experiment(np.hstack([u, u]), u, dt=0.1))


def test_gap_free_parts_are_scored_together_from_initial_states_of_their_own():
    rng = np.random.default_rng(2)
    truth, u = first_order(K=[[0.5]]), rng.standard_normal((400, 1))
    y = truth.simulate(u, [3.0])
    y[[150, 155]] = np.nan  # four samples between are too few to judge
    values = score(truth, Experiment(u, y, dt=0.1)).values
    assert values["fit_simulation"] == pytest.approx(100, abs=1e-6) == values["fit_one_step"]
    wrong, residual = first_order(0.8, K=[[0.5]]), []
    for part in (Experiment(u[:150], y[:150], dt=0.1), Experiment(u[156:], y[156:], dt=0.1)):
        residual.append(part.y - wrong.simulate(part.u, initial_state(wrong, part, predictor=False)))
    judged, residual = np.r_[y[:150], y[156:]], np.concatenate(residual)
    expected = 100 * (1 - np.linalg.norm(residual) / np.linalg.norm(judged - judged.mean()))
    assert score(wrong, Experiment(u, y, dt=0.1)).per_output["fit_simulation_unclipped"][0] == pytest.approx(expected)


def test_estimates_survive_json_and_hold_no_nan():
    model = first_order(K=[[0.2]])
    estimate = Estimate(
        model, "ssarx", 1, x0=(np.array([0.3]),), singular_values=np.array([1.0, np.nan]), warnings=("w",)
    )
    plain = estimate_to_dict(estimate)
    assert plain["singular_values"] == [1.0, None] and plain["poles"][0]["re"] == 0.9
    back = estimate_from_dict(plain, "here")
    assert back.model.impulse(9).tobytes() == model.impulse(9).tobytes() and back.x0[0][0] == 0.3
    del plain["A"]
    with pytest.raises(ExciteError, match="here"):
        estimate_from_dict({**plain, "kind": "state space"}, "here")


def test_of_equal_matchings_the_ordered_one_is_taken():
    true, estimated = np.exp(0.01 * np.array([-0.55, -0.71])), np.exp(0.01 * np.array([-2.0, -3.0]))
    for shuffled in (estimated, estimated[::-1]):
        found = pole_errors(true, shuffled, 0.01)
        np.testing.assert_allclose(np.log(found.estimated) / 0.01, [-2.0, -3.0])


def test_a_model_is_not_scored_on_channels_that_are_known_to_be_others():
    model = StateSpaceModel(
        [[0.5]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]], 1.0, inputs=["a [deg]", "b [deg]"], outputs=["y [m]"]
    )
    u = np.random.default_rng(0).standard_normal((200, 2))
    y = model.simulate(u)
    assert score(model, Experiment(u, y, dt=1.0, inputs=["p", "q"])).values["fit_simulation"] > 99.999
    with pytest.raises(ExciteError, match=r"inputs are a .deg., b .deg., the record's b .deg., a .deg.; give"):
        score(model, Experiment(u[:, ::-1], y, dt=1.0, inputs=["b [deg]", "a [deg]"]))
    with pytest.raises(ExciteError, match="inputs: 'b' is in deg in the model and in rad in the record; convert one"):
        score(model, Experiment(u, y, dt=1.0, inputs=["a [deg]", "b [rad]"], outputs=["y [m]"]))
