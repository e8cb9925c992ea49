"""Correlations and modal sums over blocks against the plain sums they stand for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.numerics import correlation
from excite.numerics.correlation import Joint, channel_blocks, correlate
from identify.steps.modal_sums import modal_sums

LENGTHS = st.lists(st.integers(1, 300), min_size=1, max_size=3)


@pytest.fixture(scope="module", autouse=True)
def small_blocks():
    """Several blocks a chunk and several chunks a record."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(correlation, "BLOCK", 16)
        patch.setattr(correlation, "CHUNK_VALUES", 200)
        patch.setattr(correlation, "CHUNK_BLOCKS", 3)
        yield


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), lengths=LENGTHS, channels=st.integers(1, 4), reach=st.integers(0, 40))
def test_linear_correlations_are_sums_over_all_pairs_of_samples(seed, lengths, channels, reach):
    rng = np.random.default_rng(seed)
    records = [rng.standard_normal((N + reach, channels)) for N in lengths]
    expected = np.stack([sum(w[: len(w) - d].T @ w[d:] for w in records) for d in range(reach + 1)])
    np.testing.assert_allclose(correlate(records, reach).linear, expected, atol=1e-11)


@pytest.mark.parametrize(("samples", "size"), [(1, 4), (8, 4), (9, 4), (100, 7)])
def test_blocks_hold_every_sample_once_and_then_zeros(samples, size):
    w = np.arange(1.0, 1 + 3 * samples).reshape(samples, 3)
    for record in (w, Joint((w[:, :1], w[:, 1:]))):
        joined = np.concatenate([X.reshape(3, -1) for X in map(np.copy, channel_blocks(record, size))], axis=1)
        np.testing.assert_array_equal(joined[:, :samples], w.T)
        assert joined.shape[1] % size == 0 and not joined[:, samples:].any()


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    lengths=LENGTHS,
    real=st.integers(0, 2),
    pairs=st.integers(0, 2),
    driving=st.integers(0, 3),
    radius=st.sampled_from([1e-30, 0.3, 0.99, 1 - 1e-6]),
)
def test_modal_sums_are_those_of_filtered_samples(seed, lengths, real, pairs, driving, radius):
    rng = np.random.default_rng(seed)
    half = radius * np.exp(1j * rng.uniform(0.1, 3, pairs))
    modes = np.concatenate(
        [radius * rng.uniform(-1, 1, real + (pairs == 0)), np.stack([half, half.conj()], -1).ravel()]
    )
    records = [rng.standard_normal((N, 3)) for N in lengths]
    on_data, own, decay_on_data, decay_on_own = 0.0, 0.0, [], []
    for w in records:
        z = np.zeros((len(w), driving + 1, len(modes)), complex)
        z[0, driving] = 1
        for t in range(len(w) - 1):
            z[t + 1] = modes * z[t]
            z[t + 1, :driving] += w[t, :driving, None]
        on = np.einsum("tai,tb->aib", z.conj(), w)
        products = np.einsum("tai,tbj->aibj", z.conj(), z)
        on_data, own = on_data + on[:driving], own + products[:driving, :, :driving]
        decay_on_data.append(on[driving])
        decay_on_own.append(products[driving])
    found = modal_sums(records, correlate(records, 0).circular, modes, driving)
    for name, value in (
        ("on_data", on_data),
        ("own", own),
        ("decay_on_data", decay_on_data),
        ("decay_on_own", decay_on_own),
    ):
        size = np.abs(value).max(initial=1.0)
        np.testing.assert_allclose(getattr(found, name), value, atol=1e-9 * size, err_msg=name)
