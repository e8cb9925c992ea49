"""Random signals: white and band-limited Gaussian, random binary, generalised binary and multilevel noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from excite.generators.parameters import Channels, Parameters
from excite.types.channel import Channel
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
    rms : standard deviation of white and band-limited noise, in the channels' units; one number, or one per channel;
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
    given = {
        "rms": rms,
        "amplitude": amplitude,
        "band_hz": band_hz,
        "hold": hold,
        "switch_probability": switch_probability,
        "mean_hold_s": mean_hold_s,
        "levels": levels,
    }
    plan = _checked(form, dt, duration_s, periods, channels, seed, offset, given)
    u, rms_played, peak_played = _play(plan)
    named = [str(c) for c in plan.channels]
    still = [name for name, column in zip(named, u.T, strict=True) if (column == column[0]).all()]
    recipe = Recipe.of(
        noise,
        form=form,
        dt=plan.dt,
        duration_s=float(duration_s),
        **(dict.fromkeys(given) | plan.own),
        offset=plan.offsets,
        periods=periods,
        channels=named,
        seed=plan.seed,
        **plan.decisions,
        realised_rms=rms_played.tolist(),
        realised_peak=peak_played.tolist(),
        warnings=[f"{name} never changes in {duration_s:g} s; play longer" for name in still],
    )
    periodic = periods is not None or form == "band-limited"
    return Signal(u, plan.dt, plan.channels, plan.length if periodic else None, recipe)


@dataclass(frozen=True)
class _Plan:
    """What is asked for, checked.

    length : samples of one period; repeats : periods played; own : the form's own parameters, with the defaults filled in;
    decisions : what followed from them.
    """

    form: str
    dt: float
    channels: tuple[Channel, ...]
    seed: int
    length: int
    repeats: int
    offsets: list[float]
    own: dict[str, Any]
    decisions: dict[str, Any]


def _checked(
    form: str,
    dt: float,
    duration_s: float,
    periods: int | None,
    channels: Channels,
    seed: int,
    offset: float | Sequence[float],
    given: Mapping,
) -> _Plan:
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    form = check.choice("form", form, FORMS)
    own = check.fill(form, FORMS[form].uses, given)
    samples = check.samples("duration_s", duration_s, dt)
    repeats = check.whole("periods", 1 if periods is None else periods)
    length = samples // repeats
    if length * repeats != samples or length == 0:
        remedy = f"{samples} samples are not {repeats} equal periods; play {max(length, 1) * repeats * dt:g} s"
        raise check.bad("periods", periods, remedy)
    check.bounded("duration_s", duration_s, samples, len(named), "shorten it, or give fewer channels")
    size = "rms" if "rms" in own else "amplitude"
    own[size] = check.amplitudes(size, own[size], len(named))
    offsets = check.offsets("offset", offset, len(named))
    if "hold" in own:
        own["hold"] = check.whole("hold", own["hold"])
        if own["hold"] > length:
            raise check.bad("hold", given["hold"], f"a period has {length} samples; lower it, or play longer")
    own, decisions = FORMS[form].settle(own, length, dt)
    return _Plan(form, dt, named, seed, length, repeats, offsets, own, NOTHING_DECIDED | decisions)


def _play(plan: _Plan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return u (N, channels), and rms and peak of each channel about its offset."""
    form, size = FORMS[plan.form], plan.own["rms" if "rms" in plan.own else "amplitude"]
    hold = plan.own.get("hold", 1)
    chips = -(-plan.length // hold)
    u = np.empty((plan.length * plan.repeats, len(plan.channels)))
    rms, peak = np.empty((2, len(plan.channels)))
    for c, stream in enumerate(np.random.SeedSequence(plan.seed).spawn(len(plan.channels))):
        wave = form.play(_uniform(stream, chips), plan.own | plan.decisions, plan.dt)
        wave = size[c] * np.repeat(wave, hold)[: plan.length]
        rms[c], peak[c] = np.sqrt((wave**2).mean()), np.abs(wave).max()
        u[:, c] = plan.offsets[c] + np.tile(wave, plan.repeats)
    return u, rms, peak


def _uniform(stream: np.random.SeedSequence, count: int) -> np.ndarray:
    """Return numbers (k + 1/2) / 2^52 inside (0, 1)."""
    return ((np.random.PCG64(stream).random_raw(count) >> np.uint64(12)) + 0.5) * 2.0**-52


def _gaussian(draws: np.ndarray, known: Mapping, dt: float) -> np.ndarray:
    return ndtri(draws)


def _in_band(draws: np.ndarray, known: Mapping, dt: float) -> np.ndarray:
    f_hz, inside = _lines(known["band_hz"], len(draws), dt)
    weights = np.where(f_hz < 0.5 / dt * (1 - 1e-12), 2, 1)[inside].sum()  # a line below Nyquist stands for two
    wave = np.fft.irfft(np.where(inside, np.fft.rfft(ndtri(draws)), 0.0), len(draws))
    return wave * np.sqrt(len(draws) / weights)


def _binary(draws: np.ndarray, known: Mapping, dt: float) -> np.ndarray:
    return np.where(draws < 0.5, -1.0, 1.0)


def _switching(draws: np.ndarray, known: Mapping, dt: float) -> np.ndarray:
    switches = draws < known["probability"]
    switches[0] = draws[0] < 0.5  # the first draw is the first sign
    return 1.0 - 2.0 * (np.cumsum(switches) & 1)


def _multilevel(draws: np.ndarray, known: Mapping, dt: float) -> np.ndarray:
    return 2.0 * np.floor(draws * known["levels"]) / (known["levels"] - 1) - 1.0


def _as_it_is(own: dict, length: int, dt: float) -> tuple[dict, dict]:
    return own, {}


def _band(own: dict, length: int, dt: float) -> tuple[dict, dict]:
    limits = check.items("band_hz", own["band_hz"], "give [low, high] in Hz")
    if len(limits) != 2:
        raise check.bad("band_hz", own["band_hz"], "give [low, high] in Hz")
    low = check.number("band_hz[0]", limits[0], "give a number of Hz, at least 0", least=0)
    high = check.frequency("band_hz[1]", limits[1], dt)
    if low > high:
        raise check.bad("band_hz", own["band_hz"], "the band is empty; give the lower frequency first")
    f_hz, inside = _lines([low, high], length, dt)
    if not inside.any():
        spacing = f"the lines of {length} samples are {1 / (length * dt):g} Hz apart"
        raise check.bad("band_hz", [low, high], f"{spacing} and none lies inside; widen the band, or play longer")
    return own | {"band_hz": [low, high]}, {"lines_hz": f_hz[inside][[0, -1]].tolist()}


def _lines(band_hz: Sequence[float], length: int, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the frequencies of a DFT over `length` samples, and which of them lie in the band, 0 never."""
    f_hz, (low, high) = np.fft.rfftfreq(length, dt), band_hz
    return f_hz, (f_hz >= low * (1 - 1e-12)) & (f_hz <= high * (1 + 1e-12)) & (f_hz > 0)


def _probability(own: dict, length: int, dt: float) -> tuple[dict, dict]:
    chip_s = own["hold"] * dt
    p, mean_s = own["switch_probability"], own["mean_hold_s"]
    if (p is None) == (mean_s is None):
        raise check.bad("switch_probability", p, f"mean_hold_s is {mean_s!r}; give one of the two")
    if p is None:
        least = chip_s * (1 - 1e-12)
        p = min(1.0, chip_s / check.number("mean_hold_s", mean_s, f"give at least the {chip_s:g} s of one hold", least))
    p = check.number("switch_probability", p, "give a probability above 0, at most 1", above=0, most=1)
    return own, {"probability": p, "expected_hold_s": chip_s / p}


def _level_count(own: dict, length: int, dt: float) -> tuple[dict, dict]:
    return own | {"levels": check.whole("levels", own["levels"], 2)}, {}


@dataclass(frozen=True)
class Form:
    """One form of noise: how it is played, which parameters it uses, and how they are checked.

    play(numbers in (0, 1), parameters and decisions, dt) -> wave of size 1; uses : parameter -> default (...: required);
    settle(own parameters, samples of a period, dt) -> the parameters checked, and the decisions that follow.
    """

    play: Callable[[np.ndarray, Mapping, float], np.ndarray]
    uses: Mapping[str, Any]
    settle: Callable[[dict, int, float], tuple[dict, dict]] = _as_it_is


FORMS: dict[str, Form] = {
    "white": Form(_gaussian, {"rms": 1.0}),
    "band-limited": Form(_in_band, {"rms": 1.0, "band_hz": ...}, _band),
    "binary": Form(_binary, {"amplitude": 1.0, "hold": 1}),
    "gbn": Form(
        _switching, {"amplitude": 1.0, "hold": 1, "switch_probability": None, "mean_hold_s": None}, _probability
    ),
    "multilevel": Form(_multilevel, {"amplitude": 1.0, "hold": 1, "levels": 3}, _level_count),
}
NOTHING_DECIDED = {"probability": None, "expected_hold_s": None, "lines_hz": None}
