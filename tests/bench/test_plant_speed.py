"""Samples a second of every plant, and of many runs at once against a loop of single ones (`-m bench -s`)."""

from statistics import median
from time import process_time

import numpy as np
import pytest

from plants.conformance import small_signal
from plants.registry import list_plants, load_plant

pytestmark = pytest.mark.bench

RUNS = 100
AT_LEAST = {"quadrotor": 2.0}  # ratio that a plant promises


def seconds(run, times=1):
    """CPU seconds of one run: a core's, whatever else the machine does."""
    start = process_time()
    for _ in range(times):
        run()
    return (process_time() - start) / times


def test_plants():
    """Single runs and many at once in turn, so that a disturbance of the machine meets both."""
    print(f"\n{'plant':<18} {'samples a run':>13} {'single /s':>10} {f'{RUNS} at once /s':>16} {'ratio':>6}")
    for name in list_plants():
        plant = load_plant(name)
        inject = next(iter(plant.injections))
        signal = small_signal(plant, inject, samples=5000)  # 20 s of the quadrotor
        count = len(plant.run(signal, inject=inject).time_s)
        pairs = [
            (
                seconds(lambda p=plant, s=signal, i=inject: p.run(s, inject=i), RUNS // 10),
                seconds(lambda p=plant, s=signal, i=inject: p.run_many(s, inject=i, seeds=range(RUNS))) / RUNS,
            )
            for _ in range(3)
        ]
        single, many = (min(column) for column in zip(*pairs, strict=True))
        ratio = median(a / b for a, b in pairs)
        print(f"{name:<18} {count:13} {count / single:10.3g} {count / many:16.3g} {ratio:6.2f}")
        assert ratio >= AT_LEAST.get(name, 0.0)


def test_many_flights_equal_the_plain_loop():
    """100 Monte Carlo flights of 20 s, compared with some of them flown alone."""
    plant = load_plant("quadrotor")
    signal = small_signal(plant, "attitude_setpoint", fraction=0.3, samples=5000)
    many = plant.run_many(signal, seeds=range(RUNS))
    for seed in (0, 57, 99):
        np.testing.assert_allclose(many[seed].values, plant.run(signal, seed=seed).values, rtol=0, atol=1e-10)
