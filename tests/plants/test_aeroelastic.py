"""The aircraft of elastic modes: its equations against an integrator, its truths, limits, noise, and choice of outputs."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg as la
from scipy.integrate import quad_vec, solve_ivp
from scipy.signal import coherence

from excite import multisine
from excite.errors import ExciteError
from excite.generators import in_sequence, rest
from excite.types.signal import Signal
from identify.data.coherence import select_outputs
from plants.aeroelastic.parameters import FAMILIES, PRESETS
from plants.aeroelastic.sensors import ACCELEROMETERS, BEAM, FUSELAGE, PRESSURES, bending, shapes
from plants.aeroelastic.turbulence import dryden_vertical, sampled_noise
from plants.conformance import checks_of
from plants.linear.actuator import Element, RamRate
from plants.registry import load_plant

ORDERS = {"flap": 6, "aileron": 12, "combined": 18}
INJECT = {"flap": "input", "aileron": "plant_input", "combined": "plant_input"}
PEAK = {"flap": 0.5, "aileron": 1.15, "combined": [0.5, 1.15]}


def plant(preset, **parameters):
    return load_plant("aeroelastic", preset=preset, parameters=parameters)


def excitation(preset, periods):
    """The experiment's multisine, 3 to 35 Hz."""
    return multisine(dt=0.01, period_s=8.0, band_hz=[3, 35], amplitude=PEAK[preset], periods=periods, starts=1)


