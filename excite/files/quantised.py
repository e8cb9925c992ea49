"""Samples as whole numbers: what a converter of finite resolution plays, and the scale that gives the units back."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from excite.arguments import positive
from excite.errors import ExciteError
from excite.files.native import damaged
from excite.files.sidecar import read_sidecar
from excite.files.table import Table
from excite.types.signal import Signal


def encoded(u: np.ndarray, top: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the codes (N, nu), whole numbers in -top ... top, and the full scale (nu,) that code `top` stands for.

    The full scale is each channel's largest magnitude (1 for a channel that is zero), so zero is code 0 and the peak is
    exact: value = code / top * full_scale, evaluated in this order.
    """
    peak = np.abs(u).max(0)
    full_scale = np.where(peak > 0, peak, 1.0)
    return np.rint(u / full_scale * top).astype(np.int32), full_scale


def decoded(codes: np.ndarray, full_scale: np.ndarray, top: int) -> np.ndarray:
    """Return the values (N, nu) that codes stand for."""
    return codes / top * full_scale


def quantised(signal: Signal, top: int) -> Signal:
    """Return the signal that codes of -top ... top play: off by at most half a step of full_scale / top.

    Quantising twice changes nothing: the codes and the full scale of the result are those it was made from.
    """
    return replace(signal, u=decoded(*encoded(signal.u, top), top))


def codes_of(table: Table, top: int) -> tuple[np.ndarray, dict]:
    """Return the codes (N, nu) of a signal's table, and what its sidecar must say to decode them."""
    codes, full_scale = encoded(table.group("u"), top)
    return codes, {"full_scale": full_scale.tolist(), "top": top}


def decoded_table(codes: np.ndarray, top: int, path: Path, raw: bytes, known: dict | None = None) -> Table:
    """Return the table of a file of codes (N, nu), with the names, units, scale and dt of its sidecar or of its header.

    `known` is what the file itself says: dt in s, columns, full_scale. Where nobody knows the scale, +-1 is full scale.
    """
    meta = {"full_scale": [1.0] * codes.shape[1], "columns": None, "dt": None} | (known or {}) | read_sidecar(path, raw)
    with damaged(str(path)):
        names, dt = meta.pop("columns"), meta["dt"]
        full_scale = np.array(meta["full_scale"], dtype=np.float64)
        if full_scale.shape != (codes.shape[1],) or not (np.isfinite(full_scale) & (full_scale > 0)).all():
            raise ExciteError(
                f"full_scale {meta['full_scale']}; one positive number for each of {codes.shape[1]} channels"
            )
        names = ["time_s", *(f"u:u{i + 1}" for i in range(codes.shape[1]))] if names is None else [*map(str, names)]
        if len(names) != codes.shape[1] + 1:
            raise ExciteError(f"its {codes.shape[1]} channels do not fit the columns {names}")
        values = decoded(codes, full_scale, top)
        if dt is None:
            return Table(tuple(names[1:]), values, str(path), meta)
        return Table(
            tuple(names), np.column_stack([np.arange(len(codes)) * positive(dt, "dt"), values]), str(path), meta
        )
