"""The Goland wing: a uniform cantilever in bending and torsion in an air stream, up to its flutter speed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
from scipy.optimize import brentq, linear_sum_assignment

from excite.errors import ExciteError
from excite.numerics.matrices import zero_order_hold
from excite.types.channel import Channel
from plants.aeroelastic.turbulence import dryden_vertical, sampled_noise
from plants.arguments import Parameter, resolve
from plants.linear.loop import Dynamics
from plants.linear.plant import LinearPlant

GOLAND = "Goland 1945, J. Appl. Mech. 12(4), the flutter of a uniform cantilever wing; in SI units"
AIR = "standard atmosphere at sea level"

PRESETS: dict[str, dict[str, Parameter]] = {
    "goland": {
        "speed": Parameter(100.0, "m/s", "assumption: well below flutter; give another for each point of the envelope"),
        "density": Parameter(1.225, "kg/m3", AIR),
        "span": Parameter(6.096, "m", GOLAND),
        "chord": Parameter(1.8288, "m", GOLAND),
        "mass": Parameter(35.71, "kg/m", GOLAND),
        "inertia": Parameter(8.64, "kg m", f"{GOLAND}; about the elastic axis"),
        "elastic_axis": Parameter(0.33, "chord", f"{GOLAND}; from the leading edge"),
        "mass_axis": Parameter(0.43, "chord", f"{GOLAND}; from the leading edge"),
        "bending_stiffness": Parameter(9.77e6, "N m2", GOLAND),
        "torsional_stiffness": Parameter(0.987e6, "N m2", GOLAND),
        "damping": Parameter(0.005, "1", "assumption: structural, of every mode without air", "non-negative"),
        "shaker_span": Parameter(1.0, "span", "assumption: shaker at the tip"),
        "shaker_chord": Parameter(
            0.6, "chord", "assumption: behind the elastic axis, so that it bends and twists", "any"
        ),
        "turbulence_length": Parameter(533.0, "m", "MIL-F-8785C: scale of Dryden turbulence at altitude"),
    }
}
NOISE_SOURCES = {
    "gust": Parameter(0.1, "m/s", "assumption: Dryden vertical gust in calm air, the same along the span"),
    "measurement": Parameter(0.05, "m/s2", "assumption: white, on each accelerometer"),
}
FORCE = 200.0  # N, an assumption: 0.1 g of the wing's mass
DT = 0.002  # s: 500 Hz, above twice the fastest mode (149 Hz without air)
SENSORS = {
    "mid_front": (0.5, 0.1),
    "mid_rear": (0.5, 0.9),
    "tip_front": (1.0, 0.1),
    "tip_rear": (1.0, 0.9),
}  # span, chord
MODES = 3  # of bending, and of torsion
# Of the uncoupled modes, in radians over the span: roots of cos b cosh b = -1, and odd multiples of pi / 2.
WAVE_NUMBERS = np.array(
    [1.8751040687119611, 4.694091132974175, 7.854757438237613, np.pi / 2, 3 * np.pi / 2, 5 * np.pi / 2]
)
# Jones (1940), NACA Report 681: Wagner's function is 1 - sum_i LAG_SHARES_i exp(-LAG_RATES_i s), s in semi-chords travelled.
LAG_SHARES, LAG_RATES = np.array([0.165, 0.335]), np.array([0.0455, 0.3])
SEARCHED = np.arange(2.0, 1000.0, 2.0)  # m/s, where flutter is looked for, and steps along which modes are followed


@dataclass(frozen=True, eq=False)
class Wing:
    """M q'' + D q' + K q = Q without air, for q = (3 bending, 3 torsion) coordinates.

    Plunge h = bend q is positive down, pitch p = twist q about the elastic axis nose up; bend, twist (points, 6) are the
    wing's own uncoupled modes at the points of a Gauss rule over the span, weights (points,) its weights in m.
    """

    values: Mapping[str, float]
    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    bend: np.ndarray
    twist: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, parameters: Mapping[str, Parameter]) -> "Wing":
        """Return the wing of a set of parameters."""
        v = {name: parameter.value for name, parameter in parameters.items()}
        points, weights = np.polynomial.legendre.leggauss(32)
        bend, twist = _shapes((points + 1) / 2)
        weights = weights * v["span"] / 2
        hh, ht, tt = _integrals(bend, twist, weights)
        static = v["mass"] * (v["mass_axis"] - v["elastic_axis"]) * v["chord"]
        M = v["mass"] * hh + static * (ht + ht.T) + v["inertia"] * tt
        k = WAVE_NUMBERS / v["span"]
        K = np.diag(v["bending_stiffness"] * k**4 * np.diag(hh) + v["torsional_stiffness"] * k**2 * np.diag(tt))
        try:
            squares, X = la.eigh(K, M)
        except la.LinAlgError:
            raise ExciteError(
                f"goland parameter 'inertia': {v['inertia']:g} kg m about the elastic axis is less than that of the mass "
                "concentrated at its own axis; raise it, or bring mass_axis and elastic_axis together"
            ) from None
        D = M @ (X * 2 * v["damping"] * np.sqrt(squares)) @ X.T @ M
        return cls(v, M, D, K, bend, twist, weights)

    def rise(self, span: float, chord: float) -> np.ndarray:
        """Return the upward displacement of a point, given as fractions of span and chord, per coordinate (6,)."""
        bend, twist = _shapes(np.array([span]))
        return -(bend + (chord - self.values["elastic_axis"]) * self.values["chord"] * twist)[0]

    def in_air(self, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Return A (24, 24) and B (24, 7) of x' = A x + B (Q; upward gust) at an air speed in m/s; x = (q, q', z_1, z_2).

        Strip theory after Theodorsen (1935, NACA Report 496); per span, b the semi-chord, a b from mid-chord back to the
        elastic axis:

            lift   = pi rho b^2 (h'' + U p' - b a p'') + 2 pi rho U b W
            moment = pi rho b^2 (b a h'' - U b (1/2 - a) p' - b^2 (1/8 + a^2) p'') + 2 pi rho U b^2 (1/2 + a) W

        W follows the downwash w = h' + U p + b (1/2 - a) p' by Wagner's function: W = w / 2 + sum_i s_i r_i z_i,
        z_i' = w - r_i z_i, r_i = LAG_RATES_i U / b, s_i = LAG_SHARES_i, with z_i kept by coordinate. A gust, the same along
        the span, adds to W at once: an assumption, as it is only a disturbance.
        """
        v, U = self.values, speed
        rho, b, a, n = v["density"], v["chord"] / 2, 2 * v["elastic_axis"] - 1, 2 * MODES
        hh, ht, tt = _integrals(self.bend, self.twist, self.weights)
        added = np.pi * rho * b**2
        M = self.M + added * (hh - b * a * (ht + ht.T) + b**2 * (1 / 8 + a**2) * tt)
        D = self.D + added * U * (ht + b * (1 / 2 - a) * tt)
        # Circulation acts at the quarter chord, (1/2 + a) b before the elastic axis.
        felt = 2 * np.pi * rho * U * b * (self.bend - b * (1 / 2 + a) * self.twist).T * self.weights
        lift, gust = felt @ (self.bend + self.twist), felt.sum(axis=1, keepdims=True)
        by_place = np.diag(np.repeat([0.0, U], MODES))  # what q and q' add to w, coordinate by coordinate
        by_rate = np.diag(np.repeat([1.0, b * (1 / 2 - a)], MODES))
        rates = LAG_RATES * U / b
        force = np.hstack(
            [-self.K - lift @ by_place / 2, -D - lift @ by_rate / 2, *np.multiply.outer(-LAG_SHARES * rates, lift)]
        )
        A, B = np.zeros((4 * n, 4 * n)), np.zeros((4 * n, n + 1))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n], B[n : 2 * n] = np.split(la.solve(M, np.hstack([force, np.eye(n), -gust])), [4 * n], axis=1)
        A[2 * n :, : 2 * n] = np.tile(np.hstack([by_place, by_rate]), (2, 1))
        A[2 * n :, 2 * n :] = np.diag(-np.repeat(rates, n))
        return A, B

    def growth(self, speed: float) -> complex:
        """Return the rightmost pole at a speed, rad/s."""
        poles = la.eigvals(self.in_air(speed)[0])
        return complex(poles[np.argmax(poles.real)])

    def flutter(self) -> tuple[float, float]:
        """Return the speed from which the wing is unstable and its frequency there, see `flutter`."""
        below = 0.01
        for speed in SEARCHED:
            if self.growth(speed).real > 0:
                critical = brentq(lambda U: self.growth(U).real, below, speed)
                return critical, abs(self.growth(critical).imag)
            below = speed
        return np.inf, np.nan


