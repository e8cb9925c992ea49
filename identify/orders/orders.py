"""Order selection: singular-value gap, information criteria, stabilisation of poles, and all three in one table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from excite.errors import ExciteError
from excite.models.model import Model
from excite.models.modes import Mode
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from identify.data.gaps import gap_free
from identify.estimate import Estimate
from identify.steps.initial_state import initial_state
from identify.steps.kalman import NOISE_FREE

if TYPE_CHECKING:
    from identify.method import Data, Method


def largest_gap(singular_values: np.ndarray) -> tuple[int, float]:
    """Return (order, ratio): the order before the largest ratio of successive singular values.

    Values at rounding level (1e-12 of the first) end the search, so that noise-free data give the true order.
    """
    s = np.asarray(singular_values, float)
    floor = 1e-12 * s[0]
    ratios = s[:-1] / np.maximum(s[1:], floor)
    ratios[s[:-1] <= floor] = 0
    order = int(np.argmax(ratios)) + 1
    return order, float(ratios[order - 1])


@dataclass(frozen=True)
class Criteria:
    """Information criteria of one model: smaller is better; aic and bic compare models of the same data.

    aic = N log det S + 2 p (Akaike 1974), bic = N log det S + p log N (Schwarz 1978; Rissanen's MDL is half of it), S the
    covariance of the one-step residuals over N samples, p = parameters. NaN for a model without noise part.
    """

    aic: float
    bic: float
    parameters: int


def free_parameters(model: Model) -> int:
    """Parameters that the data determine, whatever the basis of the state.

    n (nu + 2 ny) of the innovation form, and ny nu of D where it is not zero; the coefficients of a polynomial model.
    """
    ny, nu = len(model.outputs), len(model.inputs)
    if isinstance(model, PolynomialModel):
        return model.a[1:].size + int((model.b != 0).any(axis=(1, 2)).sum()) * ny * nu
    model = model.to_state_space()
    return model.order * (nu + 2 * ny) + (ny * nu if np.any(model.D) else 0)


def information_criteria(model: Model, data: "Data") -> Criteria:
    """Return AIC and BIC of a model on the data it was estimated from (gaps left out).

    Residuals at rounding level count as equal, so that of noise-free models the smallest exact one is best.
    """
    data = (data,) if isinstance(data, Experiment) else tuple(data)
    count, parts = free_parameters(model), gap_free(data, 1).parts
    model = model.to_state_space()
    if model.K is None:
        return Criteria(np.nan, np.nan, count)
    with np.errstate(over="ignore", invalid="ignore"):
        residual = np.concatenate([p.y - model.predict(p, x0=initial_state(model, p, predictor=True)) for p in parts])
    if not np.isfinite(residual).all():
        return Criteria(np.inf, np.inf, count)
    N = len(residual)
    floor = NOISE_FREE * np.linalg.norm(np.concatenate([p.y for p in parts]), axis=0)
    fit = N * np.linalg.slogdet((residual.T @ residual + np.diag(floor**2)) / N)[1]
    return Criteria(fit + 2 * count, fit + count * np.log(N), count)


@dataclass(frozen=True)
class StablePole:
    """One mode of one order in a stabilisation diagram, and whether the next lower order has it too."""

    order: int
    mode: Mode
    frequency: bool
    damping: bool
    shape: bool


def stabilisation(
    models: Mapping[int, StateSpaceModel], frequency: float = 0.01, damping: float = 0.05, mac: float = 0.98
) -> tuple[StablePole, ...]:
    """Return the modes of models, given by their order, each compared with the nearest mode of the next lower order.

    frequency, damping : relative changes up to which a mode is stable in them; mac : least modal assurance criterion
    |a^H b|^2 / (a^H a b^H b) of stable shapes (Peeters and De Roeck, Mech. Syst. Signal Process. 13, 1999). The modes of
    the first model are not stable in anything.
    """
    found, before = [], ()
    for order in sorted(models):
        modes = models[order].modes()
        for mode in modes:
            if not before:
                found.append(StablePole(order, mode, False, False, False))
                continue
            near = min(before, key=lambda other: abs(other.pole - mode.pole))
            same_frequency = bool(abs(mode.f_hz - near.f_hz) <= frequency * near.f_hz)
            same_damping = bool(abs(mode.damping - near.damping) <= damping * abs(near.damping))
            found.append(StablePole(order, mode, same_frequency, same_damping, _mac(mode.shape, near.shape) >= mac))
        before = modes
    return tuple(found)


def _mac(a: np.ndarray, b: np.ndarray) -> float:
    size = np.vdot(a, a).real * np.vdot(b, b).real
    return float(abs(np.vdot(a, b)) ** 2 / size) if size > 0 else 0.0


@dataclass(frozen=True, eq=False)
class OrderRow:
    """What one order gives: the estimate and its criteria, or the reason why there is none.

    gap : ratio of this singular value to the next, NaN where the method has none; radius : largest pole modulus.
    """

    order: int
    estimate: Estimate | None
    reason: str | None
    gap: float
    criteria: Criteria
    radius: float


@dataclass(frozen=True, eq=False)
class OrderTable:
    """Orders side by side; chosen : the order that "gap", "aic" and "bic" each prefer; poles : stabilisation diagram."""

    rows: tuple[OrderRow, ...]
    chosen: Mapping[str, int]
    poles: tuple[StablePole, ...]


def order_table(data: "Data", method: "Method", orders: Sequence[int]) -> OrderTable:
    """Fit several orders and return what speaks for each. The data are compressed and decomposed once for all of them.

    The order that a method takes when none is given is that of the gap; the criteria are offered beside it because they
    weigh fit against size, where singular values of noisy data fall without a step. They presuppose estimates near the
    least one-step error: arx, ssarx, cva, pbsid, parsim_k, wfa. The gain of MOESP, N4SID and IEM is less efficient, so that
    larger orders go on lowering their residuals beyond the true one.
    """
    from identify.method import experiments  # which imports this module

    data = experiments(data)
    method.check(data, None)
    shared, rows = {}, []
    for n in sorted(set(orders)):
        try:
            estimate = method.fit(data, n, shared)
        except ExciteError as error:
            rows.append(OrderRow(n, None, str(error), np.nan, Criteria(np.nan, np.nan, 0), np.nan))
            continue
        s = estimate.singular_values
        gap = np.nan if s is None or n >= len(s) else float(s[n - 1] / max(s[n], 1e-12 * s[0]))
        radius = float(np.abs(estimate.model.poles()).max(initial=0.0))
        rows.append(OrderRow(n, estimate, None, gap, information_criteria(estimate.model, data), radius))
    judged = {
        "gap": {row.order: -row.gap for row in rows},
        "aic": {row.order: row.criteria.aic for row in rows},
        "bic": {row.order: row.criteria.bic for row in rows},
    }
    chosen = {
        name: min(v, key=v.get) for name, each in judged.items() if (v := {n: x for n, x in each.items() if x == x})
    }
    models = {row.order: row.estimate.model.to_state_space() for row in rows if row.estimate is not None}
    return OrderTable(tuple(rows), chosen, stabilisation(models))
