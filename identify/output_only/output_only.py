"""What the output-only methods have in common: data without inputs, and a model of noise alone."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.numerics.kalman import kalman_gain
from excite.types.experiment import Experiment
from identify.data.records import Kind, Records
from identify.estimate import Estimate
from identify.state_space_method import StateSpaceMethod
from identify.steps.completion import Inputs, Noise, complete
from identify.steps.kalman import spectral_radius


@dataclass(frozen=True)
class OutputOnlyMethod(StateSpaceMethod[Records]):
    """A method for outputs alone, whose excitation is white noise that nobody measured.

    Past and future should each span half a period of the slowest mode (Reynders and De Roeck 2008).
    """

    takes: ClassVar[frozenset[Kind]] = frozenset({Kind.OUTPUTS})
    asymptotic: ClassVar[bool] = True

    block_rows: int = field(
        default=20,
        metadata={"meaning": "r, rows of past and of future each; at least half a period of the slowest mode"},
    )

    def span(self, order: int | None) -> int:
        """2 r + 1, past and future and the shift."""
        return 2 * self.block_rows + 1

    def largest_order(self, data: Records) -> int:
        """(r - 1) ny: one block row is lost to the shift."""
        return (self.block_rows - 1) * len(data.outputs)

    def completed(
        self,
        parts: tuple[Experiment, ...],
        A: np.ndarray,
        C: np.ndarray,
        covariances: tuple[np.ndarray, np.ndarray, np.ndarray],
        notes: tuple[str, ...],
        **found: Any,
    ) -> Estimate:
        """Return the estimate; covariances : Q, R, S of the noise in x+ = A x + w, y = C x + v."""
        noise, more = noise_part(A, C, *covariances)
        silent = Inputs(np.empty((len(A), 0)), np.empty((len(C), 0)))
        return complete(
            self.name,
            parts,
            A,
            C,
            noise=noise,
            inputs=silent,
            predictor=noise is not None,
            warnings=(*notes, *more),
            **found,
        )


def noise_part(
    A: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray
) -> tuple[Noise | None, tuple[str, ...]]:
    """Return the steady Kalman gain and innovation covariance of the noise, and warnings.

    Without a positive definite innovation covariance and a stable A - K C (then the covariances of the estimate are
    those of no process: they are not positive real) the model has no K.
    """
    try:
        K, cov = kalman_gain(A, C, Q, R, S)
        if spectral_radius(A - K @ C) >= 1 or la.eigvalsh(cov)[0] <= 0:
            raise ExciteError("the innovations' covariance is not positive definite")
    except (ExciteError, la.LinAlgError) as error:
        return None, (
            f"no Kalman gain: the estimated output covariances are not positive real ({error}); A and C stand",
        )
    return Noise(K, cov), ()
