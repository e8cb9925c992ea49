"""Scores as strict JSON (null, never NaN), and back."""

from collections.abc import Mapping
from typing import Any

from excite.plain import plain
from identify.score import Score


def score_to_dict(outcome: Score) -> dict[str, Any]:
    """Return a score as plain values."""
    return plain(
        {
            "values": outcome.values,
            "per_output": outcome.per_output,
            "reason": outcome.reason,
            "reasons": outcome.reasons,
        }
    )


def score_from_dict(data: Mapping[str, Any]) -> Score:
    """Rebuild a score; a value that is null is absent, and NaN among the values per output."""
    per_output = {
        name: tuple(float("nan") if value is None else value for value in each)
        for name, each in data["per_output"].items()
    }
    values = {name: value for name, value in data["values"].items() if value is not None}
    return Score(values, per_output, data["reason"], dict(data.get("reasons", {})))
