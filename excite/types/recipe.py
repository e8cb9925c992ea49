"""Recipe: how a signal came about, enough to make it again bit for bit."""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from excite.errors import ExciteError
from excite.plain import plain
from excite.types.frozen import Frozen


@dataclass(frozen=True)
class Recipe:
    """What a generator was asked for, and what it decided.

    kind : the generator's or the composition's name; parameters : what it takes, by name (the parts of a composition are
    recipes themselves); decisions : what followed (start state, line phases, crest factor, …); warnings : to be read by
    the user; shaped : limits, band_hz and method of the shaping that followed, or None.

    ``recipe["amplitude"]`` looks a name up among the parameters, then among the decisions.
    """

    kind: str
    parameters: Mapping[str, Any] = field(default_factory=Frozen)
    decisions: Mapping[str, Any] = field(default_factory=Frozen)
    warnings: tuple[str, ...] = ()
    shaped: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or not self.kind:
            raise ExciteError(f"Recipe.kind: {self.kind!r}; give the name of a generator")
        for key in ("parameters", "decisions"):
            object.__setattr__(self, key, Frozen(getattr(self, key)))
        object.__setattr__(self, "warnings", tuple(self.warnings))
        if self.shaped is not None:
            object.__setattr__(self, "shaped", Frozen(self.shaped))

    def __getitem__(self, name: str) -> Any:
        return self.parameters[name] if name in self.parameters else self.decisions[name]

    def get(self, name: str, default: Any = None) -> Any:
        """Return a parameter or a decision, or the default where there is none of that name."""
        return self[name] if name in self else default

    def __contains__(self, name: object) -> bool:
        return name in self.parameters or name in self.decisions

    def __iter__(self) -> Iterator[str]:
        return iter({**self.parameters, **self.decisions})

    def to_dict(self) -> dict[str, Any]:
        """Plain values for files."""
        parts = {"kind": self.kind, "parameters": self.parameters, "decisions": self.decisions}
        parts |= {"warnings": self.warnings} | ({} if self.shaped is None else {"shaped": self.shaped})
        return plain(parts, finite=False)

    @classmethod
    def of(cls, made_by: Callable, warnings: Iterable[str] = (), **values: Any) -> "Recipe":
        """Return the recipe of a generator or composition: values named like its arguments are its parameters."""
        names = inspect.signature(made_by).parameters
        parameters = {name: value for name, value in values.items() if name in names}
        decisions = {name: value for name, value in values.items() if name not in names}
        return cls(made_by.__name__, parameters, decisions, tuple(warnings))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Recipe":
        """Read what `to_dict` gave; raises ExciteError for anything else."""
        if not isinstance(data, Mapping) or not isinstance(data.get("parameters"), Mapping):
            raise ExciteError(f"recipe: {str(data)[:80]}; give kind, parameters, decisions and warnings")

        def read(value: Any) -> Any:
            if isinstance(value, Mapping) and {"kind", "parameters"} <= value.keys():
                return cls.from_dict(value)
            return [read(each) for each in value] if isinstance(value, list) else value

        parameters = {name: read(value) for name, value in data["parameters"].items()}
        return cls(
            data["kind"], parameters, data.get("decisions") or {}, data.get("warnings") or (), data.get("shaped")
        )
