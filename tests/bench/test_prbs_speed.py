"""Bits of a maximum-length sequence: time of excite and of SciPy, side by side in one run (`-m bench -s`)."""

import numpy as np
import pytest
from scipy.signal import max_len_seq

from excite.generators import lfsr, prbs
from excite.generators.prbs import TAPS

pytestmark = pytest.mark.bench


def test_sequences(fastest):
    print("\n order      chips   excite ms    scipy ms   ratio   prbs() ms")
    for order in (10, 14, 18, 20, 22, 24):
        length = 2**order - 1
        ours, bits = fastest(7, lambda n=order, m=length: lfsr.sequence(n, TAPS[n], m, m))
        theirs, expected = fastest(3, lambda n=order: max_len_seq(n, state=np.ones(n, int), taps=list(TAPS[n]))[0])
        signal, _ = fastest(2, lambda n=order: prbs(n, dt=1.0))
        assert np.array_equal(bits, expected)
        print(
            f"{order:6} {length:10} {1e3 * ours:11.3f} {1e3 * theirs:11.3f} {theirs / ours:7.1f} {1e3 * signal:11.1f}"
        )
    assert theirs >= 10 * ours


def test_choosing_different_sequences(fastest):
    print("\n order  channels   seconds   cross-correlation x M")
    for order, count in ((10, 3), (14, 3), (16, 3), (18, 2), (20, 2)):
        lfsr.least_correlated.cache_clear()
        seconds, sets = fastest(1, lambda n=order, c=count: lfsr.least_correlated(n, TAPS[n], c))
        worst = lfsr.cross_correlation(order, sets) * (2**order - 1)
        print(f"{order:6} {count:9} {seconds:9.2f} {worst:12.0f}")
        assert seconds < 20
