"""Conformance of identification methods: what every method in the table must satisfy, as callables for a test runner."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.kalman import kalman_gain
from excite.numerics.simulate import simulate
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from identify.method import fit, method_class
from identify.metrics.impulse import impulse_error
from identify.metrics.poles import pole_errors

ORDER = 4  # states of the example; two lags of two outputs
LAGS = 2


def example(noise: float = 0.1, samples: int = 1500, seed: int = 0) -> tuple[Experiment, StateSpaceModel]:
    """Return open-loop data and truth of a stable 2 x 2 fourth-order innovation model with ARX structure.

    K is chosen so that A - K C is nilpotent: the model is an ARX model of LAGS lags, in the class of every method.
    """
    rng = np.random.default_rng(seed)
    A, B, C = _system(rng)
    K = _deadbeat(A, C)
    model = StateSpaceModel(A, B, C, np.zeros((2, 2)), 0.1, K=K, innovation_cov=noise**2 * np.eye(2))
    u, e = rng.standard_normal((samples, 2)), noise * rng.standard_normal((samples, 2))
    y = model.simulate(u) + simulate(A, K, C, np.eye(2), e)
    return Experiment(u, y, dt=0.1), model


def _system(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    A = la.block_diag([[0.8, 0.3], [-0.3, 0.8]], [[0.5, 0.4], [-0.4, 0.5]])
    return A, rng.standard_normal((4, 2)), rng.standard_normal((2, 4))


def _deadbeat(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return K with (A - K C)^2 = 0 for observability indices (2, 2): ARX coefficients C A^2 = a1 C A + a2 C."""
    O = np.vstack([C, C @ A])
    a2, a1 = np.split(C @ A @ A @ la.inv(O), 2, axis=1)
    return la.solve(O, np.vstack([a1, a2 + a1 @ a1]))


def closed_loop(samples: int, seed: int) -> tuple[Experiment, StateSpaceModel]:
    """Return data and truth of the loop of seed 003 V-B (Mercère, Markovsky and Ramos)."""
    rng = np.random.default_rng(seed)
    r, e = rng.standard_normal((2, samples))
    u, y, z, v = np.zeros((4, samples))
    for k in range(2, samples):
        v[k] = -1.5 * v[k - 1] - 0.7 * v[k - 2] + e[k] + 0.5 * e[k - 1]
        u[k - 1] = -0.5 * y[k - 1] + r[k]
        z[k] = 1.5 * z[k - 1] - 0.7 * z[k - 2] + u[k - 1] + 0.5 * u[k - 2]
        y[k] = z[k] + 0.8 * v[k]
    truth = StateSpaceModel([[1.5, -0.7], [1, 0]], [[1], [0]], [[1, 0.5]], [[0]], 1.0)
    return Experiment(u, y, dt=1.0, reference=r, loop=Loop("closed")), truth


Records = tuple[tuple[Experiment, ...], StateSpaceModel]


def _time_series(noise: float, length: int) -> Records:
    data, truth = example(noise, 1500 * length)
    return (data,), truth


def _responses(noise: float, length: int, shape: Callable[[np.ndarray], np.ndarray]) -> Records:
    """One record for each input, which alone moves, at a sample of its own; white noise on the outputs."""
    rng = np.random.default_rng(0)
    A, B, C = _system(rng)
    truth = StateSpaceModel(A, B, C, np.zeros((2, 2)), 0.1)
    records = []
    for j in range(2):
        u = np.zeros((150 * length, 2))
        u[:, j] = 10 * shape(np.arange(len(u)) - 10 * (j + 1))
        records.append(Experiment(u, truth.simulate(u) + noise * rng.standard_normal((len(u), 2)), dt=0.1))
    return tuple(records), truth


