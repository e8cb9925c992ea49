"""From plain numbers, as a scenario file holds them, to a linear plant: system, noise, controller, channels, limits.

A system is a table of A, B, C, D (rows; D may be left out; D alone is a static gain) or of num and den (descending powers
of z, as in scipy and python-control; num as rows for several outputs). All are discrete, at the plant's dt. The keys:

    dt, system; noise : what shapes the output noise, either {K}, the innovation form, or a stable filter of its own;
    controller : a system from set-point and measured outputs to the inputs, or the gains kp, ki, kd of a PID from each
    measured output to the input of the same number; with `measured` (names of outputs, all unless given) and `sign` (-1,
    negative feedback); input_filter : a stable filter from what is played to u;
    inputs, outputs : names with units; limits, setpoint_limits : the largest modulus, one number or one per channel.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.arguments import number
from excite.errors import ExciteError, did_you_mean
from excite.models.state_space import StateSpaceModel
from excite.numerics.matrices import spectral_radius
from excite.plain import plain
from excite.types.channel import Channel
from plants.arguments import NONE, Parameter, is_there, resolve
from plants.linear.loop import Dynamics, Feedback
from plants.linear.plant import LinearPlant

MATRICES, FRACTION = ("A", "B", "C", "D"), ("num", "den")
SYSTEM = (*MATRICES, *FRACTION)
GAINS = ("kp", "ki", "kd")
System = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Described:
    """A plant of the table that is made from presets of parameters; calling it builds the plant.

    presets : name -> its parameters, the first is the default; noise : preset -> its noise sources, of the names
    "process" (white, on every state), "input" (white, on every input) and "output" (white, shaped, on every output);
    equations : from the parameters' values to the keys above, for a plant whose parameters are not these keys themselves.
    """

    name: str
    description: str
    presets: Mapping[str, Mapping[str, Parameter]]
    noise: Mapping[str, Mapping[str, Parameter]]
    equations: Callable[[Mapping[str, Any]], Mapping[str, Any]] = dict
    note: str = ""

    def __call__(self, preset: str | None = None, parameters: Mapping[str, Any] | None = None) -> LinearPlant:
        """Return the plant of a preset with parameters overridden by name."""
        preset = preset or next(iter(self.presets))
        given = _replacing(plain(dict(parameters or {}), self.name, finite=False), self.presets.get(preset, {}))
        resolved = resolve(self.name, self.presets, preset, given)
        values = self.equations({name: parameter.value for name, parameter in resolved.items()})
        noise = self.noise[preset]
        try:
            fields = _fields({key: value for key, value in values.items() if is_there(value)}, tuple(noise))
        except ExciteError as error:
            raise ExciteError(f"{self.name} parameter {error}") from None
        return LinearPlant(
            name=self.name,
            description=self.description,
            parameters=resolved,
            noise_sources=noise,
            preset=preset,
            note=self.note,
            make=self,
            **fields,
        )


def _replacing(given: dict[str, Any], known: Mapping[str, Parameter]) -> dict[str, Any]:
    """Return what is given, and that it replaces the other description of the system where the preset has that."""
    for keys, others in ((FRACTION, MATRICES), (MATRICES, FRACTION)):
        if any(is_there(given.get(key)) for key in keys):
            given = {key: NONE for key in others if key in known} | given
    return given


def _fields(values: Mapping[str, Any], sources: tuple[str, ...]) -> dict[str, Any]:
    """Return the fields of LinearPlant that the keys above describe."""
    dt = number(values["dt"], "'dt'")
    A, B, C, D = _system({key: values[key] for key in SYSTEM if key in values}, "")
    nu, ny = B.shape[1], len(C)
    dynamics = _noisy((A, B, C, D), values.get("noise", {}), sources)
    inputs, outputs = channels_of(values, "inputs", nu, "u"), channels_of(values, "outputs", ny, "y")
    fields = {"dt": dt, "inputs": inputs, "outputs": outputs, "limits": limits_of(values, "limits", nu)}
    if "input_filter" in values:
        table = _table(values["input_filter"], "input_filter", SYSTEM)
        fields["input_filter"] = StateSpaceModel(*_filter(table, "input_filter", nu), dt)
    if "controller" not in values:
        return fields | {"dynamics": dynamics(spectral_radius(A) < 1 - 1e-9)}
    feedback = feedback_of(values["controller"], [c.name for c in outputs], nu, dt)
    limits = limits_of(values, "setpoint_limits", len(feedback.measured))
    return fields | {"dynamics": dynamics(True), "feedback": feedback, "reference_limits": limits}


def feedback_of(given: object, names: list[str], inputs: int, dt: float) -> Feedback:
    """Return the feedback that the table `controller` describes, from outputs of these names to `inputs` inputs."""
    table = _table(given, "controller", (*SYSTEM, *GAINS, "measured", "sign"))
    measured = table.pop("measured", names)
    if not isinstance(measured, list) or not measured:
        raise ExciteError(f"'controller.measured': {measured!r}; give a list of outputs' names")
    for name in measured:
        if name not in names:
            raise ExciteError(f"'controller.measured': {name!r} is no output; {did_you_mean(str(name), names)}")
    sign = table.pop("sign", -1)
    if sign not in (-1, 1):
        raise ExciteError(f"'controller.sign': {sign!r}; give -1 for negative feedback, or 1")
    gains = {key: table.pop(key) for key in GAINS if key in table}
    if gains and table:
        raise ExciteError(f"'controller': holds PID gains and '{next(iter(table))}'; give one description")
    system = _pid(gains, len(measured), dt) if gains else _system(table, "controller.")
    if system[3].shape != (inputs, len(measured)):
        raise ExciteError(
            f"'controller': is {_size(system[3])}; from {len(measured)} measured outputs to {inputs} inputs it is "
            f"{inputs} x {len(measured)}"
        )
    return Feedback(StateSpaceModel(*system, dt), tuple(map(names.index, measured)), sign)


def _pid(gains: Mapping[str, Any], count: int, dt: float) -> System:
    """Return kp + ki dt / (z - 1) + kd (1 - 1/z) / dt for each of `count` channels, with no state for a gain of zero."""
    kp, ki, kd = (
        [number(gain, f"'controller.{key}'") for gain in (each if isinstance(each, list) else [each] * count)]
        for key in GAINS
        for each in [gains.get(key, 0.0)]
    )
    if not len(kp) == len(ki) == len(kd) == count:
        raise ExciteError(f"'controller.kp': give one number, or {count}, one per measured output; so ki and kd")
    parts = []
    for p, i, d in zip(kp, ki, kd, strict=True):
        A, B, C = np.diag([1.0, 0.0]), np.array([[dt], [1.0]]), np.array([[i, -d / dt]])
        used = np.flatnonzero(C[0])
        parts.append((A[np.ix_(used, used)], B[used], C[:, used], np.array([[p + d / dt]])))
    return tuple(la.block_diag(*(part[j] for part in parts)) for j in range(4))


def _noisy(system: System, given: object, sources: tuple[str, ...]) -> Callable[[bool], Dynamics]:
    """Return how to make the dynamics with noise of unit variance from the sources named; output noise goes through H(q).

    `given` describes H(q): as a gain K, when H(q) = I + C (q I - A)^-1 K shares the plant's states (innovation form), or
    as a filter of its own. The argument is whether noise starts in its stationary distribution.
    """
    A, B, C, D = system
    n, ny = len(A), len(C)
    given = _table(given, "noise", (*SYSTEM, "K"))
    if "K" in given:
        if len(given) > 1:
            raise ExciteError("'noise': holds K and a filter of its own; give one of the two")
        K = matrix_of(given["K"], "noise.K", (n, ny))
        _inverts(A - K @ C, "noise.K")
        F, N, M, H = np.zeros((0, 0)), np.zeros((0, ny)), np.zeros((ny, 0)), np.eye(ny)
    else:
        K = np.zeros((n, ny))
        F, N, M, H = _filter(given or {"D": np.eye(ny)}, "noise", ny)
        if abs(la.det(H)) > 0:
            _inverts(F - N @ la.solve(H, M), "noise")
    k, nu = len(F), B.shape[1]
    entries = {  # source -> where it enters: states, noise states, outputs
        "process": (np.eye(n), np.zeros((k, n)), np.zeros((ny, n))),
        "input": (B, np.zeros((k, nu)), D),
        "output": (K, N, H),
    }
    G, own, H = (np.hstack(parts) for parts in zip(*(entries[name] for name in sources), strict=True))
    widths = {name: entries[name][2].shape[1] for name in sources}
    B, C = np.vstack([B, np.zeros((k, nu))]), np.hstack([C, M])
    return lambda stationary: Dynamics(la.block_diag(A, F), B, C, D, np.vstack([G, own]), H, widths, k, stationary)


def _inverts(zeros: np.ndarray, place: str) -> None:
    """Refuse noise from which no predictor recovers e; its spectrum is also that of a filter that can be inverted."""
    if (radius := spectral_radius(zeros)) > 1 + 1e-9:
        raise ExciteError(
            f"'{place}': a zero of the noise filter has modulus {radius:.6g}; replace it by its inverse, which leaves the "
            "spectrum as it is but for a factor"
        )


def _filter(given: Mapping[str, Any], place: str, count: int) -> System:
    """Return a stable filter from and to `count` channels; a transfer function serves each channel by itself."""
    system = _system(given, f"{place}.")
    if "num" in given and count > 1:
        A, B, C, D = (np.kron(np.eye(count), part) for part in system)
        system = A, B, C, D
    if system[3].shape != (count, count):
        raise ExciteError(f"'{place}': is {_size(system[3])}; it must be {count} x {count}")
    if (radius := spectral_radius(system[0])) >= 1:
        raise ExciteError(f"'{place}': has a pole of modulus {radius:.6g}; a filter needs all of them below 1")
    return system


def _system(given: Mapping[str, Any], at: str) -> System:
    """Return A, B, C, D from matrices (D alone is a static gain) or from num and den, whose lists descend in powers of z."""
    if any(key in given for key in FRACTION):
        if any(key in given for key in MATRICES):
            raise ExciteError(f"'{at}num': a transfer function and matrices are both given; give one of the two")
        return _fraction(given, at)
    if "A" not in given and "D" in given:
        D = matrix_of(given["D"], f"{at}D")
        return np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((len(D), 0)), D
    for key in ("A", "B", "C"):
        if key not in given:
            raise ExciteError(f"'{at}{key}': missing; give A, B, C (and D), or num and den")
    A, B, C = (matrix_of(given[key], f"{at}{key}") for key in ("A", "B", "C"))
    n = len(A)
    for key, part, shape in (("A", A, (n, n)), ("B", B, (n, B.shape[1])), ("C", C, (len(C), n))):
        if part.shape != shape:
            raise ExciteError(f"'{at}{key}': is {_size(part)}; with this A it is {shape[0]} x {shape[1]}")
    D = matrix_of(given["D"], f"{at}D", (len(C), B.shape[1])) if "D" in given else np.zeros((len(C), B.shape[1]))
    return A, B, C, D


def _fraction(given: Mapping[str, Any], at: str) -> System:
    """Return the controllable canonical form of one input and as many outputs as `num` has rows."""
    for key in FRACTION:
        if key not in given:
            raise ExciteError(f"'{at}{key}': missing; a transfer function needs num and den")
    num, den = matrix_of(given["num"], f"{at}num"), matrix_of(given["den"], f"{at}den")
    if len(den) > 1:
        raise ExciteError(f"'{at}den': has {len(den)} rows; give one list, the outputs share it")
    den = den[0]
    if den[0] == 0:
        raise ExciteError(f"'{at}den': starts with 0; its first coefficient is that of the highest power of z")
    if num.shape[1] > len(den):
        raise ExciteError(
            f"'{at}num': has {num.shape[1]} coefficients, den {len(den)}; the numerator's degree is at most the denominator's"
        )
    num = np.hstack([np.zeros((len(num), len(den) - num.shape[1])), num]) / den[0]
    a, n = den[1:] / den[0], len(den) - 1
    A = np.vstack([-a, np.eye(n - 1, n)]) if n else np.zeros((0, 0))
    return A, np.eye(n, 1), num[:, 1:] - num[:, :1] * a, num[:, :1]


def matrix_of(value: object, place: str, shape: tuple[int, int] | None = None) -> np.ndarray:
    """Return a matrix of finite numbers from nested lists; one list is one row, one number a matrix of it."""
    if isinstance(value, np.ndarray):
        return value
    rows = value if isinstance(value, list) and value and isinstance(value[0], list) else [value]
    table: list[list[Any]] = [row if isinstance(row, list) else [row] for row in rows]
    if not table[0] or len({len(row) for row in table}) > 1:
        raise ExciteError(f"'{place}': {value!r}; give rows of equal length, [[…], […]]")
    matrix = np.array([[number(each, f"'{place}'") for each in row] for row in table])
    if shape is not None and matrix.shape != shape:
        raise ExciteError(f"'{place}': is {_size(matrix)}; it must be {shape[0]} x {shape[1]}")
    return matrix


def _size(matrix: np.ndarray) -> str:
    return " x ".join(map(str, matrix.shape))


def _table(value: object, place: str, known: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise ExciteError(
            f"'{place}': {value!r}; give a table such as {{num = [1.0], den = [1.0, -0.5]}}, or \"{NONE}\""
        )
    for key in value:
        if key not in known:
            raise ExciteError(f"'{place}.{key}': unknown key; {did_you_mean(str(key), known)}")
    return dict(value)


def channels_of(values: Mapping[str, Any], key: str, count: int, prefix: str) -> tuple[Channel, ...]:
    """Return the channels that `key` names, or numbered ones without unit."""
    names = values.get(key, [f"{prefix}{i + 1} [1]" if count > 1 else f"{prefix} [1]" for i in range(count)])
    if not isinstance(names, list) or len(names) != count or not all(isinstance(name, str) for name in names):
        raise ExciteError(f"'{key}': {names!r}; give {count} names, such as \"flap [deg]\"")
    channels = tuple(Channel.parse(name) for name in names)
    if len({c.name for c in channels}) != count:
        raise ExciteError(f"'{key}': {names!r}; each name once")
    return channels


def limits_of(values: Mapping[str, Any], key: str, count: int) -> tuple[tuple[float, float], ...]:
    """Return (-m, m) for the largest moduli m that `key` gives, one for all or one per channel."""
    given = values[key]
    each = given if isinstance(given, list) else [given]
    each = each * count if len(each) == 1 else each
    if len(each) != count:
        raise ExciteError(f"'{key}': has {len(each)} numbers; give one, or {count}")
    sizes = [number(one, f"'{key}'") for one in each]
    if min(sizes) <= 0:
        raise ExciteError(f"'{key}': {min(sizes):g}; a limit is positive, and bounds both signs")
    return tuple((-size, size) for size in sizes)
