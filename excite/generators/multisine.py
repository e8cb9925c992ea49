"""Multisines: sums of sines on chosen lines, with a small crest factor and several orthogonal inputs."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from excite.generators import allocation, crest
from excite.generators.allocation import ORTHOGONAL, SPACINGS, check, floats
from excite.generators.parameters import Channels
from excite.models.state_space import StateSpaceModel
from excite.types.recipe import Recipe
from excite.types.signal import Signal

PHASES = ("optimal", "schroeder", "newman", "random")


def multisine(
    *,
    dt: float,
    period_s: float,
    band_hz: Sequence[float] | None = None,
    spacing: str = "full",
    count: int | None = None,
    lines: Sequence | None = None,
    spectrum: Callable[[np.ndarray], np.ndarray] | Sequence | None = None,
    amplitude: float | Sequence[float] = 1.0,
    phases: str | Sequence = "optimal",
    channels: Channels = 1,
    orthogonal: str = "interleaved",
    periods: int = 1,
    zero_start: bool = False,
    model: StateSpaceModel | Mapping | None = None,
    crest_target: float | None = None,
    starts: int | None = None,
    time_limit_s: float | None = None,
    seed: int = 0,
    decided: Mapping | None = None,
) -> Signal:
    """Return a multisine, periodic with N = period_s / dt samples:

        u_c(t) = sum_k a_ck cos(2 pi l_k t / period_s + phi_ck),   l_k whole numbers below N / 2.

    The lines are exact: one period has the amplitudes a_ck to rounding and nothing elsewhere. `amplitude` is a peak, as in
    `prbs`: the lines of a channel are scaled so that its largest sample equals it; between the samples the reconstructed
    waveform stays below the recipe's `peak_bound`.

    Several channels are orthogonal by one of

    - interleaved: every line belongs to one channel; all channels play at once for `periods` periods. With optimal phases
      the allocation of lines to channels is optimised as well.
    - dft, hadamard: all channels play all lines, in E experiments one after the other, `periods` periods each; in
      experiment e channel c is multiplied by W[e, c] = exp(2 pi j e c / E), E = channels, or by the signs of the Hadamard
      matrix of the next power of two. At every line the matrix of inputs (channels in units of their amplitude, by
      experiments) has the condition number 1; to that end one factor scales all channels, and the highest peak of any
      reaches the amplitude. Play at least two periods: the first of each experiment is transient.

    Parameters
    ----------
    dt : sampling time, s.
    period_s : length of a period, s, a whole number of samples; lines lie at multiples of 1 / period_s.
    band_hz : lowest and highest frequency, Hz, the ends included.
    spacing : which lines of the band: "full" (all), "odd", "odd-odd" (1, 5, 9, …), "odd-random" (odd, one in every group of
        four left out at random for detection of nonlinear distortion), or "log" (`count` logarithmically spaced lines,
        rounded to distinct whole numbers).
    count : lines of the "log" spacing, default ten a decade; lines that round to the same number count once.
    lines : line numbers, increasing, instead of `band_hz`; or one such list a channel for an interleaved allocation.
    spectrum : relative amplitudes of the lines: one number a line (in order of frequency), a function of f_hz (F,), or
        breakpoints ``[(f_hz, amplitude), …]``, linear between them and constant beyond. None: equal amplitudes.
    amplitude : peak of the played samples in the channels' units; one number, or one a channel.
    phases : "optimal" (smallest crest factor), "schroeder", "newman" or "random", or given in rad: one number a line, or
        one list a channel.
    channels : their count, or their names with units.
    periods : whole periods to play, of every experiment.
    zero_start : move the waveform in time so that the first sample is zero; being periodic, it is back at zero one sample
        after the last, where rest may follow. The continuous crest factor is unchanged.
    model : discrete state-space model (or its A, B, C, D in a mapping) from the channels to outputs whose crest factors,
        in periodic steady state, are reported, and with optimal phases minimised jointly with those of the inputs.
    crest_target : stop the search when all crest factors meet it. When they do not, the best is returned with a warning.
    starts, time_limit_s : effort of the search, by number of starts or by wall-clock seconds (for each channel and for
        all together). Default: as many starts as take about a second. Only a search that the time limit ended may
        differ from run to run; the recipe reproduces its result all the same.
    seed : whole number from 0; detection lines, random phases and the search draw from it.
    decided : the entry of that name in a recipe; plays those lines, amplitudes and phases without designing again.

    Returns
    -------
    Signal with u (E periods N, channels) and period N (E periods N for several experiments). The recipe holds the
    parameters; `decided`: lines, line_amplitudes, phases (one list a channel), detection_lines, method, starts, seconds;
    period_samples; experiments; for each channel crest_factor (on 16 points per period of the highest line),
    crest_factor_bound and peak_bound (over continuous time), relative_peak_factor (max - min) / (2 sqrt(2) rms) and
    chirp_likeness (1: one sweep through the band; about 1/sqrt(F): noise-like); for each output output_crest_factor;
    warnings. It is JSON, and `regenerate(recipe)` returns the same bits however long the search ran.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.

    Sources
    -------
    Schroeder, IEEE Trans. IT 16, 1970; van der Ouderaa, Schoukens and Renneboog, IEEE Trans. IM 37, 1988; Guillaume et al.,
    IEEE Trans. IM 40, 1991 (the 2p-norm, joint input-output); Pintelon and Schoukens, System Identification, 2012,
    sections 2.7 and 5.2 (orthogonal multisines); Morelli, J. Aircraft 49, 2012 (interleaved lines, relative peak factor).
    """
    dt = check.seconds("dt", dt)
    size = _whole_period(period_s, dt)
    periods, seed = check.whole("periods", periods), check.seed(seed)
    names = check.channels(channels)
    levels = check.amplitudes("amplitude", amplitude, len(names))
    check.choice("spacing", spacing, SPACINGS)
    check.choice("orthogonal", orthogonal, ORTHOGONAL)
    check.flag("zero_start", zero_start)
    starts = None if starts is None else check.whole("starts", starts)
    time_limit_s = None if time_limit_s is None else check.seconds("time_limit_s", time_limit_s)
    if crest_target is not None:
        check.number("crest_target", crest_target, "give peak over rms, at least 1; 1.4 suits many lines", least=1)
    mixing = allocation.mixing_matrix(orthogonal, len(names))
    remedy = "shorten the period, or play fewer periods or channels"
    check.bounded("period_s", period_s, size * periods * len(mixing), len(names), remedy)
    model = _model(model, dt, len(names))
    real = np.isreal(mixing).all()
    if zero_start and (not real or (model is not None and len(names) > 1)):
        reason = (
            "channels of 'dft' are not in phase" if not real else "shifts of several inputs change the model's outputs"
        )
        raise check.bad(
            "zero_start", zero_start, f"{reason}; use one channel, or 'hadamard' or 'interleaved' without a model"
        )

    streams = np.random.SeedSequence(seed).spawn(3 + len(names))
    if lines is None:
        (union, detection), owner = allocation.chosen_lines(band_hz, spacing, count, dt, size, streams[0]), None
    else:
        union, owner = allocation.given_lines(lines, band_hz, spacing, count, size, len(names), orthogonal)
        detection = np.empty(0, int)
    if orthogonal == "interleaved" and len(union) < len(names):
        raise check.bad(
            "channels", len(names), f"only {len(union)} lines to share; widen the band or lengthen the period"
        )
    shape = allocation.line_shape(spectrum, union / (size * dt))
    response = None if model is None else model.frf(union / (size * dt))
    if decided is None:
        search = {"starts": starts, "time_limit_s": time_limit_s, "target": crest_target}
        decided = _design(union, owner, shape, levels, phases, mixing, response, search, streams[1:], zero_start, size)
        decided["detection_lines"] = detection.tolist()
    numbers, amplitudes, angles = _checked(decided, len(names), size)

    u = np.empty((len(mixing), periods, size, len(names)))
    for c, (l, a, phi) in enumerate(zip(numbers, amplitudes, angles, strict=True)):
        u[..., c] = _period_of(l, a * np.exp(1j * phi) * mixing[:, c : c + 1], size)[:, None, :]
    u = np.clip(u.reshape(-1, len(names)), -np.array(levels), levels)  # rounding must not exceed the level by a bit

    report = _report(numbers, amplitudes, angles, mixing, model, size, dt)
    values = {
        "dt": dt,
        "period_s": float(period_s),
        "band_hz": band_hz,
        "spacing": spacing,
        "count": count,
        "lines": lines,
        "spectrum": None if spectrum is None else shape.tolist(),
        "amplitude": levels,
        "phases": phases,
        "channels": [str(c) for c in names],
        "orthogonal": orthogonal,
        "periods": periods,
        "zero_start": bool(zero_start),
        "model": None if model is None else {k: getattr(model, k).tolist() for k in "ABCD"},
        "crest_target": crest_target,
        "starts": starts,
        "time_limit_s": time_limit_s,
        "seed": seed,
        "decided": decided,
        "period_samples": size,
        "experiments": len(mixing),
        **report,
    }
    recipe = Recipe.of(
        multisine, _warnings(decided, report, crest_target, len(mixing), periods, count), **_plain(values)
    )
    return Signal(u, dt, names, size * (periods * len(mixing) if len(mixing) > 1 else 1), recipe)


def _design(
    lines: np.ndarray,
    owner: np.ndarray | None,
    shape: np.ndarray,
    levels: list[float],
    phases: str | Sequence,
    mixing: np.ndarray,
    response: np.ndarray | None,
    search: Mapping,
    streams: list,
    zero_start: bool,
    size: int,
) -> dict:
    """Return lines, amplitudes and phases of every channel, with the method, the starts and the seconds it took."""
    count, shared = len(levels), len(mixing) > 1
    optimal = isinstance(phases, str) and phases == "optimal"
    made, seconds, table = 0, 0.0, None
    if shared:
        plays = np.ones((count, len(lines)), bool)
    else:
        if owner is None and optimal and count > 1:
            limit, target = search["time_limit_s"], search["target"]
            half = None if limit is None else limit / 2
            rounds = 6 if search["starts"] is None else int(np.clip(search["starts"] // 8, 1, 6))
            owner, table, seconds = allocation.allocate(
                lines, shape, count, seed=streams[0], rounds=rounds, time_limit_s=half, target=target
            )
        elif owner is None:
            owner = allocation.round_robin(len(lines), count)
        plays = owner == np.arange(count)[:, None]

    if not optimal:
        table = _given_phases(phases, lines, shape, plays, streams[2:])
    elif response is not None or shared or count == 1:
        dense = plays * shape
        dense = dense * (levels / np.sqrt((dense**2).sum(1)) / max(levels))[:, None]
        weights = shape * _distinct_rotations(mixing) if shared else dense
        if response is not None:
            outputs = np.einsum("kjc,ec,ck->ejk", response, mixing, dense).reshape(-1, len(lines))
            weights = np.concatenate([weights, outputs])
        found = crest.optimise(lines, weights, seed=streams[1], initial=table, **_rest(search, seconds, 1))
        table, made, seconds = np.tile(found.phases, (count, 1)), found.starts, seconds + found.seconds
    else:
        begun, table = table, np.zeros(plays.shape)
        for c, mine in enumerate(plays):
            initial = None if begun is None else begun[mine]
            limits = _rest(search, seconds, count - c)
            found = crest.optimise(lines[mine], shape[mine], seed=streams[2 + c], initial=initial, **limits)
            table[c, mine], made, seconds = found.phases, made + found.starts, seconds + found.seconds

    decided, peaks = {"lines": [], "line_amplitudes": [], "phases": []}, []
    for c, mine in enumerate(plays):
        l, a, phi = lines[mine], shape[mine] / shape[mine].max(), table[c, mine]
        phi = crest.zero_shift(l, a, phi) if zero_start else phi
        peaks.append(np.abs(_period_of(l, a * np.exp(1j * phi) * mixing[:, c : c + 1], size)).max())
        for key, values in (("lines", l), ("line_amplitudes", a), ("phases", phi)):
            decided[key].append(values)
    if shared:
        peaks = [max(peaks)] * count  # one factor for all channels keeps the condition number at 1
    decided["line_amplitudes"] = [levels[c] / peaks[c] * a for c, a in enumerate(decided["line_amplitudes"])]
    decided = _plain(decided)
    method = phases if isinstance(phases, str) else "given"
    return decided | {"method": method, "starts": made, "seconds": round(seconds, 3)}


def _rest(search: Mapping, seconds: float, sharing: int) -> dict:
    """The search limits with this channel's share of what is left of the time."""
    limit = search["time_limit_s"]
    return {**search, "time_limit_s": None if limit is None else max(limit - seconds, 0.02 * limit) / sharing}


