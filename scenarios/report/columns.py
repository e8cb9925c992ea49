"""The columns of the ranking table: what they show, in which unit, and what they cannot tell."""

import re
from dataclasses import dataclass

from excite.words import number
from scenarios.run.results import ViewResult

HORIZON = re.compile(r"fit_(clean_)?(\d+)_step")


@dataclass(frozen=True)
class Column:
    """One metric of the ranking table: header, factor to the header's unit, decimals (None: three digits).

    quartiles : show [q25 q75] behind the median; compact : also in the terminal.
    """

    metric: str
    header: str
    scale: float = 1.0
    decimals: int | None = None
    quartiles: bool = False
    compact: bool = False


COLUMNS = (
    Column("pole_error_max", "pole error max [%]", 100, quartiles=True, compact=True),
    Column("pole_error_frequency_percent", "frequency error [%]", compact=True),
    Column("pole_error_damping", "damping error [–]", compact=True),
    Column("pole_error_time_constant_percent", "time-constant error [%]"),
    Column("pole_error_integrator_rad_s", "integrator error [rad/s]"),
    Column("pole_error_z_max", "|dλ| max [–]"),
    Column("frf_error_h2", "FRF error H2 [%]", 100, quartiles=True, compact=True),
    Column("frf_error_peak", "FRF error peak [%]", 100),
    Column("fit_simulation", "fit simulation, measured [%]", decimals=2, compact=True),
    Column("fit_clean", "fit simulation, noise-free [%]", decimals=2, compact=True),
    Column("fit_below_floor", "below floor [points]", decimals=2, compact=True),
    Column("fit_one_step", "fit one step [%]", decimals=2, compact=True),
    Column("vaf_simulation", "VAF simulation [%]", decimals=2, compact=True),
)
SHORT = {
    "pole_error_max": "pole max %",
    "pole_error_frequency_percent": "freq %",
    "pole_error_damping": "damping",
    "frf_error_h2": "FRF H2 %",
    "fit_simulation": "fit sim %",
    "fit_clean": "fit clean %",
    "fit_one_step": "1-step %",
    "fit_below_floor": "below floor",
    "vaf_simulation": "VAF sim %",
}


def columns_of(view: ViewResult, compact: bool = False) -> tuple[list[Column], list[str]]:
    """Return the columns of a view, its further prediction horizons among them, and their headers.

    compact : only those that fit a terminal, under short headers.
    """
    metrics = {m for row in view.rows for s in row.scores for m in s.values}
    found = sorted((int(m[2]), m[1] or "", m[0]) for name in metrics if (m := HORIZON.fullmatch(name)))
    columns, shorts = list(COLUMNS), dict(SHORT)
    for steps, clean, metric in found:
        ahead = f"{steps * view.dt * 1e3:.4g} ms"
        columns.append(
            Column(metric, f"fit {ahead} ahead{', noise-free' * bool(clean)} [%]", decimals=2, compact=bool(clean))
        )
        shorts[metric] = f"{ahead} clean"
    if compact:
        columns = [c for c in columns if c.compact]
    return columns, [shorts[c.metric] if compact else c.header for c in columns]


# (metric, what it tells, what it cannot tell)
LEGEND = (
    (
        "pole error max",
        "Distance of the worst matched pole in the s-plane, relative to the true pole; a missing pole counts 100 %.",
        "Whether residues and zeros are right. With surplus poles the match is generous: the best are chosen.",
    ),
    (
        "frequency, damping, time-constant, integrator error",
        "In engineering terms: worst oscillatory pair, worst real pole, distance of integrators from s = 0.",
        "How much it matters: a heavily damped pole may be far off and hardly change the response.",
    ),
    (
        "|dλ| max",
        "Worst distance of matched poles in the z-plane.",
        "Much on its own: with fast sampling all poles crowd at z = 1 and every distance looks small.",
    ),
    (
        "FRF error H2, peak",
        "Error of the frequency response over the band: in the mean square, and at the worst frequency.",
        "Anything outside the band. Large responses govern H2, small ones the peak.",
    ),
    (
        "fit simulation, measured",
        "How well the measured validation output is simulated from its input alone (unlimited horizon).",
        "Which model is nearer the truth: noise bounds it, and in closed loop the input carries the noise, so that "
        "fit against measured closed-loop output rewards bias. It is not used for ranking unless the scenario asks.",
    ),
    (
        "noise-free fits; below floor",
        "The same on the noise-free twin of that run, and how far it stays below the fit of the linearised truth "
        "itself (the linearisation floor): by simulation, or at the longest horizon where the truth integrates.",
        "How the model does at other amplitudes: the floor belongs to this run. Below zero means that the model suits "
        "this amplitude better than the small-signal truth does.",
    ),
    (
        "fit one step, fit … ms ahead",
        "Prediction from the outputs measured up to that horizon.",
        "Whether the dynamics are right: with fast sampling the next output is nearly the last, and a poor model fits.",
    ),
    (
        "VAF simulation",
        "Variance accounted for by the simulation.",
        "Offsets, which a variance does not see; near 100 % it tells models apart less well than the fit.",
    ),
    ("[q25 q75]", "Quartiles over the estimation runs.", "Errors that all runs share, such as bias or a wrong order."),
)


def complex_text(s: complex) -> str:
    """Return a pole as text, with ± for the pair."""
    real = number(s.real).replace("-", "−")
    return real if abs(s.imag) < 1e-9 * max(abs(s), 1e-12) else f"{real} ± {number(abs(s.imag))}j"
