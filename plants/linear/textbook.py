"""The example systems of the sources, as printed, and classics: two masses and a spring, inverted pendulum, dead time.

The sources count samples; where no sampling time is printed it is 1 s, so that rad/s is rad per sample.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.linalg as la

from excite.errors import ExciteError
from excite.numerics.matrices import zero_order_hold
from plants.arguments import Parameter
from plants.linear.described import Described

COUNTED = {
    "dt": Parameter(1.0, "s", "assumption: the source counts samples"),
    "limits": Parameter(100.0, "of input", "assumption: the source has none"),
}
NOT_PRINTED = "assumption, the source prints no number"


def _printed(source: str, **values: Any) -> dict[str, Parameter]:
    return {**COUNTED, **{name: Parameter(value, "1", source) for name, value in values.items()}}


def _example(
    name: str, description: str, parameters: Mapping[str, Parameter], note: str = "", **noise: Parameter
) -> Described:
    """Return a plant with one preset, "printed"."""
    return Described(name, description, {"printed": parameters}, {"printed": noise}, note=note)


MILLER = "Miller 2012, Example "
miller_31 = _example(
    "miller_31",
    "Miller, Example 3.1: four lightly damped poles, two outputs; for the step response",
    _printed(
        f"{MILLER}3.1",
        A=[[0.95, 0.1, 0, 0], [-0.1, 0.95, 0, 0], [0, 0, 0.93, 0.3], [0, 0, -0.3, 0.93]],
        B=[[-0.01209], [0.2429], [0], [0.4246]],
        C=[[0.4039, 0.4039, -0.0955, -0.2196], [0.2, 0.3, -0.4, 0.3]],
    ),
    output=Parameter(0.003**0.5, "1", f"{MILLER}3.1: variance 0.003, white, independent on each output"),
)

_41 = {"A": [[0.7, 1.0], [-0.16, 0.7]], "B": [[0.0], [1.0]], "C": [[-0.1247, 1.2469]]}
_41_NOISE = {"A": [[0.9, 1.0], [-0.04, 0.9]], "B": [[0.0], [0.25]], "C": [[0.2, 0.0]]}
miller_41 = Described(
    "miller_41",
    "Miller, Example 4.1: two poles, with white process and output noise or with coloured output noise",
    {"white": _printed(f"{MILLER}4.1", **_41), "coloured": _printed(f"{MILLER}4.1", **_41, noise=_41_NOISE)},
    {
        "white": {
            "process": Parameter(0.1**0.5, "1", f"{MILLER}4.1: e(t), white on both states, covariance 0.1 I"),
            "output": Parameter(1.0, "1", f"{MILLER}4.1: w(t), white, variance 1"),
        },
        "coloured": {
            "output": Parameter(1.0, "1", f"{MILLER}4.1: e_v(t); assumption: variance 1, the source prints none")
        },
    },
    note="the source plays white noise; assumption: of variance 1",
)

miller_51 = _example(
    "miller_51",
    "Miller, Example 5.1: two poles, strongly coloured noise, and an input filter for a coloured input",
    _printed(
        f"{MILLER}5.1",
        A=[[0.7, 0.3], [-0.3, 0.7]],
        B=[[0.0], [0.8333]],
        C=[[0.72, 0.0]],
        noise={"A": [[0.6, 0.4], [-0.4, 0.6]], "B": [[0.0], [1.25]], "C": [[0.64, 0.0]]},
        input_filter={"A": [[0.5, 0.7], [-0.7, 0.5]], "B": [[0.0], [1.429]], "C": [[1.0, 0.0]]},
    ),
    note="the source plays white noise of variance 1 through the input filter: injection filtered_input",
    output=Parameter(10.0**0.5, "1", f"{MILLER}5.1: white, variance 10, through the noise filter"),
)

MERCERE = "Mercère, Markovsky and Ramos 2016, section V-"
mercere_open = _example(
    "mercere_open",
    "Mercère, Markovsky and Ramos, V-A: one pole, feedthrough, innovation form",
    _printed(
        f"{MERCERE}A, after Van Overschee and De Moor 1996, 4.4.5",
        A=[[0.749]],
        B=[[1.8805]],
        C=[[0.8725]],
        D=[[-2.0895]],
        noise={"K": [[-0.0580]]},
    )
    | {"dt": Parameter(1.0, "s", f"{MERCERE}A")},
    note="the source plays 4000 samples of white noise of variance 1",
    output=Parameter(6.705**0.5, "1", f"{MERCERE}A: innovations e of variance R = 6.705"),
)

mercere_closed = _example(
    "mercere_closed",
    "Mercère, Markovsky and Ramos, V-B: two poles under proportional feedback, coloured noise",
    _printed(
        f"{MERCERE}B",
        num=[1.0, 0.5],
        den=[1.0, -1.5, 0.7],
        noise={"num": [1.0, 0.5, 0.0], "den": [1.0, 1.5, 0.7]},
        controller={"D": [[0.5]]},
    )
    | {"setpoint_limits": Parameter(100.0, "of output", "assumption: the source has none")},
    # The printed loop sets u(k-1) = -0.5 y(k-1) + r(k). Here u(k) = -0.5 y(k) + r(k): the same loop with the reference
    # counted from one sample earlier, so that what is recorded as r at k acts at k.
    note="the source plays 1000 samples of white noise of variance 1 at plant_input and writes r(k) for what acts at k-1",
    output=Parameter(
        0.8, "1", f"{MERCERE}B: y = z + 0.8 v, v = (1 + 0.5 q^-1)/(1 + 1.5 q^-1 + 0.7 q^-2) e, e of variance 1"
    ),
)

NOTES = "Zaffalon and Hofmann 2024 (lecture notes), "
_ARX = _printed(f"{NOTES}5.2.2: structure; {NOT_PRINTED}", num=[1.0], den=[1.0, -0.8])
_EQUATION_ERROR = {"noise": Parameter({"K": [[0.8]]}, "1", f"{NOTES}5.2.2: H = 1/A, in innovation form")}
_ARX_NOISE = "white e; assumption: half the input's standard deviation, the source prints no number"
arx_bias = Described(
    "arx_bias",
    "the ARX bias example: b q^-1/(1 + a q^-1) with white output noise, H = 1, or with equation error, H = 1/A",
    {"output_error": _ARX, "equation_error": _ARX | _EQUATION_ERROR},
    {
        preset: {"output": Parameter(0.5, "1", f"{NOTES}5.2.2: {_ARX_NOISE}")}
        for preset in ("output_error", "equation_error")
    },
    note="the source plays one period of a PRBS of order 7, N = 127",
)

etfe_transient = _example(
    "etfe_transient",
    "the ETFE transient example: a slow resonance from rest, whose first periods are transient",
    _printed(
        f"{NOTES}3.2.1: {NOT_PRINTED}; poles of modulus 0.96 at 0.3 rad per sample",
        num=[1.0, 0.5],
        den=[1.0, -1.834, 0.9216],
    ),
    note="the source plays periods of one signal: the bias falls as 1/periods, the noise as 1/sqrt(periods)",
    output=Parameter(1.0, "1", f"{NOTES}3.2.1: {NOT_PRINTED}; white"),
)


def _two_masses(values: Mapping[str, Any]) -> dict[str, Any]:
    """m1 x1'' = u - friction x1' - F, m2 x2'' = F, F = stiffness (x1 - x2) + damping (x1' - x2'); y = [x1, x2]."""
    m1, m2, k, d, b = (values[name] for name in ("mass_1", "mass_2", "stiffness", "damping", "friction"))
    A_c = [[0, 1, 0, 0], [-k / m1, -(d + b) / m1, k / m1, d / m1], [0, 0, 0, 1], [k / m2, d / m2, -k / m2, -d / m2]]
    A, B = zero_order_hold(np.array(A_c), np.array([[0], [1 / m1], [0], [0]]), values["dt"])
    return {
        "dt": values["dt"],
        "A": A,
        "B": B,
        "C": [[1, 0, 0, 0], [0, 0, 1, 0]],
        "limits": values["limits"],
        "inputs": ["force [N]"],
        "outputs": ["position_1 [m]", "position_2 [m]"],
    }