def steps(preset, amplitude, samples=600):
    """Random binary commands, held for 10 samples."""
    rng = np.random.default_rng(3)
    return Signal(
        amplitude * np.repeat(rng.choice([-1.0, 1.0], (samples // 10, len(plant(preset).inputs))), 10, axis=0), 0.01
    )


def test_dryden_gust_has_its_variance_and_its_spectrum():
    speed, length = 273.0, 533.0
    A, B, C = dryden_vertical(speed, length)
    P = la.solve_continuous_lyapunov(A, -B @ B.T)
    assert (C @ P @ C.T).item() == pytest.approx(1.0, rel=1e-12)
    # MIL-F-8785C, 3.7.1.2, one-sided over W: Phi(W) dW = Phi(w / V) dw / V; white noise of unit intensity has 1/pi per rad/s
    w = np.array([0.05, 0.5, 5.0, 50.0])
    H = np.array([(C @ la.solve(1j * each * np.eye(2) - A, B)).item() for each in w])
    LW = length * w / speed
    np.testing.assert_allclose(
        np.abs(H) ** 2 / np.pi, length / np.pi / speed * (1 + 3 * LW**2) / (1 + LW**2) ** 2, rtol=1e-12
    )


def test_sampled_noise_is_what_an_interval_gathers():
    A, G, dt = np.array([[0.0, 1.0], [-900.0, -3.0]]), np.array([[0.2], [5.0]]), 0.01
    Gd = sampled_noise(A, G, dt)
    Q = quad_vec(lambda t: la.expm(A * t) @ G @ G.T @ la.expm(A * t).T, 0, dt, epsabs=1e-14)[0]
    np.testing.assert_allclose(Gd @ Gd.T, Q, rtol=1e-9, atol=1e-14)


def test_shapes_are_those_of_a_clamped_wing_on_two_sides():
    for root in BEAM:
        assert np.cos(root) * np.cosh(root) == pytest.approx(-1, abs=2e-3)
    assert len(ACCELEROMETERS) + len(PRESSURES) == 94
    for family, sign in (("symmetric", 1), ("antisymmetric", -1)):
        wing = shapes(family)[: len(ACCELEROMETERS) - len(FUSELAGE)]
        left, right = np.split(wing, 2)
        np.testing.assert_allclose(right, sign * left)
    # second bending of a clamped beam: node at 0.7834 of the span (Blevins, 1979, table 8-1)
    assert bending(BEAM[1], np.array([0.7834])) == pytest.approx(0, abs=5e-4)
    np.testing.assert_allclose([bending(root, np.array([0.0, 1.0])) for root in BEAM], [[0, 1]] * 3, atol=1e-12)


@pytest.mark.parametrize("preset", ORDERS)
def test_poles_are_those_of_the_named_modes(preset):
    p = plant(preset)
    values = p.values
    modes = [
        (2 * np.pi * values[f"{FAMILIES[s]}_{i}_frequency"], values[f"{FAMILIES[s]}_{i}_damping"])
        for s in FAMILIES
        if f"{s}_travel" in values
        for i in range(1, 7)
        if f"{FAMILIES[s]}_{i}_damping" in values
    ]
    s = np.array([w * (-z + 1j * np.sqrt(1 - z**2)) for w, z in modes])
    expected = np.exp(np.concatenate([s, s.conj()]) * p.dt)
    truth = p.truth(None, "position")
    assert len(truth.poles) == ORDERS[preset]
    np.testing.assert_allclose(np.sort_complex(truth.poles), np.sort_complex(expected), atol=1e-12)
    # beside them only the zeros of the sampled servos, on the negative real axis
    others = [z for z in truth.model.poles() if np.abs(z - expected).min() > 1e-9]
    assert len(others) == len(p.inputs) and all(abs(z.imag) < 1e-12 and -1 < z.real < -0.6 for z in others)


def test_it_answers_as_the_differential_equations_do():
    p, v = plant("flap"), plant("flap").values
    u = steps("flap", 0.1, 100)
    recording = p.run(u, noise=False)
    omega, zeta, force = (
        np.array([v[f"symmetric_{i}_{key}"] for i in (1, 2, 3)]) for key in ("frequency", "damping", "force")
    )
    omega = 2 * np.pi * omega
    a0, a1 = v["flap_slow_pole"] * v["flap_fast_pole"], v["flap_slow_pole"] + v["flap_fast_pole"]

    def acceleration(x):
        return force * x[0] - omega**2 * x[2:5] - 2 * zeta * omega * x[5:]

    def motion(t, x, command):
        return np.concatenate([[x[1], a0 * (command - x[0]) - a1 * x[1]], x[5:], acceleration(x)])

    x, rows = np.zeros(8), []
    for command in u.u[:, 0]:
        rows.append(np.concatenate([[x[0]], acceleration(x)]))
        x = solve_ivp(motion, (0, p.dt), x, args=(command,), rtol=1e-10, atol=1e-13).y[:, -1]
    position, modal = np.split(np.array(rows), [1], axis=1)
    np.testing.assert_allclose(recording.columns(("flap_position",)), position, atol=1e-9)
    expected = modal @ shapes("symmetric")[: len(ACCELEROMETERS)].T
    np.testing.assert_allclose(recording.columns(ACCELEROMETERS), expected, atol=1e-8)


@pytest.mark.parametrize("preset", ORDERS)
@pytest.mark.parametrize("scale", [1, 4])
def test_every_view_has_its_truth_and_position_has_it_beyond_the_limits(preset, scale):
    p = plant(preset)
    for inject in p.injections:
        if inject == "setpoint":
            u = Signal(scale * 5.0 * steps("flap", 1.0).u, 0.01)
        else:
            u = steps(preset, scale * np.multiply(PEAK[preset], 0.5))
        recording = p.run(u, inject=inject, noise=False)
        commands, followed = (recording.columns(tuple(c.name for c in each)) for each in (p.inputs, p.acting))
        limited = np.abs(commands - followed).max() > 0.01
        assert limited == (scale > 1)
        for view in p.injections[inject].views:
            data, truth = recording.experiment(view), p.truth(recording, view)
            error = np.abs(truth.model.simulate(data.u) - data.y).max() / np.abs(data.y).max()
            assert error < 1e-9 if view == "position" or not limited else error > 1e-3


@pytest.mark.parametrize("preset, share", [("flap", 0.0025), ("aileron", 0.001)])
def test_motion_between_samples_hardly_shows_in_the_structures_order(preset, share):
    """Within the band the fast pole of "position" is nearly a constant, so that models of order 6 and 12 can be right."""
    model = plant(preset).truth(None, "position").model.select(ACCELEROMETERS)
    f = np.linspace(3, 35, 200)
    poles, V = la.eig(model.A)
    fast = np.argmin(poles.real)
    residue = (model.C @ V[:, fast]) * la.solve(V, model.B.astype(complex))[fast]
    part = residue / (np.exp(2j * np.pi * f * 0.01) - poles[fast])[:, None]
    assert la.norm(part - part.mean(0).real) < share * la.norm(model.frf(f))


def test_rams_keep_their_rate_and_pass_what_is_slow():
    p = plant("combined")
    ram = next(e for e in p.actuator if isinstance(e, RamRate))
    for scale, passes in ((0.5, True), (3.0, False)):
        u = steps("combined", np.multiply(PEAK["combined"], scale)).u
        assert ram.passes(u) == passes
        x, rates, followed = ram.start(u.shape[1:]), [], []
        for each in u:
            v, x = ram.advance(each, x)
            rates.append(x[:, 1])
            followed.append(v)
        assert (np.abs(rates) <= ram.rate * (1 + 1e-12)).all()
        assert np.array_equal(followed, u) == passes
        if not passes:
            np.testing.assert_allclose(np.abs(rates).max(0), ram.rate)


@dataclass(frozen=True)
class Watched(Element):
    """Changes nothing, but cannot promise it."""

    def step(self, u, last):
        return u

    def passes(self, u):
        return False


@pytest.mark.parametrize("preset", ["flap", "aileron"])
def test_linear_path_is_the_sample_loop(preset):
    p, u = plant(preset, outputs=20), steps(preset, 0.2)
    slow = replace(p, actuator=(*p.actuator, Watched()))
    fast, loop = (each.run(u, inject=INJECT[preset], seed=4).values for each in (p, slow))
    np.testing.assert_allclose(fast, loop, atol=1e-10)


def test_gust_moves_input_and_output_alike_and_goes_on_while_r_rests():
    p, part = plant("flap"), excitation("flap", periods=1)
    u = in_sequence([part, rest(dt=0.01, duration_s=320.0, channels=1), part])
    resting = slice(1200, 32_800)
    without = dict.fromkeys(p.noise_sources, 0.0)
    for noise, least, most in ((without | {"gust": 0.5}, 0.9, 1.0), ({"gust": 0.0}, 0.0, 0.1)):
        recording = p.run(u, noise=noise, seed=2)
        data = recording.experiment("position")
        assert len(data) == len(u.u) and not data.reference[resting].any()
        position, acceleration = data.u[resting, 0], recording.columns(("acc_left_8_mid",))[resting, 0]
        f, gamma2 = coherence(position, acceleration, fs=100, nperseg=1600)
        assert least <= gamma2[(f > 4) & (f < 20)].mean() <= most
        assert (np.corrcoef(acceleration[1:], acceleration[:-1])[0, 1] > 0.5) == (
            least > 0
        )  # coloured by the gust alone


def test_noise_has_the_spectrum_of_the_stated_innovations():
    """The one-step predictor of truth "plant" whitens closed-loop data: the gyro, which the controller sees, is in it."""
    p = plant("aileron", outputs=6)
    data = p.run(excitation("aileron", periods=10), inject="plant_input", seed=1).experiment("plant")
    assert data.outputs[-1].name == "roll_rate" and data.loop.closed
    truth = p.truth(None, "plant").model
    e = (data.y - truth.predict(data))[2000:]
    assert np.abs(e[1:].T @ e[:-1] / len(e)).max() / truth.innovation_cov.max() < 0.05
    np.testing.assert_allclose(e.var(0), np.diag(truth.innovation_cov), rtol=0.06)


@pytest.mark.parametrize("preset, count", [("flap", 8), ("aileron", 49)])
def test_coherence_keeps_as_many_outputs_as_in_the_seed(preset, count):
    data = plant(preset).run(excitation(preset, periods=16), inject=INJECT[preset], seed=0).experiment("position")
    assert data.y.shape[1] == 94
    kept = select_outputs(data, (3.0, 35.0))
    assert len(kept) == count
    fewer = plant(preset, outputs=count)
    assert [c.name for c in fewer.outputs if c.name in kept] == [c.name for c in fewer.outputs[:count]]


def test_each_input_of_the_combined_experiment_moves_its_own_modes():
    p = plant("combined")
    wing = ACCELEROMETERS[: len(ACCELEROMETERS) - len(FUSELAGE)]
    for channel, sign in ((0, 1), (1, -1)):
        u = np.zeros((200, 2))
        u[10:, channel] = 0.2
        recording = p.run(Signal(u, 0.01), inject="plant_input", noise=False)
        left, right = np.split(recording.columns(wing), 2, axis=1)
        np.testing.assert_allclose(right, sign * left, atol=1e-12)
        assert np.abs(left).max() > 0.01
    assert p.injections["plant_input"].views["position"].reference == ("r_flap_command", "r_aileron_command")


def test_parameters_name_their_sources_and_wrong_ones_are_refused():
    for parameters in PRESETS.values():
        assert all(
            "assumption" in p.source
            for name, p in parameters.items()
            if name.endswith(("frequency", "damping", "pole"))
        )
    for count in (0.5, 95):
        with pytest.raises(ExciteError, match=f"'outputs': {count:g}.*from 1 to 94"):
            plant("flap", outputs=count)
    with pytest.raises(ExciteError, match="not internally stable"):
        plant("aileron", feedback_gain=30.0)


@pytest.mark.parametrize(
    "preset, inject", [("aileron", "plant_input"), ("aileron", "setpoint"), ("combined", "plant_input")]
)
def test_other_presets_conform(preset, inject):
    p = plant(preset, outputs=12)
    for check in checks_of(p):
        check(p, inject)
