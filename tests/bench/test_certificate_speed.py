"""Timings of certificates and of shaping: `pytest -m bench -s tests/bench/test_certificate_speed.py`."""

import time

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import butter, cont2discrete, lfilter

from excite.limits.limits import Limits, OutputLimit
from excite.limits.shaping import shape
from excite.models.state_space import StateSpaceModel
from excite.numerics.hankel import hankel_factor
from excite.persistency.certificate import certify
from excite.types.signal import Signal

pytestmark = pytest.mark.bench


def timed(function):
    wall, cpu = time.perf_counter(), time.process_time()
    result = function()
    return result, time.perf_counter() - wall, time.process_time() - cpu


@pytest.mark.parametrize("channels", [1, 3])
def test_a_million_samples_of_order_two_hundred(channels):
    u = np.random.default_rng(0).standard_normal((10**6, channels))
    factor, wall, cpu = timed(lambda: hankel_factor([u], 200))
    certificate, wall_all, cpu_all = timed(lambda: certify(Signal(u, 1e-3), block_rows=200))
    print(
        f"\n1e6 samples x {channels} channels, 200 block rows ({factor.path}): factor {wall:.2f} s (CPU {cpu:.2f}), "
        f"certificate {wall_all:.2f} s (CPU {cpu_all:.2f}), order {certificate.order}, margin {certificate.margin:.3f}"
    )
    assert certificate.reached and cpu < (5 if channels == 1 else 20)


def test_where_the_gram_matrix_cannot_tell():
    u = lfilter(*butter(4, 0.3), np.random.default_rng(0).standard_normal(10**5))
    factor, wall, cpu = timed(lambda: hankel_factor([u[:, None]], 100))
    print(
        f"\n1e5 samples, 100 block rows ({factor.path}, condition {factor.condition:.1e}): {wall:.2f} s (CPU {cpu:.2f})"
    )
    assert factor.path == "blocked-qr"


@pytest.mark.parametrize("outputs", [False, True])
def test_shaping_twenty_thousand_samples_of_three_channels(outputs):
    N, dt, rng = 20_000, 0.02, np.random.default_rng(0)
    lines = rng.permutation(np.arange(20, 1200))[:300].reshape(3, 100)
    spectrum = np.zeros((N // 2 + 1, 3), complex)
    for c in range(3):
        spectrum[lines[c], c] = N / 2 / np.sqrt(50) * np.exp(2j * np.pi * rng.random(100))
    signal = Signal(np.fft.irfft(spectrum, N, axis=0), dt, period=N)
    w = 2 * np.pi * 1.5
    modes = [
        cont2discrete(
            (np.array([[0, 1], [-w * w, -2 * z * w]]), np.array([[0], [w * w]]), np.eye(2), np.zeros((2, 1))), dt
        )
        for z in (0.3, 0.5, 0.7)
    ]
    model = StateSpaceModel(*(block_diag(*[m[k] for m in modes]) for k in range(4)), dt)
    bound = 0.7 * np.abs(model.simulate(signal.u)).max(0)
    limited = (OutputLimit(model, (-bound).tolist(), bound.tolist()),) if outputs else ()
    shaped, wall, cpu = timed(lambda: shape(signal, Limits(amplitude=2.0, rate=20.0, bits=12, outputs=limited)))
    print(
        f"\n20 000 x 3, amplitude, rate, 12 bits{', six outputs' if outputs else ''}: {wall:.1f} s (CPU {cpu:.1f}), "
        f"lines {shaped.loss.mean_line_db:.2f} dB, worst {shaped.loss.worst_line_db:.2f} dB"
    )
    assert shaped.after.ok and cpu < 60