BENCHMARK = "Wie and Bernstein, Benchmark problems for robust control design, J. Guidance 15, 1992"
two_mass_spring = Described(
    "two_mass_spring",
    "two masses on a spring, pushed at the first: an integrator and a lightly damped mode, collocated or not",
    {
        "benchmark": {
            "dt": Parameter(0.1, "s", "assumption: 44 samples per period of the mode"),
            "mass_1": Parameter(1.0, "kg", BENCHMARK),
            "mass_2": Parameter(1.0, "kg", BENCHMARK),
            "stiffness": Parameter(1.0, "N/m", BENCHMARK),
            "damping": Parameter(
                0.02, "N s/m", "assumption: ratio 0.014 of the mode; the benchmark has none", "non-negative"
            ),
            "friction": Parameter(
                0.1, "N s/m", "assumption: a slow pole beside the integrator; the benchmark has none"
            ),
            "limits": Parameter(10.0, "N", "assumption"),
        }
    },
    {
        "benchmark": {
            "input": Parameter(0.05, "N", "assumption: white disturbance of the force"),
            "output": Parameter(0.01, "m", "assumption: white on both positions"),
        }
    },
    _two_masses,
)


def _pendulum(values: Mapping[str, Any]) -> dict[str, Any]:
    """Linearised about upright: (M + m) x'' + b x' - m l phi'' = u, (I + m l^2) phi'' - m g l phi = m l x''.

    The controller is the LQG compensator of the discrete plant, u = K xhat(r - y): weights 1/m^2 on the position,
    1/rad^2 on the angle and 0.01/N^2 on the force, a force noise of 1 N and white noise of 1 mm and 1 mrad on y.
    """
    M, m, b, l, I, g = (values[name] for name in ("cart", "mass", "friction", "length", "inertia", "gravity"))
    J, p = I + m * l**2, I * (M + m) + M * m * l**2
    A_c = [
        [0, 1, 0, 0],
        [0, -J * b / p, m**2 * g * l**2 / p, 0],
        [0, 0, 0, 1],
        [0, -m * l * b / p, m * g * l * (M + m) / p, 0],
    ]
    A, B = zero_order_hold(np.array(A_c), np.array([[0], [J / p], [0], [m * l / p]]), values["dt"])
    C = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    try:
        X = la.solve_discrete_are(A, B, C.T @ C, np.array([[0.01]]))
        P = la.solve_discrete_are(A.T, C.T, B @ B.T, 1e-6 * np.eye(2))
    except la.LinAlgError as error:
        raise ExciteError(
            f"inverted_pendulum: no stabilising controller for these parameters ({error}); change them"
        ) from None
    K = la.solve(B.T @ X @ B + 0.01, B.T @ X @ A)
    L = la.solve(C @ P @ C.T + 1e-6 * np.eye(2), C @ P @ A.T).T
    return {
        "dt": values["dt"],
        "A": A,
        "B": B,
        "C": C,
        "limits": values["limits"],
        "setpoint_limits": [0.2, 0.1],
        "controller": {"A": A - B @ K - L @ C, "B": L, "C": K, "D": np.zeros((1, 2))},
        "inputs": ["force [N]"],
        "outputs": ["position [m]", "angle [rad]"],
    }


