"""Settings for several methods at once."""

from collections.abc import Iterable, Mapping
from typing import Any

from excite.errors import ExciteError, did_you_mean
from identify.method import Method
from identify.registry import load_method, method_class, settings_for


def load_methods(names: Iterable[str], settings: Mapping[str, Any] | None = None) -> dict[str, Method]:
    """Return methods by name, each with those of the settings that it has.

    Parameters
    ----------
    names : of methods.
    settings : setting -> value; every one must be a setting of at least one of the methods.

    Raises
    ------
    ExciteError for a method that does not exist, a setting that none of them has, and a value that one refuses.

    Examples
    --------
    >>> load_methods(["arx", "po_moesp"], {"block_rows": 10})["po_moesp"].block_rows
    10
    """
    names, settings = list(names), dict(settings or {})
    known = {setting for name in names for setting in method_class(name).setting_names()}
    for key in settings:
        if key not in known:
            raise ExciteError(
                f"setting '{key}': none of {', '.join(names)} has this setting; {did_you_mean(key, known)}"
            )
    return {name: load_method(name, **settings_for(name, settings)) for name in names}
