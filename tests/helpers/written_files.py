"""Experiments and recordings to be written."""

import numpy as np

from excite.types.experiment import Experiment


def same(a, b):
    return a is b is None or np.asarray(a).tobytes() == np.asarray(b).tobytes()


def experiment(**changes):
    rng = np.random.default_rng(1)
    y = rng.standard_normal((50, 3)) * 10.0 ** rng.integers(-300, 300, (50, 3))
    y[3, 1], y[4, 0] = np.nan, -0.0
    parts = {
        "u": rng.standard_normal((50, 2)),
        "y": y,
        "reference": rng.standard_normal(50),
        "dt": 1 / 3,
        "period": 25,
        "inputs": ["flap [deg]", "tab"],
        "outputs": ["acc_1 [m/s2]", "acc_2", "flap"],
        "references": ["flap_ref [deg]"],
        "name": "flight 7",
    }
    return Experiment(**parts | changes)
