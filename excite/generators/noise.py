"""Random signals: white and band-limited Gaussian, random binary, generalised binary and multilevel noise."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import ndtri

from excite.generators.parameters import Channels, Parameters
from excite.types.recipe import Recipe
from excite.types.signal import Signal

check = Parameters("noise")


def noise(
    *,
    form: str = "white",
    dt: float,
    duration_s: float,
    rms: float | Sequence[float] | None = None,
    amplitude: float | Sequence[float] | None = None,
    offset: float | Sequence[float] = 0.0,
    band_hz: Sequence[float] | None = None,
    hold: int | None = None,
    switch_probability: float | None = None,
    mean_hold_s: float | None = None,
    levels: int | None = None,
    periods: int | None = None,
    channels: Channels = 1,
    seed: int = 0,
) -> Signal:
    """Return a random signal, independent between the channels.

    - white: independent Gaussian samples.
    - band-limited: Gaussian; white noise whose DFT over one period is set to zero outside the band. The lines left are
      k / (period dt) with low <= f <= high; the one at 0 is never among them.
    - binary: +amplitude or -amplitude with equal probability, anew for every `hold` samples.
    - gbn: generalised binary noise: after every `hold` samples the sign changes with probability p, so a level lasts
      hold dt / p on average, and the autocorrelation of the chips is (1 - 2p)^|l|; p = 1/2 is binary noise, a small p
      puts the power at low frequencies.
    - multilevel: one of `levels` equally spaced levels from -amplitude to +amplitude, each equally likely, anew for every
      `hold` samples.

    Parameters
    ----------
    form : "white", "band-limited", "binary", "gbn" or "multilevel".
    dt : sampling time, s.
    duration_s : length, s.
    rms : standard deviation of white and band-limited noise, in the channels' units; one number, or one a channel;
        default 1. It belongs to the ensemble; a realisation's own rms is in the recipe.
    amplitude : peak of the other forms, likewise; default 1.
    offset : mean that is added, likewise.
    band_hz : [low, high] for "band-limited", Hz.
    hold : samples per decision, default 1; the last ones of a period may be fewer.
    switch_probability : p of "gbn", above 0, at most 1.
    mean_hold_s : mean time that a level of "gbn" lasts, s, instead of `switch_probability`.
    levels : number of levels of "multilevel", at least 2; default 3.
    periods : how many equal periods `duration_s` holds. None: the signal does not repeat; band-limited noise, whose lines
        make it periodic with its own length, then counts as one period.
    channels : their count, or their names with units.
    seed : whole number from 0. Each channel draws from a stream of its own, so a further channel leaves the others as
        they were; raw bits, whose stream NumPy keeps fixed.

    Returns
    -------
    Signal, with the recipe: the parameters above, and kind, realised_rms (about the offset), realised_peak, probability
    and expected_hold_s (of "gbn", else None), lines_hz (first and last line of "band-limited", else None), warnings.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.

    Sources
    -------
    Tulleken, Generalized binary noise test-signal concept for improved identification-experiment design, Automatica 26,
    1990; Ljung, System Identification, 1999, section 13.3.
    """
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    count = len(named)
    form = check.choice("form", form, FORMS)
    given = {
        "rms": rms,
        "amplitude": amplitude,
        "band_hz": band_hz,
        "hold": hold,
        "switch_probability": switch_probability,
        "mean_hold_s": mean_hold_s,
        "levels": levels,
    }
    play, used = FORMS[form]
    own = check.fill(form, used, given)
    samples = check.samples("duration_s", duration_s, dt)
    repeats = check.whole("periods", 1 if periods is None else periods)
    length = samples // repeats
    if length * repeats != samples or length == 0:
        remedy = f"{samples} samples are not {repeats} equal periods; play {max(length, 1) * repeats * dt:g} s"
        raise check.bad("periods", periods, remedy)
    check.bounded("duration_s", duration_s, samples, count, "shorten it, or give fewer channels")
    size = "rms" if "rms" in own else "amplitude"
    own[size] = check.amplitudes(size, own[size], count)
    offsets = check.offsets("offset", offset, count)

    u, decisions = np.empty((samples, count)), {"probability": None, "expected_hold_s": None, "lines_hz": None}
    chips = length
    if "hold" in own:
        own["hold"] = check.whole("hold", own["hold"])
        if own["hold"] > length:
            raise check.bad("hold", hold, f"a period has {length} samples; lower it, or play longer")
        chips = -(-length // own["hold"])
    realised = np.empty((2, count))
    for c, stream in enumerate(np.random.SeedSequence(seed).spawn(count)):
        wave, decided = play(_uniform(stream, chips), own, dt)
        wave = own[size][c] * np.repeat(wave, own.get("hold", 1))[:length]
        realised[:, c] = np.sqrt((wave**2).mean()), np.abs(wave).max()
        u[:, c] = offsets[c] + np.tile(wave, repeats)
        decisions |= decided
    period = length if periods is not None or form == "band-limited" else None
    constant = [str(named[c]) for c in np.flatnonzero((u == u[0]).all(axis=0))]
    recipe = Recipe.of(
        noise,
        form=form,
        dt=dt,
        duration_s=float(duration_s),
        **(dict.fromkeys(given) | own),
        offset=offsets,
        periods=periods,
        channels=[str(c) for c in named],
        seed=seed,
        **decisions,
        realised_rms=realised[0].tolist(),
        realised_peak=realised[1].tolist(),
        warnings=[f"{name} never changes in {duration_s:g} s; play longer" for name in constant],
    )
    return Signal(u, dt, named, period, recipe)


def _uniform(stream: np.random.SeedSequence, count: int) -> np.ndarray:
    """Return numbers (k + 1/2) / 2^52 inside (0, 1)."""
    return ((np.random.PCG64(stream).random_raw(count) >> np.uint64(12)) + 0.5) * 2.0**-52


def _white(draws: np.ndarray, own: dict, dt: float) -> tuple[np.ndarray, dict]:
    return ndtri(draws), {}


def _band_limited(draws: np.ndarray, own: dict, dt: float) -> tuple[np.ndarray, dict]:
    low, high = own["band_hz"] = _band(own["band_hz"], dt)
    f_hz = np.fft.rfftfreq(len(draws), dt)
    inside = (f_hz >= low * (1 - 1e-12)) & (f_hz <= high * (1 + 1e-12)) & (f_hz > 0)
    if not inside.any():
        spacing = f"the lines of {len(draws)} samples are {1 / (len(draws) * dt):g} Hz apart"
        raise check.bad("band_hz", [low, high], f"{spacing} and none lies inside; widen the band, or play longer")
    weights = np.where(f_hz < 0.5 / dt * (1 - 1e-12), 2, 1)[inside].sum()  # a line below Nyquist stands for two
    wave = np.fft.irfft(np.where(inside, np.fft.rfft(ndtri(draws)), 0.0), len(draws))
    return wave * np.sqrt(len(draws) / weights), {"lines_hz": [float(f_hz[inside][0]), float(f_hz[inside][-1])]}


def _band(band_hz: object, dt: float) -> list[float]:
    limits = check.items("band_hz", band_hz, "give [low, high] in Hz")
    if len(limits) != 2:
        raise check.bad("band_hz", band_hz, "give [low, high] in Hz")
    low = check.number("band_hz[0]", limits[0], "give a number of Hz, at least 0", least=0)
    high = check.frequency("band_hz[1]", limits[1], dt)
    if low > high:
        raise check.bad("band_hz", band_hz, "the band is empty; give the lower frequency first")
    return [low, high]


def _binary(draws: np.ndarray, own: dict, dt: float) -> tuple[np.ndarray, dict]:
    return np.where(draws < 0.5, -1.0, 1.0), {}


def _gbn(draws: np.ndarray, own: dict, dt: float) -> tuple[np.ndarray, dict]:
    chip_s = own["hold"] * dt
    p, mean_s = own["switch_probability"], own["mean_hold_s"]
    if (p is None) == (mean_s is None):
        raise check.bad("switch_probability", p, f"mean_hold_s is {mean_s!r}; give one of the two")
    if p is None:
        least = chip_s * (1 - 1e-12)
        p = min(1.0, chip_s / check.number("mean_hold_s", mean_s, f"give at least the {chip_s:g} s of one hold", least))
    p = check.number("switch_probability", p, "give a probability above 0, at most 1", above=0, most=1)
    switches = draws < p
    switches[0] = draws[0] < 0.5  # the first draw is the first sign
    return 1.0 - 2.0 * (np.cumsum(switches) & 1), {"probability": p, "expected_hold_s": chip_s / p}


def _multilevel(draws: np.ndarray, own: dict, dt: float) -> tuple[np.ndarray, dict]:
    count = own["levels"] = check.whole("levels", own["levels"], 2)
    return 2.0 * np.floor(draws * count) / (count - 1) - 1.0, {}


# form -> how to play it, from numbers in (0, 1); the parameters it uses with their defaults (...: required)
FORMS: dict[str, tuple[Callable, dict]] = {
    "white": (_white, {"rms": 1.0}),
    "band-limited": (_band_limited, {"rms": 1.0, "band_hz": ...}),
    "binary": (_binary, {"amplitude": 1.0, "hold": 1}),
    "gbn": (_gbn, {"amplitude": 1.0, "hold": 1, "switch_probability": None, "mean_hold_s": None}),
    "multilevel": (_multilevel, {"amplitude": 1.0, "hold": 1, "levels": 3}),
}
