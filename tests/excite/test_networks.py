"""Cauer and Foster networks: accuracy of the conversions whatever the ratios, and exact responses."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as la

from excite.errors import ExciteError
from excite.numerics.networks import cauer_to_foster, foster_to_cauer, response

EPS = np.finfo(float).eps


def error(found, expected):
    """Largest relative error of any element."""
    return max(np.abs(np.asarray(a) / b - 1).max() for a, b in zip(found, expected, strict=True))


def gap(tau):
    """Least relative distance of two time constants: what the rounding of inputs is divided by in any conversion."""
    return np.diff(np.log(np.sort(tau))).min()


def continued_fraction(resistance, tau):
    """Ladder of sum R / (1 + s tau) by Euclid's algorithm on polynomials in exact rational arithmetic."""

    def times(a, b):
        product = [Fraction(0)] * (len(a) + len(b) - 1)
        for i, x in enumerate(a):
            for j, y in enumerate(b):
                product[i + j] += x * y
        return product

    num, den = [], [Fraction(1)]
    for R, t in zip(map(Fraction, resistance), map(Fraction, tau), strict=True):
        factor = [Fraction(1), t]
        num = [a + R * b for a, b in zip(times(num, factor), den, strict=True)]
        den = times(den, factor)
    ladder = [], []
    while num:  # den / num = s C + 1 / (R + num' / den')
        ladder[1].append(den[-1] / num[-1])
        den = [a - ladder[1][-1] * b for a, b in zip(den, [0, *num], strict=True)][:-1]
        ladder[0].append(num[-1] / den[-1])
        num = [a - ladder[0][-1] * b for a, b in zip(num, den, strict=True)][:-1]
    return tuple(np.array([float(x) for x in each]) for each in ladder)


def random_foster(rng, n, decades):
    return 10 ** rng.uniform(-2, 2, n), np.sort(10 ** rng.uniform(-decades / 2, decades / 2, n))


def test_published_values():
    """Default ladder and LED ladder (Luminus SST-10 application note) of facts/plants.md, five digits."""
    ladder = foster_to_cauer([0.5, 1.2, 1.8, 2.0, 1.5], [20e-6, 5e-4, 0.01, 0.25, 6.0])
    np.testing.assert_allclose(ladder[0], [0.60655, 1.29119, 1.77582, 1.95560, 1.37084], rtol=1e-5)
    np.testing.assert_allclose(ladder[1], [3.6247e-5, 3.8059e-4, 5.4660e-3, 0.125857, 4.23922], rtol=2e-5)
    R, tau = cauer_to_foster([5.3, 0.3, 0.6, 3.7], [0.0193, 0.253, 0.0204, 46.1])
    np.testing.assert_allclose(R[:, 0], [9e-7, 3.95, 2.23, 3.72], rtol=5e-3)
    np.testing.assert_allclose(tau, [3.9e-3, 91e-3, 0.263, 172], rtol=1e-2)


def test_one_stage_and_two_stages_by_hand():
    R, tau = cauer_to_foster([2.0], [3.0])
    assert R[0, 0] == pytest.approx(2.0, rel=4 * EPS) and tau[0] == pytest.approx(6.0, rel=4 * EPS)
    # R1 = R2 = C1 = C2 = 1: s^2 + 3 s + 1
    _, tau = cauer_to_foster([1.0, 1.0], [1.0, 1.0])
    np.testing.assert_allclose(tau, [(3 - np.sqrt(5)) / 2, (3 + np.sqrt(5)) / 2], rtol=4 * EPS)


@pytest.mark.parametrize("decades", [0.5, 3, 12, 30])
@pytest.mark.parametrize("n", [2, 7, 16])
def test_ladders_are_exact_to_rounding(n, decades):
    R, tau = random_foster(np.random.default_rng(n), n, decades)
    assert error(foster_to_cauer(R, tau), continued_fraction(R, tau)) < 30 * EPS


@pytest.mark.parametrize("decades", [1, 4, 12])
def test_fifty_stages_there_and_back_from_foster(decades):
    rng = np.random.default_rng(int(decades))
    tau = np.cumprod(1 + rng.uniform(0.5, 1.5, 50) * (10 ** (decades / 50) - 1)) * 1e-6
    R = 10 ** rng.uniform(-2, 2, 50)
    order = rng.permutation(50)
    seen, back = cauer_to_foster(*foster_to_cauer(R[order], tau[order]))
    assert error((seen[:, 0], back), (R, tau)) < 1e-12


