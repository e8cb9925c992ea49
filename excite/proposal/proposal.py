"""The design loop: parameters of a signal from what is known of a plant, or from a model of it, each with its reason."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, log10, sqrt
from typing import Any

import numpy as np

from excite.errors import DesignRefused, ExciteError, did_you_mean
from excite.models.state_space import StateSpaceModel
from excite.types.channel import positive

SAMPLES_PER_PERIOD = 10  # of the highest frequency of interest
RELATIVE_ERROR = 0.1  # of the frequency response that the noise may leave
MOST_PERIODS = 100
SPECTRUM_RANGE = 10.0  # largest over smallest line amplitude, 20 dB: no line starves for another
KINDS = ("prbs", "multisine", "sweep")


@dataclass(frozen=True)
class Knowledge:
    """What is known before an experiment.

    bandwidth_hz : highest frequency of interest; settling_s : time in which responses die out; limit : peak that the
    input may reach; noise, gain : rms of the output noise and size of the response in output units a unit of input;
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


@dataclass(frozen=True)
class Proposal:
    """A generator's name, its parameters, the reason for each, and what to beware of."""

    kind: str
    parameters: Mapping[str, Any]
    reasons: Mapping[str, str]
    warnings: tuple[str, ...] = ()


def propose(kind: str, known: Knowledge, dt: float | None = None, channels: int = 1) -> Proposal:
    """Propose a "prbs", "multisine" or "sweep" for what is known; dt in s when the sampling is given.

    Raises DesignRefused when the given sampling cannot show the bandwidth.
    """
    if kind not in KINDS:
        raise ExciteError(f"propose: kind '{kind}'; {did_you_mean(kind, KINDS)}")
    dt, reason, warnings = _sampling(known, dt)
    periods, averaging, more = _periods(known)
    parameters: dict[str, Any] = {"dt": dt, "amplitude": known.limit, "channels": channels}
    reasons = {"dt": reason, "amplitude": "the limit: the information grows with the square of the amplitude"}
    low = 1 / known.settling_s
    if kind == "prbs":
        order = _prbs_order(known, dt, channels)
        parameters |= {"order": order, "highest_hz": known.bandwidth_hz, "periods": periods}
        reasons["highest_hz"] = "the bandwidth; the clock follows at 2.5 times it, where the spectrum has lost 2.3 dB"
        reasons["order"] = f"the shortest sequence whose {channels} shifted copies stay apart for the settling time"
        reasons["periods"] = averaging
    elif kind == "multisine":
        period = ceil(2 * channels * known.settling_s / dt) * dt
        parameters |= {
            "period_s": period,
            "band_hz": [1 / period, known.bandwidth_hz],
            "spacing": "odd",
            "periods": periods + 1,
        }
        reasons["period_s"] = (
            "twice the settling time a channel: each channel's lines are closer than the sharpest resonance"
        )
        reasons["band_hz"] = "from the first line to the bandwidth"
        reasons["spacing"] = "odd lines: what appears on even ones is nonlinear distortion"
        reasons["periods"] = f"{averaging}; one more, the first, is transient"
        if known.spectrum is not None:
            parameters["spectrum"] = [list(point) for point in known.spectrum]
            reasons["spectrum"] = "noise over gain of the model: every line learns the response equally well"
    else:
        duration = ceil(max(5 * known.settling_s, 5 / low) * max(1, periods / 2) / dt) * dt
        parameters |= {
            "form": "log",
            "start_hz": low,
            "stop_hz": known.bandwidth_hz,
            "duration_s": duration,
            "dwell_cycles": 1,
            "fade_in_s": known.settling_s / 4,
            "fade_out_s": known.settling_s / 4,
        }
        reasons["start_hz"] = "one cycle in the settling time"
        reasons["stop_hz"] = "the bandwidth"
        reasons["duration_s"] = f"at least five times the longest period (Tischler and Remple 2012); {averaging}"
        reasons["dwell_cycles"] = "one cycle at the first frequency, after which its response has settled"
        reasons["fade_in_s"] = reasons["fade_out_s"] = "a soft start and end, a quarter of the settling time"
        if low >= known.bandwidth_hz:
            raise ExciteError(
                f"propose: settling_s {known.settling_s:g} s and bandwidth_hz {known.bandwidth_hz:g} Hz leave no band to sweep; "
                "a slower plant settles later than one period of its bandwidth"
            )
    return Proposal(kind, parameters, reasons, (*warnings, *more))


