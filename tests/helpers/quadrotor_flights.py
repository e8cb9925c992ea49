"""What the quadrotor's test files share: excitations, the plant of 2013 and fits."""

from functools import cache

import numpy as np

from excite.types.signal import Signal
from plants.quadrotor.plant import Quadrotor

PLANT = Quadrotor()
SMALL = {"attitude_setpoint": (0.5, 0.5, 0.5), "rate_setpoint": (2.0, 2.0, 2.0), "motor_command": (300.0,) * 4}


def random_binary(amplitude, duration_s=60.0, dt=0.02, seed=1):
    """Random binary values with chips of 0.5 s, one amplitude a channel."""
    chips = np.random.default_rng(seed).choice([-1.0, 1.0], (round(duration_s / 0.5), len(amplitude)))
    return Signal(np.repeat(chips * np.array(amplitude, float), round(0.5 / dt), axis=0), dt)


def fit(y, simulated):
    """Fit per output, 100 (1 - |y - yhat| / |y - mean|)."""
    return 100.0 * (1.0 - np.linalg.norm(y - simulated, axis=0) / np.linalg.norm(y - y.mean(0), axis=0))


def simulated_fit(plant, recording, view, outputs=slice(None)):
    """Fit of the truth's simulation to a recording."""
    data = recording.experiment(view)
    return fit(data.y[:, outputs], plant.truth(recording, view).model.simulate(data.u)[:, outputs])


@cache
def noisy_flight():
    """A minute at 1 deg and deg/s."""
    return PLANT.run(random_binary((1, 1, 1)), seed=7)
