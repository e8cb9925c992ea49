"""Conformance of simulated plants: what every plant must satisfy, ours and those of other packages.

`check_plant(plant)` runs everything on an instance; a test runner may take the callables of `checks_of(plant)` one by one.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from math import lcm
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.arguments import same_dt
from excite.errors import ExciteError, SimulationStopped, did_you_mean
from excite.generators.multisine import multisine
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.recording import Recording
from excite.types.signal import Signal
from plants.linear.plant import LinearPlant
from plants.plant import Plant

SEEDS = 30
LINES = 24  # of the multisine, in logarithmic steps
VISIBLE = 0.01  # of an output's largest response: what is smaller is not compared


def small_signal(plant: Plant, inject: str, fraction: float = 0.02, samples: int = 200, hold: int = 20) -> Signal:
    """Return random binary levels, a fraction of the limits about the allowed value nearest to zero, at twice the plant's dt."""
    place = plant.injections[inject]
    chips = np.random.default_rng(0).choice([-1.0, 1.0], (samples // hold, len(place.channels)))
    middle, size = _inside(plant, inject, fraction)
    return Signal(np.repeat(chips, hold, axis=0) * size + middle, 2 * plant.dt, place.channels)


def _inside(plant: Plant, inject: str, fraction: float) -> tuple[np.ndarray, np.ndarray]:
    """Return for each channel a value near zero and an amplitude about it that keep the limits."""
    low, high = np.array(plant.injections[inject].limits).T
    size = fraction * (high - low) / 2
    return np.clip(0.0, low + size, high - size), size


def _run(plant: Plant, inject: str, **options: Any) -> Recording:
    return plant.run(small_signal(plant, inject), inject=inject, **options)


def check_deterministic(plant: Plant, inject: str) -> None:
    """The same seed gives the same bits, another seed others; run_many agrees with run."""
    first, again, other = (_run(plant, inject, seed=seed).values for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes() and first.tobytes() != other.tobytes()
    many = plant.run_many(small_signal(plant, inject), inject=inject, seeds=[1, 2])
    np.testing.assert_allclose(many[0].values, first, rtol=0, atol=1e-10)
    np.testing.assert_allclose(many[1].values, other, rtol=0, atol=1e-10)


def check_copies(plant: Plant, inject: str) -> None:
    """A copy, as another process gets one, plays the same bits."""
    again = _run(deepcopy(plant), inject, seed=1)
    assert again.values.tobytes() == _run(plant, inject, seed=1).values.tobytes()


def check_noise_off(plant: Plant, inject: str) -> None:
    """Without noise the seed does not matter, and every source at zero is the same as none."""
    off = _run(plant, inject, noise=False, seed=1).values
    assert off.tobytes() == _run(plant, inject, noise=False, seed=2).values.tobytes()
    assert off.tobytes() == _run(plant, inject, noise=dict.fromkeys(plant.noise_sources, 0.0)).values.tobytes()


def check_seeds_are_independent(plant: Plant, inject: str) -> None:
    """The noise of each source by itself is uncorrelated between seeds, on average over pairs and over neighbours.

    Deviations from the noise-free run, each channel scaled to its own size, are correlated over time and channels.
    """
    signal = small_signal(plant, inject, samples=40)
    clean = plant.run(signal, inject=inject, noise=False).values
    for source, parameter in plant.noise_sources.items():
        levels = dict.fromkeys(plant.noise_sources, 0.0) | {source: parameter.value}
        runs = plant.run_many(signal, inject=inject, seeds=range(SEEDS), noise=levels)
        E = np.array([run.values - clean for run in runs])
        size = np.sqrt((E**2).mean(axis=(0, 1)))
        E = (E[:, :, size > 0] / size[size > 0]).reshape(SEEDS, -1)
        if not E.size:
            assert parameter.value == 0, f"{source} does nothing"
            continue
        E /= np.linalg.norm(E, axis=1, keepdims=True)
        pairs = E @ E.T
        everyone, neighbours = (pairs.sum() - SEEDS) / (SEEDS * (SEEDS - 1)), np.diag(pairs, 1).mean()
        assert abs(everyone) < 0.3 and abs(neighbours) < 0.5, (source, everyone, neighbours)


def check_sources_have_streams_of_their_own(plant: Plant, inject: str) -> None:
    """What all sources do together is what each does by itself: switching one off leaves the others as they were."""
    signal = small_signal(plant, inject, samples=40)
    off = dict.fromkeys(plant.noise_sources, 0.0)
    clean, both = (plant.run(signal, inject=inject, noise=noise, seed=3).values for noise in (False, True))
    parts = [
        plant.run(signal, inject=inject, noise=off | {source: parameter.value}, seed=3).values - clean
        for source, parameter in plant.noise_sources.items()
    ]
    size = np.abs(both - clean).max(axis=0)
    error = np.abs(both - clean - sum(parts)).max(axis=0)
    assert (error <= 0.1 * size + 1e-9 * np.abs(clean).max(axis=0)).all(), error / np.where(size > 0, size, 1)


def check_named_and_described(plant: Plant, inject: str) -> None:
    """Channels, limits, parameters and noise sources are named, with units and sources; views resolve."""
    recording = _run(plant, inject)
    place = plant.injections[inject]
    assert len(place.limits) == len(place.channels) and all(low < high for low, high in place.limits)
    for channel in (*place.channels, *recording.channels):
        assert channel.unit, f"{channel.name} has no unit; a number without one is in '1'"
    for name, parameter in {**plant.parameters, **plant.noise_sources}.items():
        assert parameter.unit and parameter.source, name
    for name in place.views:
        experiment = recording.experiment(name)
        truth = plant.truth(recording, name)
        assert tuple(truth.model.inputs) == experiment.inputs and tuple(truth.model.outputs) == experiment.outputs
        assert experiment.dt is None or same_dt(truth.model.dt, experiment.dt)


def check_records_what_it_says(plant: Plant, inject: str) -> None:
    """Channels, sampling, views and loop of a recording are those that `records` announces."""
    layout, recording = plant.records(inject), _run(plant, inject)
    assert layout.channels == recording.channels and layout.dt == recording.dt
    assert dict(layout.views) == dict(recording.views) and layout.default == recording.default
    assert layout.loop.state == recording.loop.state
    assert [c for c in layout.channels if c in plant.outputs] == list(plant.outputs), "outputs that are not recorded"
    assert recording.origin.plant == plant.name and dict(recording.origin.parameters) == plant.values


def check_records_what_is_played(plant: Plant, inject: str) -> None:
    """The channels of the injection are recorded as the signal, held over its longer samples, at the limits as well."""
    for fraction in (0.02, 0.2):
        signal = small_signal(plant, inject, fraction)
        recording = plant.run(signal, inject=inject)
        k = np.floor((recording.time_s - recording.origin.start_s) / signal.dt + 1e-9).astype(int)
        held = np.where(k[:, None] < 0, 0.0, signal.u[np.minimum(k, len(signal.u) - 1)])
        names = tuple(c.name for c in plant.injections[inject].channels)
        np.testing.assert_array_equal(recording.columns(names), held)


def check_limits(plant: Plant, inject: str) -> None:
    """A signal beyond the limits, and one with the wrong number of channels, are refused by name."""
    signal = small_signal(plant, inject)
    channel = plant.injections[inject].channels[0].name
    for bad, expected in (
        (replace(signal, u=signal.u * 1000, recipe=None), channel),
        (Signal(np.hstack([signal.u, signal.u[:, :1]]), signal.dt), str(signal.u.shape[1] + 1)),
    ):
        try:
            plant.run(bad, inject=inject)
        except ExciteError as error:
            assert expected in str(error), error
        else:
            raise AssertionError(f"{plant.name} played what it should refuse ({expected})")


def check_finite_or_stopped(plant: Plant, inject: str) -> None:
    """At its limits a run stays finite or is stopped by name; so it does where an actuator takes the feedback away."""
    several = [plant]
    if isinstance(plant, LinearPlant) and plant.feedback is not None:
        weak = min(high - low for low, high in plant.limits) * 1e-4
        several.append(plant.with_actuator({"actuator_saturation": weak}))
    for each in several:
        try:
            values = each.run(small_signal(each, inject, fraction=1.0), inject=inject).values
        except SimulationStopped as error:
            assert ";" in str(error), f"no remedy: {error}"
        else:
            assert np.isfinite(values).all()


def check_bad_loops_are_refused(plant: Plant, inject: str) -> None:
    """A loop without delay, and a controller that is unstable by itself and out of the loop's reach, are refused."""
    assert isinstance(plant, LinearPlant) and plant.feedback is not None, "only a linear plant has such a loop"
    controller, dynamics = plant.feedback.controller, plant.dynamics
    direct = replace(controller, D=np.ones_like(controller.D))
    nu, m = controller.D.shape
    hidden = replace(
        controller,
        A=la.block_diag(controller.A, [[1.1]]),
        B=np.vstack([controller.B, np.zeros((1, m))]),
        C=np.hstack([controller.C, np.zeros((nu, 1))]),
    )
    cases: tuple[tuple[dict[str, Any], str], ...] = (
        (
            {
                "dynamics": replace(dynamics, D=np.ones_like(dynamics.D)),
                "feedback": replace(plant.feedback, controller=direct),
            },
            "algebraic loop",
        ),
        ({"feedback": replace(plant.feedback, controller=hidden)}, "not internally stable"),
    )
    for changes, expected in cases:
        try:
            replace(plant, **changes)
        except ExciteError as error:
            assert expected in str(error), error
        else:
            raise AssertionError(f"{plant.name} closed a loop that it should refuse ({expected})")


def check_truth(plant: Plant, inject: str) -> None:
    """The frequency response of small noise-free runs is that of each view's truth, within the truth's accuracy.

    A multisine is played on one channel after the other. At its lines the part of each output that the truth does not
    explain is compared with what the truth says there, in the run that moves this output most at that line.
    """
    place = plant.injections[inject]
    held = lcm(2, *(roles.every for roles in place.views.values()))
    lines = np.unique(np.geomspace(1, 100, LINES).round().astype(int))
    middle, size = _inside(plant, inject, 0.02)
    dt = held * plant.dt
    tone = multisine(dt=dt, period_s=256 * dt, lines=lines.tolist(), phases="schroeder", periods=2, zero_start=False).u
    runs = []
    for c in range(len(place.channels)):
        u = np.tile(middle, (len(tone), 1))
        u[:, c] += size[c] * tone[:, 0]
        runs.append(plant.run(Signal(u, dt, place.channels), inject=inject, noise=False))
    for name in place.views:
        truth = plant.truth(runs[0], name)
        error = response_errors([run.experiment(name) for run in runs], truth.model, 2 * lines)
        assert error.max() <= truth.accuracy, (name, error.max(axis=(0, 2)))


def response_errors(runs: Sequence[Experiment], model: StateSpaceModel, lines: np.ndarray) -> np.ndarray:
    """Return |Y - G U - T| at DFT lines of whole records, relative to the largest |G U| of all runs, (runs, lines, ny).

    T = C (zI - A)^-1 z d is how transients show in the DFT of a finite record, d = x(0) - x(N), which is fitted at all
    lines; so neither slow nor unstable poles leave a trace. Pintelon and Schoukens (2012), System Identification, 2.6.3.
    Zero where a response is below VISIBLE of the output's largest.
    """
    N = len(runs[0].y)
    k = np.arange(1, N // 2)
    z = np.exp(2j * np.pi * k / N)[:, None, None]
    U, Y = (np.fft.rfft(np.array(part), axis=1)[:, k] for part in ([run.u for run in runs], [run.y for run in runs]))
    GU = (model.frf(k / (N * runs[0].uniform_dt)) @ U[..., None])[..., 0]
    reference = np.abs(GU[:, lines - 1]).max(axis=0)
    scale = reference.max(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    T = z * (model.C @ np.linalg.inv(z * np.eye(model.order) - model.A)) / scale[:, None]
    rest = ((Y - GU) / scale).reshape(len(runs), -1).T
    T = T.reshape(-1, model.order)
    stacked = [np.concatenate([part.real, part.imag]) for part in (T, rest)]
    d = np.linalg.lstsq(stacked[0], stacked[1])[0]
    rest = (rest - T @ d).T.reshape(Y.shape)[:, lines - 1]
    seen = reference / scale > VISIBLE
    return np.where(seen, np.abs(rest) / np.where(seen, reference / scale, 1.0), 0.0)


CHECKS: tuple[Callable[[Plant, str], None], ...] = (
    check_named_and_described,
    check_records_what_it_says,
    check_records_what_is_played,
    check_deterministic,
    check_copies,
    check_noise_off,
    check_seeds_are_independent,
    check_sources_have_streams_of_their_own,
    check_limits,
    check_finite_or_stopped,
    check_bad_loops_are_refused,
    check_truth,
)


def checks_of(plant: Plant, exceptions: Mapping[str, str] | None = None) -> list[Callable[[Plant, str], None]]:
    """Return the checks that a plant must pass: those that have a meaning for it and are not excepted.

    exceptions : name of a check -> why the plant need not pass it, beside `plant.conformance_exceptions`.
    """
    excepted = {**plant.conformance_exceptions, **(exceptions or {})}
    known = [check.__name__ for check in CHECKS]
    for name, reason in excepted.items():
        if name not in known:
            raise ExciteError(f"{plant.name} conformance_exceptions: no check '{name}'; {did_you_mean(name, known)}")
        if not reason:
            raise ExciteError(f"{plant.name} conformance_exceptions '{name}': has no reason; say why it need not pass")
    meaningless = set()
    if not (isinstance(plant, LinearPlant) and plant.feedback is not None):
        meaningless.add(check_bad_loops_are_refused)
    if any(plant.records(inject).dt is None for inject in plant.injections):
        meaningless.add(check_truth)  # it compares spectral lines
    return [check for check in CHECKS if check.__name__ not in excepted and check not in meaningless]


def check_plant(plant: Plant, exceptions: Mapping[str, str] | None = None) -> None:
    """Check a plant, ours or anybody's, at every place of injection.

    Parameters
    ----------
    plant : an instance, as `load_plant` returns it.
    exceptions : name of a check -> why this plant need not pass it; what the plant declares itself is added.

    Raises
    ------
    AssertionError listing every check that fails and where; ExciteError for an exception that names no check, or gives
    no reason.

    Example
    -------
    >>> check_plant(load_plant("miller_31"), exceptions={"check_truth": "its truth is not derived yet"})
    """
    failures = []
    for check in checks_of(plant, exceptions):
        for inject in plant.injections:
            try:
                check(plant, inject)
            except Exception as error:  # whatever somebody's plant raises is the finding
                failures.append(f"{check.__name__} at {inject}: {type(error).__name__}: {error}")
    if failures:
        raise AssertionError(f"{plant.name}: {len(failures)} checks fail:\n" + "\n".join(failures))
