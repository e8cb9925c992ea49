"""The excitation of a scenario: one generator, or several parts one after the other."""

import inspect
from collections.abc import Mapping, Sequence
from typing import Any

from excite.errors import ExciteError, did_you_mean
from excite.generators import GENERATORS, in_sequence, rest
from excite.types.signal import Signal
from scenarios.scenario.toml_table import NUMBER, TomlTable, at_least

FIXED = ("channels", "seed")  # arguments of a generator that a run decides itself


def play(parts: Sequence[Mapping[str, Any]], channels: list[str] | int, seed: int) -> Signal:
    """Return the signal of one part, or of several one after the other with their rests."""
    signals = []
    for i, part in enumerate(parts):
        given = {k: v for k, v in part.items() if k not in ("kind", "rest_s")}
        signals.append(GENERATORS[part["kind"]](**given, channels=channels, seed=seed + i))
        if part["rest_s"]:
            signals.append(rest(dt=signals[-1].dt, duration_s=part["rest_s"], channels=channels))
    return signals[0] if len(signals) == 1 else in_sequence(signals)


def read_excitation(top: TomlTable) -> tuple[dict[str, Any], ...]:
    """Read [excitation], or the parts of [[excitation]], each of which may end with a rest of rest_s."""
    several = isinstance(top.values.get("excitation"), list)
    tables = top.tables("excitation") if several else [top.table("excitation")]
    if not tables:
        raise ExciteError(f"{top.place}excitation: is empty; give at least one part")
    return tuple(_part(table, several) for table in tables)


def _part(table: TomlTable, several: bool) -> dict[str, Any]:
    kind = table.take("kind", str)
    if kind not in GENERATORS:
        raise ExciteError(f"{table.place}kind: '{kind}'; {did_you_mean(kind, GENERATORS)}")
    rest_s = table.take("rest_s", NUMBER, 0.0, at_least(0)) if several else 0.0
    known = [p for p in inspect.signature(GENERATORS[kind]).parameters if p not in FIXED]
    for key in table.values:
        if key not in known:
            raise ExciteError(f"{table.place}{key}: unknown key for a {kind}; {did_you_mean(key, known)}")
    return {"kind": kind, **table.values, "rest_s": rest_s}
