"""Conformance of simulated plants: what every plant in the table must satisfy, as callables for a test runner."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from excite.errors import ExciteError
from excite.types.recording import Recording
from excite.types.signal import Signal
from plants.plant import Plant


def small_signal(plant: Plant, inject: str, fraction: float = 0.02, samples: int = 200, hold: int = 20) -> Signal:
    """Return random binary levels, a small fraction of the limits, at twice the plant's dt."""
    place = plant.injections[inject]
    chips = np.random.default_rng(0).choice([-1.0, 1.0], (samples // hold, len(place.channels)))
    half = np.array([(high - low) / 2 for low, high in place.limits])
    middle = np.array([(high + low) / 2 for low, high in place.limits])
    return Signal(np.repeat(chips, hold, axis=0) * fraction * half + middle, 2 * plant.dt, place.channels)


def _run(plant: Plant, inject: str, **options: object) -> Recording:
    return plant.run(small_signal(plant, inject), inject=inject, **options)


def check_deterministic(plant: Plant, inject: str) -> None:
    """The same seed gives the same bits, another seed others; run_many agrees with run."""
    first, again, other = (_run(plant, inject, seed=seed).values for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes() and first.tobytes() != other.tobytes()
    many = plant.run_many(small_signal(plant, inject), inject=inject, seeds=[1, 2])
    np.testing.assert_allclose(many[0].values, first, rtol=0, atol=1e-10)
    np.testing.assert_allclose(many[1].values, other, rtol=0, atol=1e-10)


def check_noise_off(plant: Plant, inject: str) -> None:
    """Without noise the seed does not matter, and every source at zero is the same as none."""
    off = _run(plant, inject, noise=False, seed=1).values
    assert off.tobytes() == _run(plant, inject, noise=False, seed=2).values.tobytes()
    assert off.tobytes() == _run(plant, inject, noise=dict.fromkeys(plant.noise_sources, 0.0)).values.tobytes()


def check_named_and_described(plant: Plant, inject: str) -> None:
    """Channels, limits, parameters and noise sources are named, with units and sources; settings resolve."""
    recording = _run(plant, inject)
    place = plant.injections[inject]
    assert len(place.limits) == len(place.channels) and all(low < high for low, high in place.limits)
    for name, parameter in {**plant.parameters, **plant.noise_sources}.items():
        assert parameter.unit and parameter.source, name
    for name in place.settings:
        experiment = recording.experiment(name)
        truth = plant.truth(recording, name)
        assert tuple(truth.model.inputs) == experiment.inputs and tuple(truth.model.outputs) == experiment.outputs
        assert abs(truth.model.dt / experiment.dt - 1) < 1e-9


def check_limits(plant: Plant, inject: str) -> None:
    """A signal beyond the limits, and one with the wrong number of channels, are refused by name."""
    signal = small_signal(plant, inject)
    channel = plant.injections[inject].channels[0].name
    for bad, expected in (
        (replace(signal, u=signal.u * 1000, recipe={}), channel),
        (Signal(np.hstack([signal.u, signal.u[:, :1]]), signal.dt), str(signal.u.shape[1] + 1)),
    ):
        try:
            plant.run(bad, inject=inject)
        except ExciteError as error:
            assert expected in str(error), error
        else:
            raise AssertionError(f"{plant.name} played what it should refuse ({expected})")


def check_truth(plant: Plant, inject: str) -> None:
    """Noise-free and small, a run follows the truth of every setting within 2 % of each output's excursion."""
    recording = _run(plant, inject, noise=False)
    for name in plant.injections[inject].settings:
        experiment, truth = recording.experiment(name), plant.truth(recording, name)
        error = experiment.y - truth.model.simulate(experiment.u)
        assert (np.abs(error).max(0) <= 0.02 * np.ptp(experiment.y, axis=0)).all(), (name, error)


CHECKS: tuple[Callable[[Plant, str], None], ...] = (
    check_deterministic,
    check_noise_off,
    check_named_and_described,
    check_limits,
    check_truth,
)
