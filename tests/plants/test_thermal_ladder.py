"""The thermal ladder: exact temperatures, several nodes, sampling, electrical transients, noise, refusals."""

import tomllib

import numpy as np
import pytest

from excite.errors import DesignRefused, ExciteError
from excite.files import load_recording, save_recording
from excite.types.signal import Signal
from plants.registry import load_plant
from plants.thermal.ladder import PRESETS, thermal_ladder
from scenarios.run.design import make_design
from scenarios.scenario.reading import LIBRARY, check_scenario

R, TAU = (np.array(PRESETS["five"][name].value) for name in ("resistance", "time_constant"))
LED = {name: PRESETS["led"][name].value for name in ("resistance", "capacitance")}


def step(power=5.0, samples=1000, dt=20e-6):
    return Signal(np.full((samples, 1), power), dt)


def rise(time_s, power=5.0):
    """(8.1) of Miller (2012) for the default preset."""
    return power * (-np.expm1(-time_s[:, None] / TAU) @ R)


def test_a_step_is_the_sum_of_exponentials_however_long():
    recording = load_plant("thermal_ladder").run(step(samples=1_500_000), noise=False)  # 30 s
    np.testing.assert_allclose(recording.values[:, 1], rise(recording.time_s), atol=1e-10)


def test_any_power_is_a_sum_of_steps():
    p = thermal_ladder("led", {"dt": 0.5})
    power = np.random.default_rng(0).uniform(0, 10, 40)
    recording = p.run(Signal(power, 1.5), noise=False)
    expected = np.zeros((120, 3))
    for k, change in enumerate(np.diff(power, prepend=0)):
        expected += change * (-np.expm1(-np.maximum(recording.time_s - 1.5 * k, 0)[:, None] / p.tau) @ p.resistance)
    np.testing.assert_allclose(recording.values[:, 1:], expected, atol=1e-11)
    np.testing.assert_array_equal(recording.values[:, 0], np.repeat(power, 3))


def test_logarithmic_samples_are_those_of_the_same_response():
    p = thermal_ladder(parameters={"samples_per_decade": 200})
    u = np.full((300, 1), 5.0)
    u[100:] = 2.0
    recording = p.run(Signal(u, 0.1), noise=False)
    t = recording.time_s
    assert recording.dt is None and (t[0], t[-1]) == (20e-6, pytest.approx(30)) and 800 < len(t) < 1236
    np.testing.assert_allclose(np.diff(np.log10(t[t > 0.1])), 1 / 200, rtol=0.05)
    np.testing.assert_allclose(t / 20e-6, np.rint(t / 20e-6), rtol=1e-12)
    np.testing.assert_allclose(recording.values[:, 1], rise(t) - rise(np.maximum(t - 10, 0), 3.0), atol=1e-12)
    np.testing.assert_array_equal(recording.values[:, 0], np.where(t < 10, 5.0, 2.0))
    noisy = p.run(Signal(u, 0.1), seed=3, noise={"measurement": 0.03})
    assert (noisy.values - recording.values)[:, 1].std() == pytest.approx(0.03, rel=0.1)
    assert (
        noisy.values.tobytes()
        == p.run_many(Signal(u, 0.1), seeds=[2, 3], noise={"measurement": 0.03})[1].values.tobytes()
    )


def test_observed_nodes_share_their_time_constants():
    """Heat reaches the nodes one after the other, and rests at power times the resistance from there to ambient."""
    p = thermal_ladder("led", {"dt": 1.0, "nodes": [1, 2, 3, 4]})
    T = p.run(step(2.0, 4000, 1.0), noise=False).values[:, 1:]
    np.testing.assert_allclose(T[-1], 2.0 * np.cumsum(LED["resistance"][::-1])[::-1], rtol=1e-7)
    assert (np.diff(T[1:], axis=1) < 0).all() and (np.diff(T[:2000], axis=0) > 0).all()
    assert [str(c) for c in p.outputs] == ["source [K]", "node_2 [K]", "node_3 [K]", "node_4 [K]"]


def test_foster_and_cauer_describe_the_same_plant():
    cauer = thermal_ladder("led", {"nodes": [1]})
    modes = {"resistance": cauer.resistance[:, 0].tolist(), "time_constant": cauer.tau.tolist()}
    foster = thermal_ladder("five", modes | {"dt": 0.01})
    signal = Signal(np.random.default_rng(0).uniform(0, 10, 500), 0.01)
    both = [p.run(signal, noise=False).values for p in (cauer, foster)]
    np.testing.assert_allclose(both[0], both[1], atol=1e-11)
    again = thermal_ladder("five", LED | {"dt": 0.01})  # giving capacitances drops the preset's time constants
    np.testing.assert_array_equal(again.run(signal, noise=False).values, both[0])


