"""Which lines a multisine plays, and how several inputs share them so that they stay orthogonal."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.linalg import hadamard

from excite.generators.crest import POLISH_GRID, crest_factor, l2p
from excite.generators.parameters import Parameters

check = Parameters("multisine")

DETECTION_GROUP = 4  # one odd line in every four neighbours is left out to detect odd nonlinear distortion
PER_DECADE = 10
CANDIDATES = 16


def floats(name: str, value: object, remedy: str) -> np.ndarray:
    """Return a finite real array, or refuse it with the remedy."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise check.bad(name, value, remedy) from None
    if array.dtype.kind not in "fiu" or not array.size:
        raise check.bad(name, value, remedy)
    if not np.isfinite(array).all():
        raise check.bad(name, float(array[~np.isfinite(array)][0]), "every number must be finite")
    return array.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Tones:
    """Which lines are played: lines (F,) in multiples of 1 / (N dt), their relative amplitudes shape (F,).

    owner : (F,) channel of each where the lines were given so, else None; detection : odd lines that were left out.
    """

    lines: np.ndarray
    shape: np.ndarray
    owner: np.ndarray | None
    detection: np.ndarray


def chosen_tones(
    dt: float,
    size: int,
    channels: int,
    orthogonal: str,
    stream: np.random.SeedSequence,
    spectrum: Callable | Sequence | None,
    *,
    band_hz: Sequence[float] | None,
    spacing: str,
    count: int | None,
    lines: Sequence | None,
) -> Tones:
    """Return the lines of a band, or those given, with their relative amplitudes."""
    check.choice("spacing", spacing, SPACINGS)
    if lines is None:
        (found, detection), owner = chosen_lines(band_hz, spacing, count, dt, size, stream), None
    else:
        found, owner = given_lines(lines, band_hz, spacing, count, size, channels, orthogonal)
        detection = np.empty(0, int)
    if orthogonal == "interleaved" and len(found) < channels:
        remedy = f"only {len(found)} lines to share; widen the band or lengthen the period"
        raise check.bad("channels", channels, remedy)
    return Tones(found, line_shape(spectrum, found / (size * dt)), owner, detection)


