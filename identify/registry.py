"""The table of methods, and how one is loaded by name with its settings."""

from collections.abc import Mapping
from typing import Any, get_args

from excite.errors import ExciteError, did_you_mean
from excite.registry import Registry
from identify.method import Method, setting_types


def _no_method(found: Any) -> str | None:
    """Return why something in an entry point is no method, or None."""
    if not (isinstance(found, type) and issubclass(found, Method)):
        return "is no subclass of identify.method.Method"
    if missing := getattr(found, "__abstractmethods__", None):
        return f"lacks {', '.join(sorted(missing))}"
    if found.order_is is not None and found.largest_order is Method.largest_order:
        return "has an order, and no largest_order that says how large it may be"
    lacking = [each for each in ("name", "summary") if not isinstance(getattr(found, each, None), str)]
    return f"has no {' and no '.join(lacking)}, a text" if lacking else None


# One line adds a method: name -> "module:class". Installed packages add theirs under the entry points excite.methods.
METHODS: Registry[type[Method]] = Registry(
    "method",
    {
        "arx": "identify.prediction_error.arx:Arx",
        "cobra": "identify.realization.cobra:Cobra",
        "cva": "identify.subspace.n4sid:Cva",
        "era": "identify.realization.era:Era",
        "ho_kalman": "identify.realization.ho_kalman:HoKalman",
        "iem": "identify.subspace.iem:Iem",
        "io_realization": "identify.realization.io_realization:IoRealization",
        "moesp": "identify.subspace.moesp:Moesp",
        "n4sid": "identify.subspace.n4sid:N4sid",
        "okid": "identify.realization.okid:Okid",
        "parsim_k": "identify.subspace.parsim_k:ParsimK",
        "pbsid": "identify.subspace.pbsid:Pbsid",
        "pi_moesp": "identify.subspace.pi_moesp:PiMoesp",
        "po_moesp": "identify.subspace.po_moesp:PoMoesp",
        "sbr": "identify.realization.sbr:Sbr",
        "ssarx": "identify.subspace.ssarx:Ssarx",
        "ssi_cov": "identify.output_only.ssi_cov:SsiCov",
        "ssi_data": "identify.output_only.ssi_data:SsiData",
        "ssinnov1": "identify.subspace.ssinnov1:Ssinnov1",
        "ssinnov2": "identify.subspace.ssinnov2:Ssinnov2",
        "wfa": "identify.subspace.wfa:Wfa",
    },
    accepts=_no_method,
    named=True,
)


def list_methods() -> list[str]:
    """Names of all methods, those of installed packages among them."""
    return list(METHODS)


def method_class(name: str) -> type[Method]:
    """Return the class behind a method's name."""
    return METHODS[name]


def load_method(name: str, **settings: Any) -> Method:
    """Return a method by name with its settings; an unknown setting is refused with the nearest known one.

    A setting that is a method itself is given by its name, or as a table {method = NAME, …} with its settings.
    """
    kind = METHODS[name]
    for key in settings:
        if key not in kind.setting_names():
            raise ExciteError(f"{name}: no setting '{key}'; {did_you_mean(key, kind.setting_names())}")
    wrapped = {key for key, each in setting_types(kind).items() if Method in (each, *get_args(each))}
    return kind(**{key: _inner(value, f"{name}.{key}") if key in wrapped else value for key, value in settings.items()})


def _inner(value: Any, place: str) -> Any:
    """Return the method that a setting names; anything else as it is."""
    if isinstance(value, str):
        return load_method(value)
    if isinstance(value, Mapping):
        if "method" not in value:
            raise ExciteError(f"{place}: no key 'method'; give a method's name, or a table with it")
        return load_method(value["method"], **{key: each for key, each in value.items() if key != "method"})
    return value


def settings_for(method: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of some settings, meant for several methods, that this one has."""
    return {key: value for key, value in given.items() if key in METHODS[method].setting_names()}
