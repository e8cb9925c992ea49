"""The mjcf plant: its linearisation, its loops against a plain loop, and files that must not be trusted."""

import time

import mujoco
import numpy as np
import pytest
import scipy.linalg as la

from excite.errors import ExciteError, SimulationStopped
from excite.types.signal import Signal
from plants import conformance as checks
from plants.mjcf import loading
from plants.mjcf.plant import EXAMPLE
from plants.registry import load_plant

OSCILLATOR = """
<mujoco>
  <option timestep="0.01" integrator="Euler" gravity="0 0 0"/>
  <worldbody><body><joint name="x" type="slide" axis="1 0 0" stiffness="4" damping="0.4"/>
    <geom type="sphere" size="0.1" mass="2"/></body></worldbody>
  <actuator><motor name="push" joint="x"/></actuator>
  <sensor><jointpos name="at" joint="x" noise="0.01"/><jointvel name="speed" joint="x"/>
    <jointactuatorfrc name="pushed" joint="x"/></sensor>
</mujoco>
"""
U = np.random.default_rng(0).choice([-0.5, 0.5], (300, 1))


@pytest.fixture
def file(tmp_path):
    def write(text, name="model.xml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


def plant_of(file, text=OSCILLATOR, **parameters):
    return load_plant("mjcf", parameters={"file": file(text), **parameters})


def test_the_truth_is_the_oscillator(file):
    """Semi-implicit Euler with implicit damping: v+ = (m v + h (u - k x)) / (m + h d), x+ = x + h v+."""
    m, k, d, h = 2.0, 4.0, 0.4, 0.01
    mass = m + h * d
    A = np.array([[1 - h * h * k / mass, h * m / mass], [-h * k / mass, m / mass]])
    B = np.array([[h * h / mass], [h / mass]])
    model = plant_of(file).truth(None, "plant").model
    np.testing.assert_allclose(model.A, A, atol=1e-8)
    np.testing.assert_allclose(model.B, B, atol=1e-8)
    np.testing.assert_allclose(model.C, [[1, 0], [0, 1], [0, 0]], atol=1e-8)
    np.testing.assert_allclose(model.D, [[0], [0], [1]], atol=1e-8)  # a force is felt at once
    slow = plant_of(file, dt=0.05).truth(None, "plant").model
    np.testing.assert_allclose(slow.A, np.linalg.matrix_power(A, 5), atol=1e-8)
    np.testing.assert_allclose(slow.B, sum(np.linalg.matrix_power(A, i) @ B for i in range(5)), atol=1e-8)


def test_a_linear_model_runs_as_its_truth_says(file):
    plant = plant_of(file, dt=0.03)
    data = plant.run(Signal(U, 0.03), noise=False).experiment("plant")
    np.testing.assert_allclose(data.y, plant.truth(None, "plant").model.simulate(U), atol=1e-6)
    assert [str(c) for c in data.outputs] == ["at [m]", "speed [m/s]", "pushed [1]"]


def test_the_loop_is_the_diagram_in_mujoco(file):
    """A PI controller on the position, sample by sample, with plain mj_step."""
    plant = plant_of(file, dt=0.02, controller={"kp": 3.0, "ki": 1.0, "measured": ["at"]})
    r = 0.3 * np.sign(U)
    data = plant.run(Signal(r, 0.02), inject="setpoint", noise=False).experiment("plant")
    model = mujoco.MjModel.from_xml_string(OSCILLATOR)
    state, integral = mujoco.MjData(model), 0.0
    for k in range(len(r)):
        e = r[k, 0] - state.qpos[0]
        state.ctrl[0] = 3.0 * e + 1.0 * integral
        integral += 0.02 * e
        np.testing.assert_allclose([data.u[k, 0], data.y[k, 0]], [state.ctrl[0], state.qpos[0]], atol=1e-10)
        mujoco.mj_step(model, state, 2)


def upright(**parameters):
    """The example's pole balanced by a state feedback that is designed on the linearisation."""
    model = mujoco.MjModel.from_xml_path(str(EXAMPLE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 1)
    A, B = np.zeros((4, 4)), np.zeros((4, 1))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)
    X = la.solve_discrete_are(A, B, np.diag([1.0, 1, 0.1, 0.1]), np.eye(1))
    K = la.solve(1 + B.T @ X @ B, B.T @ X @ A)
    return load_plant("mjcf", parameters={"keyframe": "upright", "state_feedback": K.tolist(), **parameters})


def test_state_feedback_balances_an_unstable_trim():
    plant = upright()
    assert np.abs(plant.truth(None, "plant").poles).max() > 1.01
    names = [c.name for c in plant.outputs]
    assert names == ["position", "angle", "q_cart", "q_pole", "v_cart", "v_pole"]
    data = plant.run(Signal(0.2 * U, plant.dt), inject="plant_input").experiment("plant")
    assert np.abs(data.y[:, 1]).max() < 0.2
    for place in plant.injections:
        for check in (
            checks.check_deterministic,
            checks.check_noise_off,
            checks.check_truth,
            checks.check_bad_loops_are_refused,
        ):
            check(plant, place)
    with pytest.raises(ExciteError, match=r"unstable in open loop.*run it in closed loop"):
        load_plant("mjcf", parameters={"keyframe": "upright"})


def test_control_limits_are_the_models_and_what_acts_is_recorded():
    plant = upright()
    recording = plant.run(Signal(np.full((200, 1), 9.0), plant.dt), inject="plant_input", noise=False)
    u, v = recording.columns(("force", "force_actual")).T
    np.testing.assert_allclose(v, np.clip(u, -10, 10), atol=1e-12)
    assert recording.views["plant"].inputs == ("force_actual",)


def test_a_recording_finds_its_file_again(file):
    plant = plant_of(file)
    recording = plant.run(Signal(U, 0.01), seed=1)
    again = load_plant("mjcf").truth(recording, "plant").model
    np.testing.assert_array_equal(again.A, plant.truth(recording, "plant").model.A)
    # position noise is the sensor's own, 0.01; speed and force have none, so that there is no whole noise model
    y = recording.experiment("plant").y - plant.run(Signal(U, 0.01), noise=False).experiment("plant").y
    np.testing.assert_allclose(y.std(0), [0.01, 0, 0], rtol=0.1)


def test_a_run_that_diverges_is_stopped(file):
    """A velocity beyond 1e6 m/s is stopped by name, before MuJoCo takes it for unstable and starts anew."""
    plant = plant_of(file, limits=1e9)
    plant.run(Signal(1e6 * U, 0.01), noise=False)
    with pytest.raises(SimulationStopped, match=r"mjcf: the motion diverged at 0.0\d0 s; reduce"):
        plant.run(Signal(8e8 * np.abs(U), 0.01), noise=False)


def replaced(old, new):
    assert old in OSCILLATOR
    return OSCILLATOR.replace(old, new)


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "is no XML"),
        ("<mujoco><", "is no XML"),
        ("<robot/>", "no MJCF file: its root is <robot>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "declares a document type"),
        (replaced("<worldbody>", '<asset><mesh file="/etc/passwd"/></asset><worldbody>'), "leaves the model's folder"),
        (
            replaced("<worldbody>", '<asset><mesh file="a/../../b.obj"/></asset><worldbody>'),
            "leaves the model's folder",
        ),
        (
            replaced("<worldbody>", '<asset><hfield file="..\\\\b.png"/></asset><worldbody>'),
            "leaves the model's folder",
        ),
        (replaced("<worldbody>", '<compiler meshdir="../.."/><worldbody>'), "leaves the model's folder"),
        (
            replaced("<worldbody>", '<asset><texture fileright="C:\\\\x.png"/></asset><worldbody>'),
            "leaves the model's folder",
        ),
        (replaced("<worldbody>", '<include file="../other.xml"/><worldbody>'), "leaves the model's folder"),
        (replaced("<worldbody>", '<include file="model.xml"/><worldbody>'), "includes itself"),
        (replaced("<worldbody>", '<include file="absent.xml"/><worldbody>'), "absent.xml: cannot be read"),
        (replaced("<worldbody>", '<extension><plugin plugin="mujoco.pid"/></extension><worldbody>'), "uses plugins"),
        (replaced("<motor", "<engine"), "MuJoCo refuses it .*engine"),
        (replaced('integrator="Euler"', 'integrator="RK4"'), "integrator RK4 cannot be linearised"),
        (replaced('<actuator><motor name="push" joint="x"/></actuator>', ""), "has 0 actuators"),
    ],
)
def test_files_that_are_refused(file, text, message):
    with pytest.raises(ExciteError, match=rf"mjcf parameter 'file': .*{message}"):
        plant_of(file, text)


