"""How the channels of a maximum-length binary sequence are told apart: one class for each way, one line in APART."""

from abc import ABC, abstractmethod

import numpy as np

import excite.generators.lfsr as lfsr
from excite.generators.lfsr import TAPS
from excite.generators.parameters import Parameters

check = Parameters("prbs")


class Decorrelation(ABC):
    """One way; M = 2^n - 1 is the length of a sequence of order n.

    different : whether every channel has a sequence of its own; shifted : whether channels play one sequence multiples of
    `spacing` apart; modulated : whether chips are multiplied by the rows of a Hadamard matrix.
    """

    different = False
    shifted = False
    modulated = False

    def rows(self, count: int) -> int:
        """Return in how many sequences the channels' signs repeat, a power of two."""
        return 1 << (count - 1).bit_length() if self.modulated else 1

    def refusal(self, order: int, count: int) -> str | None:
        """Return why so many channels cannot be told apart, or None."""
        return None

    def tap_sets(self, order: int, count: int) -> list[tuple[int, ...]]:
        """Return the taps to play where none are given: one set for all channels, or one per channel."""
        return [TAPS[order]]

    def spacing(self, order: int, taps: tuple[int, ...], count: int) -> tuple[int, int | None]:
        """Return the length of the responses that separate, in chips, and the least lag of a product of two channels."""
        return 2**order - 1, None

    @abstractmethod
    def correlation(self, order: int, tap_sets: list[tuple[int, ...]], rows: np.ndarray) -> float | None:
        """Return the largest cross-correlation of two channels within that length, relative to 1; None when not known."""


class Shift(Decorrelation):
    """One sequence, multiples of one spacing apart."""

    shifted = True

    def refusal(self, order: int, count: int) -> str | None:
        """Refuse more channels than shifts."""
        most = 2**order - 1
        return f"order {order} has only {most} distinct shifts; raise the order" if count > most else None

    def spacing(self, order: int, taps: tuple[int, ...], count: int) -> tuple[int, int | None]:
        """Return the spacing that puts products of two channels farthest behind every channel."""
        return lfsr.spacing(order, taps, count)

    def correlation(self, order: int, tap_sets: list[tuple[int, ...]], rows: np.ndarray) -> float:
        """Return 1/M."""
        return 1.0 / (2**order - 1)


class Hadamard(Decorrelation):
    """One sequence, its chips multiplied by rows of a Hadamard matrix."""

    modulated = True

    def correlation(self, order: int, tap_sets: list[tuple[int, ...]], rows: np.ndarray) -> float:
        """Return the rows' own correlation, over M."""
        return lfsr.row_correlation(rows) / (2**order - 1)


class Sequences(Decorrelation):
    """A different primitive polynomial for every channel."""

    different = True

    def tap_sets(self, order: int, count: int) -> list[tuple[int, ...]]:
        """Return the sets of taps whose sequences correlate least."""
        if count == 1:
            return [TAPS[order]]
        if order > lfsr.MAX_PAIR_ORDER:
            most = lfsr.MAX_PAIR_ORDER
            remedy = f"different sequences are chosen up to order {most}; give taps, or use shift or hadamard"
            raise check.bad("order", order, remedy)
        if lfsr.polynomials(order) < count:
            remedy = f"order {order} has only {lfsr.polynomials(order)} primitive polynomials; raise the order"
            raise check.bad("channels", count, remedy)
        return list(lfsr.least_correlated(order, TAPS[order], count))

    def correlation(self, order: int, tap_sets: list[tuple[int, ...]], rows: np.ndarray) -> float | None:
        """Return the largest at any lag, where the sequences are short enough to compute it."""
        return None if order > lfsr.MAX_PAIR_ORDER else lfsr.cross_correlation(order, tap_sets)


APART: dict[str, Decorrelation] = {"shift": Shift(), "hadamard": Hadamard(), "sequences": Sequences()}
