"""The lti plant: what its numbers mean, what is refused, and that its recordings know their truth."""

import json

import numpy as np
import pytest
import scipy.linalg as la
from scipy.signal import lfilter

from excite.errors import ExciteError
from excite.files import load_recording, save_recording
from excite.types.signal import Signal
from plants.linear.lti import lti
from plants.registry import load_plant
from scenarios.cli.main import status

A, B = [[0.9, 0.2], [-0.2, 0.9]], [[0.0, 1.0], [1.0, 0.5]]
C, D = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], [[0.0, 0.0], [0.3, 0.0], [0.0, 0.0]]
MATRICES = {"A": A, "B": B, "C": C, "D": D}
U = np.random.default_rng(0).standard_normal((200, 1))


def output(parameters, u=U, **options):
    plant = lti(parameters=parameters)
    return plant.run(Signal(u, plant.dt), **options).experiment("plant").y


@pytest.mark.parametrize(
    "num, den",
    [
        ([2.0], [1.0, -0.5]),
        ([1.0, 0.5], [2.0, -1.5, 0.7]),
        ([0.3, 0.2, 0.1], [1.0, -1.2, 0.5]),
        ([0.0, 0.0, 1.0], [1.0, 0, 0]),
        ([2.5], [1.0]),
    ],
)
def test_a_transfer_function_in_descending_powers_of_z(num, den):
    lagged = [0.0] * (len(den) - len(num)) + num  # in powers of 1/z
    np.testing.assert_allclose(
        output({"num": num, "den": den}, noise=False)[:, 0], lfilter(lagged, den, U[:, 0]), atol=1e-10
    )


def test_several_numerators_share_the_denominator():
    y = output({"num": [[0, 1.0], [0.5, 0]], "den": [1.0, -0.6]}, noise=False)
    expected = [lfilter(b, [1.0, -0.6], U[:, 0]) for b in ([0, 1.0], [0.5, 0])]
    np.testing.assert_allclose(y.T, expected, atol=1e-12)


def test_matrices_are_simulated_as_they_stand():
    u = np.random.default_rng(1).standard_normal((100, 2))
    x, rows = np.zeros(2), []
    for now in u:
        rows.append(np.array(C) @ x + np.array(D) @ now)
        x = np.array(A) @ x + np.array(B) @ now
    np.testing.assert_allclose(output(MATRICES, u, noise=False), rows, atol=1e-10)
    without = {key: value for key, value in MATRICES.items() if key != "D"}
    model = lti(parameters=without).truth(None, "plant").model
    np.testing.assert_array_equal(model.D, np.zeros((3, 2)))


def test_innovation_form_is_recovered_by_the_truth():
    K = [[0.2, 0.0, 0.1], [0.0, 0.3, 0.0]]
    plant = lti(parameters=MATRICES | {"noise": {"K": K}})
    recording = plant.run(Signal(np.zeros((20_000, 2)), 1.0), noise={"output": 0.5}, seed=2)
    model = plant.truth(recording, "plant").model
    np.testing.assert_allclose(model.K, K, atol=1e-9)
    np.testing.assert_allclose(model.innovation_cov, 0.25 * np.eye(3), atol=1e-9)
    e = recording.experiment("plant").y - model.predict(recording.experiment("plant"))
    np.testing.assert_allclose(e.T @ e / len(e), 0.25 * np.eye(3), atol=0.01)


def test_noise_sources_enter_where_they_say():
    """Variances of y in the long run: process C P C', P = A P A' + I; input with B B' and D; output through its filter."""
    rest = {"process": 0.0, "input": 0.0, "output": 0.0}
    u = np.zeros((200_000, 2))
    plant = lti(parameters=MATRICES | {"noise": {"num": [1.0, 0.0], "den": [1.0, -0.8]}})
    a, b, c, d = (np.array(part) for part in (A, B, C, D))
    expected = {
        "process": c @ la.solve_discrete_lyapunov(a, np.eye(2)) @ c.T,
        "input": c @ la.solve_discrete_lyapunov(a, b @ b.T) @ c.T + d @ d.T,
        "output": np.eye(3) / (1 - 0.64),
    }
    for source, covariance in expected.items():
        y = plant.run(Signal(u, 1.0), noise=rest | {source: 1.0}).experiment("plant").y
        np.testing.assert_allclose(y.T @ y / len(y), covariance, atol=0.04 * covariance.max())


