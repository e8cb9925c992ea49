"""Random stable models of every class, with offsets, for tests that hold for any of them."""

from types import SimpleNamespace

import numpy as np

from excite.models.fir import FirModel
from excite.models.foster import FosterModel
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import StateSpaceModel


def offsets(rng, nu, ny):
    return {"input_offset": rng.standard_normal(nu), "output_offset": rng.standard_normal(ny)}


def state_space(rng, n, nu, ny, noise=True, feedthrough=True):
    A = rng.standard_normal((n, n))
    A *= 0.8 / np.abs(np.linalg.eigvals(A)).max()
    D = rng.standard_normal((ny, nu)) * feedthrough
    K = 0.1 * rng.standard_normal((n, ny)) if noise else None
    B, C = rng.standard_normal((n, nu)), rng.standard_normal((ny, n))
    return StateSpaceModel(A, B, C, D, 0.5, K=K, **offsets(rng, nu, ny))


def polynomial(rng, ny, nu, na=0, nb=0, nc=0, nd=0, nf=0, dead=1):
    """Coefficients small enough for stability; F of the first pair and D of the second output stay 1 where there are several."""

    def monic(lags, *shape):
        return np.concatenate([np.ones((1, *shape)), 0.5 * rng.uniform(-1, 1, (lags, *shape)) / max(lags, 1)])

    a = np.concatenate([np.eye(ny)[None], 0.5 * rng.uniform(-1, 1, (na, ny, ny)) / max(na * ny, 1)])
    b, c, d, f = rng.standard_normal((nb + 1, ny, nu)), monic(nc, ny), monic(nd, ny), monic(nf, ny, nu)
    b[:dead] = 0
    if ny > 1:
        f[1:, 0, :1], d[1:, 1] = 0, 0
    return PolynomialModel(a, b, 0.5, c=c, d=d, f=f, **offsets(rng, nu, ny))


def fir(rng, count, ny, nu):
    return FirModel(rng.standard_normal((count, ny, nu)), 0.5, **offsets(rng, nu, ny))


def foster(rng, n, ny, nu):
    return FosterModel(rng.standard_normal((n, ny, nu)), np.geomspace(0.3, 30, n), **offsets(rng, nu, ny))


PARAMETRIC = {
    "state space": lambda rng: state_space(rng, 3, 2, 2),
    "state space without noise": lambda rng: state_space(rng, 4, 1, 3, noise=False),
    "state space without feedthrough": lambda rng: state_space(rng, 2, 2, 1, feedthrough=False),
    "arx": lambda rng: polynomial(rng, 2, 3, na=2, nb=3),
    "armax": lambda rng: polynomial(rng, 2, 2, na=1, nb=1, nc=2),
    "output error": lambda rng: polynomial(rng, 2, 1, nb=2, nf=2),
    "box-jenkins": lambda rng: polynomial(rng, 1, 2, nb=2, nc=1, nd=1, nf=3),
    "all polynomials": lambda rng: polynomial(rng, 2, 2, na=2, nb=2, nc=2, nd=2, nf=2),
    "fir": lambda rng: fir(rng, 5, 2, 3),
    "foster": lambda rng: foster(rng, 3, 2, 2),
}


def random_record(rng, model, samples):
    """Noise in all channels, at random instants for a model in continuous time."""
    u, y = (rng.standard_normal((samples, len(channels))) for channels in (model.inputs, model.outputs))
    steps = np.full(samples, model.dt) if model.dt else rng.exponential(1.0, samples)
    return SimpleNamespace(u=u, y=y, time_s=np.cumsum(steps))
