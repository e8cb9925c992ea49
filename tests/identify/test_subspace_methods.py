"""The subspace family: exactness, what its members have in common and where they differ, and peers' printed results."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from paths import SHARED
from scipy.optimize import linear_sum_assignment

from excite.errors import ExciteError, Unsupported
from excite.files import load_experiment
from excite.models.state_space import StateSpaceModel
from excite.numerics.simulate import markov, simulate
from excite.types.experiment import Experiment
from identify.data.records import Kind, Records
from identify.estimate import Status
from identify.examples import closed_loop
from identify.examples import series as example
from identify.fit import fit
from identify.metrics.impulse import impulse_error
from identify.registry import METHODS, load_method, method_class
from identify.steps.compression import lq
from identify.steps.regions import Stable
from identify.steps.shift import Shift

DATA = SHARED / "data"
PREDICTOR_FORM = ["iem", "parsim_k", "pbsid", "ssarx", "ssinnov1", "ssinnov2", "wfa"]
ROBUST = {"algorithm": "robust"}


def shared(*parts):
    path = DATA.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"../shared/data/{'/'.join(parts)} is not there")
    return path


def pole_error(true, found):
    cost = np.abs(np.subtract.outer(true, found))
    return cost[linear_sum_assignment(cost)].max()


def oscillators(n):
    """n / 2 pairs of poles of modulus 0.9 over the band, two inputs, three outputs, feedthrough."""
    rng = np.random.default_rng(n)
    z = 0.9 * np.exp(1j * np.linspace(0.3, 2.6, n // 2))
    A = la.block_diag(*[[[p.real, p.imag], [-p.imag, p.real]] for p in z])
    return StateSpaceModel(
        A, rng.standard_normal((n, 2)), rng.standard_normal((3, n)), rng.standard_normal((3, 2)), 1.0
    )


@pytest.mark.parametrize("n", [2, 6, 12])
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("moesp", {}),
        ("pi_moesp", {}),
        ("po_moesp", {}),
        ("n4sid", {}),
        ("n4sid", {"weight": "moesp"}),
        ("cva", {}),
        ("n4sid", ROBUST),
        ("n4sid", ROBUST | {"weight": "moesp"}),
        ("cva", ROBUST),
    ],
)
def test_exact_without_noise(name, settings, n):
    truth, rng = oscillators(n), np.random.default_rng(n)
    u, x0 = rng.standard_normal((1500, 2)), rng.standard_normal(n)
    y = truth.simulate(u, x0)
    horizons = {"block_rows": 15} if "moesp" in name else {"past": 15, "future": 15}
    estimate = fit(Experiment(u, y, dt=1.0), name, n, **settings, **horizons)
    assert pole_error(truth.poles(), estimate.model.poles()) < 1e-9
    assert impulse_error(estimate.model, truth) < 1e-8
    assert not estimate.model.K.any()  # no gain is made from rounding
    np.testing.assert_allclose(estimate.model.simulate(u, estimate.x0[0]), y, atol=1e-6)


@pytest.mark.parametrize("name", PREDICTOR_FORM)
def test_errors_of_the_predictor_form_are_proportional_to_the_innovations(name):
    """Down to rounding; the noise of `example` is the same sequence at each level."""
    levels = (1e-2, 1e-4, 1e-6)
    errors = []
    for level in levels:
        data, truth = example(level)
        errors.append(impulse_error(fit(data, name, 4).model, truth) / level)
    assert max(errors) < 0.5 and max(errors) / min(errors) < 1.5, errors


@pytest.mark.parametrize("name", PREDICTOR_FORM)
def test_gain_and_innovations_of_the_predictor_form(name):
    """K C (basis-free: its trace) and the innovation covariance of the example, in which A - K C is nilpotent."""
    data, truth = example(0.1, 20_000)
    model = fit(data, name, 4).model
    np.testing.assert_allclose(model.innovation_cov, 0.01 * np.eye(2), atol=1e-3)
    assert np.trace(model.K @ model.C) == pytest.approx(np.trace(truth.K @ truth.C), rel=0.05)
    assert np.abs(la.eigvals(model.A - model.K @ model.C)).max() < 0.4


def output_noise(samples, coloured, seed):
    """The deterministic part of the example plus output noise, white or of poles 0.9 (not the system's)."""
    data, truth = example(0.0, samples, seed)
    e = 0.5 * np.random.default_rng(seed + 1).standard_normal(data.y.shape)
    v = simulate(0.9 * np.eye(2), np.eye(2), np.eye(2), np.eye(2), e) if coloured else e
    return replace(data, y=data.y + v), truth


def test_what_each_instrument_stands():
    """White output noise: all consistent. Coloured: MOESP without an instrument is not, past inputs make it so."""
    poles = {}
    for coloured in (False, True):
        for name in ("moesp", "pi_moesp"):
            for samples in (2000, 32_000):
                errors = []
                for seed in range(4):
                    data, truth = output_noise(samples, coloured, seed)
                    errors.append(pole_error(truth.poles(), fit(data, name, 4, block_rows=8).model.poles()))
                poles[name, coloured, samples] = np.median(errors)
    for case in (("moesp", False), ("pi_moesp", False), ("pi_moesp", True)):
        assert poles[*case, 32_000] < 0.4 * poles[*case, 2000], poles
    assert poles["moesp", True, 32_000] > 10 * poles["pi_moesp", True, 32_000], poles


def test_wfa_is_row_by_row_least_squares():
    data, _ = example(0.1, 400)
    method = load_method("wfa", past=4, future=3)
    factor = method.compression(Records.of(data))
    rows = []
    for i in range(3):
        before = [factor.z(), *(m(4 + k, 5 + k) for k in range(i) for m in (factor.y, factor.u))]
        solution = la.lstsq(np.vstack(before).T, factor.y(4 + i, 5 + i).T)[0].T
        rows.append(solution[:, : len(factor.z())])
    values = la.svdvals(np.vstack(rows) @ factor.z())
    np.testing.assert_allclose(method.decompose(factor).values[:6], values, rtol=1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_ssinnov1_solves_the_printed_structured_problem(closed):
    """Mercère et al. (2016), (27), (29), (31)-(39), with the Kronecker products, on one loop: no residual,
    the ARX model's response."""
    data, _ = closed_loop(400, 0)
    p, f = 6, 5
    method = load_method("ssinnov1", past=p, future=f)
    factor = method.compression(Records.of(data))
    found = method.decompose(factor)
    theta = la.lstsq(factor.z().T, factor.y(p, p + 1).T)[0].T
    E = np.vstack([factor.y(p + i, p + i + 1) - theta @ factor.z(i) for i in range(f)])
    U, Y, E = (np.hstack(L[1:]) for L in lq(factor.z(), factor.u(p, p + f), factor.y(p, p + f), E)[1:])
    second, target = (Y, E) if closed else (E, Y)
    F = [np.eye(f, k=-k) for k in range(f)]
    regressors = np.column_stack([(Fk @ V).ravel() for V in (U, second) for Fk in F])
    x, residual, *_ = la.lstsq(regressors, target.ravel())
    first, other = np.split(x, 2)
    assert residual < 1e-20 * np.linalg.norm(target) ** 2
    if closed:  # E = -H_u U + (I - H_y) Y in the predictor's Markov parameters: close the loop through y
        h_u, h_y = -first, np.eye(1, f)[0] - other
        T = la.inv(np.eye(f) - la.toeplitz(h_y, np.zeros(f)))
        first, other = T @ h_u, T[:, 0]
    np.testing.assert_allclose(found.response[:, 0, 0], first[1:], atol=1e-9)
    np.testing.assert_allclose(found.noise[:, 0, 0], other[1:], atol=1e-9)


def test_ssinnov2_with_the_whole_arx_past_is_ssinnov1():
    data, _ = example(0.3, 3000)
    second = load_method("ssinnov2", past=6, future=12, lags=6)
    factor = second.compression(Records.of(data))
    first = load_method("ssinnov1", past=6, future=18).decompose(factor)
    found = second.decompose(factor)
    np.testing.assert_allclose(found.response, first.response[:11], atol=1e-9)
    np.testing.assert_allclose(found.noise, first.noise[:11], atol=1e-9)
    shorter = load_method("ssinnov2", past=6, future=12, lags=3)
    apart = np.abs(shorter.decompose(shorter.compression(Records.of(data))).response - first.response[:11]).max()
    assert 1e-6 < apart < 0.2  # shorter, it is an estimate of its own


def printed(path):
    """Matrices of a SLICOT example's result file by name."""
    found, rows = {}, None
    for line in path.read_text().splitlines():
        if title := re.match(r" The (.*?)(?: \w+)? (?:is|are)\s*$", line):
            rows = found.setdefault(title[1], [])
        elif rows is not None and (numbers := re.findall(r"-?\d+\.\d+", line)):
            rows.append([float(x) for x in numbers])
    return {
        name: np.array(rows) if len({*map(len, rows)}) == 1 else np.concatenate(rows)
        for name, rows in found.items()
        if rows
    }


def record(name):
    if name == "dryer":
        return load_experiment(shared("daisy_dryer", "dryer.dat"), inputs=[0], outputs=[1], dt=0.08), 4, 1e-4
    path = shared("daisy_CD_player_arm", "CD_player_arm.dat")
    return load_experiment(path, inputs=[0, 1], outputs=[2, 3], dt=1.0), 8, 1e-3


@pytest.mark.parametrize("name", ["dryer", "CD player"])
def test_n4sid_robust_with_the_moesp_weight_is_the_combined_method_of_slicot_and_octave(name):
    """IB01BD with METH = 'C' and Octave's moen4: MOESP for A and C, N4SID for B, D and K (their printed A, B, C, D, K).

    The algorithms coincide: Markov parameters agree to the tolerance of Octave's own tests, which is that of four printed
    decimals. SLICOT divides the noise covariances by all samples, here they are divided by the columns: K is the same.
    """
    data, n, tolerance = record(name)
    estimate = fit(data, "n4sid", n, past=15, future=15, weight="moesp", algorithm="robust")
    peer = np.load(
        shared("octave_cd_player", f"octave_moen4_{'hairdryer_TIB01' if name == 'dryer' else 'CD_player'}.npz")
    )
    theirs = StateSpaceModel(*(peer[key] for key in ("Ae", "Be", "Ce", "De")), data.dt)
    assert pole_error(theirs.poles(), estimate.model.poles()) < 5e-4
    np.testing.assert_allclose(estimate.model.impulse(60), theirs.impulse(60), atol=tolerance)
    if name == "dryer":
        print_K = printed(shared("slicot_tib01", "IB01BD.res"))["Kalman gain matrix"]
        noise = [markov(m.A, K, m.C, np.eye(1), 40) for m, K in ((theirs, print_K), (estimate.model, estimate.model.K))]
        np.testing.assert_allclose(noise[1], noise[0], atol=1e-3)


def test_po_moesp_is_slicots_moesp_with_b_d_and_x0_from_all_samples():
    """IB01AD (METH = 'M'), then IB01CD with COMUSE = 'C', on the dryer: singular values, B, D and x0 as printed.

    The algorithms coincide: the response of both inputs, u and x0, agrees to the printed decimals.
    """
    data, n, _ = record("dryer")
    estimate = fit(data, "po_moesp", n, block_rows=15)
    p = printed(shared("slicot_tib01", "IB01CD.res"))
    A, B, C, D = (p[f"system {key} matrix"] for key in ("state", "input", "output", "input-output"))
    ours, theirs = estimate.model, StateSpaceModel(A, B, C, D, data.dt)
    assert pole_error(theirs.poles(), ours.poles()) < 5e-4
    np.testing.assert_allclose(ours.impulse(60), theirs.impulse(60), atol=1e-4)
    free = [
        m.simulate(np.zeros((60, 1)), x0) for m, x0 in ((ours, estimate.x0[0]), (theirs, p["initial state vector"][0]))
    ]
    np.testing.assert_allclose(free[0], free[1], atol=5e-3)  # x0 of 11 times four decimals


def test_po_moesp_has_the_singular_values_of_the_cd_player():
    data, n, _ = record("CD player")
    expected = printed(shared("octave_cd_player", "IB01AD_CD.res"))["singular"]
    found = fit(data, "po_moesp", n, block_rows=15).singular_values
    np.testing.assert_allclose(found, expected, atol=6e-5)


def shift(A, C, rows):
    return Shift(A, C, rows, lambda: np.eye(len(A)), lambda: np.eye(len(A)))


def test_the_guard_makes_stable_and_only_where_it_must():
    rng = np.random.default_rng(0)
    for radius in (1.0001, 1.02, 1.3):
        A = rng.standard_normal((5, 5))
        A *= radius / np.abs(la.eigvals(A)).max()
        stable, warning = Stable()(shift(A, rng.standard_normal((2, 5)), 12))
        assert np.abs(la.eigvals(stable)).max() < 1 and f"spectral radius {radius:.4f}" in warning
    kept, warning = Stable()(shift(0.9 * A / 1.3, rng.standard_normal((2, 5)), 12))
    assert warning is None and np.array_equal(kept, 0.9 * A / 1.3)
    fast = la.block_diag([[0.3]], [[1.1]])  # the mode that dies out keeps its place
    found, _ = Stable()(shift(fast, np.array([[1.0, 0.0], [0.0, 1.0]]), 20))
    assert sorted(np.abs(la.eigvals(found)))[0] == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize(("name", "settings"), [("po_moesp", {}), ("iem", {}), ("n4sid", ROBUST), ("ssinnov2", {})])
def test_one_guard_serves_every_method(name, settings):
    """Slowly growing data: unstable without the guard, stable and said so with it."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal((800, 1))
    y = StateSpaceModel([[1.003]], [[0.1]], [[1.0]], [[0.0]], 1.0).simulate(u) + 0.01 * rng.standard_normal((800, 1))
    data = Experiment(u, y, dt=1.0)
    bare = fit(data, name, 1, stability_guard=False, **settings)
    assert bare.status is Status.UNSTABLE and not any("stability_guard" in w for w in bare.warnings)
    guarded = fit(data, name, 1, stability_guard=True, **settings)
    assert np.abs(guarded.model.poles()).max() < 1 and guarded.status is not Status.UNSTABLE
    assert sum("stability_guard" in w for w in guarded.warnings) == 1


def twice(data):
    return replace(
        data, u=data.u[:, [0, 0]]
    ), r"inputs 'u1' and 'u2' are multiples of each other .* excite them independently"


def scaled(data):
    u = np.column_stack([data.u[:, 0], -3e-4 * data.u[:, 0]])
    u[11] = np.nan  # also where samples are missing
    return replace(data, u=u), r"inputs 'u1' and 'u2' are multiples"


def delayed(data):
    u = np.column_stack([data.u[:, 0], np.roll(data.u[:, 0], 1)])
    return replace(data, u=u), r"persistently exciting of order 1, but \d+ .* need order"


def one_sensor(data):
    return replace(data, y=data.y[:, [1, 1]]), r"outputs 'y1' and 'y2' are multiples of each other .* drop one"


def flat(data):
    return replace(data, y=np.column_stack([data.y[:, 0], np.zeros(len(data))])), "output 'y2' is constant"


def diverged(data):
    y = data.y * np.exp(0.4 * np.arange(len(data)))[:, None]
    return replace(data, y=y), r"channel 'y1' passes 1e\+100 at sample 5\d\d and reaches \S+e\+2\d\d: a diverged run"


def tiny(data):
    return replace(data, u=1e-200 * data.u), "channel 'u1' stays below 1e-100.* change its unit"


def sines(data):
    t = np.arange(len(data))
    return replace(
        data, u=np.column_stack([np.sin(0.3 * t), np.sin(0.5 * t)])
    ), r"persistently exciting of order \d, but \d+"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bad", [twice, scaled, delayed, one_sensor, flat, diverged, tiny, sines])
@pytest.mark.parametrize("name", ["arx", "moesp", "cva", "n4sid", *PREDICTOR_FORM])
def test_bad_data_are_refused_with_the_channel(name, bad):
    data, message = bad(example()[0].window(0, 1200))
    with pytest.raises(ExciteError, match=message):
        fit(data, name, 4)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["arx", "moesp", "n4sid", *PREDICTOR_FORM])
def test_growing_data_raise_no_numpy_warnings(name):
    """Unstable, but within range: an estimate or an ExciteError, and nothing else."""
    u = np.random.default_rng(0).standard_normal((800, 1))
    for pole in (1.02, 1.1, 1.25):
        y = StateSpaceModel([[pole, 0.1], [0, 0.5]], [[1], [1]], [[1, 0]], [[0]], 0.1).simulate(u)
        try:
            fit(Experiment(u, y, dt=0.1), name, 2)
        except ExciteError as error:
            assert str(error)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("n4sid", {"weight": "csv"}, r"n4sid\.weight: 'csv'; did you mean 'cva'"),
        ("n4sid", {"algorithm": "robus"}, r"n4sid\.algorithm: 'robus'; did you mean 'robust'"),
        ("ssinnov2", {"lags": 0}, r"ssinnov2\.lags: 0; give a whole number of at least 1"),
        ("moesp", {"stability_guard": 1}, r"moesp\.stability_guard: 1; give true or false"),
    ],
)
def test_bad_settings_are_refused_by_name(name, settings, message):
    with pytest.raises(ExciteError, match=message):
        load_method(name, **settings)


@pytest.mark.parametrize(
    ("name", "settings"), [("pi_moesp", {"block_rows": 6}), ("ssinnov1", {"future": 12}), ("moesp", {})]
)
def test_the_largest_order_can_be_realised(name, settings):
    """One input, three outputs: the responses to u have fewer columns than rows."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1500, 1))
    y = oscillators(12).simulate(u @ np.ones((1, 2))) + 0.1 * rng.standard_normal((1500, 3))
    data, method = Experiment(u, y, dt=1.0), load_method(name, **settings)
    largest = method.largest_order(Records.of(data))
    assert fit(data, method, largest).model.order == largest
    with pytest.raises(ExciteError, match=f"largest possible, {largest}"):
        fit(data, method, largest + 1)


def test_horizons_too_long_for_the_data_say_how_long_they_can_be():
    data, _ = example(samples=300)
    with pytest.raises(Unsupported, match=r"need 280 Hankel columns, but the data leave 231; .* is 60"):
        fit(data, "ssinnov2", 4, past=20, future=40)


@pytest.mark.parametrize("method", [m for m in METHODS if Kind.SERIES in method_class(m).takes])
def test_an_impulse_is_taken_or_refused_by_its_excitation(method):
    rng, u = np.random.default_rng(0), np.zeros(240)
    u[5] = 1.0
    y = np.convolve(u, [0, 1, 0.8, 0.5, 0.2, 0.1])[:240] + 1e-3 * rng.standard_normal(240)
    try:
        fit(Experiment(u, y, dt=1.0), method, 2)
    except ExciteError as error:
        assert "exciting of order" in str(error)


def test_noise_on_the_input_does_not_bias_where_the_reference_is_the_instrument():
    """Open loop: B and D from covariances with the reference, not by simulation on the noisy input."""
    errors = []
    for samples in (2000, 32_000):
        rng = np.random.default_rng(0)
        r, noise = rng.standard_normal(samples), 0.5 * rng.standard_normal((2, samples))
        true = StateSpaceModel([[1.5, -0.7], [1, 0]], [[1], [0]], [[1, 0.5]], [[0]], 1.0)
        data = Experiment(r + noise[0], true.simulate(r[:, None])[:, 0] + noise[1], dt=1.0, reference=r)
        errors.append(impulse_error(fit(data, "io_realization", 2, instrument="reference").model, true))
    assert errors[1] < 0.4 * errors[0] < 0.04
