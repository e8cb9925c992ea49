"""Compressed Hankel data against explicit matrices, and the order of persistency against theory."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.generators.prbs import prbs
from excite.numerics.correlation import correlate
from excite.numerics.hankel import columns_of, hankel_factor, hankel_gram
from excite.persistency.certificate import certify, verdict
from excite.persistency.rank import line_vectors, order_of_lines, order_of_recurrence
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
    seed=st.integers(0, 10**6),
    rows=st.integers(1, 9),
    channels=st.integers(1, 4),
    lengths=st.lists(st.integers(5, 200), min_size=1, max_size=3),
)
def test_gram_equals_explicit_hankel(seed, rows, channels, lengths):
    rng = np.random.default_rng(seed)
    segments = [rng.standard_normal((n, channels)) for n in lengths if n >= rows]
    if not segments:
        return
    H = explicit(segments, rows)
    np.testing.assert_allclose(hankel_gram(segments, correlate(segments, rows - 1)), H @ H.T, atol=1e-10 * H.shape[1])


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


def explicit_order(segments, most):
    """Largest s with s block rows of full row rank, by the definition and NumPy's rank of explicit matrices."""
    order = 0
    for s in range(1, most + 1):
        if columns_of(segments, s) < s * segments[0].shape[1]:
            break
        H = explicit(segments, s)
        if np.linalg.matrix_rank(H, tol=1e-9 * np.linalg.norm(H, 2)) < len(H):
            break
        order = s
    return order


