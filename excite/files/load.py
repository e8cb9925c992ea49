"""Reading data files: tables, experiments, signals and recordings."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import readable
from excite.files.formats import by_extension
from excite.files.native import damaged, to_level, to_loop, to_recording
from excite.files.roles import Columns, channels, choose, marked, require, sampling
from excite.files.table import Table
from excite.types.experiment import Experiment
from excite.types.level import Level
from excite.types.loop import Loop
from excite.types.recipe import Recipe
from excite.types.recording import Recording
from excite.types.signal import Signal

State = TypeVar("State", Loop, Level)
Values = Sequence[float]


def read_table(path: str | os.PathLike) -> Table:
    """Return the columns of a file of any known format, before roles are chosen."""
    given = by_extension(readable(path))
    if given.read is None:
        raise ExciteError(f"{path}: this format is only written; load the signal it was made from")
    return given.read(Path(path))


def load_experiment(
    path: str | os.PathLike,
    inputs: Columns | None = None,
    outputs: Columns | None = None,
    reference: Columns | None = None,
    dt: float | None = None,
    time: str | int | None = None,
    view: str | None = None,
    loop: str | Loop | None = None,
    level: str | Level | tuple[Values, Values] | None = None,
) -> Experiment:
    """Return the experiment in a data file.

    Files of excite need nothing but the path; a recording gives its default view, or the `view` named. Elsewhere `inputs`,
    `outputs` and `reference` choose columns; without them, headers such as ``u:flap``, u, u1, y2 and r count. Chosen
    roles keep the period, the loop and the level that the file states.

    Parameters
    ----------
    path : file of a format that `excite.files.formats.FORMATS` reads.
    inputs, outputs, reference : columns by name or by number from 0. An empty list, or a file of excite without
        inputs, leaves outputs alone.
    dt : sampling time, s.
    time : the time column, in s; one called time_s, t_s, time or t is found.
    view : of a recording.
    loop : "open", "closed" or "unknown": whether the inputs depended on the outputs through feedback. What the file
        states counts where nothing is given; a file that states nothing counts as open.
    level : "zero", "unknown" or the pair (u0, y0): the operating point that the numbers are measured from. What the file
        states counts where nothing is given; a file that states nothing counts as zero.

    Raises
    ------
    ExciteError naming the file, the place in it, and the remedy; also where `loop` or `level` contradict the file.

    Notes
    -----
    NaN and empty fields are missing samples.

    Examples
    --------
    >>> load_experiment("dryer.dat", inputs=0, outputs=1, dt=0.08, loop="open", level="unknown")
    """
    table = read_table(path)
    given_loop = Loop(loop) if isinstance(loop, str) else loop
    given_level = None if level is None else Level.of(level)
    if table.meta.get("kind") == "recording" and all(v is None for v in (inputs, outputs, reference, dt, time)):
        recording = to_recording(table)
        with damaged(table.place):
            found = recording.experiment(view)
        said = _agreed(path, "loop", found.loop, given_loop), _agreed(path, "level", found.level, given_level)
        loop, level = said[0] or found.loop, said[1] or found.level
        return found if (loop, level) == (found.loop, found.level) else replace(found, loop=loop, level=level)
    if view is not None:
        raise ExciteError(f"{path}: view '{view}' needs a recording, without roles or dt given; drop it")
    u, y, r = choose(table, "u", inputs), choose(table, "y", outputs), choose(table, "r", reference)
    outputs_alone = not u and (inputs is not None or marked(table, "y"))
    require(table, None if outputs_alone else u, y)
    time_s, dt = sampling(table, dt, time, u + y + r)
    agreed_loop = _agreed(path, "loop", _stated(table, "loop", to_loop), given_loop)
    agreed_level = _agreed(path, "level", _stated(table, "level", to_level), given_level)
    with damaged(table.place):
        return Experiment(
            table.values[:, u],
            table.values[:, y],
            dt=dt,
            time_s=time_s,
            reference=table.values[:, r] if r else None,
            inputs=channels(table, u) if u else None,
            outputs=channels(table, y),
            references=channels(table, r) if r else None,
            period=table.meta.get("period"),
            loop=agreed_loop or Loop("open"),
            level=agreed_level or Level("zero"),
            name=table.meta.get("name") or Path(path).stem,
        )


def load_signal(
    path: str | os.PathLike, inputs: Columns | None = None, dt: float | None = None, time: str | int | None = None
) -> Signal:
    """Return the signal in a data file: its input columns, chosen as in `load_experiment`.

    Recipe and period come back from files of excite (from CSV, while the sidecar belongs to exactly this file).
    """
    table = read_table(path)
    u = choose(table, "u", inputs)
    require(table, u)
    time_s, dt = sampling(table, dt, time, u)
    if dt is None:
        times = np.asarray(time_s)
        span = f"{times[0]:g} to {times[-1]:g} s"
        raise ExciteError(f"{path}: its {len(times)} times from {span} are not uniform; resample it, or give dt")
    with damaged(table.place):
        recipe = table.meta.get("recipe") if inputs is None else None
        recipe = None if recipe is None else Recipe.from_dict(recipe)
        return Signal(table.values[:, u], dt, channels(table, u), table.meta.get("period"), recipe)


def load_recording(path: str | os.PathLike) -> Recording:
    """Return the recording that `save_recording` wrote."""
    table = read_table(path)
    if table.meta.get("kind") != "recording":
        raise ExciteError(f"{path}: is not a recording of excite; load it as an experiment, with roles")
    return to_recording(table)


def _stated(table: Table, key: str, read: Callable[[Mapping], State]) -> State | None:
    """Return what a file.s meta states of its loop or its level, None where it states nothing."""
    with damaged(table.place):
        return None if table.meta.get(key) is None else read(table.meta[key])


def _agreed(path: str | os.PathLike, word: str, stated: State | None, given: State | None) -> State | None:
    """Return what a file states or what is given, whichever says more; refuse a contradiction. None: nobody says."""
    if stated is None or given is None or given == stated:
        return given if stated is None else stated
    if stated.state == "unknown" or (stated.state == given.state and _bare(stated)):
        return given
    if stated.state == given.state and _bare(given):
        return stated
    raise ExciteError(
        f"{path}: {word} '{given.state}' is given, but the file says '{stated.state}'; drop your {word}, or choose the view "
        "or the columns that you mean"
    )


def _bare(state: Loop | Level) -> bool:
    """Whether nothing but the state is said: no controller, no known values."""
    return state.state != "known" and state == type(state)(state.state)
