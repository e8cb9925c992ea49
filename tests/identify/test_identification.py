"""Identification against independent sources: peers' printed results, theory, and the cases behind the figures."""

import numpy as np
import pytest
from paths import SHARED
from scipy.optimize import linear_sum_assignment

from excite.errors import ExciteError, Unsupported
from excite.files import load_experiment
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from identify.estimate import Status
from identify.examples import closed_loop
from identify.examples import series as example
from identify.fit import fit
from identify.metrics.impulse import impulse_error
from identify.orders.gap import largest_gap
from identify.registry import load_method


def shared(*parts):
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"../shared/{'/'.join(parts)} is not there")
    return path


def pole_error(true, found):
    cost = np.abs(np.subtract.outer(true, found))
    return cost[linear_sum_assignment(cost)].max()


def dryer():
    return load_experiment(shared("data", "daisy_dryer", "dryer.dat"), inputs=[0], outputs=[1], dt=0.08)


def test_dryer_agrees_with_slicot():
    """Singular values and eigenvalues as SLICOT's IB01AD prints them (TIB01 example; combined method for A)."""
    estimate = fit(dryer(), "po_moesp", order=4, block_rows=15)
    printed = [69.8841, 14.9963, 3.6675, 1.9677, 0.3000, 0.2078, 0.1651, 0.1373, 0.1133, 0.1059, 0.0856, 0.0784]
    np.testing.assert_allclose(estimate.singular_values[:12], printed, atol=6e-5)  # the common factor is one
    expected = [0.4758 + 0.1999j, 0.4758 - 0.1999j, 0.7456, 0.9610]
    assert pole_error(np.array(expected), estimate.model.poles()) < 1e-3


def test_dryer_markov_parameters_agree_with_octave():
    """Octave's moen4 result; it fits B and D differently, so its Markov parameters agree to the estimates' own error."""
    peer = np.load(shared("data", "octave_cd_player", "octave_moen4_hairdryer_TIB01.npz"))
    A, B, C, D = (peer[key] for key in ("Ae", "Be", "Ce", "De"))
    theirs = StateSpaceModel(A, B, C, D, 0.08)
    ours = fit(dryer(), "po_moesp", order=4, block_rows=15).model
    assert pole_error(theirs.poles(), ours.poles()) < 1e-3
    assert impulse_error(ours, theirs, 60) < 0.05


def test_order_is_found_at_the_gap():
    estimate = fit(dryer(), "po_moesp", block_rows=15)
    assert estimate.order == 4 and "order 4 chosen at the largest singular-value gap" in estimate.warnings[0]
    assert largest_gap([5.0, 4.0, 3.0, 1e-15, 1e-16])[0] == 3


@pytest.mark.parametrize("method", ["iem", "ssarx"])
def test_closed_loop_error_falls_with_the_root_of_the_record(method):
    """e_h of the loop of Mercère et al. (2016), V-B: four times the samples, half the error; PO-MOESP stays where it is."""
    errors = {}
    for name in (method, "po_moesp"):
        options = {"block_rows": 20, "feedthrough": False} if name == "po_moesp" else {"past": 20, "future": 20}
        errors[name] = [
            np.median(
                [impulse_error(fit(d, name, 4, **options).model, t) for d, t in map(closed_loop, [N] * 12, range(12))]
            )
            for N in (1000, 4000, 16_000)
        ]
    slopes = np.diff(np.log(errors[method])) / np.log(4)
    assert -0.75 < slopes.mean() < -0.4 and slopes.max() < -0.3, errors
    assert errors["po_moesp"][-1] > 0.6 * errors["po_moesp"][0] and errors["po_moesp"][-1] > 3 * errors[method][-1]


def test_the_example_loop_is_the_printed_one(cases):
    u, y, *_ = cases.mercere_closed(3, 500)
    ours, truth = closed_loop(500, 3)
    impulse = truth.impulse(4)[:, 0, 0]
    np.testing.assert_allclose(impulse, [0, 1, 2, 2.3])
    theirs = impulse_error(fit(Experiment(u, y, dt=1.0, loop=Loop("closed")), "ssarx", 4).model, truth)
    assert 0 < theirs < 0.15 and impulse_error(fit(ours, "ssarx", 4).model, truth) < 0.15


