"""Settings for several methods at once."""

from collections.abc import Iterable, Mapping
from typing import Any

from excite.errors import ExciteError, did_you_mean
from identify.method import Method
from identify.registry import load_method, method_class, settings_for


def load_methods(
    chosen: Iterable[str | tuple[str, Mapping[str, Any]]], settings: Mapping[str, Any] | None = None
) -> list[Method]:
    """Return methods, each with its own settings and with those of the common ones that it has.

    Parameters
    ----------
    chosen : names of methods, or pairs of a name and settings of its own. A method may stand there more than once.
    settings : setting -> value; every one must be a setting of at least one of the methods.

    Raises
    ------
    ExciteError for a method that does not exist, a setting that none of them has, and a value that one refuses.

    Examples
    --------
    >>> [method.past for method in load_methods(["ssarx", ("ssarx", {"past": 30})], {"past": 10})]
    [10, 30]
    """
    pairs = [(each, {}) if isinstance(each, str) else each for each in chosen]
    names, settings = [name for name, _ in pairs], dict(settings or {})
    known = {setting for name in names for setting in method_class(name).setting_names()}
    for key in settings:
        if key not in known:
            raise ExciteError(
                f"setting '{key}': none of {', '.join(names)} has this setting; {did_you_mean(key, known)}"
            )
    return [load_method(name, **{**settings_for(name, settings), **own}) for name, own in pairs]
