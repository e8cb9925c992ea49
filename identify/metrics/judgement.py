"""What metrics look at: a case, which is the same for all models, and one model's judgement in it, derived once."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, TypeVar, cast

import numpy as np

from excite.models.model import Dynamic, Model, Predictor
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from excite.types.truth import Truth
from identify.data.gaps import gap_free

PART = 10  # samples per state in a gap-free part: in a shorter one the initial state alone explains too much

Predict = Callable[[Any, Experiment, Sequence[int]], Mapping[str, np.ndarray]]
Derived = TypeVar("Derived")


class Deriving:
    """An object that keeps what is derived from it, so that metrics share what costs time."""

    @cached_property
    def _derived(self) -> dict[Callable[..., Any], Any]:
        return {}

    def once(self, derive: Callable[[Self], Derived]) -> Derived:
        """Return derive(self), computed the first time and kept.

        Parameters
        ----------
        derive : a function defined in a module, which stands for its result.

        Examples
        --------
        >>> from identify.metrics.poles import matched
        >>> judgement.once(matched).missing  # doctest: +SKIP
        0
        """
        if derive not in self._derived:
            self._derived[derive] = derive(self)
        return self._derived[derive]


@dataclass(frozen=True, eq=False)
class Case(Deriving):
    """What models are judged on; one case serves any number of models.

    Parameters
    ----------
    predict : how a model is run on a record, `identify.score.predictions`.
    validation : the record, or None where models are judged against the truth alone.
    truth : at the models' rate, or None where it is not known.
    clean : the noise-free twin of a simulated validation record, or None.
    horizons : prediction horizons in samples, beside one step.
    band_hz : low and high frequency of the frequency-response errors; None: `identify.metrics.frequency.default_band`.
    """

    predict: Predict
    validation: Experiment | None = None
    truth: Truth | None = None
    clean: Experiment | None = None
    horizons: tuple[int, ...] = ()
    band_hz: tuple[float, float] | None = None

    @cached_property
    def true(self) -> "Judgement":
        """The truth itself, judged as a model."""
        return Judgement(cast(Truth, self.truth).model, self)


@dataclass(frozen=True, eq=False)
class Judgement(Deriving):
    """One model in one case.

    `dynamic`, `record`, `clean` and `truth` are for metrics that need them: there they are what they say.
    """

    model: Model
    case: Case

    @property
    def dynamic(self) -> Dynamic:
        """The model, which is more than a frequency response."""
        return cast(Dynamic, self.model)

    @property
    def record(self) -> Experiment:
        """The validation record."""
        return cast(Experiment, self.case.validation)

    @property
    def clean(self) -> Experiment:
        """Its noise-free twin."""
        return cast(Experiment, self.case.clean)

    @property
    def truth(self) -> Truth:
        """The truth."""
        return cast(Truth, self.case.truth)

    @cached_property
    def parts(self) -> tuple[Experiment, ...]:
        """Gap-free parts of the validation record, of at least PART samples per state (or the longest)."""
        if self.record.incomplete is None:
            return (self.record,)
        return gap_free((self.record,), PART * len(self.dynamic.poles())).parts

    @cached_property
    def y(self) -> np.ndarray:
        """Measured outputs of these parts, one after the other, (N, ny)."""
        return np.concatenate([part.y for part in self.parts])

    @cached_property
    def predicted(self) -> Mapping[str, np.ndarray]:
        """Outputs beside `y` as the model has them, (N, ny) each: "simulation", "one_step", "<h>_step".

        Every part starts from the initial state that fits it best.
        """
        each = [self.case.predict(self.model, part, self.case.horizons) for part in self.parts]
        return {name: np.concatenate([one[name] for one in each]) for name in each[0]}

    @cached_property
    def predicted_clean(self) -> Mapping[str, np.ndarray]:
        """The same for the noise-free twin, by simulation and at the longest horizon."""
        horizons = self.case.horizons
        return self.case.predict(self.model, self.clean, [max(horizons)] if horizons else [])


def predicts(model: Model) -> bool:
    """Whether a model can predict: whether it has a noise part."""
    return isinstance(model, Predictor) and not (isinstance(model, StateSpaceModel) and model.K is None)
