"""The shift register behind `prbs`: polynomials, bits, periods."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import max_len_seq
from sequences import circular_correlation, is_primitive, prime_factors

from excite.generators import lfsr, prbs
from excite.generators.prbs import TAPS


def test_every_polynomial_is_primitive():
    assert sorted(TAPS) == list(range(2, 33))
    assert all(is_primitive(order, taps) for order, taps in TAPS.items())


def test_the_primitivity_test_rejects_a_short_cycle():
    assert not is_primitive(4, (2,))  # x^4 + x^2 + 1 = (x^2 + x + 1)^2, period 6
    assert not is_primitive(4, (3, 2, 1))  # irreducible, period 5


def registers(least, most):
    """An order and a register that is not zero."""
    return st.integers(least, most).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, 2**n - 1)))


@pytest.mark.parametrize("order", range(2, 21))
def test_a_whole_period_has_the_bits_of_scipy(order):
    state = int(np.random.default_rng(order).integers(1, 2**order))
    expected, _ = max_len_seq(order, state=[state >> i & 1 for i in range(order)], taps=list(TAPS[order]))
    assert np.array_equal(lfsr.sequence(order, TAPS[order], state, 2**order - 1), expected)


@settings(max_examples=60, deadline=None)
@given(registers(2, 32), st.integers(1, 3000))
def test_any_state_and_length_has_the_bits_of_scipy(register, length):
    order, state = register
    expected, _ = max_len_seq(
        order, state=[state >> i & 1 for i in range(order)], length=length, taps=list(TAPS[order])
    )
    assert np.array_equal(lfsr.sequence(order, TAPS[order], state, length), expected)


def test_24_bits_at_ten_times_the_speed_of_scipy(fastest):
    """Both measured in one run."""
    scipys, expected = fastest(2, lambda: max_len_seq(24, state=np.ones(24, int), taps=list(TAPS[24]))[0])
    ours, bits = fastest(8, lambda: lfsr.sequence(24, TAPS[24], 2**24 - 1, 2**24 - 1))
    assert np.array_equal(bits, expected)
    assert scipys >= 10 * ours


@settings(max_examples=60, deadline=None)
@given(registers(2, 32), st.integers(0, 5000))
def test_jumps_ahead(register, chips):
    order, state = register
    bits = lfsr.sequence(order, TAPS[order], state, chips + order)
    assert lfsr.advance(order, TAPS[order], state, chips) == sum(int(b) << i for i, b in enumerate(bits[chips:]))
    assert lfsr.advance(order, TAPS[order], state, 2**order - 1) == state


def test_the_table_of_primes():
    assert all(prime_factors(q) == {q} for q in lfsr.PRIMES)
    for order in range(2, 33):
        rest = 2**order - 1
        for q in lfsr.PRIMES:
            while rest % q == 0:
                rest //= q
        assert rest == 1


@pytest.mark.parametrize("order", range(2, 9))
def test_primitive_and_period_agree_with_walking_the_register(order):
    primitive = set()
    for inner in range(1, 2 ** (order - 1)):
        taps = tuple(i + 1 for i in reversed(range(order - 1)) if inner >> i & 1)
        impulse = 1 << (order - 1)
        state, steps = lfsr.advance(order, taps, impulse, 1), 1
        while state != impulse:
            state, steps = lfsr.advance(order, taps, state, 1), steps + 1
        assert lfsr.period(order, taps) == steps
        assert lfsr.is_primitive(order, taps) == is_primitive(order, taps) == (steps == 2**order - 1)
        if steps == 2**order - 1:
            primitive.add(taps)
    assert len(primitive) == lfsr.polynomials(order) == [1, 2, 2, 6, 6, 18, 16][order - 2]
    others = [lfsr.decimated(order, TAPS[order], every) for every in lfsr.decimations(order)]
    assert {TAPS[order], *others} == primitive and len(others) == len(primitive) - 1


@settings(max_examples=30, deadline=None)
@given(st.integers(3, 12), st.integers(0, 99))
def test_a_decimated_sequence_obeys_the_taps_found_for_it(order, pick):
    every = list(lfsr.decimations(order))
    every = every[pick % len(every)]
    bits = lfsr.sequence(order, TAPS[order], 1, 2**order - 1)
    decimated = bits[np.arange(2**order - 1) * every % len(bits)]
    taps = lfsr.decimated(order, TAPS[order], every)
    state = sum(int(b) << i for i, b in enumerate(decimated[:order]))
    assert np.array_equal(lfsr.sequence(order, taps, state, len(bits)), decimated)


def test_own_taps():
    signal = prbs(order=5, dt=1.0, taps=[4, 3, 2])
    assert signal.recipe["taps"] == [4, 3, 2]
    assert not np.array_equal(signal.u, prbs(order=5, dt=1.0).u)
    expected = np.full(31, -1.0)
    expected[0] = 31
    np.testing.assert_allclose(circular_correlation(signal.u[:, 0], signal.u[:, 0]), expected, atol=1e-9)
