"""A bootstrap around any method: its estimate, with the scatter of many."""

from dataclasses import dataclass, field, replace
from typing import ClassVar

from identify.data.records import Records
from identify.estimate import Estimate
from identify.fit import fit
from identify.method import Method
from identify.subspace.po_moesp import PoMoesp
from identify.uncertainty.replicates import bootstrap


@dataclass(frozen=True)
class Bootstrapped(Method):
    """Any method, whose uncertainty comes from a block bootstrap of its simulation residuals."""

    name: ClassVar[str] = "bootstrapped"
    summary: ClassVar[str] = "any method, with bootstrapped uncertainty"

    inner: Method = field(default=PoMoesp(), metadata={"meaning": "the method behind it"})
    replicates: int = field(default=20, metadata={"minimum": 10, "meaning": "models of the bootstrap"})

    def largest_order(self, data: Records) -> int:
        """That of the method behind."""
        return self.inner.largest_order(data)

    def unsupported(self, data: Records) -> str | None:
        """In closed loop, the noise moves the input too."""
        return "the loop is closed, and replaying residuals holds in open loop" if data.closed else None

    def realize(self, compressed: Records, order: int, data: Records) -> Estimate:
        """Return the estimate with its replicates."""
        found = bootstrap(fit(data, self.inner, order), data, self.replicates, method=self.inner)
        return replace(found, method=self.name)