@pytest.mark.parametrize("seed", range(20))
def test_fifty_stages_there_and_back_from_cauer(seed):
    """Elements over two decades hide modes from the source (shares down to 1e-90); they come back all the same."""
    rng = np.random.default_rng(seed)
    ladder = 10 ** rng.uniform(-1, 1, (2, 50))
    seen, tau = cauer_to_foster(*ladder)
    off = error(foster_to_cauer(seen[:, 0], tau), ladder)
    assert off < 30 * EPS / gap(tau)
    if gap(tau) > 1e-2:
        assert off < 1e-12


def test_uniform_ladders_of_any_length():
    """1 / tau = 4 sin^2((2 k - 1) pi / (4 n + 2)) for R = C = 1, a chain free at its head and fixed at its end."""
    for n in (50, 400):
        seen, tau = cauer_to_foster(np.ones(n), np.ones(n))
        rate = 4 * np.sin((2 * np.arange(n, 0, -1) - 1) * np.pi / (4 * n + 2)) ** 2
        assert error((1 / tau,), (rate,)) < 1e-13
        assert error(foster_to_cauer(seen[:, 0], tau), (1.0, 1.0)) < 1e-12


def test_nodes_obey_the_heat_equation():
    """At rest node k is at the sum of what follows it; at first only node 1 heats up, at 1 / C_1."""
    rng = np.random.default_rng(0)
    R, C = 10 ** rng.uniform(-1, 1, (2, 30))
    seen, tau = cauer_to_foster(R, C)
    np.testing.assert_allclose(seen.sum(0), np.cumsum(R[::-1])[::-1], rtol=1e-12)
    slope = (seen / tau[:, None]).sum(0)
    np.testing.assert_allclose(slope, np.append(1 / C[0], np.zeros(29)), atol=1e-11 / C[0])
    G = np.diag(1 / R + np.append(0, 1 / R[:-1])) - np.diag(1 / R[:-1], 1) - np.diag(1 / R[:-1], -1)
    for s in (0.01, 1.0, 100.0):
        plain = la.solve(G + s * np.diag(C), np.eye(30)[0])
        np.testing.assert_allclose((seen / (1 + s * tau)[:, None]).sum(0), plain, rtol=1e-10, atol=1e-14 * plain.max())


def test_response_is_exact_at_any_time():
    rng = np.random.default_rng(1)
    R, tau = rng.uniform(0.5, 2, (4, 2)), np.array([1e-5, 1e-2, 1.0, 300.0])
    starts, power = np.cumsum(10 ** rng.uniform(-5, 2, 23)), rng.standard_normal(23)
    time = np.sort(np.concatenate([starts, starts[0] + rng.uniform(0, 1500, 200)]))
    expected = np.zeros((len(time), 2))
    for start, change in zip(starts, np.diff(power, prepend=0), strict=True):  # one step after another
        since = np.maximum(time - start, 0)[:, None]
        expected += change * (-np.expm1(-since / tau) @ R)
    np.testing.assert_allclose(response(R, tau, power, starts, time), expected, atol=1e-13)


@pytest.mark.parametrize(
    ("convert", "message"),
    [
        (lambda: cauer_to_foster([1.0, -2.0], [1.0, 1.0]), r"resistance\[1\]: -2"),
        (lambda: cauer_to_foster([1.0, 2.0], [1.0]), "2 resistances and 1 capacitances"),
        (lambda: foster_to_cauer([1.0, 2.0], [3.0, 3.0]), "time constant 3 s is given twice"),
        (lambda: foster_to_cauer([], []), "give a list of numbers"),
        (lambda: foster_to_cauer([1.0, 1.0], [1.0, np.inf]), r"tau\[1\]: inf"),
        (lambda: foster_to_cauer([1e-300, 1.0], [1.0, 1e-30]), "leaves the range of double precision"),
    ],
)
def test_what_is_no_network_is_refused(convert, message):
    with pytest.raises(ExciteError, match=message):
        convert()
