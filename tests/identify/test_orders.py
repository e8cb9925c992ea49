"""Order selection: gap, information criteria, stabilisation, and the table of all three."""

import numpy as np
import pytest

from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from identify.examples import series as example
from identify.fit import fit
from identify.orders.criteria import free_parameters, information_criteria
from identify.orders.gap import largest_gap
from identify.orders.stabilisation import stabilisation
from identify.orders.table import order_table
from identify.registry import load_method
from identify.subspace.subspace_method import SubspaceMethod


def test_the_gap_ends_at_rounding():
    assert largest_gap([5.0, 4.0, 3.0, 1e-15, 1e-16]) == (3, pytest.approx(3 / 5e-12))
    assert largest_gap([8.0, 4.0, 1.0, 0.9])[0] == 2


def test_parameters_of_the_innovation_form():
    """n (nu + 2 ny) + ny nu: an (n, nu, ny) = (1, 1, 1) ARMAX with feedthrough has a, b0, b1 and c."""
    A, B, C = np.eye(3) / 2, np.ones((3, 2)), np.ones((4, 3))
    assert free_parameters(StateSpaceModel([[0.5]], [[1]], [[1]], [[1]], 1.0)) == 4
    assert free_parameters(StateSpaceModel(A, B, C, np.zeros((4, 2)), 1.0)) == 3 * (2 + 8)
    assert free_parameters(StateSpaceModel(A, B, C, np.ones((4, 2)), 1.0)) == 3 * (2 + 8) + 8
    a, b = np.stack([np.eye(2), np.eye(2), np.eye(2)]), np.stack([np.zeros((2, 1)), np.ones((2, 1)), np.ones((2, 1))])
    assert free_parameters(PolynomialModel(a, b, 1.0)) == 2 * 4 + 2 * 2


def test_criteria_are_those_of_the_one_step_residuals():
    data, _ = example()
    model = fit(data, "ssarx", 4).model
    residual = data.y - model.predict(data, x0=fit(data, "ssarx", 4).x0[0])
    fitted = len(data) * np.log(np.linalg.det(residual.T @ residual / len(data)))
    found = information_criteria(model, data)
    assert found.parameters == 4 * (2 + 4)
    assert found.aic == pytest.approx(fitted + 2 * 24, abs=1e-2)  # x0 is fitted once with B and D, once alone
    assert found.bic - found.aic == pytest.approx(24 * (np.log(1500) - 2))
    gap = data.y.copy()
    gap[100] = np.nan
    gappy = information_criteria(model, Experiment(data.u, gap, dt=data.dt))
    assert gappy.aic == pytest.approx(found.aic * 1499 / 1500, rel=0.01)
    assert information_criteria(StateSpaceModel(model.A, model.B, model.C, model.D, 0.1), data) is None
    diverging = StateSpaceModel(4 * np.eye(2), np.ones((2, 2)), np.eye(2), np.zeros((2, 2)), 0.1, K=np.zeros((2, 2)))
    assert information_criteria(diverging, data).aic == np.inf


@pytest.mark.parametrize("name", ["ssarx", "cva", "pbsid", "parsim_k", "wfa"])
def test_bic_finds_the_order(name):
    """In noise of a third of the output, where the singular values fall without a step."""
    found = [order_table(example(0.3, seed=s)[0], load_method(name), range(1, 8)).chosen["bic"] for s in range(6)]
    assert found.count(4) >= 5, found


def test_without_noise_the_smallest_exact_order_is_best():
    for name in ("ssarx", "po_moesp"):
        chosen = order_table(example(0.0)[0], load_method(name), range(1, 8)).chosen
        assert chosen["bic"] == chosen["aic"] == 4
    assert chosen["gap"] == 4


def test_one_decomposition_serves_all_orders(monkeypatch):
    count = []
    for kind in {SubspaceMethod, *(type(load_method(n)) for n in ("po_moesp", "iem", "ssinnov2", "n4sid", "ssarx"))}:
        if "decompose" in vars(kind) and kind is not SubspaceMethod:
            original = kind.decompose
            monkeypatch.setattr(
                kind, "decompose", lambda self, factor, f=original: count.append(self.name) or f(self, factor)
            )
    data, _ = example()
    for name in ("iem", "ssinnov2", "n4sid", "ssarx"):
        count.clear()
        table = order_table(data, load_method(name), range(1, 10))
        assert count == [name]
        for row in (table.rows[1], table.rows[6]):
            alone = fit(data, name, row.order)
            assert row.estimate.model.impulse(30).tobytes() == alone.model.impulse(30).tobytes()


def test_the_table_gives_a_reason_where_an_order_fails():
    data, _ = example()
    table = order_table(data, load_method("ssarx", future=3), [9, 2, 2, 4])
    assert [row.order for row in table.rows] == [2, 4, 9]
    last = table.rows[-1]
    assert last.estimate is None and "largest possible, 4" in last.reason and last.gap is None
    assert set(table.chosen.values()) <= {2, 4} and {p.order for p in table.poles} == {2, 4}
    s = table.rows[0].estimate.singular_values
    assert table.rows[0].gap == s[1] / s[2] and table.rows[0].radius < 1
    lags = order_table(data, load_method("arx"), [1, 2, 3])
    assert lags.chosen == {"aic": 2, "aicc": 2, "bic": 2} and lags.rows[0].gap is None  # no singular values, no gap


def test_true_modes_are_stable_and_spurious_ones_are_not():
    data, truth = example()
    table = order_table(data, load_method("ssarx"), range(2, 10))
    stable = [p for p in table.poles if p.order > 6 and p.frequency and p.damping and p.shape]
    for mode in truth.modes():
        near = [p for p in stable if abs(p.mode.f_hz / mode.f_hz - 1) < 0.02]
        assert {p.order for p in near} == {7, 8, 9}
    assert sum(p.order > 6 for p in table.poles) > len(stable)


def test_each_flag_judges_its_own_quantity():
    def model(order, angle, radius, shape):
        z = radius * np.exp(1j * angle)
        A = np.kron(np.eye(order // 2), [[z.real, z.imag], [-z.imag, z.real]])
        C = np.zeros((2, order))
        C[:, 0] = shape
        return StateSpaceModel(A[:order, :order], np.ones((order, 1)), C, np.zeros((2, 1)), 1.0)

    def flags(angle, radius, shape):
        first, second = model(2, 0.5, 0.9, [1, 2]), model(2, angle, radius, shape)
        rows = stabilisation({2: first, 3: second})
        return [(p.frequency, p.damping, p.shape) for p in rows]

    assert flags(0.5, 0.9, [2, 4]) == [(False, False, False), (True, True, True)]
    assert flags(0.5, 0.9, [1, -2])[1] == (True, True, False)
    assert flags(0.5, 0.85, [1, 2])[1][1] is False
    assert flags(0.6, 0.9, [1, 2])[1][0] is False