TUTORIAL = "Control Tutorials for MATLAB and Simulink (University of Michigan), Inverted pendulum: system modeling"
inverted_pendulum = Described(
    "inverted_pendulum",
    "inverted pendulum on a cart, linearised upright: unstable, held by an LQG controller, closed loop only",
    {
        "tutorial": {
            "dt": Parameter(0.01, "s", "assumption"),
            "cart": Parameter(0.5, "kg", TUTORIAL),
            "mass": Parameter(0.2, "kg", f"{TUTORIAL}: pendulum"),
            "friction": Parameter(0.1, "N s/m", f"{TUTORIAL}: of the cart"),
            "length": Parameter(0.3, "m", f"{TUTORIAL}: to the pendulum's centre of mass"),
            "inertia": Parameter(0.006, "kg m2", f"{TUTORIAL}: of the pendulum about its centre of mass"),
            "gravity": Parameter(9.8, "m/s2", TUTORIAL),
            "limits": Parameter(10.0, "N", "assumption"),
        }
    },
    {
        "tutorial": {
            "input": Parameter(0.1, "N", "assumption: white disturbance of the force"),
            "output": Parameter(0.001, "m and rad", "assumption: white on position and angle"),
        }
    },
    _pendulum,
    note="set-points up to 0.2 m and 0.1 rad, an assumption: the linearisation is meant for small angles",
)


def _dead_time(values: Mapping[str, Any]) -> dict[str, Any]:
    """gain exp(-delay s) / (tau s + 1) with zero-order hold, exactly: a delay of d whole samples and a fraction f.

    x+ = a x + gain ((1 - a(dt - f)) u(k-d) + (a(dt - f) - a(dt)) u(k-d-1)), a(t) = exp(-t / tau), a = a(dt).
    """
    dt, gain, tau = values["dt"], values["gain"], values["tau"]
    if values["delay"] > 1000 * dt:
        raise ExciteError(
            f"delay_process parameter 'delay': {values['delay']:g} s is over 1000 samples; give a larger dt"
        )
    d = int(values["delay"] / dt + 1e-9)
    f = max(values["delay"] - d * dt, 0.0)
    a, late = np.exp(-dt / tau), np.exp(-(dt - f) / tau)
    whole = f < 1e-9 * dt
    num = [gain * (1 - a)] if whole else [gain * (1 - late), gain * (late - a)]
    den = [1.0, -a] + [0.0] * (d if whole else d + 1)
    return {"dt": dt, "num": num, "den": den, "limits": values["limits"]}


delay_process = Described(
    "delay_process",
    "a first-order process with dead time, as process control knows it",
    {
        "example": {
            "dt": Parameter(1.0, "s", "assumption"),
            "gain": Parameter(2.0, "1", "assumption", "any"),
            "tau": Parameter(10.0, "s", "assumption"),
            "delay": Parameter(
                4.5, "s", "assumption: four samples and a half, so that a zero stands for the half", "non-negative"
            ),
            "limits": Parameter(10.0, "1", "assumption"),
        }
    },
    {"example": {"output": Parameter(0.1, "1", "assumption: white")}},
    _dead_time,
)
