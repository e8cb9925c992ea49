"""A closed-loop wrapper around any method."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from excite.numerics.simulate import fir
from excite.types.experiment import Experiment
from identify.data.records import Records
from identify.estimate import Estimate
from identify.fit import fit
from identify.method import Method, Need
from identify.prediction_error.arx import Arx


@dataclass(frozen=True)
class TwoStage(Method):
    """Two-stage method (Van den Hof and Schrama 1993): the input without its noise, from the reference, then any method.

    Of the input, what the past `taps` samples of the reference explain is kept; noise that the loop fed back is left out.
    """

    name: ClassVar[str] = "two_stage"
    summary: ClassVar[str] = "closed loop: any method on the part of the input that the reference explains"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    consistent_in_closed_loop: ClassVar[bool] = True

    inner: Method = field(default=Arx(), metadata={"meaning": "the method behind it"})
    taps: int = field(default=150, metadata={"meaning": "samples of the reference that explain the input"})

    def largest_order(self, data: Records) -> int:
        """That of the method behind."""
        return self.inner.largest_order(data)

    def compress(self, data: Records) -> tuple[Records, dict]:
        """Records with the explained input, as taken in open loop, and what the method behind will share."""
        return Records.of([self._explained(record) for record in data.measured]), {}

    def realize(self, compressed: tuple[Records, dict], order: int | None, data: Records) -> Estimate:
        """Return what the method behind finds."""
        records, shared = compressed
        return replace(fit(records, self.inner, order, shared=shared), method=self.name)

    def _explained(self, record: Experiment) -> Experiment:
        r = record.reference
        past = np.vstack([np.zeros((self.taps, r.shape[1])), r])
        X = np.hstack([past[self.taps - k : len(past) - k] for k in range(self.taps + 1)])
        h = np.linalg.lstsq(X, record.u)[0].reshape(self.taps + 1, r.shape[1], -1).transpose(0, 2, 1)
        return replace(record, u=fir(h, r), references=None, loop="open")
