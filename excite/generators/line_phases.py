"""Phases and amplitudes of a multisine's lines, by a rule or by search for a small crest factor."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import excite.generators.allocation as allocation
import excite.generators.crest as crest
from excite.generators.allocation import Tones, check, floats
from excite.models.state_space import StateSpaceModel
from excite.plain import plain
from excite.types.channel import Channel


@dataclass(frozen=True, eq=False)
class Frame:
    """What does not depend on the lines.

    dt : s; size : samples of a period, N; periods : of every experiment; levels : amplitude of each channel; mixing : W
    (experiments, channels), by which each experiment multiplies each channel; zero_start, model : as asked for; seed.
    """

    dt: float
    size: int
    periods: int
    channels: tuple[Channel, ...]
    levels: list[float]
    mixing: np.ndarray
    zero_start: bool
    model: StateSpaceModel | None
    seed: int

    @cached_property
    def streams(self) -> list[np.random.SeedSequence]:
        """Random streams: of detection lines, allocation, the joint search, and of each channel."""
        return np.random.SeedSequence(self.seed).spawn(3 + len(self.channels))

    @property
    def rotations(self) -> np.ndarray:
        """Distinct factors (R, 1) up to the sign by which experiments multiply a channel."""
        angles = np.unique(np.round(np.angle(self.mixing) % np.pi, 9) % round(np.pi, 9))
        return np.exp(1j * angles)[:, None]

    def period_of(self, lines: np.ndarray, c: np.ndarray, channel: int) -> np.ndarray:
        """Return one period (E, N) of Re W[e, channel] sum_k c_k exp(2 pi j lines[k] n / N) in each experiment e."""
        mixed = c * self.mixing[:, channel : channel + 1]
        scale = np.abs(mixed).max()
        spectrum = np.zeros((len(mixed), self.size // 2 + 1), complex)
        spectrum[:, lines] = mixed / scale * (self.size / 2)
        return scale * np.fft.irfft(spectrum, self.size)


def design(frame: Frame, tones: Tones, phases: str | Sequence, effort: Mapping) -> dict:
    """Return lines, amplitudes and phases of every channel, with the method, the starts and the seconds it took.

    phases : a name in PHASES, or numbers in rad; effort : crest_target, starts and time_limit_s of the search.
    """
    optimal = isinstance(phases, str) and phases == "optimal"
    plays, table, seconds = _shares(frame, tones, optimal, effort)
    made = 0
    if optimal:
        table, made, took = _searched(frame, tones, plays, table, effort, seconds)
        seconds += took
    else:
        table = _by_rule(phases, tones, plays, frame.streams[3:])
    method = phases if isinstance(phases, str) else "given"
    decided = _scaled(frame, tones, plays, table)
    detection = tones.detection.tolist()
    return decided | {"method": method, "starts": made, "seconds": round(seconds, 3), "detection_lines": detection}


def _shares(frame: Frame, tones: Tones, optimal: bool, effort: Mapping) -> tuple[np.ndarray, np.ndarray | None, float]:
    """Return which channel plays which line (channels, F), phases (F,) to begin from, and the seconds that this took."""
    count = len(frame.channels)
    if len(frame.mixing) > 1:
        return np.ones((count, len(tones.lines)), bool), None, 0.0
    owner, table, seconds = tones.owner, None, 0.0
    if owner is None and optimal and count > 1:
        limit = effort["time_limit_s"]
        owner, table, seconds = allocation.allocate(
            tones.lines,
            tones.shape,
            count,
            seed=frame.streams[1],
            rounds=6 if effort["starts"] is None else int(np.clip(effort["starts"] // 8, 1, 6)),
            time_limit_s=None if limit is None else limit / 2,
            target=effort["crest_target"],
        )
    elif owner is None:
        owner = allocation.round_robin(len(tones.lines), count)
    return owner == np.arange(count)[:, None], table, seconds


def _searched(
    frame: Frame, tones: Tones, plays: np.ndarray, begun: np.ndarray | None, effort: Mapping, spent: float
) -> tuple[np.ndarray, int, float]:
    """Return phases (channels, F) of small crest factors, the starts made and the seconds taken.

    Together where channels share lines, or a model mixes them; else channel by channel.
    """
    count = len(plays)
    if frame.model is not None or len(frame.mixing) > 1 or count == 1:
        weights, limits = _rows(frame, tones, plays), _rest(effort, spent, 1)
        found = crest.optimise(tones.lines, weights, seed=frame.streams[2], initial=begun, **limits)
        return np.tile(found.phases, (count, 1)), found.starts, found.seconds
    table, made, seconds = np.zeros(plays.shape), 0, 0.0
    for c, mine in enumerate(plays):
        found = crest.optimise(
            tones.lines[mine],
            tones.shape[mine],
            seed=frame.streams[3 + c],
            initial=None if begun is None else begun[mine],
            **_rest(effort, spent + seconds, count - c),
        )
        table[c, mine], made, seconds = found.phases, made + found.starts, seconds + found.seconds
    return table, made, seconds


def _rows(frame: Frame, tones: Tones, plays: np.ndarray) -> np.ndarray:
    """Return the weights (R, F) of all waveforms that share phases: inputs, and the outputs of the model."""
    dense = plays * tones.shape
    dense = dense * (frame.levels / np.sqrt((dense**2).sum(1)) / max(frame.levels))[:, None]
    weights = tones.shape * frame.rotations if len(frame.mixing) > 1 else dense
    if frame.model is None:
        return weights
    response = frame.model.frf(tones.lines / (frame.size * frame.dt))
    outputs = np.einsum("kjc,ec,ck->ejk", response, frame.mixing, dense).reshape(-1, len(tones.lines))
    return np.concatenate([weights, outputs])


def _rest(effort: Mapping, seconds: float, sharing: int) -> dict:
    """Return the limits of one search: a share of what is left of the time."""
    limit = effort["time_limit_s"]
    left = None if limit is None else max(limit - seconds, 0.02 * limit) / sharing
    return {"starts": effort["starts"], "target": effort["crest_target"], "time_limit_s": left}


def _scaled(frame: Frame, tones: Tones, plays: np.ndarray, table: np.ndarray) -> dict:
    """Return lines, amplitudes and phases of every channel, such that its highest sample is its level."""
    lines, amplitudes, phases, peaks = [], [], [], []
    for c, mine in enumerate(plays):
        l, a, phi = tones.lines[mine], tones.shape[mine] / tones.shape[mine].max(), table[c, mine]
        phi = crest.zero_shift(l, a, phi) if frame.zero_start else phi
        peaks.append(np.abs(frame.period_of(l, a * np.exp(1j * phi), c)).max())
        lines.append(l)
        amplitudes.append(a)
        phases.append(phi)
    if len(frame.mixing) > 1:
        peaks = [max(peaks)] * len(plays)  # one factor for all channels keeps the condition number at 1
    amplitudes = [level / peak * a for level, peak, a in zip(frame.levels, peaks, amplitudes, strict=True)]
    return plain({"lines": lines, "line_amplitudes": amplitudes, "phases": phases})


def _by_rule(
    phases: str | Sequence, tones: Tones, plays: np.ndarray, streams: Sequence[np.random.SeedSequence]
) -> np.ndarray:
    """Return the phases (channels, F) of a rule, or those given."""
    if not isinstance(phases, str):
        return _explicit_phases(phases, plays)
    rule = RULES[check.choice("phases", phases, PHASES)]
    table = np.zeros(plays.shape)
    for c, mine in enumerate(plays):
        table[c, mine] = rule(tones.lines[mine], tones.shape[mine], streams[c])
    return table


def _explicit_phases(phases: Sequence, plays: np.ndarray) -> np.ndarray:
    table, counts = np.zeros(plays.shape), plays.sum(1).tolist()
    remedy = f"give one of {', '.join(PHASES)}, or numbers in rad"
    given = check.items("phases", phases, remedy)
    nested = isinstance(given[0], (Sequence, np.ndarray))
    given = [floats("phases", p, remedy) for p in (given if nested else [given])]
    if not nested and (plays.all() or len(plays) == 1):
        given = given * len(plays)
    if [p.shape for p in given] != [(n,) for n in counts]:
        got = ", ".join(str(p.size) for p in given)
        raise check.bad(
            "phases", f"{got} numbers", f"give one per line: {', '.join(map(str, counts))} for each channel"
        )
    for c, mine in enumerate(plays):
        table[c, mine] = given[c]
    return table


def _random(lines: np.ndarray, shape: np.ndarray, stream: np.random.SeedSequence) -> np.ndarray:
    return np.random.default_rng(stream).uniform(0, 2 * np.pi, len(lines))


# Name -> phases of one channel from its lines (F,), their relative amplitudes (F,) and a random stream.
RULES: dict[str, Callable[[np.ndarray, np.ndarray, np.random.SeedSequence], np.ndarray]] = {
    "schroeder": lambda lines, shape, stream: crest.schroeder(lines, shape),
    "newman": lambda lines, shape, stream: crest.newman(len(lines)),
    "random": _random,
}
PHASES = ("optimal", *RULES)