def _outputs(noise: float, length: int) -> Records:
    """Outputs of two lightly damped modes driven by white process noise, with a little noise of their own.

    The example's own modes hardly show in its noise: with 1500 samples no method finds them within 0.05.
    """
    rng = np.random.default_rng(0)
    modes = ((0.97, 0.4), (0.95, 1.2))
    A = la.block_diag(*(r * np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]]) for r, w in modes))
    C = _system(rng)[2]
    K, cov = kalman_gain(A, C, np.eye(4), noise**2 * np.eye(2), np.zeros((4, 2)))
    truth = StateSpaceModel(A, np.empty((4, 0)), C, np.empty((2, 0)), 0.1, K=K, innovation_cov=cov)
    e = rng.standard_normal((1500 * length, 2)) @ la.cholesky(cov)
    return (Experiment(None, simulate(A, K, C, np.eye(2), e), dt=0.1),), truth


# What a method consumes -> its example data: (noise, length in units of the usual record) -> records and truth.
EXAMPLES: dict[str, Callable[[float, int], Records]] = {
    "time series": _time_series,
    "impulse responses": lambda noise, length: _responses(noise, length, lambda t: t == 0),
    "step responses": lambda noise, length: _responses(noise, length, lambda t: t >= 0),
    "outputs": _outputs,
}


def example_for(name: str, noise: float = 0.1, length: int = 1) -> Records:
    """Return records of the kind that a method consumes, and their truth."""
    if name == "moesp":  # without an instrument, white noise on the outputs is all it stands
        (data,), truth = _time_series(0.0, length)
        y = data.y + noise * np.random.default_rng(1).standard_normal(data.y.shape)
        return (replace(data, y=y),), truth
    return EXAMPLES[method_class(name).consumes](noise, length)


def _order(name: str) -> int:
    return LAGS if name == "arx" else ORDER


def _poles(model: object) -> np.ndarray:
    return np.sort_complex(np.round(model.poles(), 12))


def _error(model: object, truth: StateSpaceModel) -> float:
    """Relative error of the impulse response, or the largest pole error where there is no input."""
    if truth.inputs:
        return impulse_error(model, truth)
    return float(pole_errors(truth.poles(), model.poles(), truth.dt).z.max())


def check_deterministic(name: str) -> None:
    """The same data give the same bits."""
    data, _ = example_for(name)
    first, second = (fit(data, name, _order(name)).model.to_state_space() for _ in range(2))
    for key in ("A", "B", "C", "D"):
        assert getattr(first, key).tobytes() == getattr(second, key).tobytes(), key


def check_inputs_unmodified(name: str) -> None:
    """A fit leaves the data as they were."""
    data, _ = example_for(name)
    before = [(e.u.tobytes(), e.y.tobytes()) for e in data]
    fit(data, name, _order(name))
    assert before == [(e.u.tobytes(), e.y.tobytes()) for e in data]