def random_periodic(rng, M, nu, structure):
    """One period of nu channels whose lines are random, shared, interleaved, delayed copies, or dependent."""
    support = rng.random((M // 2 + 1, 1)) < rng.uniform(0.2, 0.9)
    lines = rng.standard_normal((M // 2 + 1, nu)) + 1j * rng.standard_normal((M // 2 + 1, nu))
    if structure == "interleaved":
        support = support & (rng.integers(0, nu, (M // 2 + 1, 1)) == np.arange(nu))
    elif structure == "delayed":
        delays = rng.integers(0, 4, nu)
        lines = lines[:, :1] * np.exp(2j * np.pi * np.arange(M // 2 + 1)[:, None] * delays / M)
    elif structure == "dependent":
        lines = lines[:, :1] * rng.standard_normal((1, nu))
    elif structure == "own":
        support = rng.random((M // 2 + 1, nu)) < 0.6
    return np.fft.irfft(lines * support, M, axis=0)


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    M=st.integers(6, 24),
    nu=st.integers(1, 3),
    structure=st.sampled_from(["shared", "interleaved", "delayed", "dependent", "own"]),
)
def test_orders_equal_explicit_ranks(seed, M, nu, structure):
    """The smallest Kronecker index of the DFT vectors, the record's certificate and the rank of H agree."""
    rng = np.random.default_rng(seed)
    period = random_periodic(rng, M, nu, structure)
    u = np.tile(period, (5 * nu, 1))
    truth = explicit_order([u], M)
    found = order_of_lines(line_vectors(period), M, M)
    assert found.exact and found.order == truth
    certificate = certify(Signal(u, 1.0, period=M), block_rows=M)
    assert certificate.order == certificate.line_order == truth
    assert certificate.lines == (np.abs(np.fft.fft(period, axis=0)).max(1) > 1e-9).sum()
    assert truth <= certificate.lines // nu
    assert certify(Signal(u, 1.0), block_rows=M).order == truth


def test_interleaved_lines_bear_only_on_their_own_channel():
    """Twelve lines a channel within 4 % of the band: order 24, out of reach of any factorisation of the 24-row matrix."""
    M, phases = 2000, np.random.default_rng(0).random((2, 12))
    t = np.arange(2 * M)[:, None]
    u = np.stack([np.cos(2 * np.pi * (np.arange(1 + c, 25, 2) * t / M + phases[c])).sum(1) for c in range(2)], axis=1)
    for certificate in (certify(Signal(u, 0.01, period=M), block_rows=30), certify(Signal(u, 0.01), block_rows=30)):
        assert certificate.order == 24 and not certificate.warnings


@pytest.mark.parametrize("period", [None, 1000])
@pytest.mark.parametrize("N", [2000, 20_000])
def test_ten_close_sines_have_order_twenty(N, period):
    t = np.arange(N)
    u = sum(np.sin(2 * np.pi * f * t + k) for k, f in enumerate(0.001 * np.arange(1, 11)))
    certificate = certify(Signal(u, 1.0, period=period), block_rows=30)
    assert certificate.order == 20 and not certificate.warnings
    assert certificate.order_above_floor < 10  # what double precision can use, reported beside


@pytest.mark.parametrize("low", [1e-3, 3e-4])
def test_eight_logarithmic_lines_have_order_sixteen(low):
    t = np.arange(20_000)
    u = sum(np.sin(2 * np.pi * f * t + k) for k, f in enumerate(np.geomspace(low, 0.4, 8)))
    certificate = certify(Signal(u, 1.0), block_rows=40)
    assert certificate.order == 16 and not certificate.reached and not certificate.warnings


def test_sines_too_close_for_their_length_are_left_undecided():
    t = np.arange(300)
    u = sum(np.sin(2 * np.pi * f * t + k) for k, f in enumerate(0.001 * np.arange(1, 11)))
    certificate = certify(Signal(u, 1.0), block_rows=30)
    assert certificate.order < 20 and "cannot be decided in double precision" in certificate.warnings[-1]


def test_low_passed_noise_is_exciting_of_every_order_however_small_the_margin():
    u = np.convolve(np.random.default_rng(5).standard_normal(20_000), np.exp(-0.5 * np.arange(-200, 201) ** 2 / 20**2))
    certificate = certify(Signal(u, 1.0), block_rows=25)
    assert certificate.order == 25 and certificate.margin < 1e-9 and certificate.order_above_floor < 25


def test_a_constant_with_little_noise_has_order_one_above_the_floor():
    u = 1 + 1e-4 * np.random.default_rng(0).standard_normal(5000)
    certificate = certify(Signal(u, 1.0), block_rows=20, noise_floor=1e-3)
    assert (certificate.order, certificate.order_above_floor) == (20, 1)
    assert certificate.margin_over_floor == pytest.approx(0.1, rel=0.1) and certificate.floor_source == "given"
    assert certify(Signal(u, 1.0), block_rows=20, noise_floor=1e-5).order_above_floor == 20


def test_the_floor_is_estimated_from_repeated_periods():
    rng = np.random.default_rng(1)
    t = np.arange(4000)
    clean = np.cos(2 * np.pi * 0.05 * t) + np.cos(2 * np.pi * 0.21 * t)
    noisy = Experiment(clean + 0.01 * rng.standard_normal(4000), t, dt=1.0, period=100)
    certificate = certify(noisy, block_rows=20)
    assert certificate.noise_floor[0] == pytest.approx(0.01, rel=0.05) and certificate.floor_source == "periods"
    assert certificate.order == 20 and certificate.line_order == 4 and certificate.order_above_floor < 20
    assert certify(Signal(clean, 1.0, period=100), block_rows=20).floor_source == "rounding"


def test_several_records_with_common_and_own_sines():
    t = np.arange(3000)
    records = [
        np.sin(2 * np.pi * f * t)[:, None] + np.sin(2 * np.pi * 0.002 * t)[:, None] for f in (0.003, 0.0045, 0.006)
    ]
    assert order_of_recurrence(records, 20).order == 8
    joined = certify([Experiment(u, t, dt=1.0) for u in records], block_rows=20)
    assert joined.order == 8 and certify(Experiment(records[0], t, dt=1.0), block_rows=20).order == 4


def test_verdicts_refuse_what_is_necessary_and_warn_of_what_would_suffice():
    signal = prbs(order=7, dt=0.1, periods=5)
    signal = Signal(signal.u - signal.u[:127].mean(), 0.1, period=127)  # no line at zero: order 126
    fir = verdict(signal, "fir of length 200", 200)
    assert str(fir) == "enough for fir of length 200: no, order 126 < 200" and not fir.ok
    moesp = verdict(signal, "po_moesp with 20 block rows and order 6", 20, 46)
    assert moesp.status == "yes" and moesp.text.startswith(
        "enough for po_moesp with 20 block rows and order 6: yes, margin 0.9"
    )
    warned = verdict(signal, "a method", 100, 150)
    assert warned.ok and "order 150 would suffice, the input has order 126" in warned.text
    unknown = verdict(certify(signal, block_rows=20), "fir", 50)
    assert unknown.status == "not known" and "certify with block_rows = 50" in unknown.text
    faint = verdict(Signal(1 + 1e-4 * np.random.default_rng(0).standard_normal(999), 1.0), "fir", 5, noise_floor=1e-3)
    assert faint.ok and "only order 1 stands above the noise floor (given)" in faint.text


def test_the_structured_factor_costs_a_fraction_of_an_explicit_one():
    u = np.random.default_rng(7).standard_normal((200_000, 1))
    begin = time.process_time()
    factor = hankel_factor([u], 100)
    structured = time.process_time() - begin
    begin = time.process_time()
    np.linalg.qr(explicit([u], 100).T, mode="r")
    assert factor.path == "gram-cholesky" and structured < 0.5 * (time.process_time() - begin)


@pytest.mark.parametrize("floor", [-1.0, np.nan, [1.0, 2.0]])
def test_bad_floors_are_refused(floor):
    with pytest.raises(ExciteError, match="noise_floor"):
        certify(Signal([1.0, -1, 2, 4], 1.0), block_rows=1, noise_floor=floor)
