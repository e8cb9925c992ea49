"""What travels and the tables of files that excite writes: each type to a table and back, nothing lost."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import numpy as np

from excite.errors import ExciteError
from excite.files.table import Table, header
from excite.models.state_space import StateSpaceModel
from excite.plain import plain
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.level import Level
from excite.types.loop import Loop
from excite.types.origin import Origin
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal

VERSION = 2
ARRAYS = ("A", "B", "C", "D", "K", "innovation_cov", "input_offset", "output_offset")


def to_table(data: Signal | Experiment | Recording, certificate: Mapping | None = None) -> Table:
    """Return the table of a signal, an experiment or a recording; `certificate` rides along in the meta."""
    columns: list[tuple[np.ndarray | None, tuple[Channel, ...], str | list[str]]]
    meta: dict = {"excite": VERSION, "dt": data.dt, "period": data.period}
    if isinstance(data, Signal):
        meta |= {"kind": "signal", "recipe": None if data.recipe is None else data.recipe.to_dict()}
        columns = [(data.u, data.channels, "u")]
    elif isinstance(data, Experiment):
        meta |= {"kind": "experiment", "name": data.name, "loop": _loop(data.loop), "level": asdict(data.level)}
        columns = [(data.u, data.inputs, "u"), (data.y, data.outputs, "y"), (data.reference, data.references, "r")]
    else:
        views = {name: asdict(view) for name, view in data.views.items()}
        meta |= {"kind": "recording", "views": views, "default": data.default, "origin": data.origin.to_dict()}
        meta |= {"loop": _loop(data.loop), "level": asdict(data.level)}
        columns = [(data.values, data.channels, _default_roles(data))]
    if certificate is not None:
        meta["certificate"] = certificate
    names: list[str] = []
    blocks = [data.time_s]
    for block, channels, roles in columns:
        if block is not None:
            names += [header(role, c) for role, c in zip(_each(roles, channels), channels, strict=True)]
            blocks.append(block)
    values = np.column_stack(blocks)
    return Table(("time_s", *names), values, meta=plain(meta, "meta"))


def to_recording(table: Table) -> Recording:
    """Return the recording that a table of kind "recording" holds."""
    meta = table.meta
    with damaged(table.place):
        views = {name: _roles(held) for name, held in meta["views"].items()}
        channels = tuple(Channel.parse(name.partition(":")[2]) for name in table.names[1:])
        return Recording(
            table.values[:, 0],
            table.values[:, 1:],
            channels,
            dt=meta["dt"],
            views=views,
            default=meta["default"],
            period=meta["period"],
            loop=to_loop(meta["loop"]),
            origin=Origin.from_dict(meta["origin"]),
            level=to_level(meta["level"]),
        )


def to_loop(meta: Mapping) -> Loop:
    """Return the loop that the meta of a file describes."""
    model = meta["controller"]
    if model is not None:
        arrays: dict[str, Any] = {
            key: None if model[key] is None else np.array(model[key], dtype=np.float64) for key in ARRAYS
        }
        model = StateSpaceModel(**arrays, dt=model["dt"], inputs=model["inputs"], outputs=model["outputs"])
    return Loop(meta["state"], model, meta["sign"], meta["entry"])


def to_level(meta: Mapping) -> Level:
    """Return the level that the meta of a file states."""
    return Level(**meta)


@contextmanager
def damaged(place: str) -> Iterator[None]:
    """Turn what unexpected meta of a file of excite raises into an error that names the file."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ExciteError(f"{place}: its description is damaged ({reason}); write it again") from error
    except ExciteError as error:
        raise type(error)(f"{place}: {error}") from error


def _roles(held: Mapping[str, Any]) -> Roles:
    """Return roles from what `asdict` made of them and JSON kept, its lists as tuples."""
    values: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in held.items()}
    return Roles(**values)


def _loop(loop: Loop) -> dict:
    model = loop.controller
    described = None
    if model is not None:
        if not isinstance(model, StateSpaceModel):
            raise ExciteError(f"Loop.controller: a {type(model).__name__} cannot be written; give a StateSpaceModel")
        named = {role: [header(role[0], c)[2:] for c in getattr(model, role)] for role in ("inputs", "outputs")}
        described = {key: getattr(model, key) for key in ARRAYS} | named | {"dt": model.dt}
    return {"state": loop.state, "controller": described, "sign": loop.sign, "entry": loop.entry}


def _each(roles: str | list[str], channels: tuple[Channel, ...]) -> list[str]:
    return [roles] * len(channels) if isinstance(roles, str) else roles


def _default_roles(recording: Recording) -> list[str]:
    """Return the role of each channel in the default view, so that its experiment needs no flag in any format."""
    chosen = Roles((), ()) if recording.default is None else recording.views[recording.default]
    groups = {"u": chosen.inputs, "y": chosen.outputs, "r": chosen.reference} if chosen.every == 1 else {}
    return [next((role for role, names in groups.items() if c.name in names), "c") for c in recording.channels]
