"""Where the aircraft's 94 sensors sit, how its modes move those places, and what the taps feel. All of it is assumed.

Places: span station eta from 0 (root) to 1 (tip), chord station xi -1 (front), 0, +1 (rear), side -1 (left), +1 (right).
"""

import numpy as np

CHORD = {"front": -1.0, "mid": 0.0, "rear": 1.0}
SIDES = {"left": -1.0, "right": 1.0}
FUSELAGE = (
    "nose_vertical",
    "nose_lateral",
    "cg_vertical",
    "cg_lateral",
    "aft_vertical",
    "aft_lateral",
    "stabilator_left_vertical",
    "stabilator_right_vertical",
    "fin_left_lateral",
    "fin_right_lateral",
)
SPAN = 8  # accelerometer stations of a wing
TAP_SPAN = 3  # stations of pressure taps of a wing

WING = [(side, k, chord) for side in SIDES for k in range(1, SPAN + 1) for chord in CHORD]
TAPS = [
    (side, k, face, chord)
    for side in SIDES
    for k in range(1, TAP_SPAN + 1)
    for face in ("top", "bottom")
    for chord in CHORD
]
ACCELEROMETERS = tuple(f"acc_{side}_{k}_{chord}" for side, k, chord in WING) + tuple(f"acc_{name}" for name in FUSELAGE)
PRESSURES = tuple(f"tap_{side}_{k}_{face}_{chord}" for side, k, face, chord in TAPS)

# Shapes of a mode are sums of: bending 1 to 3 of the wing (clamped beam, 1 at the tip), torsion 1 and 2 (1 at the tip's
# rear edge), and motion of the fuselage, of the stabilators and fins.
BEAM = (1.875104, 4.694091, 7.854757)  # roots of cos b cosh b = -1
SHAPES = {
    "symmetric": np.array(
        [
            [1.0, 0.0, 0.0, 0.1, 0.0, 0.10, 0.2],  # first wing bending
            [0.1, 0.2, 0.0, 0.8, 0.0, 0.05, 0.1],  # wing torsion
            [0.0, 1.0, 0.1, 0.2, 0.1, 0.20, 0.3],  # second wing bending
        ]
    ),
    "antisymmetric": np.array(
        [
            [0.5, 0.0, 0.0, 0.1, 0.0, 0.60, 0.6],  # fuselage bending
            [1.0, 0.1, 0.0, 0.1, 0.0, 0.10, 0.1],  # wing bending
            [0.3, 0.3, 0.0, 0.2, 0.0, 0.10, 1.0],  # stabilators and fins
            [0.1, 0.2, 0.0, 0.9, 0.1, 0.05, 0.1],  # wing torsion
            [0.1, 0.9, 0.1, 0.2, 0.1, 0.10, 0.2],  # second wing bending
            [0.0, 0.2, 0.5, 0.3, 0.6, 0.05, 0.1],  # outer wing
        ]
    ),
}
FELT = {  # Pa for a degree of a surface, or for 1 m/s of upwash; the top feels suction, the bottom half as much pressure
    "flap": {"front": 90.0, "mid": 15.0, "rear": 5.0},
    "aileron": {"front": 5.0, "mid": 20.0, "rear": 60.0},
    "upwash": {"front": 60.0, "mid": 25.0, "rear": 10.0},
}
FUSELAGE_MOTION = {"nose": 1.0, "cg": -0.1, "aft": 0.2}


def shapes(family: str) -> np.ndarray:
    """Return the displacement of every sensor's place per modal coordinate, (94, modes); a tap's is that of the wing there."""
    odd = family == "antisymmetric"
    eta = np.array([k / SPAN for _, k, _ in WING] + [k / TAP_SPAN for _, k, _, _ in TAPS])
    xi = np.array([CHORD[chord] for _, _, chord in WING] + [CHORD[chord] for _, _, _, chord in TAPS])
    sides = [side for side, *_ in WING] + [side for side, *_ in TAPS]
    side = np.array([SIDES[side] if odd else 1.0 for side in sides])
    wing = np.column_stack(
        [*(bending(root, eta) for root in BEAM), *(np.sin(k * np.pi * eta / 2) * xi for k in (1, 3))]
    )
    wing = np.hstack([side[:, None] * wing, np.zeros((len(eta), 2))])
    body = np.zeros((len(FUSELAGE), wing.shape[1]))
    for row, name in zip(body, FUSELAGE, strict=True):
        where, *which = name.split("_")
        if where in FUSELAGE_MOTION:
            row[5] = FUSELAGE_MOTION[where] * (which == ["lateral" if odd else "vertical"])
        else:
            row[6] = SIDES[which[0]] if odd == (which[1] == "vertical") else 1.0
    return np.vstack([wing[: len(WING)], body, wing[len(WING) :]]) @ SHAPES[family].T


def tap_gains(surface: str) -> np.ndarray:
    """Return what each tap feels of "flap" or "aileron" [Pa/deg], or of "upwash" [Pa per m/s], (36,)."""
    gains = np.empty(len(TAPS))
    for i, (side, k, face, chord) in enumerate(TAPS):
        gains[i] = FELT[surface][chord] * (-1.0 if face == "top" else 0.5)
        if surface == "aileron":  # at the outer wing, and up on one side as it goes down on the other
            gains[i] *= SIDES[side] * (k / TAP_SPAN) ** 2
    return gains


def bending(root: float, eta: np.ndarray) -> np.ndarray:
    """Return a bending mode of a clamped beam, 1 at the tip."""
    ratio = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))

    def shape(x: np.ndarray) -> np.ndarray:
        return np.cosh(root * x) - np.cos(root * x) - ratio * (np.sinh(root * x) - np.sin(root * x))

    return shape(eta) / shape(np.ones(1))
