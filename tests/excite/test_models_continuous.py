"""Models in continuous time: Foster networks against their differential equation, state space against scipy."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
from random_models import foster
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from excite.errors import ExciteError
from excite.models.foster import FosterModel
from excite.models.state_space import ContinuousModel


def test_a_step_charges_each_lag_exponentially():
    """Two RC links, 2 K/W at 1 ms and 3 K/W at 10 s, under 4 W from the first instant on, at instants over eight decades."""
    model, time = FosterModel([[2.0], [3.0]], [1e-3, 10.0]), np.geomspace(1e-6, 1e2, 200)
    expected = 4 * (2 * (1 - np.exp(-(time - time[0]) / 1e-3)) + 3 * (1 - np.exp(-(time - time[0]) / 10)))
    y = model.simulate(np.full((200, 1), 4.0), time_s=time)
    np.testing.assert_allclose(y[:, 0], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(4 * model.step(time - time[0])[:, 0, 0], expected, rtol=1e-9, atol=1e-15)


def test_held_inputs_at_any_instants_solve_the_differential_equation():
    rng = np.random.default_rng(0)
    model = foster(rng, 3, 2, 2)
    time, u, x0 = np.cumsum(rng.exponential(1.0, 40)), rng.standard_normal((40, 2)), rng.standard_normal(6)
    y, x = model.simulate(u, x0, time_s=time), x0
    for k in range(39):
        held = (u[k] - model.input_offset)[None]

        def slope(_, x, held=held):
            return ((held - x.reshape(3, 2)) / model.tau[:, None]).ravel()

        x = solve_ivp(slope, time[k : k + 2], x, rtol=1e-10, atol=1e-12).y[:, -1]
        expected = np.einsum("noi,ni->o", model.R, x.reshape(3, 2)) + model.output_offset
        np.testing.assert_allclose(y[k + 1], expected, atol=1e-8)


def test_samples_of_a_foster_model_are_those_of_its_state_space_form():
    rng = np.random.default_rng(1)
    model, u, x0 = foster(rng, 4, 3, 2), rng.standard_normal((500, 2)), rng.standard_normal(8)
    space = model.to_state_space(0.2)
    np.testing.assert_allclose(model.simulate(u, x0, time_s=0.2 * np.arange(500)), space.simulate(u, x0), atol=1e-11)
    np.testing.assert_allclose(model.impulse(30, 0.2), space.impulse(30), atol=1e-13)
    fine = model.to_state_space(1e-5)  # a sampled model tends to the continuous one far below its Nyquist frequency
    f = np.array([0.0, 0.01, 0.1])
    np.testing.assert_allclose(model.frf(f), fine.frf(f), rtol=1e-4)
    np.testing.assert_allclose(np.unique(np.log(space.poles().real) / 0.2), np.sort(model.poles().real), rtol=1e-9)
    np.testing.assert_allclose(model.frf([0.0])[0], model.R.sum(0), rtol=1e-12)


def test_every_theta_of_a_foster_model_is_a_model():
    model = foster(np.random.default_rng(2), 3, 1, 1)
    np.testing.assert_allclose(model.at(model.theta()).tau, model.tau, rtol=1e-14)
    shorter = model.at(model.theta() - np.r_[0, 0, 0, np.log([2, 2, 2])])
    np.testing.assert_allclose(shorter.tau, model.tau / 2, rtol=1e-13)
    with pytest.raises(ValueError, match="read-only"):
        copy.deepcopy(shorter).tau[0] = 1


def masses():
    """A mass on a spring with a damper, 1 Hz and 5 %, force to position and speed; and an integrator."""
    w = 2 * np.pi
    A = np.array([[0, 1, 0], [-(w**2), -0.1 * w, 0], [0, 0, 0.0]])
    return ContinuousModel(A, [[0, 0], [1, 0], [0, 1]], [[1, 0, 0], [0, 1, 1]], [[0, 0], [0, 0.5]])


def test_continuous_state_space_equals_scipy_and_its_definition():
    model, rng = masses(), np.random.default_rng(3)
    time, u, x0 = 0.05 * np.arange(200), rng.standard_normal((200, 2)), rng.standard_normal(3)
    expected = lsim((model.A, model.B, model.C, model.D), u, time, x0, interp=False)[1]
    np.testing.assert_allclose(model.simulate(u, x0, time_s=time), expected, atol=1e-9)
    uneven = np.sort(rng.choice(200, 60, replace=False))
    held = u[uneven][np.searchsorted(uneven, np.arange(uneven[0], uneven[-1] + 1), side="right") - 1]
    fine = lsim((model.A, model.B, model.C, model.D), held, 0.05 * np.arange(len(held)), x0, interp=False)[1]
    y = model.simulate(u[uneven], x0, time_s=time[uneven])
    np.testing.assert_allclose(y, fine[uneven - uneven[0]], atol=1e-9)
    s = 2j * np.pi * 0.7
    G = model.C @ np.linalg.solve(s * np.eye(3) - model.A, model.B) + model.D
    np.testing.assert_allclose(model.frf([0.7])[0], G, atol=1e-13)
    np.testing.assert_allclose(model.impulse(9, 0.05), model.to_state_space(0.05).impulse(9))


def test_sampling_and_its_inverse_keep_model_and_operating_point():
    model = ContinuousModel([[-2.0]], [[1.0]], [[3.0]], [[0.5]], input_offset=[1.0], output_offset=[5.0])
    back = model.to_state_space(0.1).to_continuous()
    for key in ("A", "B", "C", "D", "input_offset", "output_offset"):
        np.testing.assert_allclose(getattr(back, key), getattr(model, key), rtol=1e-12)
    np.testing.assert_array_equal(model.simulate(np.ones((4, 1)), time_s=[0, 1, 2, 4.0]), 5 * np.ones((4, 1)))
    assert model.dt is None and model.poles() == [-2]


def test_a_record_brings_its_own_instants():
    for model in (foster(np.random.default_rng(4), 2, 2, 2), masses()):
        record = SimpleNamespace(u=np.ones((5, 2)), y=np.zeros((5, 2)), time_s=np.array([0, 1, 3, 7, 8.0]))
        np.testing.assert_array_equal(model.response(record), model.simulate(record.u, time_s=record.time_s))


FOSTER = FosterModel([[1.0]], [1.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FosterModel([[1.0]], [0.0]), r"FosterModel\.tau: 0 s; time constants are positive"),
        (lambda: FosterModel([[1.0]], [1.0, 2.0]), r"FosterModel\.R: shape \(1, 1, 1\), expected \(2, N, N\)"),
        (lambda: FosterModel(np.empty((0, 1)), []), r"FosterModel\.R: .* one of each or more"),
        (lambda: FOSTER.simulate([[1.0]]), r"FosterModel\.simulate: no instants; give time_s"),
        (lambda: FOSTER.simulate([[1.0], [2.0]], time_s=[1.0, 1.0]), "time does not increase"),
        (lambda: FOSTER.to_state_space(), r"FosterModel\.to_state_space: .* no sampling time of its own; give dt"),
        (lambda: FOSTER.impulse(3), r"FosterModel\.impulse: .* give dt"),
        (lambda: masses().to_state_space(-1.0), "ContinuousModel: dt: -1.0 is not a positive finite number"),
        (lambda: masses().simulate(np.ones((2, 2))), r"ContinuousModel\.simulate: no instants"),
        (lambda: ContinuousModel([[1.0]], [[1, 2.0]], [[1.0]], [[1.0]]), r"ContinuousModel\.B: shape \(1, 2\)"),
    ],
)
def test_bad_use_is_refused_in_words(make, message):
    with pytest.raises(ExciteError, match=message):
        make()
