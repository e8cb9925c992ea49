"""Conformance of identification methods: what every method in the table must satisfy, as callables for a test runner."""

from collections.abc import Callable

import numpy as np
import scipy.linalg as la

from excite import lti
from excite.errors import ExciteError
from excite.types.experiment import Experiment
from excite.types.models import StateSpaceModel
from excite.types.recording import Loop
from identify.method import fit, method_class
from identify.metrics import impulse_error

ORDER = 4  # states of the example; two lags of two outputs
LAGS = 2


def example(noise: float = 0.1, samples: int = 1500, seed: int = 0) -> tuple[Experiment, StateSpaceModel]:
    """Return open-loop data and truth of a stable 2 x 2 fourth-order innovation model with ARX structure.

    K is chosen so that A - K C is nilpotent: the model is an ARX model of LAGS lags, in the class of every method.
    """
    rng = np.random.default_rng(seed)
    A = la.block_diag([[0.8, 0.3], [-0.3, 0.8]], [[0.5, 0.4], [-0.4, 0.5]])
    B, C = rng.standard_normal((4, 2)), rng.standard_normal((2, 4))
    K = _deadbeat(A, C)
    model = StateSpaceModel(A, B, C, np.zeros((2, 2)), 0.1, K=K, innovation_cov=noise**2 * np.eye(2))
    u, e = rng.standard_normal((samples, 2)), noise * rng.standard_normal((samples, 2))
    y = model.simulate(u) + lti.simulate(A, K, C, np.eye(2), e)
    return Experiment(u, y, dt=0.1), model


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
    return Experiment(u, y, dt=1.0, reference=r, loop=Loop(closed=True)), truth


def _order(name: str) -> int:
    return LAGS if name == "arx" else ORDER


def _poles(model: object) -> np.ndarray:
    return np.sort_complex(np.round(model.poles(), 12))


def check_deterministic(name: str) -> None:
    """The same data give the same bits."""
    data, _ = example()
    first, second = (fit(data, name, _order(name)).model.impulse(30) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def check_inputs_unmodified(name: str) -> None:
    """A fit leaves the data as they were."""
    data, _ = example()
    before = data.u.tobytes(), data.y.tobytes()
    fit(data, name, _order(name))
    assert before == (data.u.tobytes(), data.y.tobytes())


def check_units(name: str) -> None:
    """One common factor on all inputs and one on all outputs scale the response and leave the poles."""
    data, _ = example()
    plain = fit(data, name, _order(name)).model
    scaled = fit(Experiment(1e3 * data.u, 1e-2 * data.y, dt=data.dt), name, _order(name)).model
    np.testing.assert_allclose(scaled.impulse(30) * 1e5, plain.impulse(30), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(_poles(scaled), _poles(plain), atol=1e-8)


def check_converges(name: str) -> None:
    """On in-class data the error of the impulse response is small and falls with the noise."""
    errors = []
    for noise in (0.1, 0.001):
        data, truth = example(noise)
        errors.append(impulse_error(fit(data, name, _order(name)).model, truth))
    assert errors[0] < 0.05 and errors[1] < 0.05 * errors[0], errors


def check_several_records(name: str) -> None:
    """A record cut in two, with samples missing between, gives one estimate that no seam disturbs."""
    data, truth = example()
    estimate = fit((data.window(0, 700), data.window(705)), name, _order(name))
    assert impulse_error(estimate.model, truth) < 0.05
    assert len(estimate.x0) == 2


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
    """Missing samples, non-uniform time, constant inputs and impossible orders are refused with a reason."""
    data, _ = example()
    y = data.y.copy()
    y[7, 1] = np.nan
    constant = np.hstack([data.u[:, :1], np.full((len(data), 1), 3.0)])
    time = np.cumsum(1 + 0.5 * np.sin(np.arange(len(data))))
    cases = {
        "sample 7 of channel 'y2' is missing": (Experiment(data.u, y, dt=0.1), _order(name)),
        "not uniform": (Experiment(data.u, data.y, time_s=time), _order(name)),
        "'u2' is constant": (Experiment(constant, data.y, dt=0.1), _order(name)),
        "order 0": (data, 0),
        "largest possible": (data, 10_000),
    }
    for expected, (bad, order) in cases.items():
        try:
            fit(bad, name, order)
        except ExciteError as error:
            assert expected in str(error), f"{expected!r} not in {error}"
        else:
            raise AssertionError(f"{name} took data that should be refused: {expected}")


CHECKS: tuple[Callable[[str], None], ...] = (
    check_deterministic,
    check_inputs_unmodified,
    check_units,
    check_converges,
    check_several_records,
    check_closed_loop_claim,
    check_refusals,
)