def test_innovations_and_gain_of_the_open_loop_example(cases):
    """Mercère et al. (2016), V-A: A .749, K -.058, R 6.705; estimates within a few deviations of the Cramér-Rao bound."""
    u, y, _ = cases.mercere_open(0, 20_000)
    for name in ("ssarx", "iem"):
        model = fit(Experiment(u, y, dt=1.0), name, 1, feedthrough=True).model
        assert model.A[0, 0] == pytest.approx(0.749, abs=0.015)
        assert model.innovation_cov[0, 0] == pytest.approx(6.705, rel=0.05)
        assert (model.K @ model.C)[0, 0] == pytest.approx(-0.058 * 0.8725, abs=0.03)
        assert model.D[0, 0] == pytest.approx(-2.0895, abs=0.1)


def test_iem_beats_po_moesp_on_an_integrating_loop(cases):
    true = np.array([1, 1, 0.96**5])
    errors = {"iem": [], "po_moesp": []}
    for seed in range(3):
        u, y, r = cases.integrating_loop(seed, 32_000)
        data = Experiment(u, y, dt=0.01, reference=r, loop=Loop("closed"))
        for name in errors:
            errors[name].append(pole_error(true, fit(data, name, 3).model.poles()))
    assert np.median(errors["iem"]) < np.median(errors["po_moesp"]) / 3, errors


def test_low_pass_data_take_the_qr_path(cases):
    system = cases.w1_to_w4()["W1"][:4]
    u, y, fresh, clean = cases.w6(system)
    estimate = fit(Experiment(u, y, dt=1.0), "po_moesp", 4, block_rows=20)
    assert estimate.route == "blocked-qr" and estimate.condition > 1e6 and estimate.status is not Status.UNSTABLE
    assert pole_error(np.linalg.eigvals(system[0]), estimate.model.poles()) < 0.01
    error = clean - estimate.model.simulate(fresh[:, None])[:, 0]
    assert np.linalg.norm(error) < 0.01 * np.linalg.norm(clean)


def test_shared_factors_give_the_same_estimate():
    data, _ = example()
    iem, ssarx = load_method("iem"), load_method("ssarx")
    assert iem.compression == ssarx.compression != load_method("iem", past=21).compression
    shared = {}
    for method in (iem, ssarx):
        shared_one, own = fit(data, method, 4, shared=shared), fit(data, method, 4)
        assert shared_one.model.impulse(20).tobytes() == own.model.impulse(20).tobytes()
    assert list(shared) == [(iem.compression, 0, None)]


def test_poor_excitation_is_refused_with_the_orders():
    t = np.arange(2000)
    u = np.sin(0.3 * t) + np.sin(0.9 * t)
    y = StateSpaceModel([[0.5]], [[1]], [[1]], [[0]], 1.0).simulate(u[:, None])
    y = y + 0.1 * np.random.default_rng(0).standard_normal(y.shape)
    with pytest.raises(ExciteError, match="persistently exciting of order 4, but 20 future rows need order 20"):
        fit(Experiment(u, y, dt=1.0), "po_moesp", 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "po_moesp", "block_rows": 400}, "the largest possible past \\+ future is"),
        ({"method": "po_moesp", "block_rows": 0}, r"po_moesp\.block_rows: 0; give a whole number of at least 1"),
        ({"method": "po_moesp", "block_rows": 2.5}, r"po_moesp\.block_rows: 2\.5"),
        ({"method": "po_moesp", "feedthrough": 1}, "give true or false"),
        ({"method": "iem", "order": 77}, r"order 77 is above the largest possible, 38"),
        ({"method": "iem", "order": True}, "order True; give a whole number"),
        ({"method": "arx", "order": None}, "arx: give the order"),
        ({"method": "iem", "passt": 3}, "no setting 'passt'; did you mean 'past'"),
        ({"method": "pomoesp"}, "method 'pomoesp' does not exist; did you mean 'po_moesp'"),
    ],
)
def test_bad_settings_are_refused_by_name(options, message):
    data, _ = example()
    options = {"order": 4, **options}
    with pytest.raises(ExciteError, match=message):
        fit(data, options.pop("method"), **options)


def test_records_must_be_of_one_kind():
    data, _ = example()
    with pytest.raises(ExciteError, match="experiment 1: its outputs differ"):
        fit((data, Experiment(data.u, data.y[:, :1], dt=data.dt)), "arx", 2)
    with pytest.raises(ExciteError, match=r"experiment 1: dt 0\.2 s differs from 0\.1 s"):
        fit((data, Experiment(data.u, data.y, dt=0.2)), "arx", 2)
    with pytest.raises(Unsupported, match="not uniform"):
        fit(Experiment([1, 2, 3], [1, 2, 3], time_s=[0, 1, 5]), "arx", 1)
