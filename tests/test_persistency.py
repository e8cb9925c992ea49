"""Compressed Hankel data against explicit matrices, and the order of persistency against theory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.generators.prbs import prbs
from excite.hankel import columns_of, hankel_factor, hankel_gram
from excite.persistency import certify
from excite.types.experiment import Experiment
from excite.types.signal import Signal


def explicit(segments, rows):
    blocks = [
        np.array([w[i : i + len(w) - rows + 1] for i in range(rows)]).transpose(0, 2, 1).reshape(rows * w.shape[1], -1)
        for w in segments
        if len(w) >= rows
    ]
    return np.hstack(blocks)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6), rows=st.integers(1, 9), channels=st.integers(1, 4),
    lengths=st.lists(st.integers(5, 200), min_size=1, max_size=3),
)  # fmt: skip
def test_gram_equals_explicit_hankel(seed, rows, channels, lengths):
    rng = np.random.default_rng(seed)
    segments = [rng.standard_normal((n, channels)) for n in lengths if n >= rows]
    if not segments:
        return
    H = explicit(segments, rows)
    np.testing.assert_allclose(hankel_gram(segments, rows), H @ H.T, atol=1e-10 * H.shape[1])


def test_factor_reproduces_the_row_space():
    rng = np.random.default_rng(0)
    segments = [rng.standard_normal((300, 2)), rng.standard_normal((4, 2)), 1e3 * rng.standard_normal((200, 2))]
    factor, H = hankel_factor(segments, 6), explicit(segments, 6)
    assert factor.columns == columns_of(segments, 6) == H.shape[1] and factor.path == "gram-cholesky"
    np.testing.assert_allclose(factor.L @ factor.L.T, H @ H.T, rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(factor.L, np.tril(factor.L))
    assert factor.index(slice(1, None), 2, 4).tolist() == [5, 7]


def test_ill_conditioned_data_take_the_qr_path_and_keep_their_small_singular_values():
    t = np.arange(20_000)
    slow = sum(np.sin(2 * np.pi * f * t) for f in (0.001, 0.0013, 0.002))
    slow += 1e-7 * np.random.default_rng(1).standard_normal(len(t))
    factor = hankel_factor([slow[:, None]], 15)
    exact = np.linalg.svd(explicit([slow[:, None]], 15), compute_uv=False)
    assert factor.path == "blocked-qr" and factor.condition > 1e6
    np.testing.assert_allclose(np.linalg.svd(factor.L, compute_uv=False), exact, rtol=1e-6)


def test_too_many_rows_name_the_largest_possible():
    u = np.random.default_rng(2).standard_normal((100, 3))
    with pytest.raises(ExciteError, match="the largest possible number of block rows is 25"):
        hankel_factor([u], 40)
    assert hankel_factor([u], 25).rows == 25


@pytest.mark.parametrize("order", [4, 6, 7])
def test_a_prbs_of_period_m_is_exciting_of_order_m(order):
    M = 2**order - 1
    certificate = certify(prbs(order=order, dt=1.0, periods=3), block_rows=M + 3)
    assert certificate.order == certificate.line_order == M and not certificate.reached


@pytest.mark.parametrize(
    ("lines", "constant", "expected"),
    [([0.1], 0, 2), ([0.1, 0.21, 0.33], 0, 6), ([0.1, 0.3], 2.0, 5), ([0.2, 0.5], 0, 3), ([], 1.5, 1)],
)
def test_sums_of_sines_follow_seed_002_4_0_4(lines, constant, expected):
    t = np.arange(400)
    u = constant + sum((np.cos(2 * np.pi * f * t) for f in lines), np.zeros(400))
    by_rank = certify(Signal(u, 1.0), block_rows=12)
    by_lines = certify(Signal(u, 1.0, period=100), block_rows=12)
    assert by_rank.order == expected and by_lines.line_order == expected
    assert by_rank.line_order is None and not by_rank.reached


def test_three_channels_share_the_lines_of_one_sequence():
    signal = prbs(order=7, dt=0.02, hold=4, channels=3)
    assert certify(signal, block_rows=20).reached
    assert certify(signal, block_rows=20).usable_response_s == signal.recipe["usable_response_s"]
    same = Signal(np.repeat(signal.u[:, :1], 2, axis=1), signal.dt)
    assert certify(same, block_rows=5).order == 0


def test_records_side_by_side_excite_together():
    t = np.arange(200)
    records = [Experiment(np.sin(2 * np.pi * f * t), t, dt=1.0) for f in (0.05, 0.12, 0.3)]
    assert [certify(r, block_rows=10).order for r in records] == [2, 2, 2]
    assert certify(records, block_rows=10).order == 6


def test_empty_bands_are_named():
    rng = np.random.default_rng(3)
    spectrum = np.zeros(1001, complex)
    spectrum[1:400] = np.exp(2j * np.pi * rng.random(399))
    certificate = certify(Signal(np.fft.irfft(spectrum, 2000), 0.01, period=2000), block_rows=5)
    (low, high), *others = certificate.missing_hz
    assert not others and low == pytest.approx(20, abs=1.0) and high == pytest.approx(50)


def test_certificates_ask_for_a_longer_record_instead_of_guessing():
    certificate = certify(Signal(np.random.default_rng(4).standard_normal(30), 1.0), block_rows=25)
    assert certificate.order == 15 and not certificate.reached
    assert "30 samples of 1 channels allow at most 15 block rows; 25 were asked for" in certificate.warnings[0]


@pytest.mark.parametrize(
    ("data", "rows", "message"),
    [
        (Signal([1.0, -1], 1.0), 0, "block_rows 0"),
        (Signal([1.0, -1], 1.0), 2.5, "block_rows 2.5"),
        (Experiment([1, np.nan, 2], [1, 2, 3], dt=1.0), 2, "missing samples"),
        (Experiment([1, 3, 2], [1, 2, 3], time_s=[0, 1, 5]), 2, "not uniform"),
    ],
)
def test_what_cannot_be_certified_is_refused(data, rows, message):
    with pytest.raises(ExciteError, match=message):
        certify(data, block_rows=rows)
