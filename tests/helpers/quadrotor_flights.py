"""What the quadrotor's test files share: excitations, the plant of 2013 and fits."""

from functools import cache

import numpy as np

from excite.types.signal import Signal
from plants.quadrotor.controller import ATTITUDE_DT, FRAME
from plants.quadrotor.plant import Quadrotor

PLANT = Quadrotor()
SMALL = {"attitude_setpoint": (0.5, 0.5, 0.5), "rate_setpoint": (2.0, 2.0, 2.0), "motor_command": (300.0,) * 4}


def random_binary(amplitude, duration_s=60.0, dt=0.02, seed=1):
    """Random binary values with chips of 0.5 s, one amplitude per channel."""
    chips = np.random.default_rng(seed).choice([-1.0, 1.0], (round(duration_s / 0.5), len(amplitude)))
    return Signal(np.repeat(chips * np.array(amplitude, float), round(0.5 / dt), axis=0), dt)


def fit(y, simulated):
    """Fit per output, 100 (1 - |y - yhat| / |y - mean|)."""
    return 100.0 * (1.0 - np.linalg.norm(y - simulated, axis=0) / np.linalg.norm(y - y.mean(0), axis=0))


def simulated_fit(plant, recording, view, outputs=slice(None)):
    """Fit of the truth's simulation to a recording."""
    data = recording.experiment(view)
    return fit(data.y[:, outputs], plant.truth(recording, view).model.simulate(data.u)[:, outputs])


def linearisation_floor(plant, recording, view):
    """Return the linearisation floor of an experiment: fit [%] per output of the truth's simulation to its noise-free twin.

    The twin is flown anew; both start from trim at the start of the excitation. No linear model can be expected to do
    much better.
    """
    origin = recording.origin
    names = tuple(channel.name for channel in plant.injections[origin.inject].channels)
    first = round(origin.start_s / plant.dt)
    signal = Signal(recording.columns(names)[first::FRAME], ATTITUDE_DT)
    twin = Quadrotor(origin.preset, origin.parameters).run(signal, inject=origin.inject, noise=False).experiment(view)
    twin = twin.window(int(np.searchsorted(twin.time_s, origin.start_s - plant.dt / 2)))
    fits = fit(twin.y, plant.truth(recording, view).model.simulate(twin.u))
    return {channel.name: float(each) for channel, each in zip(twin.outputs, fits, strict=True)}


@cache
def noisy_flight():
    """A minute at 1 deg and deg/s."""
    return PLANT.run(random_binary((1, 1, 1)), seed=7)
