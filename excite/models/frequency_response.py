"""Frequency responses that are known at frequencies: a model and data at once."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from excite.errors import ExciteError
from excite.models.arrays import finite, read_only
from excite.models.model import Model
from excite.types.channel import Channels, channels_for, positive
from excite.types.checked import NOT_GIVEN, OptionalArray

EDGE = 1e-9  # relative distance by which a frequency may lie outside the band, for rounding


@dataclass(frozen=True, eq=False)
class FrequencyResponse(Model):
    """Frequency response known at F frequencies: what nonparametric methods estimate and files of responses hold.

    Parameters
    ----------
    f_hz : frequencies (F,), increasing, not negative
    values : (F, ny, nu), complex
    dt : sampling time of the signals, s, or None where they are in continuous time
    covariance : of the errors of vec G = G.ravel() (row by row), m = ny nu entries, per frequency: E[dg dg^H] (F, m, m),
        Hermitian; or variances E|dG_ij|^2 (F, ny, nu), kept as a diagonal. Errors are circular complex: the real and
        the imaginary part have half of it each and are uncorrelated (Pintelon and Schoukens, System Identification: A
        Frequency Domain Approach, 2nd ed. 2012, ch. 2). None where it is not known
    coherence : multiple coherence of each output with all inputs (F, ny), from 0 to 1, or None

    >>> G = FrequencyResponse([1.0, 2.0], [[[1.0]], [[0.5 - 0.5j]]])
    >>> G.frf([1.5]).item()
    (0.75-0.25j)
    """

    f_hz: np.ndarray
    values: np.ndarray
    dt: float | None = None
    covariance: OptionalArray = NOT_GIVEN
    coherence: OptionalArray = NOT_GIVEN
    inputs: Channels = NOT_GIVEN
    outputs: Channels = NOT_GIVEN

    def __post_init__(self) -> None:
        f = finite(self.f_hz, (None,), "FrequencyResponse.f_hz")
        values = finite(self.values, (len(f), None, None), "FrequencyResponse.values", complex)
        if 0 in values.shape:
            raise ExciteError(
                f"FrequencyResponse.values: shape {values.shape}; expected (frequencies, outputs, inputs)"
            )
        if f[0] < 0 or (np.diff(f) <= 0).any():
            k = int(np.argmax(np.diff(f, prepend=-np.inf if f[0] >= 0 else f[0]) <= 0))
            raise ExciteError(f"FrequencyResponse.f_hz: {f[k]:g} Hz at {k}; give increasing frequencies from 0 Hz on")
        _, ny, nu = values.shape
        object.__setattr__(self, "f_hz", f)
        object.__setattr__(self, "values", values)
        if self.dt is not None:
            dt = positive(self.dt, "FrequencyResponse.dt")
            if f[-1] > (1 + EDGE) * 0.5 / dt:
                raise ExciteError(
                    f"FrequencyResponse.f_hz: {f[-1]:g} Hz lies above the Nyquist frequency, {0.5 / dt:g} Hz at dt {dt:g} s; "
                    "leave those frequencies out, or correct dt"
                )
            object.__setattr__(self, "dt", dt)
        object.__setattr__(self, "covariance", _covariance(self.covariance, (len(f), ny, nu)))
        if self.coherence is not None:
            coherence = finite(self.coherence, (len(f), ny), "FrequencyResponse.coherence")
            if coherence.min() < 0 or coherence.max() > 1 + EDGE:
                raise ExciteError("FrequencyResponse.coherence: values outside 0 to 1; give the squared magnitude")
            object.__setattr__(self, "coherence", coherence)
        object.__setattr__(self, "inputs", channels_for(nu, self.inputs, "u"))
        object.__setattr__(self, "outputs", channels_for(ny, self.outputs, "y"))

    def __len__(self) -> int:
        return len(self.f_hz)

    @property
    def variance(self) -> np.ndarray | None:
        """Variances E|dG_ij|^2 (F, ny, nu), or None."""
        if self.covariance is None:
            return None
        return np.diagonal(self.covariance, axis1=1, axis2=2).real.reshape(self.values.shape)

    def frf(self, f_hz: np.ndarray) -> np.ndarray:
        """Frequency response (F, ny, nu) at f_hz inside the band, by straight lines in the complex plane between its values.

        Raises ExciteError outside the band: nothing is known there.
        """
        f = np.atleast_1d(np.asarray(f_hz, float))
        low, high = self.f_hz[[0, -1]]
        outside = (f < low * (1 - EDGE)) | (f > high * (1 + EDGE)) | np.isnan(f)
        if outside.any():
            raise ExciteError(
                f"{f[outside][0]:g} Hz lies outside the band of this frequency response, {low:g} to {high:g} Hz; "
                "ask inside the band"
            )
        right = np.clip(np.searchsorted(self.f_hz, f), 1, max(len(self) - 1, 1))
        if len(self) == 1:
            return np.repeat(self.values, len(f), axis=0)
        left, gap = right - 1, self.f_hz[right] - self.f_hz[right - 1]
        share = np.clip((f - self.f_hz[left]) / gap, 0.0, 1.0)[:, None, None]
        return (1 - share) * self.values[left] + share * self.values[right]

    def band(self, low_hz: float, high_hz: float) -> "FrequencyResponse":
        """Return the frequencies from low_hz to high_hz, both included."""
        keep = (self.f_hz >= low_hz) & (self.f_hz <= high_hz)
        if not keep.any():
            raise ExciteError(
                f"no frequency from {low_hz:g} to {high_hz:g} Hz; this response is known from {self.f_hz[0]:g} to "
                f"{self.f_hz[-1]:g} Hz"
            )
        more = {key: None if (m := getattr(self, key)) is None else m[keep] for key in ("covariance", "coherence")}
        return replace(self, f_hz=self.f_hz[keep], values=self.values[keep], **more)


def _covariance(value: ArrayLike | None, shape: tuple[int, int, int]) -> np.ndarray | None:
    """Return a covariance (F, m, m), from one or from variances (F, ny, nu)."""
    if value is None:
        return None
    place, (lines, ny, nu) = "FrequencyResponse.covariance", shape
    if np.shape(value) == shape and ny * nu > 1:
        variance = finite(value, shape, place).reshape(lines, ny * nu)
        value = variance[:, :, None] * np.eye(ny * nu)
    full = finite(value, (lines, ny * nu, ny * nu), place, complex)
    scale = np.abs(full).max(initial=0.0)
    if np.abs(full - full.conj().transpose(0, 2, 1)).max(initial=0.0) > 1e-9 * scale:
        raise ExciteError(f"{place}: not Hermitian; give E[dg dg^H] of the entries of G, row by row, or variances")
    if np.diagonal(full, axis1=1, axis2=2).real.min(initial=0.0) < -1e-12 * scale:
        raise ExciteError(f"{place}: negative variances; give E|dG|^2 per frequency")
    return read_only(full)
