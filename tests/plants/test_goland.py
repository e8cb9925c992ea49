"""The Goland wing: published frequencies and flutter, the exact wing with Theodorsen's function, truth and noise."""

import numpy as np
import pytest
import scipy.linalg as la
from scipy.optimize import fsolve
from scipy.special import hankel2

from excite.errors import ExciteError
from excite.types.signal import Signal
from plants.aeroelastic.goland import DT, PRESETS, Wing, flutter, goland, modes
from plants.registry import load_plant

V = {name: parameter.value for name, parameter in PRESETS["goland"].items()}


def shaking(samples=4000, amplitude=50.0, seed=0):
    return Signal(amplitude * np.sign(np.random.default_rng(seed).standard_normal((samples, 1))), DT)


def theodorsen(k):
    h1, h0 = hankel2(1, k), hankel2(0, k)
    return h1 / (h1 + 1j * h0)


def exact_boundary(speed, omega, damping=0.0):
    """Determinant of the tip's conditions for exp(j omega t), the beam and shaft equations integrated from the root."""
    b, a, rho = V["chord"] / 2, 2 * V["elastic_axis"] - 1, V["density"]
    static = V["mass"] * (V["mass_axis"] - V["elastic_axis"]) * V["chord"]
    s, added = 1j * omega, np.pi * rho * b**2
    circulation = 2 * np.pi * rho * speed * b * theodorsen(omega * b / speed)
    wash = np.array([s, speed + b * (0.5 - a) * s])  # of plunge and pitch
    lift = added * np.array([s**2, speed * s - b * a * s**2]) + circulation * wash
    moment = added * np.array([b * a * s**2, -speed * b * (0.5 - a) * s - b**2 * (0.125 + a**2) * s**2])
    moment = moment + circulation * b * (0.5 + a) * wash
    N = np.zeros((6, 6), complex)  # of h, h', h'', h''', p, p'
    N[0, 1] = N[1, 2] = N[2, 3] = N[4, 5] = 1
    N[3, [0, 4]] = (-(s**2) * np.array([V["mass"], static]) - lift) / V["bending_stiffness"]
    N[5, [0, 4]] = (s**2 * np.array([static, V["inertia"]]) - moment) / V["torsional_stiffness"]
    tip = la.expm(N * V["span"])
    return la.det(tip[np.ix_([2, 3, 5], [2, 3, 5])])


def test_frequencies_without_air():
    """Uncoupled bending and torsion meet textbook beams; coupled, the values of facts/plants.md."""
    apart = Wing.of({**PRESETS["goland"], "mass_axis": PRESETS["goland"]["elastic_axis"]})
    L, rod = V["span"], np.sqrt(V["torsional_stiffness"] / V["inertia"])
    beam = np.sqrt(V["bending_stiffness"] / V["mass"])
    expected = np.r_[np.array([3.51602, 22.0345, 61.6972]) * beam / L**2, np.array([1, 3, 5]) * np.pi / 2 * rod / L]
    np.testing.assert_allclose(np.sqrt(np.diag(apart.K) / np.diag(apart.M)), expected, rtol=1e-5)
    wing = Wing.of(PRESETS["goland"])
    hz = np.sqrt(la.eigvalsh(wing.K, wing.M)) / (2 * np.pi)
    np.testing.assert_allclose(hz[:4], [7.66, 15.23, 38.8, 55.3], atol=0.05)
    s = la.eigvals(np.block([[np.zeros((6, 6)), np.eye(6)], [-la.solve(wing.M, np.hstack([wing.K, wing.D]))]]))
    np.testing.assert_allclose(-s.real / np.abs(s), V["damping"], rtol=1e-6)


def test_flutter_speed():
    """137 m/s and about 69 rad/s (Goland 1945, corrected by Goland and Luke 1948), within 2 %."""
    speed, omega = flutter()
    assert speed == pytest.approx(137, rel=0.02) and omega == pytest.approx(69, rel=0.02)
    speed, omega = flutter({"damping": 0})
    assert (speed, omega) == (pytest.approx(137.3, abs=0.1), pytest.approx(69.3, abs=0.1))


def test_flutter_is_that_of_the_exact_wing():
    """No assumed modes and Theodorsen's own function: Jones's lags and six modes cost less than 1.5 %."""

    def residual(x):
        value = exact_boundary(*x) / exact_boundary(100.0, 60.0)
        return value.real, value.imag

    exact, _, found, _ = fsolve(residual, (130.0, 70.0), full_output=True)
    assert found == 1
    np.testing.assert_allclose(flutter({"damping": 0}), exact, rtol=0.015)


def test_divergence_is_that_of_a_shaft():
    """Elastic axis far enough back and mass ahead of it: torsional divergence at (pi / 2 L) sqrt(2 GJ / (rho c e 2 pi))."""
    given = {"elastic_axis": 0.45, "mass_axis": 0.40}
    speed, omega = flutter(given)
    c = V["chord"]
    lift = V["density"] * c * (0.45 - 0.25) * c * 2 * np.pi
    assert speed == pytest.approx(np.pi / (2 * V["span"]) * np.sqrt(2 * V["torsional_stiffness"] / lift), rel=1e-6)
    assert omega == 0
    with pytest.raises(ExciteError, match="divergence sets in at"):
        goland(parameters={**given, "speed": speed + 1})


