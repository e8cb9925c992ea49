"""Sample-wise nonlinear actuators in front of a plant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from excite.arguments import bad, number
from excite.errors import ExciteError
from excite.numerics.simulate import states
from plants.arguments import NONE, Parameter


class Element:
    """One nonlinearity between a command u and what acts on the plant; its memory is its last output, unless it says so."""

    memoryless = False

    def start(self, shape: tuple[int, ...]) -> Any:
        """Return the memory before the first sample, for inputs of shape (…, nu)."""
        return np.zeros(shape)

    def advance(self, u: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """Return the output for one sample u (…, nu), and the memory after it."""
        v = self.step(u, memory)
        return v, v

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Return the output from one sample and the last output, (…, nu) each."""
        raise NotImplementedError

    def passes(self, u: np.ndarray) -> bool:
        """Whether the whole sequence u (N, nu) goes through unchanged: each sample, the last output being the last sample."""
        return np.array_equal(self.step(u, np.vstack([np.zeros((1, u.shape[1])), u[:-1]])), u)


@dataclass(frozen=True)
class Saturation(Element):
    """v = min(max(u, low), high)."""

    low: float | np.ndarray
    high: float | np.ndarray
    memoryless = True

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Clip."""
        return np.clip(u, self.low, self.high)


@dataclass(frozen=True)
class RateLimit(Element):
    """v moves by at most `rate` per sample from its last value; v starts at 0."""

    rate: float | np.ndarray

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Clip to the neighbourhood of the last output."""
        return np.clip(u, last - self.rate, last + self.rate)


@dataclass(frozen=True)
class Backlash(Element):
    """Play of the given width: v stays until u drags it along; v starts at 0."""

    width: float | np.ndarray

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Keep the last output within half a width of u."""
        return np.clip(last, u - self.width / 2, u + self.width / 2)


@dataclass(frozen=True)
class Quantiser(Element):
    """v = the multiple of `step_size` nearest to u."""

    step_size: float | np.ndarray
    memoryless = True

    def step(self, u: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Round."""
        return np.round(u / self.step_size) * self.step_size


@dataclass(frozen=True, eq=False)
class RamRate(Element):
    """A ram behind the command moves by at most `rate` (units/s): v is the command nearest to u that keeps it so.

    The ram is x+ = A x + B v with x = [position, rate], at rest before the first sample; where |rate+| would be larger,
    v takes it to the limit exactly. One axis per input: A (nu, 2, 2), B (nu, 2), rate (nu,). What follows v stays linear,
    the ram's motion between the samples included.
    """

    A: np.ndarray
    B: np.ndarray
    rate: np.ndarray

    def start(self, shape: tuple[int, ...]) -> np.ndarray:
        """Rams at rest, (…, nu, 2)."""
        return np.zeros((*shape, 2))

    def advance(self, u: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Clip the command to what the rate allows from here, and move the rams."""
        free = np.einsum("jab,...jb->...ja", self.A, memory)
        reach = (self.rate / self.B[:, 1] * side - free[..., 1] / self.B[:, 1] for side in (-1, 1))
        v = np.clip(u, *reach)
        return v, free + self.B * v[..., None]

    def passes(self, u: np.ndarray) -> bool:
        """Rams that follow u keep their rates."""
        rates = [states(A, B[:, None], u[:, [j]])[:, 1] for j, (A, B) in enumerate(zip(self.A, self.B, strict=True))]
        return bool((np.abs(rates).T <= self.rate).all())


IN_FRONT: dict[str, Parameter] = {
    "actuator_quantum": Parameter(
        NONE, "of input", "step of a quantiser; one number, or one per input; none: no such element"
    ),
    "actuator_saturation": Parameter(NONE, "of input", "largest modulus behind the quantiser"),
    "actuator_rate": Parameter(NONE, "of input/s", "largest rate behind the saturation"),
    "actuator_backlash": Parameter(NONE, "of input", "width of the backlash behind the rate limit"),
}


def apart(parameters: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a plant's own parameters, and those of the elements in front of it."""
    own = {key: value for key, value in parameters.items() if key not in IN_FRONT}
    return own, {key: value for key, value in parameters.items() if key in IN_FRONT}


def elements_in_front(
    plant: str, given: Mapping[str, Any], inputs: int, dt: float
) -> tuple[tuple[Element, ...], dict[str, Parameter]]:
    """Return the elements that parameters named as in IN_FRONT describe, in its order, and all of those parameters."""
    kinds = {
        "actuator_quantum": Quantiser,
        "actuator_saturation": lambda s: Saturation(-s, s),
        "actuator_rate": lambda s: RateLimit(s * dt),
        "actuator_backlash": Backlash,
    }
    elements, parameters = [], {}
    for key, old in IN_FRONT.items():
        value = given.get(key, NONE)
        parameters[key] = old if value == NONE else replace(old, value=value, source="override")
        if value != NONE:
            elements.append(kinds[key](_sizes(value, f"{plant} parameter '{key}'", inputs)))
    return tuple(elements), parameters


def _sizes(value: object, place: str, count: int) -> np.ndarray:
    sizes = value if isinstance(value, list) else [value] * count
    if len(sizes) != count:
        raise ExciteError(f"{place}: has {len(sizes)} numbers; give one, or {count}")
    for size in sizes:
        if number(size, place) <= 0:
            raise bad(place, size, f'it must be positive, or "{NONE}"')
    return np.array(sizes, float)


def actuate(elements: Sequence[Element], u: np.ndarray) -> np.ndarray:
    """Return the actuator's output for a whole sequence u (N, nu)."""
    for element in elements:
        if element.memoryless:
            u = element.step(u, u)
            continue
        v, memory = np.empty_like(u), element.start(u.shape[1:])
        for k, each in enumerate(u):
            v[k], memory = element.advance(each, memory)
        u = v
    return u
