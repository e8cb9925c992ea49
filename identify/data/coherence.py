"""Which outputs an experiment tells anything about: selection by coherence with what was played."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from excite.errors import ExciteError, did_you_mean
from excite.types.experiment import Experiment

SEGMENTS = 8  # pieces of the record, overlapping by half: pure noise then shows about 1/14 for each channel of z
POWERLESS = 1e-8  # below this fraction of its largest power in the band the instrument does not excite a frequency


def output_coherence(
    experiment: Experiment, band_hz: tuple[float, float], instrument: str | None = None
) -> dict[str, float]:
    """Return the mean magnitude-squared coherence of every output with the instrument z over a band.

    gamma^2(f) = S_zy^H S_zz^-1 S_zy / S_yy, the multiple coherence when z has several channels, by Welch's method over
    pieces of 1/8 of the record, or of a period where that is shorter. Frequencies at which z has no power, as between
    the lines of a multisine, are left out.

    band_hz : first and last frequency; instrument : "reference", "inputs", or None: the reference where one is recorded.
    """
    from scipy.signal import csd  # slow to import, and few runs need it

    z, dt = _instrument(experiment, instrument), experiment.dt
    if dt is None or np.isnan(experiment.y).any() or np.isnan(z).any():
        raise ExciteError("coherence needs uniform sampling without missing samples; resample, or take a gap-free part")
    low, high = band_hz
    if not 0 <= low < high <= 0.5 / dt:
        raise ExciteError(
            f"band_hz: {low:g} to {high:g} Hz; give 0 <= first < last <= {0.5 / dt:g} Hz, the Nyquist frequency"
        )
    length = min(len(experiment) // SEGMENTS, experiment.period or len(experiment))
    f_hz = np.fft.rfftfreq(max(length, 1), dt)
    band = np.flatnonzero((f_hz >= low) & (f_hz <= high))
    if len(band) == 0:
        raise ExciteError(
            f"band_hz: {low:g} to {high:g} Hz holds no frequency that the record resolves ({1 / (max(length, 1) * dt):g} Hz "
            "apart); widen the band or record longer"
        )

    def spectrum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return csd(a, b, nperseg=length, axis=0)[1][band]

    S_zz = spectrum(z[:, :, None], z[:, None, :])
    power = np.trace(S_zz, axis1=1, axis2=2).real
    excited = power > POWERLESS * power.max()
    inverse = np.linalg.pinv(S_zz[excited], rcond=POWERLESS, hermitian=True)
    y = experiment.y
    S_zy, S_yy = spectrum(z[:, :, None], y[:, None, :])[excited], spectrum(y, y)[excited].real
    explained = np.einsum("fiy,fij,fjy->fy", S_zy.conj(), inverse, S_zy).real
    gamma2 = np.divide(explained, S_yy, out=np.zeros_like(S_yy), where=S_yy > 0).mean(0)
    found = {channel.name: float(value) for channel, value in zip(experiment.outputs, gamma2, strict=True)}
    return found


def select_outputs(
    experiment: Experiment, band_hz: tuple[float, float], threshold: float = 2 / 3, instrument: str | None = None
) -> dict[str, float]:
    """Return the outputs whose mean coherence over the band is at least `threshold`, with that coherence.

    The rule by which Miller (2012), 6.2.1, keeps 8 or 49 of 94 signals (2/3 over 3 to 35 Hz).
    """
    if not 0 <= threshold <= 1:
        raise ExciteError(f"threshold: {threshold:g}; coherence lies between 0 and 1")
    found = output_coherence(experiment, band_hz, instrument)
    kept = {name: value for name, value in found.items() if value >= threshold}
    if not kept:
        best = max(found, key=lambda name: found[name])
        raise ExciteError(
            f"no output reaches a mean coherence of {threshold:.3g} from {band_hz[0]:g} to {band_hz[1]:g} Hz; the best is "
            f"'{best}' with {found[best]:.3g}: excite more, choose a band that is excited, or lower the threshold"
        )
    return kept


def with_outputs(experiment: Experiment, names: Iterable[str]) -> Experiment:
    """Return the experiment with the named outputs alone, in that order."""
    known, names = [c.name for c in experiment.outputs], list(names)
    for name in names:
        if name not in known:
            raise ExciteError(f"no output '{name}'; {did_you_mean(name, known)}")
    index = [known.index(name) for name in names]
    return replace(
        experiment,
        y=experiment.y[:, index],
        outputs=[experiment.outputs[i] for i in index],
        references=experiment.references or None,
    )


def _instrument(experiment: Experiment, instrument: str | None) -> np.ndarray:
    if instrument is None:
        instrument = "inputs" if experiment.reference is None else "reference"
    choices = {"reference": experiment.reference, "inputs": experiment.u if experiment.inputs else None}
    if instrument not in choices:
        raise ExciteError(f"instrument: {instrument!r}; {did_you_mean(instrument, choices)}")
    values = choices[instrument]
    if values is None:
        raise ExciteError(f"instrument: the experiment has no {instrument}; name its channels")
    return values
