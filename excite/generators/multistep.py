"""Steps, pulses, doublets, 3-2-1-1 and staircases, and when to sample a step response."""

from collections.abc import Sequence

import numpy as np

from excite.generators.compose import in_turn
from excite.generators.parameters import Channels, Parameters
from excite.types.recipe import Recipe
from excite.types.signal import Signal

# form -> level of each unit of time, as a fraction of the amplitude; a staircase is made from its number of steps
UNITS: dict[str, tuple[int, ...]] = {
    "step": (1,),
    "pulse": (1,),
    "doublet": (1, -1),
    "3-2-1-1": (1, 1, 1, -1, -1, 1, -1),
    "staircase": (),
}
REPEATING = {"lead_s": None, "rest_s": None, "repeats": 1, "alternate": False}

check = Parameters("multistep")


def multistep(
    *,
    form: str = "doublet",
    dt: float,
    unit_s: float,
    lead_s: float | None = None,
    rest_s: float | None = None,
    steps: int | None = None,
    repeats: int | None = None,
    alternate: bool | None = None,
    amplitude: float | Sequence[float] = 1.0,
    offset: float | Sequence[float] = 0.0,
    channels: Channels = 1,
    seed: int = 0,
) -> Signal:
    """Return a sequence of constant levels; several channels are played one after the other.

    - step: +1 for one unit, to the end.
    - pulse: +1 for one unit, then rest.
    - doublet: +1, -1, one unit each, then rest; its mean is zero.
    - 3-2-1-1: +1 for three units, -1 for two, +1 for one, -1 for one, then rest.
    - staircase: up to +1 in `steps` equal steps and down again, one unit per level, then rest.

    Levels are fractions of the amplitude, about the offset. The spectrum of a doublet peaks near 0.37 / unit_s; a 3-2-1-1
    is the wider of the two.

    Parameters
    ----------
    form : "step", "pulse", "doublet", "3-2-1-1" or "staircase".
    dt : sampling time, s.
    unit_s : unit of time, s, rounded to whole samples (`unit_samples`).
    lead_s : rest before the first level, s, 0 for none; default one unit.
    rest_s : rest after each repetition, s, 0 for none; default one unit. Not for "step".
    steps : steps of a "staircase" from 0 to the amplitude; default 4.
    repeats : how often pattern and rest are played; default 1. Not for "step".
    alternate : whether every second repetition has the opposite sign; default false. Not for "step".
    amplitude : not zero; negative begins downwards; one number, or one per channel, in the channels' units.
    offset : level at rest, likewise.
    channels : their count, or their names with units. Each plays the whole, lead included, while the others rest.
    seed : taken for uniformity; the signal is deterministic.

    Returns
    -------
    Signal, with the recipe: the parameters above, and kind, unit_samples, starts (first sample of each channel's turn),
    edges (every sample at which a level changes), warnings.

    Raises
    ------
    ExciteError naming the parameter, its value and the remedy.

    Sources
    -------
    Jategaonkar, Flight Vehicle System Identification, 2006, chapter 2 (multistep inputs).
    """
    dt = check.seconds("dt", dt)
    seed = check.seed(seed)
    named = check.channels(channels)
    form = check.choice("form", form, UNITS)
    given = {"lead_s": lead_s, "rest_s": rest_s, "repeats": repeats, "alternate": alternate, "steps": steps}
    used = {"lead_s": None} if form == "step" else REPEATING
    own = check.fill(form, used | ({"steps": 4} if form == "staircase" else {}), given)
    unit = check.samples("unit_s", unit_s, dt)
    waits = {name: unit_s if own[name] is None else own[name] for name in ("lead_s", "rest_s") if name in own}
    pauses = {name: check.pause(name, seconds, dt) for name, seconds in waits.items()}
    own |= {name: float(seconds) for name, seconds in waits.items()}
    lead, pause = pauses["lead_s"], pauses.get("rest_s", 0)
    pattern = np.array(UNITS[form], dtype=float)
    if form == "staircase":
        stairs = check.whole("steps", own["steps"])
        check.bounded("steps", stairs, 2 * stairs * unit, len(named), "give fewer")
        pattern = np.append(np.arange(1, stairs + 1), np.arange(stairs - 1, 0, -1)) / stairs
    times = check.whole("repeats", own.get("repeats", 1))
    swap = check.flag("alternate", own.get("alternate", False))
    samples = lead + times * (len(pattern) * unit + pause)
    check.bounded("unit_s", unit_s, samples * len(named), len(named), "shorten the times, or repeat less")
    levels = check.nonzero("amplitude", amplitude, len(named))
    offsets = check.offsets("offset", offset, len(named))

    once = np.concatenate([np.repeat(pattern, unit), np.zeros(pause)])
    signs = np.where(np.arange(times) % 2, -1.0 if swap else 1.0, 1.0)
    wave = np.concatenate([np.zeros(lead), np.outer(signs, once).ravel()])
    u = in_turn(wave, levels, offsets)
    recipe = Recipe.of(
        multistep,
        form=form,
        dt=dt,
        unit_s=float(unit_s),
        **(dict.fromkeys(given) | own),
        amplitude=levels,
        offset=offsets,
        channels=[str(c) for c in named],
        seed=seed,
        unit_samples=unit,
        starts=[c * samples for c in range(len(named))],
        edges=(np.flatnonzero((np.diff(u, axis=0) != 0).any(axis=1)) + 1).tolist(),
        warnings=[],
    )
    return Signal(u, dt, named, None, recipe)


def log_times(*, first_s: float, last_s: float, per_decade: int, dt: float) -> np.ndarray:
    """Return when to sample a step response: times evenly spaced on a logarithmic scale, each on the sample grid, once.

    first_s, last_s : s, both included (rounded to the grid, the first at least dt); per_decade : times per factor of ten;
    dt : s. Returns (n,) increasing multiples of dt. Where the grid is coarser than the spacing, fewer remain: one each dt.

    A thermal impedance spans many decades of time, and its time-constant spectrum lives on the logarithmic axis
    (JEDEC JESD51-14, 2010).
    """
    own = Parameters("log_times")
    dt = own.seconds("dt", dt)
    per_decade = own.whole("per_decade", per_decade)
    first, last = own.samples("first_s", first_s, dt), own.samples("last_s", last_s, dt)
    if first >= last:
        raise own.bad("last_s", last_s, f"it must lie behind first_s = {first_s:g} s by a sample; raise it")
    count = int(np.ceil(np.log10(last / first) * per_decade - 1e-9)) + 1
    own.bounded("per_decade", per_decade, count, 1, "give fewer")
    return np.unique(np.rint(np.geomspace(first, last, max(count, 2))).astype(np.int64)) * dt
