"""The plant that is nothing but its numbers."""

from plants.arguments import NONE, Parameter
from plants.linear.described import Described

EXAMPLE = "assumption: an example, give your own"
LTI: dict[str, Parameter] = {
    "dt": Parameter(1.0, "s", EXAMPLE),
    "num": Parameter([1.0, 0.5], "1", f"{EXAMPLE}; descending powers of z, [[…], […]] for several outputs"),
    "den": Parameter([1.0, -1.5, 0.7], "1", f"{EXAMPLE}; descending powers of z"),
    "A": Parameter(NONE, "1", "rows of the discrete-time matrix; A, B, C, D replace num and den"),
    "B": Parameter(NONE, "1", "rows, one per state"),
    "C": Parameter(NONE, "1", "rows, one per output"),
    "D": Parameter(NONE, "1", "rows, one per output; none: zero"),
    "noise": Parameter(NONE, "1", "what shapes the output noise: {K}, {num, den} or {A, B, C, D}; none: white"),
    "controller": Parameter(
        NONE, "1", "{num, den}, {A, B, C, D} or {kp, ki, kd}; measured: names of outputs; sign: -1 or 1"
    ),
    "input_filter": Parameter(NONE, "1", "from a played signal to u: {num, den} or {A, B, C, D}; none: u is played"),
    "inputs": Parameter(NONE, "1", 'names with units, such as "flap [deg]"; none: u, or u1, u2, …'),
    "outputs": Parameter(NONE, "1", "names with units; none: y, or y1, y2, …"),
    "limits": Parameter([1000.0], "of input", "assumption: a linear plant has none; one number, or one per input"),
    "setpoint_limits": Parameter(
        [1000.0], "of output", "assumption: a linear plant has none; one number, or one per set-point"
    ),
}

lti = Described(
    "lti",
    "any linear discrete-time plant: matrices or a transfer function, shaped noise, a controller",
    {"example": LTI},
    {
        "example": {
            "process": Parameter(0.0, "of state", "assumption: white on every state, off unless given"),
            "input": Parameter(
                0.0, "of input", "assumption: white on every input, behind what is recorded, off unless given"
            ),
            "output": Parameter(0.1, "of output", "assumption: white on every output, through the filter `noise`"),
        }
    },
)