def check_units(name: str) -> None:
    """One common factor on all inputs and one on all outputs scale the response and leave the poles."""
    data, _ = example_for(name)
    plain = fit(data, name, _order(name)).model
    scaled = fit([Experiment(1e3 * e.u, 1e-2 * e.y, dt=e.dt) for e in data], name, _order(name)).model
    np.testing.assert_allclose(scaled.impulse(30) * 1e5, plain.impulse(30), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(_poles(scaled), _poles(plain), atol=1e-8)


def check_converges(name: str) -> None:
    """On in-class data the error is small and falls with the noise; with the record where a method is `asymptotic`."""
    first, second, least = ((0.1, 1), (0.1, 16), 0.5) if method_class(name).asymptotic else ((0.1, 1), (0.001, 1), 0.05)
    errors = []
    for noise, length in (first, second):
        data, truth = example_for(name, noise, length)
        errors.append(_error(fit(data, name, _order(name)).model, truth))
    assert errors[0] < 0.05 and errors[1] < least * errors[0], errors


def check_several_records(name: str) -> None:
    """More records give one estimate that no seam disturbs: a record cut in two with samples missing between, or the
    responses measured again.
    """
    data, truth = example_for(name)
    if method_class(name).consumes in ("time series", "outputs"):
        data = [part for e in data for part in (e.window(0, 700), e.window(705))]
    else:
        data = data + data
    estimate = fit(data, name, _order(name))
    assert _error(estimate.model, truth) < 0.05
    assert len(estimate.x0) == len(data)


def check_closed_loop_claim(name: str) -> None:
    """A method that claims consistency in closed loop converges there where the biased one does not."""
    order = 20 if name == "arx" else 4
    errors = []
    for samples in (1000, 16_000):
        runs = [closed_loop(samples, seed) for seed in range(4)]
        errors.append(np.median([impulse_error(fit(d, name, order).model, t, 60) for d, t in runs]))
    if method_class(name).closed_loop:
        assert errors[1] < 0.5 * errors[0], errors
    else:
        assert errors[1] > 0.5 * errors[0], errors


def check_refusals(name: str) -> None:
    """Non-uniform time, constant channels and impossible orders are refused with a reason."""
    data, _ = example_for(name)
    order = _order(name)
    flat = [replace(e, y=np.column_stack([e.y[:, 0], np.full(len(e), 3.0)])) for e in data]
    uneven = [replace(e, dt=None, time_s=np.cumsum(1 + 0.5 * np.sin(np.arange(len(e))))) for e in data]
    cases = {
        "not uniform": (uneven, order),
        "'y2' is constant": (flat, order),
        "order 0": (data, 0),
        "largest possible": (data, 10_000),
    }
    for expected, (bad, order) in cases.items():
        _refuses(name, bad, order, expected)


def check_gaps(name: str) -> None:
    """Missing samples split a record, which the estimate says; a method that cannot take gaps refuses them."""
    data, truth = example_for(name)
    y, middle = data[0].y.copy(), len(data[0]) // 2
    y[7, 1] = y[middle : middle + 9] = np.nan
    data = [replace(data[0], y=y), *data[1:]]
    if method_class(name)().span(1) is None:
        _refuses(name, data, _order(name), "sample 7 of channel 'y2' is missing")
        return
    estimate = fit(data, name, _order(name))
    assert _error(estimate.model, truth) < 0.05
    assert len(estimate.x0) == len(data) and "10 of " in estimate.warnings[0] and "incomplete" in estimate.warnings[0]


def check_needs_its_input(name: str) -> None:
    """Records whose input is absent, constant, or not of the kind consumed are refused with a reason."""
    kind = method_class(name).consumes
    series, _ = example()
    u = series.u.copy()
    u[:, 1] = 3.0
    constant = replace(series, u=u)
    absent = replace(series, u=None, inputs=None)
    cases = {
        "time series": {"'u2' is constant": constant, "no input": absent},
        "impulse responses": {"not an impulse": series},
        "step responses": {"not a step": series, "no input": absent},
    }[kind]
    for expected, bad in cases.items():
        _refuses(name, bad, _order(name), expected)


def _refuses(name: str, bad: object, order: int, expected: str) -> None:
    try:
        fit(bad, name, order)
    except ExciteError as error:
        assert expected in str(error), f"{expected!r} not in {error}"
    else:
        raise AssertionError(f"{name} took data that should be refused: {expected}")


# Each check and the kinds of data for which it has a meaning.
CHECKS: dict[Callable[[str], None], tuple[str, ...]] = {
    check_deterministic: tuple(EXAMPLES),
    check_inputs_unmodified: tuple(EXAMPLES),
    check_units: tuple(EXAMPLES),
    check_converges: tuple(EXAMPLES),
    check_several_records: tuple(EXAMPLES),
    check_closed_loop_claim: ("time series",),  # the others play open loop, or know no input
    check_refusals: tuple(EXAMPLES),
    check_gaps: tuple(EXAMPLES),
    check_needs_its_input: ("time series", "impulse responses", "step responses"),
}


def checks_of(name: str) -> list[Callable[[str], None]]:
    """Return the checks that have a meaning for a method."""
    return [check for check, kinds in CHECKS.items() if method_class(name).consumes in kinds]
