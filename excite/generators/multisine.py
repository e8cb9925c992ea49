"""Multisines: sums of sines on chosen lines, with a small crest factor and several orthogonal inputs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from excite.arguments import same_dt
from excite.generators.allocation import ORTHOGONAL, check, chosen_tones, floats
from excite.generators.line_phases import Frame, design
from excite.generators.line_report import figures, warnings_of
from excite.generators.parameters import Channels
from excite.models.state_space import StateSpaceModel
from excite.plain import plain
from excite.types.recipe import Recipe
from excite.types.signal import Signal


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
    count : lines of the "log" spacing, default ten per decade; lines that round to the same number count once.
    lines : line numbers, increasing, instead of `band_hz`; or one such list per channel for an interleaved allocation.
    spectrum : relative amplitudes of the lines: one number per line (in order of frequency), a function of f_hz (F,), or
        breakpoints ``[(f_hz, amplitude), …]``, linear between them and constant beyond. None: equal amplitudes.
    amplitude : peak of the played samples in the channels' units; one number, or one per channel.
    phases : "optimal" (smallest crest factor), "schroeder", "newman" or "random", or given in rad: one number per line, or
        one list per channel.
    channels : their count, or their names with units.
    orthogonal : "interleaved", "dft" or "hadamard", how several channels are told apart.
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
    parameters; `decided`: lines, line_amplitudes, phases (one list per channel), detection_lines, method, starts, seconds;
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
    frame = _frame(dt, period_s, periods, channels, amplitude, orthogonal, zero_start, model, seed)
    wanted: dict[str, Any] = {"band_hz": band_hz, "spacing": spacing, "count": count, "lines": lines}
    tones = chosen_tones(frame.dt, frame.size, len(frame.channels), orthogonal, frame.streams[0], spectrum, **wanted)
    effort = {"crest_target": crest_target, **_effort(crest_target, starts, time_limit_s)}
    if decided is None:
        decided = design(frame, tones, phases, effort)
    played = _checked(decided, len(frame.channels), frame.size)
    report = figures(*played, frame)
    values = {
        "dt": frame.dt,
        "period_s": float(period_s),
        **wanted,
        "spectrum": None if spectrum is None else tones.shape.tolist(),
        "amplitude": frame.levels,
        "phases": phases,
        "channels": [str(c) for c in frame.channels],
        "orthogonal": orthogonal,
        "periods": frame.periods,
        "zero_start": frame.zero_start,
        "model": None if frame.model is None else {k: getattr(frame.model, k).tolist() for k in "ABCD"},
        **effort,
        "seed": frame.seed,
        "decided": decided,
        "period_samples": frame.size,
        "experiments": len(frame.mixing),
        **report,
    }
    warnings = warnings_of(decided, report, frame, crest_target, count)
    recipe = Recipe.of(multisine, warnings, **plain(values, finite=False))
    experiments = len(frame.mixing)
    period = frame.size * (frame.periods * experiments if experiments > 1 else 1)
    return Signal(_play(frame, *played), frame.dt, frame.channels, period, recipe)


def _frame(
    dt: float,
    period_s: float,
    periods: int,
    channels: Channels,
    amplitude: float | Sequence[float],
    orthogonal: str,
    zero_start: bool,
    model: StateSpaceModel | Mapping | None,
    seed: int,
) -> Frame:
    """Return what does not depend on the lines, checked."""
    dt = check.seconds("dt", dt)
    size = _whole_period(period_s, dt)
    periods, seed = check.whole("periods", periods), check.seed(seed)
    names = check.channels(channels)
    levels = check.amplitudes("amplitude", amplitude, len(names))
    mixing = ORTHOGONAL[check.choice("orthogonal", orthogonal, ORTHOGONAL)](len(names))
    zero_start = check.flag("zero_start", zero_start)
    remedy = "shorten the period, or play fewer periods or channels"
    check.bounded("period_s", period_s, size * periods * len(mixing), len(names), remedy)
    model = _model(model, dt, len(names))
    real = np.isreal(mixing).all()
    if zero_start and (not real or (model is not None and len(names) > 1)):
        reason = "shifts of several inputs change the model's outputs" if real else "channels of 'dft' are not in phase"
        remedy = f"{reason}; use one channel, or 'hadamard' or 'interleaved' without a model"
        raise check.bad("zero_start", zero_start, remedy)
    return Frame(dt, size, periods, names, levels, mixing, zero_start, model, seed)


def _effort(crest_target: float | None, starts: int | None, time_limit_s: float | None) -> dict:
    """Return the limits of the search for phases, checked."""
    if crest_target is not None:
        check.number("crest_target", crest_target, "give peak over rms, at least 1; 1.4 suits many lines", least=1)
    return {
        "starts": None if starts is None else check.whole("starts", starts),
        "time_limit_s": None if time_limit_s is None else check.seconds("time_limit_s", time_limit_s),
    }


def _play(frame: Frame, lines: list[np.ndarray], amplitudes: list[np.ndarray], phases: list[np.ndarray]) -> np.ndarray:
    """Return u (E periods N, channels) of lines, amplitudes and phases, one array per channel."""
    u = np.empty((len(frame.mixing), frame.periods, frame.size, len(lines)))
    for c, (l, a, phi) in enumerate(zip(lines, amplitudes, phases, strict=True)):
        u[..., c] = frame.period_of(l, a * np.exp(1j * phi), c)[:, None, :]
    levels = np.array(frame.levels)
    return np.clip(u.reshape(-1, len(lines)), -levels, levels)  # rounding must not exceed the level by a bit


def _checked(decided: object, channels: int, size: int) -> tuple[list, list, list]:
    """Return lines, amplitudes and phases, one array per channel."""
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
    if not same_dt(model.dt, dt):
        raise check.bad("model", f"dt {model.dt:g} s", f"the signal is sampled every {dt:g} s; resample the model")
    if len(model.inputs) != channels:
        raise check.bad("model", f"{len(model.inputs)} inputs", f"the signal has {channels} channels; they must agree")
    poles = np.abs(model.poles())
    if poles.size and poles.max() >= 1:
        raise check.bad(
            "model", f"pole of modulus {poles.max():.6g}", "it has no periodic steady state; close the loop first"
        )
    return model