def _distinct_rotations(mixing: np.ndarray) -> np.ndarray:
    """Distinct factors (R, 1) up to the sign by which experiments multiply a channel: one row each."""
    angles = np.unique(np.round(np.angle(mixing) % np.pi, 9) % round(np.pi, 9))
    return np.exp(1j * angles)[:, None]


def _given_phases(
    phases: str | Sequence, lines: np.ndarray, shape: np.ndarray, plays: np.ndarray, streams: list
) -> np.ndarray:
    """Return the phases (channels, F) of a rule, or those given."""
    table = np.zeros(plays.shape)
    if not isinstance(phases, str):
        return _explicit_phases(phases, plays)
    check.choice("phases", phases, PHASES)
    for c, mine in enumerate(plays):
        if phases == "random":
            table[c, mine] = np.random.default_rng(streams[c]).uniform(0, 2 * np.pi, mine.sum())
        else:
            schroeder = phases == "schroeder"
            table[c, mine] = crest.schroeder(lines[mine], shape[mine]) if schroeder else crest.newman(mine.sum())
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
        raise check.bad("phases", f"{got} numbers", f"give one a line: {', '.join(map(str, counts))} for each channel")
    for c, mine in enumerate(plays):
        table[c, mine] = given[c]
    return table


def _period_of(lines: np.ndarray, c: np.ndarray, size: int) -> np.ndarray:
    """One period (E, N) of Re sum_k c[:, k] exp(2 pi j lines[k] n / N)."""
    scale = np.abs(c).max()
    spectrum = np.zeros((len(c), size // 2 + 1), complex)
    spectrum[:, lines] = c / scale * (size / 2)
    return scale * np.fft.irfft(spectrum, size)


def _report(
    lines: list, amplitudes: list, phases: list, mixing: np.ndarray, model: StateSpaceModel | None, size: int, dt: float
) -> dict:
    """Return the figures of every channel, the worst of its experiments, and of every output of the model."""
    keys = ("crest_factor", "crest_factor_bound", "peak_bound", "relative_peak_factor", "chirp_likeness")
    report = {key: [] for key in (*keys, "output_crest_factor")}
    turns = _distinct_rotations(mixing)
    for l, a, phi in zip(lines, amplitudes, phases, strict=True):
        bound = max(crest.crest_bound(l, a * turn, phi)[0] for turn in turns)
        figures = (
            crest.crest_factor(l, a * turns, phi).max(),
            bound,
            bound * a.max() * np.sqrt(((a / a.max()) ** 2).sum() / 2),
            crest.relative_peak_factor(l, a * turns, phi).max(),
            crest.chirp_likeness(l, a, phi),
        )
        for key, value in zip(keys, figures, strict=True):
            report[key].append(None if value is None else float(value))
    if model is not None:
        union = np.unique(np.concatenate(lines))
        dense = np.zeros((len(lines), len(union)), complex)
        for c, (l, a, phi) in enumerate(zip(lines, amplitudes, phases, strict=True)):
            dense[c, np.searchsorted(union, l)] = a * np.exp(1j * phi)
        outputs = np.einsum("kjc,ec,ck->jek", model.frf(union / (size * dt)), mixing, dense)
        report["output_crest_factor"] = [
            float(crest.crest_factor(union, y, np.zeros(len(union))).max()) for y in outputs
        ]
    return report


def _warnings(
    decided: Mapping, report: Mapping, target: float | None, experiments: int, periods: int, count: int | None
) -> list[str]:
    warnings = []
    worst = max(report["crest_factor"] + report["output_crest_factor"])
    if target is not None and worst > target:
        effort = f"{decided['starts']} starts and {decided['seconds']:g} s"
        remedy = "allow more starts or time, or play more lines" if decided["starts"] else "use phases = 'optimal'"
        warnings.append(
            f"crest factor {worst:.4f} misses the target {target:g} after {effort}, the best found; {remedy}"
        )
    if experiments > 1 and periods == 1:
        warnings.append(
            "each experiment plays one period, which holds the transient from the one before; play two or more"
        )
    played = len(set().union(*decided["lines"]))
    if count is not None and played < count:
        warnings.append(f"{count} lines were asked for, {played} remain after rounding; lengthen the period")
    return warnings


def _checked(decided: object, channels: int, size: int) -> tuple[list, list, list]:
    """Return lines, amplitudes and phases, one array a channel."""
    keys = ("lines", "line_amplitudes", "phases")
    remedy = "pass the entry 'decided' of a recipe unchanged, or leave it out"
    if not isinstance(decided, Mapping) or not {*keys, "starts", "seconds"} <= decided.keys():
        raise check.bad("decided", type(decided).__name__, remedy)
    if any(not isinstance(decided[key], Sequence) or len(decided[key]) != channels for key in keys):
        raise check.bad("decided", f"not {channels} channels", remedy)
    lines, amplitudes, phases = ([floats("decided", part, remedy) for part in decided[key]] for key in keys)
    for l, a, phi in zip(lines, amplitudes, phases, strict=True):
        fits = l.ndim == 1 and l.shape == a.shape == phi.shape and len(l) and (np.diff(l) > 0).all()
        if not fits or l[0] < 1 or l[-1] >= size / 2 or (l % 1).any():
            raise check.bad("decided", "lines that do not fit the period, or lists of different lengths", remedy)
    return [l.astype(int) for l in lines], amplitudes, phases


def _whole_period(period_s: object, dt: float) -> int:
    ratio = check.seconds("period_s", period_s) / dt
    if not 2.5 < ratio < 2**53:
        raise check.bad("period_s", period_s, f"it must hold at least 3 samples of dt = {dt:g} s")
    size = round(ratio)
    if abs(ratio - size) > 1e-6 * max(1.0, size * 1e-3):
        near = f"{np.floor(ratio) * dt:.12g} s and {np.ceil(ratio) * dt:.12g} s"
        raise check.bad(
            "period_s", period_s, f"{ratio:.9g} samples of dt = {dt:g} s; the nearest whole periods are {near}"
        )
    return size


def _model(model: object, dt: float, channels: int) -> StateSpaceModel | None:
    """Return the model, checked to have a periodic steady state at this sampling time."""
    if model is None:
        return None
    if isinstance(model, Mapping):
        if set(model) != set("ABCD"):
            raise check.bad("model", sorted(model), "give the matrices A, B, C and D, or a StateSpaceModel")
        model = StateSpaceModel(**model, dt=dt)
    if not isinstance(model, StateSpaceModel):
        raise check.bad("model", type(model).__name__, "give a StateSpaceModel, or A, B, C and D in a mapping")
    if abs(model.dt / dt - 1) > 1e-9:
        raise check.bad("model", f"dt {model.dt:g} s", f"the signal is sampled every {dt:g} s; resample the model")
    if len(model.inputs) != channels:
        raise check.bad("model", f"{len(model.inputs)} inputs", f"the signal has {channels} channels; they must agree")
    poles = np.abs(model.poles())
    if poles.size and poles.max() >= 1:
        raise check.bad(
            "model", f"pole of modulus {poles.max():.6g}", "it has no periodic steady state; close the loop first"
        )
    return model


def _plain(value: object) -> object:
    """Lists, numbers and text for JSON instead of arrays, tuples and NumPy scalars."""
    if isinstance(value, Mapping):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