def flutter(parameters: Mapping[str, Any] | None = None) -> tuple[float, float]:
    """Return the speed in m/s from which the wing is unstable, and its frequency there in rad/s (0: divergence).

    parameters : overrides as of `goland`. (inf, nan) when it is stable up to 1000 m/s.
    """
    return Wing.of(resolve("goland", PRESETS, "goland", parameters or {})).flutter()


def modes(speeds: Sequence[float], parameters: Mapping[str, Any] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return natural frequency |s| / 2 pi in Hz and damping -Re s / |s| of the six modes at each speed, (S, 6): V-f and V-g.

    Modes are followed from standstill and keep their column, in the order of their frequencies there. A mode that no
    longer oscillates shows one of its two poles, with damping 1 or -1.

    speeds : m/s, positive, in any order; parameters : overrides as of `goland`.
    """
    wing = Wing.of(resolve("goland", PRESETS, "goland", parameters or {}))
    asked = np.asarray(speeds, float)
    if asked.ndim != 1 or not asked.size or not (np.isfinite(asked) & (asked > 0)).all():
        raise ExciteError(f"goland speeds: {asked.tolist()}; give a list of positive speeds in m/s")
    path = np.unique(np.concatenate([SEARCHED[SEARCHED < asked.max()], asked]))
    followed: list[np.ndarray] = []
    for speed in path:
        poles = la.eigvals(wing.in_air(speed)[0])
        poles = poles[poles.imag >= 0]
        now = (
            linear_sum_assignment(np.abs(followed[-1][:, None] - poles))[1]
            if followed
            else np.argsort(poles.imag)[-2 * MODES :]
        )
        followed.append(poles[now])
    s = np.array(followed)[np.searchsorted(path, asked)]
    return np.abs(s) / (2 * np.pi), -s.real / np.abs(s)


def goland(preset: str = "goland", parameters: Mapping[str, Any] | None = None) -> LinearPlant:
    """Return the wing at one air speed: shaker force [N] -> upward accelerations [m/s2] at four places.

    24 states besides the noise: six modes, and two lags of the circulation for each coordinate. The truth is exact for a
    force held over each sample; accelerometers feel the force at once (D is not zero). Dryden turbulence, exactly sampled,
    has been blowing before the record begins. From the flutter speed on the wing is refused.
    """
    found = resolve("goland", PRESETS, preset, parameters or {})
    wing = Wing.of(found)
    v, (critical, frequency) = wing.values, wing.flutter()
    onset = f"{f'flutter at {frequency:.3g} rad/s' if frequency else 'divergence'} sets in at {critical:.4g} m/s"
    if v["speed"] >= critical:
        raise ExciteError(f"goland parameter 'speed': {v['speed']:g} m/s; {onset} and breaks the wing: give less")
    A, B = wing.in_air(v["speed"])
    air, white, gust = dryden_vertical(v["speed"], v["turbulence_length"])
    n, m, ny = len(A), 2 * MODES, len(SENSORS)
    A = np.block([[A, B[:, m:] @ gust], [np.zeros((len(air), n)), air]])
    G = sampled_noise(A, np.vstack([np.zeros((n, 1)), white]), DT)
    force = np.zeros((len(A), 1))
    force[:n, 0] = B[:, :m] @ wing.rise(v["shaker_span"], v["shaker_chord"])
    held, held_force = zero_order_hold(A, force, DT)
    accelerations = np.array([wing.rise(*place) for place in SENSORS.values()]) @ np.hstack([A, force])[m : 2 * m]
    # Displacements and velocities differ by the modes' frequencies; filters are computed better in equal units.
    balanced, (unit, _) = la.matrix_balance(held, permute=False, separate=True)
    return LinearPlant(
        name="goland",
        description="Goland wing: cantilever in bending and torsion with unsteady strip-theory air forces, tip shaker",
        dt=DT,
        dynamics=Dynamics(
            balanced,
            held_force / unit[:, None],
            accelerations[:, :-1] * unit,
            accelerations[:, -1:],
            np.hstack([G / unit[:, None], np.zeros((len(G), ny))]),
            np.hstack([np.zeros((ny, len(G))), np.eye(ny)]),
            {"gust": len(G), "measurement": ny},
            noise_states=len(air),
            stationary=True,
        ),
        inputs=(Channel("force", "N"),),
        outputs=tuple(Channel(f"acc_{name}", "m/s2") for name in SENSORS),
        limits=((-FORCE, FORCE),),
        parameters=found,
        noise_sources=NOISE_SOURCES,
        preset=preset,
        note=f"shaker force, upward; the limit is an assumption; {onset}",
        make=goland,
    )


def _shapes(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the shapes of bending and of torsion (N, 6) at fractions x (N,) of the span, zero for the other kind."""
    beam, shaft = x[:, None] * WAVE_NUMBERS[:MODES], x[:, None] * WAVE_NUMBERS[MODES:]
    k = WAVE_NUMBERS[:MODES]
    ratio = (np.cosh(k) + np.cos(k)) / (np.sinh(k) + np.sin(k))
    bend = np.cosh(beam) - np.cos(beam) - ratio * (np.sinh(beam) - np.sin(beam))
    none = np.zeros_like(bend)
    return np.hstack([bend, none]), np.hstack([none, np.sin(shaft)])


def _integrals(bend: np.ndarray, twist: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the integrals over the span of bend bend, bend twist and twist twist, (6, 6) each."""
    return (bend.T * weights) @ bend, (bend.T * weights) @ twist, (twist.T * weights) @ twist