def test_truth_is_the_network(tmp_path):
    p = load_plant("thermal_ladder", preset="led", parameters={"nodes": [1, 4]})
    recording = p.run(Signal(np.random.default_rng(1).uniform(0, 10, 400), 0.02), seed=1)
    save_recording(recording, tmp_path / "led.npz")
    truth = load_plant("thermal_ladder").truth(load_recording(tmp_path / "led.npz"), "plant")
    np.testing.assert_allclose(-0.01 / np.log(np.sort(truth.poles.real)), p.tau, rtol=1e-9)
    model, data = truth.model, recording.experiment()
    residual = data.y - model.simulate(data.u)
    assert residual.std() == pytest.approx(0.01, rel=0.1)
    np.testing.assert_allclose(data.y - model.predict(data), residual, atol=1e-12)
    np.testing.assert_allclose(model.innovation_cov, 1e-4 * np.eye(2))


@pytest.mark.parametrize("per_decade", [0, 100])
def test_electrical_transient_follows_each_change_of_power(per_decade):
    p = thermal_ladder(parameters={"samples_per_decade": per_decade, "transient_time": 1e-3})
    u = np.full((400, 1), 5.0)
    u[100:] = 2.0
    only = {"measurement": 0.0, "transient": 0.5}
    bad, clean = (p.run(Signal(u, 2e-4), noise=noise) for noise in (only, False))
    t = clean.time_s
    expected = 0.5 * (5.0 * np.exp(-t / 1e-3) - 3.0 * np.exp(-(t - 0.02) / 1e-3) * (t >= 0.02 - 1e-9))
    np.testing.assert_allclose(bad.values[:, 1] - clean.values[:, 1], expected, atol=1e-12)
    quiet, off = (p.run(Signal(u, 2e-4), noise=noise).values for noise in ({"measurement": 0.0}, False))
    np.testing.assert_array_equal(quiet, off)  # no transient unless given


def test_transient_shows_where_temperature_is_measured_electrically():
    p = thermal_ladder("led", {"nodes": [4, 1]})
    bad, clean = (p.run(step(dt=0.01), noise=noise).values for noise in ({"measurement": 0.0, "transient": 0.5}, False))
    np.testing.assert_array_equal(bad[:, 1], clean[:, 1])
    assert bad[0, 2] == 2.5 and clean[0, 2] == 0


def test_actuator_in_front_of_the_source():
    for per_decade in (0, 50):
        given = {"samples_per_decade": per_decade, "actuator_saturation": 4.0}
        recording = load_plant("thermal_ladder", parameters=given).run(step(5.0), noise=False)
        assert [c.name for c in recording.channels] == ["power", "power_actual", "source"]
        np.testing.assert_allclose(recording.values[:, 2], rise(recording.time_s, 4.0), atol=1e-11)


@pytest.mark.parametrize(
    ("preset", "parameters", "message"),
    [
        ("five", {"resistance": 2.0}, r"'resistance': 2\.0; give a list of numbers"),
        ("five", {"resistance": [1, 2, 3]}, "3 resistances and 5 time constants"),
        ("five", {"time_constant": [1, "a"]}, r"'time_constant'\[1\]: 'a' is not a number"),
        ("five", {"resistance": [1, 1], "time_constant": [1, 1]}, "1 s is given twice"),
        ("led", {"capacitance": [1, 1, 1, -1]}, r"capacitance\[3\]: -1; every value must be positive"),
        ("led", {"capacitance": [1, 1, 1, 1], "time_constant": [1, 2, 3, 4]}, "give one of the two"),
        ("led", {"nodes": [1, 5]}, r"'nodes': \[1, 5\]; give a list of different nodes from 1 \(source\) to 4"),
        ("led", {"nodes": [2, 2]}, "different nodes"),
        ("led", {"nodes": []}, "different nodes"),
    ],
)
def test_what_is_no_ladder_is_refused(preset, parameters, message):
    with pytest.raises(ExciteError, match=message):
        load_plant("thermal_ladder", preset=preset, parameters=parameters)


def test_what_cannot_be_played_is_refused():
    with pytest.raises(DesignRefused, match="exceeds the limit 20 W"):
        thermal_ladder(parameters={"samples_per_decade": 10}).run(step(21.0))
    late = Signal(np.r_[np.zeros(5), 30.0], 20e-6)
    with pytest.raises(DesignRefused, match="exceeds the limit 20 W"):
        thermal_ladder(parameters={"samples_per_decade": 10}).run(late)
    with pytest.raises(ExciteError, match="samples_per_decade"):
        thermal_ladder(parameters={"samples_per_decade": 1e9}).run(step())


def test_scenarios_refuse_uneven_times_before_they_run():
    source = tomllib.loads((LIBRARY / "thermal_step.toml").read_text(encoding="utf-8"))
    source["plant"]["parameters"]["samples_per_decade"] = 50
    source["excitation"] = source["excitation"][0] | {"dt": 0.1}
    with pytest.raises(ExciteError, match=r"plant\.parameters: they have the plant sample at uneven times"):
        make_design(check_scenario(source, "uneven.toml"))
