"""The equations of the aircraft of elastic modes, sampled exactly.

    d_s'' + a1_s d_s' + a0_s d_s = a0_s (v_s + h_s w)                   surface positions, deg
    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = b_i d_s + g_i w             modal coordinates, m, of the surface's family
    p' = -p / T + L d_aileron + l w                                     rigid-body roll rate, deg/s

The commands v are held between samples. One Dryden gust of speed w moves surfaces and structure alike, so that the noise
on input and output is coloured and correlated. Accelerometers give sum_i phi_i q_i''; pressure taps give
K d + k (w - sum_i phi_i q_i'); both see the elastic motion alone. The gyro gives p + e sum_i q_i'.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.numerics.matrices import zero_order_hold
from plants.aeroelastic.parameters import EXCITED, FAMILIES, NOISE
from plants.aeroelastic.sensors import ACCELEROMETERS, PRESSURES, shapes, tap_gains
from plants.aeroelastic.turbulence import dryden_vertical, sampled_noise
from plants.linear.loop import Dynamics

DT = 0.01  # s
BAND_HZ = (3.0, 35.0)  # of the experiments
ALL = np.arange(len(ACCELEROMETERS) + len(PRESSURES))


def servo(values: Mapping[str, float], surface: str) -> tuple[float, float]:
    """Return a0, a1 of a surface's servo."""
    if surface == "flap":
        slow, fast = values["flap_slow_pole"], values["flap_fast_pole"]
        return slow * fast, slow + fast
    frequency = values["aileron_frequency"]
    return frequency**2, 2 * values["aileron_damping"] * frequency


def dynamics(values: Mapping[str, float], surfaces: Sequence[str], sensors: np.ndarray) -> Dynamics:
    """Return the aircraft with some of its sensors: states d, d', q, q', p, gust; outputs sensors, gyro, positions.

    Every quantity below is a row of coefficients (or one row for each) of states, commands, and the gust's white noise.
    """
    families = [FAMILIES[s] for s in surfaces]
    phi = [shapes(family) for family in families]
    owner = np.repeat(np.arange(len(surfaces)), [each.shape[1] for each in phi])  # the surface that moves each mode
    modes = [f"{family}_{i + 1}" for family, each in zip(families, phi, strict=True) for i in range(each.shape[1])]
    displacement, roll = np.hstack(phi), int("aileron" in surfaces)
    ns, m = len(surfaces), len(modes)

    def column(names: Sequence[str], key: str) -> np.ndarray:
        return np.array([[values[f"{name}_{key}"]] for name in names])

    n = 2 * ns + 2 * m + roll + 2
    d, d_dot, q, q_dot, p, gust, v, white = np.split(np.eye(n + ns + 1), np.cumsum([ns, ns, m, m, roll, 2, ns]))
    gust_A, gust_B, gust_C = dryden_vertical(values["speed"], values["turbulence_length"])
    w, gust_dot = gust_C @ gust, gust_A @ gust + gust_B @ white
    a0, a1 = np.array([servo(values, s) for s in surfaces]).T[:, :, None]
    d_ddot = a0 * (v + column(surfaces, "gust") * w - d) - a1 * d_dot
    omega = 2 * np.pi * column(modes, "frequency")
    q_ddot = column(modes, "force") * d[owner] + column(modes, "gust") * w
    q_ddot -= omega**2 * q + 2 * column(modes, "damping") * omega * q_dot
    p_dot, rate = p, p
    if roll:
        aileron = surfaces.index("aileron")
        p_dot = (
            -p / values["roll_time_constant"] + values["roll_effectiveness"] * d[[aileron]] + values["roll_gust"] * w
        )
        rate = p + values["gyro_elastic"] * q_dot[owner == aileron].sum(0)
    motion = np.vstack([d_dot, d_ddot, q_dot, q_ddot, p_dot, gust_dot])

    acceleration = displacement[: len(ACCELEROMETERS)] @ q_ddot
    felt = np.column_stack([tap_gains(s) for s in surfaces]) @ d
    pressure = felt + tap_gains("upwash")[:, None] * (w - displacement[len(ACCELEROMETERS) :] @ q_dot)
    C = np.vstack([np.vstack([acceleration, pressure])[sensors], rate, d])[:, :n]
    A, B = zero_order_hold(motion[:, :n], motion[:, n:-1], DT)
    Gd = sampled_noise(motion[:, :n], motion[:, -1:], DT)
    accelerometers = int((sensors < len(ACCELEROMETERS)).sum())
    widths = {
        "gust": n,
        "accelerometers": accelerometers,
        "taps": len(sensors) - accelerometers,
        "gyro": roll,
        "positions": ns,
    }
    return Dynamics(
        A,
        B,
        C,
        np.zeros((len(C), ns)),
        np.hstack([Gd, np.zeros((n, len(C)))]),
        np.hstack([np.zeros((len(C), n)), np.eye(len(C))]),
        {name: width for name, width in widths.items() if width},
        noise_states=2,
        stationary=True,
    )


def coherence(plant: Dynamics, surfaces: Sequence[str]) -> np.ndarray:
    """Return the coherence of every output with the commands, averaged over the band, at the levels of `EXCITED` and `NOISE`."""
    noisy = plant.scaled({name: NOISE[name].value for name in plant.sources})
    f = np.linspace(*BAND_HZ, 129)
    scale = np.array([EXCITED[s] for s in surfaces]) * np.sqrt(0.5 / DT / (BAND_HZ[1] - BAND_HZ[0]))
    signal, noise = (
        (np.abs(StateSpaceModel(noisy.A, B, noisy.C, D, DT).frf(f)) ** 2).sum(2)
        for B, D in ((noisy.B * scale, noisy.D * scale), (noisy.G, noisy.H))
    )
    return (signal / (signal + noise)).mean(0)


def strongest(plant: Dynamics, surfaces: Sequence[str], count: float) -> np.ndarray:
    """Return the indices of the `count` sensors with the highest coherence, in order, of a plant with all of them."""
    if count not in range(1, len(ALL) + 1):
        raise ExciteError(f"aeroelastic parameter 'outputs': {count:g}; give a whole number from 1 to {len(ALL)}")
    return np.sort(np.argsort(-coherence(plant, surfaces)[: len(ALL)], kind="stable")[: int(count)])
