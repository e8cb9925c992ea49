"""The one loop diagram: linear plants against a plain sample loop, refusals, actuators, noise streams."""

import numpy as np
import pytest
import scipy.linalg as la

from excite.errors import ExciteError, SimulationStopped
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.signal import Signal
from plants.arguments import Parameter
from plants.linear.actuator import Backlash, Quantiser, RateLimit, Saturation, actuate
from plants.linear.loop import Dynamics, Feedback, interconnect
from plants.linear.plant import LinearPlant

DT = 0.1


def dynamics(feedthrough=False, stationary=False):
    rng = np.random.default_rng(0)
    A = la.block_diag([[0.9, 0.2], [-0.2, 0.9]], [[0.5]])
    B, C = rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
    B[2] = 0  # the third state shapes noise
    D = rng.standard_normal((2, 2)) if feedthrough else np.zeros((2, 2))
    G = np.array([[0, 0, 0], [0, 0, 0], [1.0, 0, 0]])
    H = np.array([[0, 1, 0], [0, 0, 1.0]])
    return Dynamics(A, B, C, D, G, H, {"process": 1, "measurement": 2}, noise_states=1, stationary=stationary)


def controller():
    return StateSpaceModel([[0.3]], [[0.1]], [[0.2], [-0.1]], [[0.05], [0.02]], DT)


def plant(feedback=True, **options):
    return LinearPlant(
        name="example",
        description="",
        dt=DT,
        dynamics=options.pop("dynamics", dynamics()),
        inputs=(Channel("u1", "V"), Channel("u2", "V")),
        outputs=(Channel("y1", "m"), Channel("y2", "m")),
        limits=((-10, 10), (-10, 10)),
        parameters={},
        noise_sources={"process": Parameter(0.1, "m", "assumption"), "measurement": Parameter(0.05, "m", "assumption")},
        feedback=Feedback(controller(), measured=(1,)) if feedback else None,
        reference_limits=((-10, 10),),
        **options,
    )


def signal(channels, amplitude=1.0, samples=300, dt=DT):
    return Signal(amplitude * np.sign(np.random.default_rng(5).standard_normal((samples, channels))), dt)


def plain_loop(p, r, inject, elements=(), dt=DT):
    """The diagram, sample by sample, without noise."""
    d, c = p.dynamics, controller()
    x, xc, last = np.zeros(3), np.zeros(1), [np.zeros(2) for _ in elements]
    rows = []
    for now in r:
        r1, r2 = (now, np.zeros(1)) if inject == "plant_input" else (np.zeros(2), now)
        y = d.C @ x
        e = r2 - y[[1]]
        u = r1 + c.C @ xc + c.D @ e
        v = u
        for i, element in enumerate(elements):
            v = last[i] = element.step(v, last[i])
        y = y + d.D @ v
        rows.append((u, v, y))
        x, xc = d.A @ x + d.B @ v, c.A @ xc + c.B @ (r2 - y[[1]])
    return [np.array(each) for each in zip(*rows, strict=True)]


@pytest.mark.parametrize("inject, channels", [("setpoint", 1), ("plant_input", 2)])
@pytest.mark.parametrize(
    "elements", [(), (Saturation(-0.02, 0.03), RateLimit(0.02)), (Backlash(0.02), Quantiser(0.013))]
)
def test_closed_loop_is_the_diagram(inject, channels, elements):
    p, s = plant(actuator=elements), signal(channels)
    recording = p.run(s, inject=inject, noise=False)
    u, v, y = plain_loop(p, s.u, inject, elements)
    np.testing.assert_allclose(recording.columns(("u1", "u2")), u, atol=1e-12)
    np.testing.assert_allclose(recording.columns(("y1", "y2")), y, atol=1e-12)
    np.testing.assert_array_equal(recording.columns(recording.views["plant"].reference), s.u)
    if elements:
        np.testing.assert_allclose(recording.columns(("u1_actual", "u2_actual")), v, atol=1e-12)
        assert np.abs(u - v).max() > 0.005


def test_feedthrough_closed_loop_is_the_diagram_when_the_controller_has_a_delay():
    delayed = StateSpaceModel([[0.3]], [[0.1]], [[0.2], [-0.1]], [[0.0], [0.0]], DT)
    d = dynamics(feedthrough=True)
    loop = interconnect(d, Feedback(delayed, (1,)))
    assert loop.order == 4
    # u does not see y of the same instant: from r1 to y at lag 0 there is D alone
    np.testing.assert_allclose(loop.D[2:, :2], d.D)