def chosen_lines(
    band_hz: Sequence[float] | None,
    spacing: str,
    count: int | None,
    dt: float,
    size: int,
    stream: np.random.SeedSequence,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lines (F,) of a band, in multiples of 1 / (N dt), and the odd detection lines left out."""
    if band_hz is None:
        raise check.bad("band_hz", None, "give the lowest and highest frequency in Hz, or the line numbers in `lines`")
    remedy = "give the lowest and the highest frequency in Hz, in that order"
    band = floats("band_hz", band_hz, remedy)
    if band.shape != (2,) or not 0 <= band[0] <= band[1]:
        raise check.bad("band_hz", band_hz, remedy)
    nyquist = 0.5 / dt
    if band[1] >= nyquist:
        remedy = f"{band[1]:g} Hz is not below the Nyquist frequency {nyquist:g} Hz; lower it or dt"
        raise check.bad("band_hz", band_hz, remedy)
    if count is not None and spacing != "log":
        raise check.bad("count", count, "only the spacing 'log' takes a count of lines; leave it out")
    period = size * dt
    low, high = max(1, int(np.ceil(band[0] * period - 1e-6))), int(np.floor(band[1] * period + 1e-6))
    inside = np.arange(low, min(high, (size - 1) // 2) + 1)
    lines, detection = SPACINGS[spacing](inside, count, stream) if len(inside) else (inside, inside)
    if not len(lines):
        remedy = f"no {spacing} line, a multiple of {1 / period:g} Hz, lies in it; widen it or lengthen the period"
        raise check.bad("band_hz", band_hz, remedy)
    return lines, detection


def _every(step: int, first: int = 0) -> "Spacing":
    """Return the spacing that keeps the lines first, first + step, … of all numbers."""

    def keep(lines: np.ndarray, count: object, stream: object) -> tuple[np.ndarray, np.ndarray]:
        return lines[lines % step == first], lines[:0]

    return keep


def _odd_random(lines: np.ndarray, count: object, stream: np.random.SeedSequence) -> tuple[np.ndarray, np.ndarray]:
    lines = lines[lines % 2 == 1]
    groups = len(lines) // DETECTION_GROUP
    left_out = np.random.default_rng(stream).integers(DETECTION_GROUP, size=groups)
    left_out += DETECTION_GROUP * np.arange(groups)
    return np.delete(lines, left_out), lines[left_out]


def _log(lines: np.ndarray, count: int | None, stream: object) -> tuple[np.ndarray, np.ndarray]:
    low, high = lines[[0, -1]]
    count = round(PER_DECADE * np.log10(high / low)) + 1 if count is None else check.whole("count", count)
    return np.unique(np.round(np.geomspace(low, high, count)).astype(int)), lines[:0]


# Name -> from the lines of the band (F,), `count` and a random stream: those played, and the detection lines left out.
Spacing = Callable[[np.ndarray, int | None, np.random.SeedSequence], tuple[np.ndarray, np.ndarray]]
SPACINGS: dict[str, Spacing] = {
    "full": _every(1),
    "odd": _every(2, 1),
    "odd-odd": _every(4, 1),
    "odd-random": _odd_random,
    "log": _log,
}


def given_lines(
    lines: Sequence, band_hz: object, spacing: str, count: object, size: int, channels: int, orthogonal: str
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the given lines (F,) and, for one list per channel, the owner of each."""
    if band_hz is not None or spacing != "full" or count is not None:
        raise check.bad("lines", lines, "they replace band_hz, spacing and count; give one or the other")
    remedy = "give increasing whole numbers from 1, or one such list per channel"
    parts = check.items("lines", lines, remedy)
    nested = isinstance(parts[0], (Sequence, np.ndarray))
    parts = [floats("lines", part, remedy) for part in (parts if nested else [parts])]
    for part in parts:
        if part.ndim != 1 or (part % 1).any() or (np.diff(part) <= 0).any() or part[0] < 1:
            raise check.bad("lines", lines, remedy)
        if part[-1] >= size / 2:
            remedy = f"it is not below the Nyquist line {size / 2:g} of a period of {size} samples; lower it, or dt"
            raise check.bad("lines", int(part[-1]), remedy)
    if not nested:
        return parts[0].astype(int), None
    if len(parts) != channels or orthogonal != "interleaved":
        raise check.bad("lines", lines, f"one list per channel needs {channels} lists and orthogonal = 'interleaved'")
    union = np.concatenate(parts).astype(int)
    if len(np.unique(union)) < len(union):
        raise check.bad("lines", lines, "channels that share a line are not orthogonal; give each line to one channel")
    order = union.argsort()
    return union[order], np.repeat(np.arange(channels), [len(part) for part in parts])[order]


def line_shape(spectrum: Callable | Sequence | None, f_hz: np.ndarray) -> np.ndarray:
    """Return the relative amplitudes (F,), the largest 1."""
    if spectrum is None:
        return np.ones(len(f_hz))
    remedy = "give a positive number per line, a function of f_hz, or breakpoints [(f_hz, amplitude), …]"
    values = floats("spectrum", spectrum(f_hz) if callable(spectrum) else spectrum, remedy)
    if values.ndim == 2 and values.shape[1:] == (2,) and len(values):
        if (np.diff(values[:, 0]) <= 0).any():
            raise check.bad("spectrum", spectrum, "the frequencies of the breakpoints must increase")
        values = np.interp(f_hz, *values.T)
    if values.shape != f_hz.shape:
        raise check.bad("spectrum", f"shape {values.shape}", f"{len(f_hz)} lines are played; {remedy}")
    if not (values > 1e-9 * values.max()).all():
        raise check.bad(
            "spectrum", values.min(), "every amplitude must be positive and above 1e-9 of the largest; drop the line"
        )
    return values / values.max()


def _together(channels: int) -> np.ndarray:
    return np.ones((1, channels))


def _dft(channels: int) -> np.ndarray:
    turns = np.outer(np.arange(channels), np.arange(channels)) % channels / channels
    W = np.exp(2j * np.pi * turns)
    return W.real if channels <= 2 else W


def _hadamard(channels: int) -> np.ndarray:
    return hadamard(1 << (channels - 1).bit_length())[:, :channels].astype(float)


# Name -> W (experiments, channels) for a number of channels, with orthogonal columns of equal length.
ORTHOGONAL: dict[str, Callable[[int], np.ndarray]] = {"interleaved": _together, "dft": _dft, "hadamard": _hadamard}


def round_robin(count: int, channels: int) -> np.ndarray:
    """Return the owner (F,) of every line when neighbours go to the channels in turn."""
    return np.arange(count) % channels


def by_divisor(lines: np.ndarray, channels: int) -> np.ndarray:
    """Return owners (F,) with like divisors together: the multiples of `channels` first, then odd before even lines.

    Such sets repeat, up to the sign, within a fraction of the period, so that fewer peaks have to be held down. Two
    channels get the odd and the even lines; three get 3k, the other odd and the other even lines.
    """
    owner = np.empty(len(lines), int)
    order = np.lexsort((lines, lines % 2 == 0, lines % channels != 0 if channels > 2 else lines < 0))
    for channel, part in enumerate(np.array_split(order, channels)):
        owner[part] = channel
    return owner


def allocate(
    lines: np.ndarray,
    amplitudes: np.ndarray,
    channels: int,
    *,
    seed: int | np.random.SeedSequence = 0,
    rounds: int = 6,
    time_limit_s: float | None = None,
    target: float | None = None,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return owner (F,), phases (F,) and the seconds taken; the largest crest factor of all channels is small.

    Which line goes to which channel matters more than the phases: lines 2, 5, 8, … lie off the multiples of their
    spacing, repeat rotated by 120 degrees every third of the period, and no phases make all rotations flat. The search
    evolves up to CANDIDATES allocations with their phases: the phases of all channels are optimised as one problem with one
    row per channel, the best quarter survives, and copies of it in which near lines have changed places replace the rest,
    so that every channel keeps covering the band. It begins from `round_robin` and `by_divisor`.
    Deterministic for a seed unless the time limit ends it.
    """
    entered = perf_counter()
    deadline = entered + (np.inf if time_limit_s is None else time_limit_s)
    rng, count = np.random.default_rng(seed), len(lines)
    size = int(np.clip(4000 // (count * channels), 2, CANDIDATES))
    kept = max(1, size // 4)
    starts = np.stack([round_robin(count, channels), by_divisor(lines, channels)])
    owners = starts[np.arange(size) % 2]
    phases = rng.uniform(0, 2 * np.pi, owners.shape)
    values, made, took = np.full(size, np.inf), 0, 0.0
    fresh = np.arange(size)
    while True:
        began = perf_counter()
        weights = rows(owners[fresh], amplitudes, channels)
        phases[fresh] = l2p(lines, weights, phases[fresh], skip=2 if made else 0, deadline=deadline)
        values[fresh] = crest_factor(lines, weights, phases[fresh], POLISH_GRID).max(1)
        order = values.argsort(kind="stable")
        owners, phases, values = owners[order], phases[order], values[order]
        made, took = made + 1, perf_counter() - began
        if made >= rounds or perf_counter() + took > deadline or (target is not None and values[0] <= target):
            return owners[0], phases[0], perf_counter() - entered
        fresh = np.arange(kept, size)
        for child, parent in zip(fresh, rng.integers(kept, size=len(fresh)), strict=True):
            owners[child] = _swapped(rng, owners[parent], channels)
            moved = owners[child] != owners[parent]
            sigma = np.where(moved, np.pi, rng.uniform(0.2, 1.2))
            phases[child] = phases[parent] + sigma * rng.standard_normal(count)


def rows(owners: np.ndarray, amplitudes: np.ndarray, channels: int) -> np.ndarray:
    """Return weights (…, channels, F): the amplitude where the channel owns the line, else 0."""
    return np.where(owners[..., None, :] == np.arange(channels)[:, None], amplitudes, 0.0)


def _swapped(rng: np.random.Generator, owner: np.ndarray, channels: int) -> np.ndarray:
    """A copy in which none to two pairs of lines, at most 2 channels apart in the list, have changed places."""
    owner = owner.copy()
    for _ in range(rng.integers(3)):
        i = rng.integers(len(owner))
        j = np.clip(i + rng.integers(-2 * channels, 2 * channels + 1), 0, len(owner) - 1)
        owner[[i, j]] = owner[[j, i]]
    return owner