def test_an_included_file_is_looked_at_too(file):
    file('<mujocoinclude><asset><mesh file="/etc/passwd"/></asset></mujocoinclude>', "parts.xml")
    with pytest.raises(ExciteError, match=r"parts.xml: <mesh .* leaves the model's folder"):
        plant_of(file, replaced("<worldbody>", '<include file="parts.xml"/><worldbody>'))
    file("<mujocoinclude><statistic extent='2'/></mujocoinclude>", "parts.xml")
    plant_of(file, replaced("<worldbody>", '<include file="parts.xml"/><worldbody> '))


def test_a_link_out_of_the_folder_is_refused(file, tmp_path):
    outside = tmp_path.parent / "outside.obj"
    outside.write_text("o x")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "inside.obj").symlink_to(outside)
    text = replaced("<worldbody>", '<compiler meshdir="meshes"/><asset><mesh file="inside.obj"/></asset><worldbody>')
    with pytest.raises(ExciteError, match="leaves the model's folder"):
        plant_of(file, text)


@pytest.mark.parametrize(
    "trial, message",
    [
        ("import os; os.kill(os.getpid(), 11)", r"crashes MuJoCo \(signal 11\)"),
        ("import time; time.sleep(30)", "does not compile it in"),
    ],
)
def test_a_crash_or_a_hang_ends_elsewhere(file, monkeypatch, trial, message):
    monkeypatch.setattr(loading, "TRIAL", trial)
    monkeypatch.setattr(loading, "SECONDS", 1)
    start = time.perf_counter()
    with pytest.raises(ExciteError, match=message):
        plant_of(file)
    assert time.perf_counter() - start < 10


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"file": "/nowhere/model.xml"}, r"mjcf parameter 'file': /nowhere/model.xml: cannot be read"),
        ({"file": 3}, r"mjcf parameter 'file': 3; give text"),
        ({"keyframe": "flying"}, r"mjcf parameter 'keyframe': 'flying' is none of the model's: hanging, upright"),
        ({"dt": 0.012}, r"mjcf parameter 'dt': 0.012 s is no whole multiple of the model's timestep; give 0.01 s"),
        (
            {"controller": {"kp": 1.0, "measured": ["speed"]}},
            r"mjcf parameter 'controller.measured': 'speed' is no output",
        ),
        ({"controller": {"kp": 1.0}}, r"'controller': is 2 x 2; from 2 measured outputs to 1 inputs it is 1 x 2"),
        ({"controller": {"kp": -50.0, "measured": ["position"]}}, r"mjcf: the closed loop is not internally stable"),
        ({"state_feedback": [[1.0]]}, r"'state_feedback': is 1 x 1; it must be 1 x 4"),
    ],
)
def test_parameters_that_are_refused(parameters, message):
    with pytest.raises(ExciteError, match=message):
        load_plant("mjcf", parameters=parameters)


def test_a_trim_must_be_an_equilibrium(file):
    keys = '<key name="pulled" qpos="0.3"/><key name="held" qpos="0.3" ctrl="1.2"/>'
    text = replaced("</sensor>", f"</sensor><keyframe>{keys}</keyframe>")
    with pytest.raises(ExciteError, match=r"keyframe pulled is no equilibrium: v_x changes by -0.59.* a second"):
        plant_of(file, text, keyframe="pulled")
    plant = plant_of(file, text, keyframe="held")
    data = plant.run(Signal(np.zeros((50, 1)), 0.01), noise=False).experiment("plant")
    np.testing.assert_allclose(data.y, 0, atol=1e-9)  # it stays, and only deviations are counted


def test_a_controller_on_a_force_needs_a_delay(file):
    with pytest.raises(ExciteError, match="algebraic loop"):
        plant_of(file, controller={"kp": 0.1, "measured": ["pushed"]})
    plant_of(file, controller={"num": [0.1], "den": [1.0, 0.0], "measured": ["pushed"]})
