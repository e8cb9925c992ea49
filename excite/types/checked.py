"""The type of a field that is given in one form and held in another, after `__post_init__` has checked it."""

from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

Given = TypeVar("Given", contravariant=True)
Held = TypeVar("Held", covariant=True)

# The default of such a field: None is given, and `__post_init__` puts what is held in its place.
NOT_GIVEN: Any = None


class Checked(Generic[Given, Held]):
    """`name: Checked[Given, Held]`: the constructor takes Given, and whoever reads the field finds Held.

    An annotation alone: nothing is ever an instance of it, and `__post_init__` turns one form into the other. Type
    checkers read it as a descriptor, which only a field with a default can be: NOT_GIVEN, as a rule. A field without one is
    annotated by what it holds, and the constructor takes whatever NumPy makes that of.
    """

    if TYPE_CHECKING:

        def __get__(self, instance: object, owner: Any = None) -> Held: ...

        def __set__(self, instance: object, value: Given) -> None: ...


ArrayByDefault = Checked[ArrayLike | None, np.ndarray]
OptionalArray = Checked[ArrayLike | None, np.ndarray | None]
