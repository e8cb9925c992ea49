"""What is known of a plant before an experiment, said by a person or by the model of the last experiment."""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from excite.arguments import positive
from excite.errors import ExciteError
from excite.models.model import Dynamic, Model
from excite.models.state_space import StateSpaceModel

SPECTRUM_RANGE = 10.0  # largest over smallest line amplitude, 20 dB: no line starves for another


@dataclass(frozen=True)
class Knowledge:
    """What is known before an experiment.

    bandwidth_hz : highest frequency of interest; settling_s : time in which responses die out; limit : peak that the
    input may reach; noise, gain : rms of the output noise and size of the response in output units per unit of input;
    spectrum : relative line amplitudes [(f_hz, amplitude), …] or None.
    """

    bandwidth_hz: float
    settling_s: float
    limit: float
    noise: float = 0.0
    gain: float = 1.0
    spectrum: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        for name in ("bandwidth_hz", "settling_s", "limit", "gain"):
            object.__setattr__(self, name, positive(getattr(self, name), f"Knowledge.{name}"))
        if not (np.isfinite(self.noise) and self.noise >= 0):
            raise ExciteError(f"Knowledge.noise: {self.noise!r}; give the rms of the output noise, at least 0")


def knowledge_of(model: Model, limit: float) -> Knowledge:
    """Return what an identified model tells for the next experiment, for an input that may reach `limit`.

    bandwidth : where the response has fallen 20 dB below its largest, or a third above the fastest pole; settling : four
    time constants of the slowest pole (integrators aside); noise : rms of the one-step innovations' output noise;
    spectrum : noise density over gain, within 20 dB. Raises ExciteError for a model that has no poles or no sampling time.
    """
    if not isinstance(model, Dynamic) or model.dt is None:
        raise ExciteError(
            f"propose: a {type(model).__name__} does not tell what the next experiment needs; say what is known yourself, or "
            "give a model with poles and a sampling time"
        )
    space: StateSpaceModel = model.to_state_space()
    s = np.log(np.where(np.abs(space.poles()) < 1e-12, 1e-12, space.poles()).astype(complex)) / space.dt
    moving = s[np.abs(s) * space.dt > 1e-6]
    if not len(moving):
        raise ExciteError(
            "propose: the model has only integrators, which have no bandwidth; say what is known yourself"
        )
    nyquist = 0.5 / space.dt
    decay = np.min(np.maximum(np.abs(moving.real), 1e-9))
    settling = 4 / decay
    f = np.geomspace(min(1 / settling, nyquist / 20), 0.98 * nyquist, 400)
    size = np.linalg.norm(space.frf(f), 2, axis=(1, 2))
    above = f[size > size.max() / 10]
    bandwidth = float(min(max(above.max(), np.abs(moving).max() / (2 * np.pi) * 4 / 3), 0.8 * nyquist))
    noise, density = 0.0, np.ones_like(f)
    if space.K is not None and space.innovation_cov is not None and np.any(space.innovation_cov):
        shaping = StateSpaceModel(space.A, space.K, space.C, np.eye(len(space.C)), space.dt).frf(f)
        density = np.sqrt(np.einsum("fab,bc,fac->f", shaping, space.innovation_cov, shaping.conj()).real)
        noise = sqrt(float(np.trace(space.innovation_cov)))
    wanted = density / np.maximum(size, 1e-12 * size.max())
    inside = f <= bandwidth
    wanted = np.clip(wanted / wanted[inside].max(), 1 / SPECTRUM_RANGE, 1.0)
    points = np.linspace(0, inside.sum() - 1, 25).astype(int)
    spectrum = tuple((float(f[i]), float(wanted[i])) for i in points)
    gain = float(np.exp(np.mean(np.log(size[inside]))))
    return Knowledge(bandwidth, settling, limit, noise, gain, spectrum)