def knowledge_of(model: StateSpaceModel, limit: float) -> Knowledge:
    """Return what an identified model tells for the next experiment, for an input that may reach `limit`.

    bandwidth : where the response has fallen 20 dB below its largest, or a third above the fastest pole; settling : four
    time constants of the slowest pole (integrators aside); noise : rms of the one-step innovations' output noise;
    spectrum : noise density over gain, within 20 dB.
    """
    s = np.log(np.where(np.abs(model.poles()) < 1e-12, 1e-12, model.poles()).astype(complex)) / model.dt
    moving = s[np.abs(s) * model.dt > 1e-6]
    if not len(moving):
        raise ExciteError(
            "propose: the model has only integrators, which have no bandwidth; say what is known yourself"
        )
    nyquist = 0.5 / model.dt
    decay = np.min(np.maximum(np.abs(moving.real), 1e-9))
    settling = 4 / decay
    f = np.geomspace(min(1 / settling, nyquist / 20), 0.98 * nyquist, 400)
    size = np.linalg.norm(model.frf(f), 2, axis=(1, 2))
    above = f[size > size.max() / 10]
    bandwidth = float(min(max(above.max(), np.abs(moving).max() / (2 * np.pi) * 4 / 3), 0.8 * nyquist))
    noise, density = 0.0, np.ones_like(f)
    if model.K is not None and model.innovation_cov is not None and np.any(model.innovation_cov):
        shaping = StateSpaceModel(model.A, model.K, model.C, np.eye(len(model.C)), model.dt).frf(f)
        density = np.sqrt(np.einsum("fab,bc,fac->f", shaping, model.innovation_cov, shaping.conj()).real)
        noise = sqrt(float(np.trace(model.innovation_cov)))
    wanted = density / np.maximum(size, 1e-12 * size.max())
    inside = f <= bandwidth
    wanted = np.clip(wanted / wanted[inside].max(), 1 / SPECTRUM_RANGE, 1.0)
    points = np.linspace(0, inside.sum() - 1, 25).astype(int)
    spectrum = tuple((float(f[i]), float(wanted[i])) for i in points)
    gain = float(np.exp(np.mean(np.log(size[inside]))))
    return Knowledge(bandwidth, settling, limit, noise, gain, spectrum)


def _sampling(known: Knowledge, dt: float | None) -> tuple[float, str, tuple[str, ...]]:
    bandwidth = known.bandwidth_hz
    if dt is None:
        exact = 1 / (SAMPLES_PER_PERIOD * bandwidth)
        decade = 10.0 ** np.floor(log10(exact))
        dt = float(max(m * decade for m in (1, 2, 5) if m * decade <= exact * (1 + 1e-9)))
        return dt, f"{SAMPLES_PER_PERIOD} or more samples a period of the bandwidth, {bandwidth:g} Hz", ()
    dt = positive(dt, "propose: dt")
    nyquist = 0.5 / dt
    if nyquist <= bandwidth:
        raise DesignRefused(
            f"propose: dt {dt:g} s has its Nyquist frequency at {nyquist:g} Hz, not above the bandwidth {bandwidth:g} Hz: what "
            f"lies between would alias; sample at {1 / (SAMPLES_PER_PERIOD * bandwidth):.2g} s or faster"
        )
    if nyquist < 2.5 * bandwidth:
        warning = (
            f"the Nyquist frequency {nyquist:g} Hz is less than 2.5 times the bandwidth {bandwidth:g} Hz: put an anti-alias "
            "filter before the sampler and expect its phase in the model"
        )
        return dt, "as given", (warning,)
    return dt, "as given", ()


def _periods(known: Knowledge) -> tuple[int, str, tuple[str, ...]]:
    """Periods to average: the error of the response falls with the root of their number."""
    ratio = known.noise / (known.gain * known.limit)
    needed = max(2, ceil((ratio / RELATIVE_ERROR) ** 2))
    periods = min(needed, MOST_PERIODS)
    reason = f"{periods} periods: noise over response {ratio:.2g}, to be averaged below {RELATIVE_ERROR:g}"
    if known.noise == 0:
        reason = "two periods, to compare them: the noise is not known"
    if needed > MOST_PERIODS:
        left = ratio / sqrt(MOST_PERIODS)
        return (
            periods,
            reason,
            (f"{needed} periods would be needed; {periods} leave an error of {left:.2g}: raise the limit",),
        )
    return periods, reason, ()


def _prbs_order(known: Knowledge, dt: float, channels: int) -> int:
    clock = 2.5 * known.bandwidth_hz
    for order in range(4, 33):
        if (2**order - 1) / clock >= 1.2 * channels * known.settling_s:
            return order
    raise ExciteError(
        f"propose: no sequence up to order 32 lasts {channels} settling times of {known.settling_s:g} s at a clock of "
        f"{clock:g} Hz; lower the bandwidth"
    )
