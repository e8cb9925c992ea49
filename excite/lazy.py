"""Package faces: a package names what it offers and loads each name when it is first asked for (PEP 562)."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


def face(package: str, home: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the `__getattr__` and `__dir__` of a package that loads its names when they are asked for.

    A name may be that of a submodule as well, as `identify.score` is: the import system would put the module in the
    place of the function, in whatever order things happen to be imported. The name stays what `home` says it is.

    Parameters
    ----------
    package : name of the package, `__name__` in its `__init__.py`.
    home : name -> module that defines it.

    Examples
    --------
    >>> __getattr__, __dir__ = face(__name__, {"Signal": "excite.types.signal"})  # in excite/__init__.py
    """
    module = sys.modules[package]

    class Face(ModuleType):
        def __setattr__(self, name: str, value: object) -> None:
            if not (name in home and isinstance(value, ModuleType)):
                super().__setattr__(name, value)

    def load(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = getattr(import_module(home[name]), name)
        setattr(module, name, value)
        return value

    module.__class__ = Face
    return load, lambda: sorted({*vars(module), *home})