def test_every_view_has_the_truth_that_simulates_it():
    p = plant()
    for inject, place in p.injections.items():
        recording = p.run(signal(len(place.channels)), inject=inject, noise=False)
        for name in place.views:
            data, truth = recording.experiment(name), p.truth(recording, name)
            np.testing.assert_allclose(truth.model.simulate(data.u), data.y, atol=1e-10)
            assert len(truth.poles) == truth.model.order - 1  # the noise's state is no pole of the path


def test_truth_predicts_with_the_covariance_it_states():
    p = plant()
    data = p.run(signal(1, samples=20_000), seed=3).experiment("plant")
    truth = p.truth(None, "plant").model
    e = data.y - truth.predict(data)
    np.testing.assert_allclose(e.T @ e / len(e), truth.innovation_cov, atol=0.05 * truth.innovation_cov.max())
    correlation = np.abs(e[1:].T @ e[:-1] / len(e)) / np.outer(e.std(0), e.std(0))
    assert correlation.max() < 0.03


def test_noise_sources_have_streams_of_their_own():
    p, s = plant(False), signal(2)
    clean, both = p.run(s, noise=False).values, p.run(s, seed=1).values
    one, other = (
        p.run(s, noise={"process": 0.0, "measurement": 0.0} | {k: v.value}, seed=1).values
        for k, v in p.noise_sources.items()
    )
    np.testing.assert_allclose(both - clean, one - clean + other - clean, atol=1e-12)


def test_stationary_noise_has_its_variance_from_the_first_sample():
    p, s = plant(False, dynamics=dynamics(stationary=True)), signal(2, samples=2)
    first = np.array([r.columns(("y1",))[0] for r in p.run_many(s, seeds=range(4000))]).ravel()
    c = p.dynamics.C[0, 2]
    assert first.var() == pytest.approx(c**2 * 0.01 / (1 - 0.25) + 0.05**2, rel=0.1)


def test_run_and_run_many_agree_and_repeat():
    p, s = plant(actuator=(Saturation(-0.4, 0.4),)), signal(1, 8)
    many = p.run_many(s, seeds=[4, 5])
    for seed, recording in zip([4, 5], many, strict=True):
        np.testing.assert_allclose(p.run(s, seed=seed).values, recording.values, atol=1e-10)
    assert p.run(s, seed=4).values.tobytes() == p.run(s, seed=4).values.tobytes()


def test_algebraic_and_unstable_loops_are_refused():
    with pytest.raises(ExciteError, match=r"example: algebraic loop.*give one of them a delay"):
        plant(dynamics=dynamics(feedthrough=True))
    d = dynamics()
    with pytest.raises(ExciteError, match=r"not internally stable: pole .* of modulus"):
        interconnect(d, Feedback(StateSpaceModel([[1.2]], [[1.0]], [[1.0], [0.0]], [[0.0], [0.0]], DT), (1,)))
    unstable = Dynamics(1.1 * np.eye(1), *(np.ones((1, 1)) for _ in range(2)), *(np.zeros((1, 1)) for _ in range(3)))
    with pytest.raises(ExciteError, match="unstable in open loop"):
        interconnect(unstable, None)


def test_a_loop_that_saturation_opens_is_stopped():
    unstable = Dynamics(
        np.array([[1.2]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), np.zeros((1, 0)), np.zeros((1, 0))
    )
    p = LinearPlant(
        name="example",
        description="",
        dt=DT,
        dynamics=unstable,
        inputs=(Channel("u"),),
        outputs=(Channel("y"),),
        limits=((-100, 100),),
        parameters={},
        noise_sources={},
        reference_limits=((-100, 100),),
        feedback=Feedback(StateSpaceModel(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[0.9]], DT), (0,)),
        actuator=(Saturation(-1, 1),),
    )
    p.run(signal(1, 0.1))
    with pytest.raises(SimulationStopped, match="diverged at sample"):
        p.run(signal(1, 50.0))


def test_actuator_elements():
    u = np.array([0.0, 1.0, 2.0, 1.8, 0.5, -3.0])[:, None]
    np.testing.assert_allclose(actuate([Saturation(-1, 1.5)], u)[:, 0], [0, 1, 1.5, 1.5, 0.5, -1])
    np.testing.assert_allclose(actuate([RateLimit(0.7)], u)[:, 0], [0, 0.7, 1.4, 1.8, 1.1, 0.4])
    np.testing.assert_allclose(actuate([Backlash(1.0)], u)[:, 0], [0, 0.5, 1.5, 1.5, 1.0, -2.5])
    np.testing.assert_allclose(actuate([Quantiser(0.5)], u)[:, 0], [0, 1, 2, 2, 0.5, -3])
