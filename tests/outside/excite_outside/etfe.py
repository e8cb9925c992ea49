"""A frequency-response estimator: records in, a FrequencyResponse out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.signal import csd

from excite.models.frequency_response import FrequencyResponse
from excite.types.frozen import Frozen
from identify.data.records import Records
from identify.estimate import Estimate
from identify.method import Method


@dataclass(frozen=True)
class Etfe(Method):
    """Averaged empirical transfer function: spectra of windowed segments, G = S_yu S_uu^-1 (H1); it has no order."""

    name: ClassVar[str] = "etfe"
    summary: ClassVar[str] = "frequency response by averaged spectra (H1)"
    order_is: ClassVar[str | None] = None
    conformance_exceptions: ClassVar[Mapping[str, str]] = Frozen(
        check_converges="leakage of the window falls with longer segments, not with less noise",
        check_several_records="leakage is above 5 % in segments of 256 samples",
    )

    segment: int = field(default=256, metadata={"minimum": 4, "meaning": "samples per segment"})

    def unsupported(self, data: Records) -> str | None:
        """A record holds one segment at least."""
        short = min(map(len, data.measured))
        return f"segments of {self.segment} samples, and a record has {short}" if short < self.segment else None

    def realize(self, compressed: Records, order: None, data: Records) -> Estimate:
        """Return the frequency response."""

        def spectra(a: str, b: str) -> np.ndarray:
            """Cross spectra (F, channels of a, channels of b), E b(f) a(f)*, summed over the records."""
            each = (
                csd(getattr(r, b).T[None], getattr(r, a).T[:, None], fs=1 / data.dt, nperseg=self.segment)[1]
                for r in data.measured
            )
            return sum(each).transpose(2, 0, 1)

        G = np.linalg.solve(spectra("u", "u").transpose(0, 2, 1), spectra("y", "u").transpose(0, 2, 1))
        f_hz = np.fft.rfftfreq(self.segment, data.dt)
        model = FrequencyResponse(f_hz, G.transpose(0, 2, 1), data.dt, inputs=data.inputs, outputs=data.outputs)
        return Estimate(model, self.name, None)