def test_any_controller_closes_the_loop_of_the_diagram():
    """u = r1 + C (r2 + sign y_m), sample by sample, with a controller of two states on the second output."""
    controller = {"num": [0.0, -0.2, -0.1], "den": [1.0, -1.2, 0.4], "measured": ["y2"], "sign": 1}
    parameters = {"num": [[0.0, 1.0], [0.0, 0.5]], "den": [1.0, -0.5], "controller": controller}
    plant = lti(parameters=parameters)
    r = 0.5 * np.random.default_rng(3).standard_normal(80)
    data = plant.run(Signal(r[:, None], 1.0), inject="setpoint", noise=False).experiment("plant")
    u, y = np.zeros(80), np.zeros((80, 2))
    for k in range(80):
        y[k] = (0.5 * y[k - 1] + np.array([1.0, 0.5]) * u[k - 1]) if k else 0
        e = r[: k + 1] + y[: k + 1, 1]
        u[k] = lfilter([0.0, -0.2, -0.1], [1.0, -1.2, 0.4], e)[-1]
    np.testing.assert_allclose(data.u[:, 0], u, atol=1e-10)
    np.testing.assert_allclose(data.y, y, atol=1e-10)
    assert data.references[0].name == "r_y2" and data.loop.sign == 1


def test_a_pid_is_the_sum_of_its_three_parts():
    """From error to input in a loop with a plant that does little: kp e + ki dt sum of past e + kd (e - e before) / dt."""
    gains = {"kp": [2.0, 3.0], "ki": [0.0, 0.4], "kd": 0.1}
    # an integral with nothing to stop it is not internally stable, so the second output follows its input a little
    parameters = {"A": [[0.0]], "B": [[0.0, 1.0]], "C": [[0.0], [0.01]], "dt": 0.5, "controller": gains}
    r = np.random.default_rng(0).standard_normal((50, 2))
    data = lti(parameters=parameters).run(Signal(r, 0.5), inject="setpoint", noise=False).experiment("plant")
    e = r - data.y
    before = np.vstack([np.zeros((1, 2)), e[:-1]])
    expected = [2.0, 3.0] * e + [0.0, 0.4] * (np.cumsum(before, axis=0) * 0.5) + 0.1 * (e - before) / 0.5
    np.testing.assert_allclose(data.u, expected, atol=1e-12)


def test_names_units_and_limits():
    plant = lti(
        parameters=MATRICES
        | {
            "inputs": ["flap [deg]", "aileron [deg]"],
            "outputs": ["a [g]", "b [g]", "c [rad/s]"],
            "limits": [3, 5],
            "dt": 0.01,
        }
    )
    place = plant.injections["input"]
    assert [str(c) for c in place.channels] == ["flap [deg]", "aileron [deg]"] and place.limits == ((-3, 3), (-5, 5))
    assert str(plant.truth(None, "plant").model.outputs[2]) == "c [rad/s]" and plant.dt == 0.01


LOOP = {"num": [1.0], "den": [1.0, -0.5]}


