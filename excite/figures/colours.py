"""Colours: of roles, which are the same in every figure, and of labels, which are the same in all figures of a run."""

from collections.abc import Iterable
from enum import Enum

# Okabe and Ito (2008) without black and yellow, continued with darker tones of Tol's "muted" scheme.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#999933", "#332288", "#117733")


class Role(Enum):
    """What a mark stands for, where that is more than a label; the value is its colour on white."""

    INK = "#222222"
    TRUTH = "#111111"
    MEASURED = "#b4b4b4"
    SIGNAL = PALETTE[0]
    BAND = "#eef3f7"
    LIMIT = "#b03a2e"
    AXIS = "#888888"
    NOTE = "#777777"
    GUIDE = "#d4d4d4"


def palette(labels: Iterable[str]) -> dict[str, str]:
    """Return one colour per label, the same whatever the order in which the labels come."""
    return {label: PALETTE[i % len(PALETTE)] for i, label in enumerate(sorted(set(labels)))}
