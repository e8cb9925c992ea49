"""What the recipe of a multisine says of its waveform: crest factors and their bounds, and warnings."""

from collections.abc import Mapping

import numpy as np

import excite.generators.crest as crest
from excite.generators.line_phases import Frame


def figures(
    lines: list[np.ndarray], amplitudes: list[np.ndarray], phases: list[np.ndarray], frame: Frame
) -> dict[str, list]:
    """Return the figures of every channel, the worst of its experiments, and of every output of the model."""
    keys = ("crest_factor", "crest_factor_bound", "peak_bound", "relative_peak_factor", "chirp_likeness")
    report: dict[str, list] = {key: [] for key in (*keys, "output_crest_factor")}
    turns = frame.rotations
    for l, a, phi in zip(lines, amplitudes, phases, strict=True):
        bound = max(crest.crest_bound(l, a * turn, phi)[0] for turn in turns)
        figures = (
            crest.crest_factor(l, a * turns, phi).max(),
            bound,
            bound * a.max() * np.sqrt(((a / a.max()) ** 2).sum() / 2),
            crest.relative_peak_factor(l, a * turns, phi).max(),
            crest.chirp_likeness(l, a, phi),
        )
        for key, value in zip(keys, figures, strict=True):
            report[key].append(None if value is None else float(value))
    if frame.model is not None:
        union = np.unique(np.concatenate(lines))
        dense = np.zeros((len(lines), len(union)), complex)
        for c, (l, a, phi) in enumerate(zip(lines, amplitudes, phases, strict=True)):
            dense[c, np.searchsorted(union, l)] = a * np.exp(1j * phi)
        outputs = np.einsum("kjc,ec,ck->jek", frame.model.frf(union / (frame.size * frame.dt)), frame.mixing, dense)
        report["output_crest_factor"] = [
            float(crest.crest_factor(union, y, np.zeros(len(union))).max()) for y in outputs
        ]
    return report


def warnings_of(decided: Mapping, report: Mapping, frame: Frame, target: float | None, count: int | None) -> list[str]:
    """Return what to tell the user: a target missed, transients that are played, lines that fell together."""
    warnings = []
    worst = max(report["crest_factor"] + report["output_crest_factor"])
    if target is not None and worst > target:
        effort = f"{decided['starts']} starts and {decided['seconds']:g} s"
        remedy = "allow more starts or time, or play more lines" if decided["starts"] else "use phases = 'optimal'"
        warnings.append(
            f"crest factor {worst:.4f} misses the target {target:g} after {effort}, the best found; {remedy}"
        )
    if len(frame.mixing) > 1 and frame.periods == 1:
        warnings.append(
            "each experiment plays one period, which holds the transient from the one before; play two or more"
        )
    played = len(set().union(*decided["lines"]))
    if count is not None and played < count:
        warnings.append(f"{count} lines were asked for, {played} remain after rounding; lengthen the period")
    return warnings
