"""The numerical ground of identification: against plain formulas, published figures, and limits of memory."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from excite.models.state_space import StateSpaceModel
from excite.numerics import correlation, hankel
from excite.numerics.correlation import Joint, correlate
from excite.numerics.hankel import columns_of, hankel_factor, hankel_gram, largest_rows
from excite.numerics.simulate import simulate
from excite.types.experiment import Experiment
from identify.estimate import Status
from identify.examples import closed_loop
from identify.fit import fit
from identify.steps import dual_regression
from identify.steps import initial_state as initial_state_module
from identify.steps import input_matrices as ground
from identify.steps.compression import compress, future_lq, left_svd, lq, regress
from identify.steps.initial_state import initial_state
from identify.steps.kalman import state_regression


@pytest.fixture(scope="module")
def workloads(cases):
    return cases.w1_to_w4()


def pole_error(A, model):
    cost = np.abs(np.subtract.outer(np.linalg.eigvals(A), model.poles()))
    return cost[linear_sum_assignment(cost)].max()


def simulation_fit(model, u, y):
    error = y - model.simulate(u)
    return 100 * (1 - np.linalg.norm(error, axis=0) / np.linalg.norm(y - y.mean(0), axis=0)).mean()


@pytest.mark.parametrize(
    ("name", "order", "poles", "simulation"),
    [("W1", 4, 3.5e-4, 99.69), ("W2", 4, 2.8e-5, 99.9), ("W3", 12, 1.5e-4, 99.76), ("W4", 12, 1.0e-4, 99.83)],
)
def test_errors_are_those_of_the_peers(workloads, name, order, poles, simulation):
    """Pole errors and simulation fits of SLICOT, of a full QR and of a small prototype, facts/peers.md."""
    A, _, _, _, u, y, fresh, clean = workloads[name]
    estimate = fit(Experiment(u, y, dt=1.0), "po_moesp", order, block_rows=20)
    assert estimate.route == "gram-cholesky"
    assert pole_error(A, estimate.model) == pytest.approx(poles, rel=0.15)
    assert simulation_fit(estimate.model, fresh, clean) > simulation - 0.02


def test_low_pass_data_of_condition_six_e_eight(cases, workloads):
    """SLICOT's N4SID reaches .0065 and 99.75 %; python-control's era and jax-sysid are unstable (facts/peers.md)."""
    system = workloads["W1"][:4]
    u, y, fresh, clean = cases.w6(system)
    estimate = fit(Experiment(u, y, dt=1.0), "po_moesp", 4, block_rows=20)
    assert estimate.route == "blocked-qr" and estimate.status is not Status.UNSTABLE
    assert pole_error(system[0], estimate.model) <= 0.007
    assert simulation_fit(estimate.model, fresh[:, None], clean[:, None]) > 99.75


@pytest.mark.parametrize(("name", "order"), [("W1", 4), ("W3", 12)])
def test_both_numerical_paths_give_one_model(workloads, monkeypatch, name, order):
    u, y = workloads[name][4:6]
    data = Experiment(u[:20_000], y[:20_000], dt=1.0)
    squared = fit(data, "po_moesp", order)
    monkeypatch.setattr(hankel, "GRAM_CONDITION", 0)
    monkeypatch.setattr(ground, "NORMAL_CONDITION", 0)
    plain = fit(data, "po_moesp", order)
    assert (squared.route, plain.route) == ("gram-cholesky", "blocked-qr")
    np.testing.assert_allclose(squared.model.poles(), plain.model.poles(), atol=1e-9)
    scale = np.abs(plain.model.impulse(50)).max()
    np.testing.assert_allclose(squared.model.impulse(50), plain.model.impulse(50), atol=1e-8 * scale)
    np.testing.assert_allclose(squared.singular_values, plain.singular_values, rtol=1e-8)


@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_displacement_stays_accurate_over_a_long_record_with_an_offset(offset):
    w = offset + np.random.default_rng(0).standard_normal((200_000, 2))
    H = np.lib.stride_tricks.sliding_window_view(w.ravel(), 60)[::2]
    exact = H.T @ H
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert np.abs((hankel_gram([w], correlate([w], 29)) - exact) / size).max() < 1e-13


def test_a_record_that_begins_with_a_blow_is_not_left_to_displacement():
    """What the recursion subtracts from the first row's norm would drown the others', well-conditioned as they are."""
    w = np.random.default_rng(0).standard_normal((2000, 1))
    w[0] = 1e8
    factor = hankel_factor([w], 12)
    H = np.lib.stride_tricks.sliding_window_view(w.ravel(), 12)
    assert factor.path == "blocked-qr" and factor.condition < 10
    np.testing.assert_allclose(factor.L @ factor.L.T, H.T @ H, rtol=1e-9, atol=1e-6)


@settings(max_examples=100, deadline=None)
@given(lengths=st.lists(st.integers(1, 60), min_size=1, max_size=4), channels=st.integers(1, 5))
def test_largest_rows_is_the_last_with_enough_columns(lengths, channels):
    segments = [np.zeros((n, channels)) for n in lengths]
    enough = [n for n in range(1, 70) if columns_of(segments, n) >= n * channels]
    assert largest_rows(segments) == max(enough, default=0)


class Stored:
    """A record that hands out small pieces only, like one on disk."""

    def __init__(self, values, most):
        self.values, self.most, self.shape = values, most, values.shape

    def __len__(self):
        return len(self.values)

    def __getitem__(self, part):
        piece = self.values[part]
        assert len(piece) <= self.most
        return piece


def test_segments_are_read_piece_by_piece(tmp_path):
    rng = np.random.default_rng(1)
    w = rng.standard_normal((100_000, 2))
    slow = np.cumsum(np.cumsum(w, axis=0), axis=0)
    for values, path in ((w, "gram-cholesky"), (slow, "blocked-qr")):
        own = hankel_factor([values[:60_000], values[60_000:]], 20)
        stored = hankel_factor([Stored(values[:60_000], 40_000), Stored(values[60_000:], 40_000)], 20)
        assert own.path == stored.path == path
        np.testing.assert_array_equal(own.L, stored.L)
        np.save(tmp_path / "record.npy", values)
        mapped = hankel_factor([np.load(tmp_path / "record.npy", mmap_mode="r")], 20)
        np.testing.assert_array_equal(mapped.L, hankel_factor([values], 20).L)
    counts = (1000 * w).astype(np.int16)
    np.testing.assert_array_equal(hankel_factor([counts], 20).L, hankel_factor([counts.astype(float)], 20).L)


def test_a_joint_segment_is_u_beside_y():
    rng = np.random.default_rng(2)
    data = Experiment(rng.standard_normal((50, 2)), rng.standard_normal((50, 3)), dt=1.0)
    joint = Joint((data.u, data.y))
    np.testing.assert_array_equal(joint[7:20], np.hstack([data.u, data.y])[7:20])
    assert joint.shape == (50, 5) and len(joint) == 50


def explicit_input_matrices(records, A, C, K, feedthrough):
    """Least squares on one simulated column an unknown: the definition of `input_matrices`."""
    n, ny, nu = len(A), len(C), records[0].u.shape[1]
    Ak = A - K @ C
    rows, targets = [], []
    for e, record in enumerate(records):
        columns = []
        for j in range(nu):
            for i in range(n):
                b = np.zeros((n, nu))
                b[i, j] = 1
                columns.append(simulate(Ak, b, C, np.zeros((ny, nu)), record.u))
        for j in range(nu if feedthrough else 0):
            for i in range(ny):
                d = np.zeros((ny, nu))
                d[i, j] = 1
                columns.append(simulate(Ak, -K @ d, C, d, record.u))
        silent = np.zeros((len(record), nu))
        for other in range(len(records)):
            for i in range(n):
                x0 = np.eye(n)[i] * (other == e)
                columns.append(simulate(Ak, np.zeros((n, nu)), C, np.zeros((ny, nu)), silent, x0))
        rows.append(np.stack(columns, -1).reshape(-1, len(columns)))
        targets.append((record.y - simulate(Ak, K, C, np.zeros((ny, ny)), record.y)).ravel())
    return np.linalg.lstsq(np.vstack(rows), np.concatenate(targets), rcond=1e-13)[0]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 4),
    ny=st.integers(1, 3),
    nu=st.integers(0, 2),
    feedthrough=st.booleans(),
    predictor=st.booleans(),
    defective=st.booleans(),
    lengths=st.lists(st.integers(40, 300), min_size=1, max_size=2),
)
def test_input_matrices_equal_the_explicit_least_squares(seed, n, ny, nu, feedthrough, predictor, defective, lengths):
    rng = np.random.default_rng(seed)
    A = np.diag(rng.uniform(-0.9, 0.9, n))
    if defective:
        A = 0.7 * np.eye(n) + 0.3 * np.eye(n, k=1)
    C, K = rng.standard_normal((ny, n)), np.zeros((n, ny))
    if predictor:
        K = 0.05 * rng.standard_normal((n, ny))
        K *= min(1, 0.2 / np.linalg.norm(K @ C, 2))
    records = tuple(Experiment(rng.standard_normal((N, nu)), rng.standard_normal((N, ny)), dt=1.0) for N in lengths)
    expected = explicit_input_matrices(records, A, C, K, feedthrough)
    squared, by_qr = [], []
    for limit, found in ((ground.NORMAL_CONDITION, squared), (0, by_qr)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ground, "NORMAL_CONDITION", limit)
            patch.setattr(dual_regression, "CHUNK_VALUES", 1000)  # several chunks a record
            patch.setattr(correlation, "BLOCK", 32)  # and many blocks
            result = ground.input_matrices(records, A, C, K, feedthrough)
        found += [result.B.T.ravel(), result.D.T.ravel() if feedthrough else [], *result.x0]
    size = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(np.concatenate(by_qr), expected, atol=1e-8 * size)
    np.testing.assert_allclose(np.concatenate(squared), expected, atol=1e-6 * size)


def test_unstable_models_overflow_without_numpy_warnings():
    rng = np.random.default_rng(0)
    data = Experiment(rng.standard_normal((9000, 1)), rng.standard_normal((9000, 1)), dt=1.0)
    found = ground.input_matrices((data,), np.array([[1.5]]), np.array([[1.0]]), np.zeros((1, 1)), True)
    assert not np.isfinite(found.B).all()


def test_regression_is_of_least_norm_where_regressors_depend_on_each_other():
    rng = np.random.default_rng(3)
    X = rng.standard_normal((3, 40))
    target, dependent = rng.standard_normal((2, 40)), np.vstack([X, X[:1] + X[1:2]])
    np.testing.assert_allclose(np.hstack(regress(target, X[:2], X[2:])), target @ np.linalg.pinv(X), atol=1e-12)
    scale = np.linalg.norm(dependent, axis=1, keepdims=True)
    np.testing.assert_allclose(
        np.hstack(regress(target, dependent)), target @ np.linalg.pinv(dependent / scale) / scale.T, atol=1e-12
    )


@pytest.mark.parametrize("smallest", [1e-3, 1e-9])
def test_left_singular_vectors_by_either_way(smallest):
    rng = np.random.default_rng(4)
    U, V = (np.linalg.qr(rng.standard_normal((m, 6)))[0] for m in (6, 9))
    values = np.geomspace(1, smallest, 6)
    left, found = left_svd(U * values @ V.T)
    np.testing.assert_allclose(found, values, rtol=1e-7 if smallest == 1e-9 else 1e-9)
    np.testing.assert_allclose(np.abs(np.sum(left * U, axis=0)), 1, atol=1e-9)


@pytest.mark.parametrize("limit", [hankel.GRAM_CONDITION, 0])
def test_the_future_beyond_the_past_is_what_an_lq_of_the_rows_gives(monkeypatch, limit):
    monkeypatch.setattr(hankel, "GRAM_CONDITION", limit)
    rng = np.random.default_rng(5)
    data = compress((Experiment(rng.standard_normal((400, 2)), rng.standard_normal((400, 1)), dt=1.0),), 3, 4)
    L, future = np.block(lq(data.u(3, 7), data.z(), data.y(3, 7))), future_lq(data)
    np.testing.assert_allclose(future.L @ future.L.T, L @ L.T, atol=1e-9)
    np.testing.assert_allclose(future.on_past, regress(data.y(3, 7), data.z(), data.u(3, 7))[0], atol=1e-12)
    assert future_lq(data) is future


@pytest.mark.parametrize("feedthrough", [True, False])
def test_state_regression_equals_its_two_least_squares_problems(feedthrough):
    rng = np.random.default_rng(6)
    X, X_next, U, Y = (rng.standard_normal((m, 60)) for m in (3, 3, 2, 2))
    known = np.vstack([X, U]) if feedthrough else X
    on_known = Y @ np.linalg.pinv(known)
    residual = Y - on_known @ known
    on_all = X_next @ np.linalg.pinv(np.vstack([X, U, residual]))
    A, C, K, E = state_regression(X, X_next, U, Y, feedthrough)
    np.testing.assert_allclose(C, on_known[:, :3], atol=1e-12)
    np.testing.assert_allclose(np.hstack([A, K]), on_all[:, [0, 1, 2, 5, 6]], atol=1e-12)
    np.testing.assert_allclose(E @ E.T, residual @ residual.T, atol=1e-12)


def test_initial_state_reads_only_as_far_as_it_is_seen():
    data, truth = closed_loop(500, 0)
    x0 = np.array([2.0, -1.0])
    y = truth.simulate(data.u, x0)
    np.testing.assert_allclose(initial_state(truth, Experiment(data.u, y, dt=1.0), False), x0, atol=1e-9)


@pytest.mark.parametrize(("values", "samples"), [(60, 20), (10**7, 300)])
def test_initial_state_of_a_slow_model_takes_bounded_memory(monkeypatch, values, samples):
    """As many samples as the values allow, but five equations a state at least."""
    monkeypatch.setattr(initial_state_module, "HEAD_VALUES", values)
    model = StateSpaceModel(np.diag([0.9999, 0.5, -0.3, 0.2]), np.ones((4, 1)), np.ones((1, 4)), [[0.0]], 1.0)
    rng = np.random.default_rng(0)
    u, x0 = rng.standard_normal((300, 1)), rng.standard_normal(4)
    y = model.simulate(u, x0)
    y[samples:] += 1.0  # what it must not look at
    np.testing.assert_allclose(initial_state(model, Experiment(u, y, dt=1.0), False), x0, atol=1e-8)


@pytest.mark.parametrize("low_pass", [False, True])
def test_a_fit_copies_no_long_record(low_pass):
    rng = np.random.default_rng(7)
    u = rng.standard_normal(400_000)
    if low_pass:
        u = np.convolve(u, np.hanning(60), mode="same")
    y = np.convolve(u, [0, 1.0, 0.5, 0.2], mode="full")[: len(u)] + 0.1 * u.std() * rng.standard_normal(len(u))
    data = Experiment(u, y, dt=1.0)
    tracemalloc.start()
    estimate = fit(data, "po_moesp", 3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert estimate.route == ("blocked-qr" if low_pass else "gram-cholesky")
    assert peak < data.u.nbytes  # half of the data