@pytest.mark.parametrize(
    "parameters, message",
    [
        (MATRICES | {"A": [[1, 2], [3]]}, r"lti parameter 'A': .* rows of equal length"),
        ({"A": [[0.5]]}, r"lti parameter 'B': missing; give A, B, C \(and D\), or num and den"),
        ({"A": [[0.5, 1.0]], "B": [[1.0]], "C": [[1.0]]}, r"'A': is 1 x 2; with this A it is 1 x 1"),
        ({"A": A, "B": [0.0, 1.0], "C": C}, r"'B': is 1 x 2; with this A it is 2 x 2"),
        (MATRICES | {"D": [[1.0]]}, r"'D': is 1 x 1; it must be 3 x 2"),
        (MATRICES | {"num": [1.0], "den": [1.0]}, r"a transfer function and matrices are both given"),
        ({"num": ["x"], "den": [1.0]}, r"'num': 'x' is not a number"),
        ({"num": [float("nan")], "den": [1.0]}, r"'num': nan is not finite"),
        ({"num": [1.0, 2.0], "den": [1.0]}, r"'num': has 2 coefficients, den 1"),
        ({"den": [0.0, 1.0]}, r"'den': starts with 0"),
        ({"num": []}, r"'num': \[\]; give rows"),
        ({"dt": -1}, r"'dt': -1 s; it must be positive"),
        ({"nun": [1.0]}, r"'nun' does not exist; did you mean 'num'"),
        ({"den": [1.0, -1.2], "num": [1.0]}, r"lti: the plant is unstable in open loop"),
        ({"controller": {"nim": [1.0]}}, r"'controller.nim': unknown key; did you mean 'num'"),
        ({"controller": 3}, r"'controller': 3; give a table"),
        ({"controller": {"num": [1.0]}}, r"'controller.den': missing"),
        (
            {"controller": {"D": [[1.0, 2.0]]}},
            r"'controller': is 1 x 2; from 1 measured outputs to 1 inputs it is 1 x 1",
        ),
        ({"controller": {**LOOP, "measured": ["z"]}}, r"'controller.measured': 'z' is no output"),
        ({"controller": {**LOOP, "sign": 2}}, r"'controller.sign': 2"),
        ({"controller": {"D": [[9.0]]}}, r"lti: the closed loop is not internally stable"),
        ({"num": [1.0, 0.0], "den": [1.0, -0.5], "controller": {"D": [[0.1]]}}, r"lti: algebraic loop"),
        ({"noise": {"num": [1.0], "den": [1.0, -1.1]}}, r"'noise': has a pole of modulus 1.1"),
        ({"noise": {"num": [1.0, 2.0], "den": [1.0, -0.5]}}, r"'noise': a zero of the noise filter has modulus 2"),
        ({"noise": {"K": [[1.0]]}}, r"'noise.K': is 1 x 1; it must be 2 x 1"),
        ({"noise": {"K": [[9.0], [0.0]]}}, r"'noise.K': a zero of the noise filter has modulus"),
        ({"inputs": ["a", "b"]}, r"'inputs': .* give 1 names"),
        ({"limits": [1.0, 2.0]}, r"'limits': has 2 numbers; give one, or 1"),
        ({"limits": -1.0}, r"'limits': -1"),
    ],
)
def test_what_cannot_be_meant_is_refused_by_its_place(parameters, message):
    with pytest.raises(ExciteError, match=message):
        load_plant("lti", parameters=parameters)


def test_a_recording_rebuilds_its_truth_from_the_file(tmp_path, capsys):
    """The parameters of the source, through a file, load the same plant: `excite score --truth auto` needs no more."""
    given = {
        "num": [0.5],
        "den": [1.0, -0.9],
        "noise": {"num": [1.0, 0.0], "den": [1.0, -0.7]},
        "controller": {"D": [[0.4]]},
    }
    plant = load_plant("lti", parameters=given)
    path = tmp_path / "flight.npz"
    recording = plant.run(Signal(np.random.default_rng(0).choice([-1.0, 1.0], (800, 1)), 1.0), inject="plant_input")
    save_recording(recording, path)
    loaded = load_recording(path)
    again = load_plant("lti", preset=loaded.origin.preset, parameters=loaded.origin.parameters)
    one, other = plant.truth(recording, "plant").model, lti().truth(loaded, "plant").model
    for key in ("A", "B", "C", "D", "K"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key))
    assert again.values == plant.values
    model = tmp_path / "model.json"
    identify = ["identify", str(path), "--view", "plant", "--method", "ssarx", "--order", "2", "-o", str(model)]
    assert status(identify) == 0
    capsys.readouterr()
    assert status(["score", str(model), str(path), "--view", "plant", "--truth", "auto", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["values"]["pole_error_max"] < 0.5


def test_it_describes_itself(capsys):
    assert status(["plants", "lti"]) == 0
    text = capsys.readouterr().out
    assert "num" in text and "controller" in text and "truth (exact)" in text