def test_frequency_and_damping_through_the_envelope():
    """Rows of facts/plants.md: dynamic pressure over that of flutter; (Hz, damping) of bending and torsion."""
    rows = {
        0.19: (7.60, 0.091, 14.34, 0.047),
        0.63: (8.67, 0.196, 12.65, 0.083),
        0.88: (9.83, 0.304, 11.29, 0.044),
        1.02: (10.25, 0.390, 10.95, -0.007),
    }
    hz, zeta = modes(flutter()[0] * np.sqrt(list(rows)))
    found = np.column_stack([hz[:, 0], zeta[:, 0], hz[:, 1], zeta[:, 1]])
    np.testing.assert_allclose(found, list(rows.values()), atol=0.006)


def test_modes_are_followed_whatever_speeds_are_asked():
    speeds = np.arange(5.0, 251.0, 5.0)
    hz, zeta = modes(speeds)
    assert np.abs(np.diff(hz, axis=0)).max() < 0.6 and np.abs(np.diff(zeta, axis=0)).max() < 0.06
    np.testing.assert_allclose(modes([250.0, 60.0]), (hz[[-1, 11]], zeta[[-1, 11]]), rtol=1e-6)
    with pytest.raises(ExciteError, match="positive speeds"):
        modes([0.0, 10.0])


@pytest.mark.parametrize("speed", [60.0, 130.0])
def test_truth_follows_the_speed(speed):
    p = load_plant("goland", parameters={"speed": speed})
    recording = p.run(shaking(), noise=False)
    truth, data = load_plant("goland").truth(recording, "plant"), recording.experiment("plant")
    np.testing.assert_allclose(truth.model.simulate(data.u), data.y, atol=1e-9)
    s = np.log(truth.poles) / DT
    s = s[np.argsort(-s.imag)[:6]][::-1]
    hz, zeta = modes([speed])
    np.testing.assert_allclose(np.abs(s) / (2 * np.pi), hz[0], rtol=1e-6)
    np.testing.assert_allclose(-s.real / np.abs(s), zeta[0], rtol=1e-6)
    assert len(truth.poles) == 24


def test_frequency_response_is_strip_theory_in_the_frequency_domain():
    """From shaker to accelerometers through (s^2 M + s D + K) of the wing and the rational lift deficiency of Jones."""
    wing, speed, f = Wing.of(PRESETS["goland"]), V["speed"], np.array([2.0, 7.0, 13.0, 40.0, 60.0])
    A, B = wing.in_air(speed)
    b, a, rho = V["chord"] / 2, 2 * V["elastic_axis"] - 1, V["density"]
    H, T, w = wing.bend, wing.twist, wing.weights
    for s in 2j * np.pi * f:
        k = s * b / speed
        C = 1 - 0.165 * k / (k + 0.0455) - 0.335 * k / (k + 0.3)
        wash = H * s + T * (speed + b * (0.5 - a) * s)
        lift = np.pi * rho * b**2 * (H * s**2 + T * (speed * s - b * a * s**2)) + 2 * np.pi * rho * speed * b * C * wash
        moment = (
            np.pi * rho * b**2 * (H * b * a * s**2 - T * (speed * b * (0.5 - a) * s + b**2 * (0.125 + a**2) * s**2))
        )
        moment = moment + 2 * np.pi * rho * speed * b**2 * (0.5 + a) * C * wash
        stiff = s**2 * wing.M + s * wing.D + wing.K + (H.T * w) @ lift - (T.T * w) @ moment
        np.testing.assert_allclose(la.solve(s * np.eye(24) - A, B[:, :6])[:6], la.inv(stiff), rtol=1e-8, atol=1e-12)


def test_noise_is_whitened_by_the_truth_and_stationary():
    p = goland()
    data = p.run(Signal(np.zeros((24_000, 1)), DT), seed=3).experiment("plant")
    truth = p.truth(None, "plant").model
    e = (data.y - truth.predict(data))[8000:]  # the filter forgets its first state in 2800 samples
    np.testing.assert_allclose(e.T @ e / len(e), truth.innovation_cov, atol=0.05 * truth.innovation_cov.max())
    assert np.abs(e[1:].T @ e[:-1] / len(e)).max() < 0.04 * truth.innovation_cov.max()
    many = p.run_many(Signal(np.zeros((2, 1)), DT), seeds=range(600), noise={"measurement": 0.0})
    first, stationary = np.array([r.values[0, 1:] for r in many]), data.y[8000:]
    np.testing.assert_allclose(first.std(0), stationary.std(0), rtol=0.15)


def test_what_cannot_fly_is_refused():
    with pytest.raises(ExciteError, match=r"'speed': 140 m/s; flutter at 69 rad/s sets in at 138\.5 m/s"):
        goland(parameters={"speed": 140})
    with pytest.raises(ExciteError, match=r"'inertia': 0\.1 kg m"):
        goland(parameters={"inertia": 0.1})
    assert flutter({"density": 1e-3})[0] == np.inf
