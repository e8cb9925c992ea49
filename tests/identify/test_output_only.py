"""Output-only identification of a structure whose modes are known: three masses in a chain, white forces, six accelerometers."""

import numpy as np
import pytest
import scipy.linalg as la

from excite.errors import ExciteError, Unsupported
from excite.models.state_space import StateSpaceModel
from excite.numerics.kalman import kalman_gain
from excite.numerics.simulate import markov, simulate, states
from excite.types.experiment import Experiment
from identify.estimate_json import estimate_from_dict, estimate_to_dict
from identify.fit import fit

DT, SAMPLES = 0.05, 20_000
STIFFNESS = 400 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])  # unit masses
OMEGA2, SHAPES = la.eigh(STIFFNESS)
OMEGA, ZETA = np.sqrt(OMEGA2), np.array([0.01, 0.015, 0.02])  # 1.42, 3.97 and 5.74 Hz
SENSORS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.3, 0, 0.7]])


def response(seed):
    """Six accelerations to white forces held over a sample, with 5 % sensor noise."""
    damping = SHAPES @ np.diag(2 * ZETA * OMEGA) @ SHAPES.T
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-STIFFNESS, -damping]])
    both = la.expm(np.block([[A, np.eye(6)[:, 3:]], [np.zeros((3, 9))]]) * DT)
    rng = np.random.default_rng(seed)
    forces = rng.standard_normal((SAMPLES + 2000, 3))
    C = SENSORS @ np.hstack([-STIFFNESS, -damping])
    y = simulate(both[:6, :6], both[:6, 6:], C, SENSORS * 1.0, forces)[2000:]
    return Experiment(None, y + 0.05 * y.std(0) * rng.standard_normal(y.shape), dt=DT)


@pytest.fixture(scope="module")
def responses():
    return [response(seed) for seed in range(20)]


def modes(model):
    """Frequencies (rad/s), damping ratios and shapes at the outputs, slowest first."""
    values, vectors = la.eig(model.A)
    s = np.log(values) / model.dt
    s, shapes = s[s.imag > 0], (model.C @ vectors)[:, s.imag > 0]
    order = np.argsort(abs(s))
    return abs(s)[order], (-s.real / abs(s))[order], shapes[:, order]


def mac(a, b):
    """Modal assurance criterion of paired columns."""
    return abs((a.conj() * b).sum(0)) ** 2 / ((abs(a) ** 2).sum(0) * (abs(b) ** 2).sum(0))


@pytest.mark.parametrize("name", ["ssi_cov", "ssi_data"])
def test_modes_of_a_structure(responses, name):
    """Frequencies within 0.5 % and shapes with a MAC above 0.99 in every run; damping without bias, and with the scatter
    that a single resonance allows: for an AR(2) with poles of modulus 1 - d, var d = d / N, hence var zeta = zeta / (w T).
    """
    found = [modes(fit(run, name, 6).model) for run in responses]
    frequency, damping = (np.array([f[i] for f in found]) for i in range(2))
    assert np.abs(frequency / OMEGA - 1).max() < 0.005
    assert min(mac(shapes, SENSORS @ SHAPES).min() for *_, shapes in found) > 0.99
    limit = np.sqrt(ZETA / (OMEGA * SAMPLES * DT))
    error = damping - ZETA
    assert (np.abs(error.mean(0)) < 3 * limit / np.sqrt(len(found))).all()
    rms = np.sqrt((error**2).mean(0))
    assert (rms > 0.5 * limit).all() and (rms < 1.6 * limit).all()


def noise_process(seed=0, samples=40_000):
    """Two modes driven by white noise, with enough noise on two outputs for a well-conditioned Kalman gain."""
    A = la.block_diag([[0.9, 0.3], [-0.3, 0.9]], [[0.4, 0.6], [-0.6, 0.4]])
    C = np.array([[1.0, 0, 0.5, 0], [0, 1, 1, 0.3]])
    K, cov = kalman_gain(A, C, np.eye(4), np.eye(2), np.zeros((4, 2)))
    e = np.random.default_rng(seed).standard_normal((samples, 2)) @ la.cholesky(cov)
    truth = StateSpaceModel(A, np.empty((4, 0)), C, np.empty((2, 0)), 0.1, K=K, innovation_cov=cov)
    return Experiment(None, simulate(A, K, C, np.eye(2), e), dt=0.1), truth


@pytest.mark.parametrize("name", ["ssi_cov", "ssi_data"])
def test_noise_model(name):
    """K and the innovation covariance are the process's own: C A^i K does not depend on the basis."""
    run, truth = noise_process()
    model = fit(run, name, 4).model
    np.testing.assert_allclose(model.innovation_cov, truth.innovation_cov, rtol=0.05, atol=0.05)
    response = [markov(m.A, m.K, m.C, np.eye(2), 20) for m in (model, truth)]
    assert la.norm(response[0] - response[1]) < 0.05 * la.norm(response[1])
    error = run.y - model.predict(run, 1, fit(run, name, 4).x0[0])
    np.testing.assert_allclose(error.T @ error / len(run), model.innovation_cov, rtol=0.05, atol=0.05)


@pytest.mark.parametrize("name", ["ssi_cov", "ssi_data"])
def test_a_free_decay_without_noise_is_exact(name):
    """A deterministic decay has the plant's poles exactly, and no Kalman gain."""
    _, truth = noise_process()
    x = states(truth.A, np.zeros((4, 1)), np.zeros((400, 1)), np.ones(4))
    estimate = fit(Experiment(None, x @ truth.C.T, dt=0.1), name, 4, block_rows=6)
    distance = np.abs(np.subtract.outer(truth.poles(), estimate.model.poles()))
    assert distance.min(1).max() < 1e-6


def test_without_positive_realness_there_is_no_gain_and_a_warning(responses):
    estimate = fit(responses[0], "ssi_cov", 6)
    assert estimate.model.K is None
    assert any("not positive real" in warning for warning in estimate.warnings)
    assert fit(responses[0], "ssi_data", 6).model.K is not None


@pytest.mark.parametrize("name", ["ssi_cov", "ssi_data"])
def test_inputs_are_refused_and_models_travel(responses, name):
    run = responses[0]
    with pytest.raises(Unsupported, match=r"'u1'.*name no input"):
        fit(Experiment(run.y[:, 0], run.y[:, 1:], dt=DT), name, 6)
    with pytest.raises(ExciteError, match="largest possible"):
        fit(run, name, 200)
    estimate = fit(run, name, 6)
    back = estimate_from_dict(estimate_to_dict(estimate), "model.json").model
    np.testing.assert_array_equal(back.A, estimate.model.A)
    assert back.inputs == () and back.simulate(run.u).shape == run.y.shape
