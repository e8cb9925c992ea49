"""Crest factors and times beside Schroeder's phases and the clipping algorithm, in one run (`-m bench -s`).

Crest factors are on 16 points per period of the highest line; `bound` holds over continuous time. Times are wall seconds
(CPU seconds in brackets); the limit is the time given to the search, and the aim what it must reach.
"""

from time import perf_counter, process_time

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from excite.generators import crest
from excite.generators.multisine import multisine
from excite.models.state_space import StateSpaceModel

pytestmark = pytest.mark.bench


def odd_random():
    """110 odd lines, one in four left out."""
    return np.array(
        multisine(dt=0.01, period_s=10.24, band_hz=(0, 28.6), spacing="odd-random", phases="random").recipe["decided"][
            "lines"
        ][0]
    )


FLAT = {
    "31": np.arange(1, 32),
    "100": np.arange(1, 101),
    "330": np.arange(1, 331),
    "3300": np.arange(1, 3301),
    "31 odd": np.arange(1, 62, 2),
    "110 odd-random": odd_random,
    "26 log, 1-400": np.geomspace(1, 400, 30),
}
# lines, seconds given, crest factor to reach
CASES = [
    ("31", 1, 1.40),
    ("31", 60, 1.37),
    ("100", 2, 1.41),
    ("100", 20, 1.38),
    ("330", 10, 1.39),
    ("3300", 4, 1.44),
    ("31 odd", 10, 1.38),
    ("110 odd-random", 3, 1.50),
    ("26 log, 1-400", 5, 2.1),
]


def timed(run):
    wall, cpu = perf_counter(), process_time()
    result = run()
    return result, perf_counter() - wall, process_time() - cpu


def test_flat_multisines():
    print(
        "\nlines            schroeder  clipping     s   limit     aim  excite   bound  starts       s (cpu)  ratio to clipping"
    )
    missed = []
    for name, limit, aim in CASES:
        lines = FLAT[name]() if callable(FLAT[name]) else np.unique(FLAT[name].round().astype(int))
        flat = np.ones(len(lines))
        start = crest.schroeder(lines, flat)
        clipped, seconds, _ = timed(lambda l=lines, a=flat, p=start: crest.clipping(l, a, p))
        found, wall, cpu = timed(lambda l=lines, a=flat, t=limit: crest.optimise(l, a, time_limit_s=t))
        first, anchor = (crest.crest_factor(lines, flat, p)[0] for p in (start, clipped))
        print(
            f"{name:16} {first:9.3f} {anchor:9.3f} {seconds:5.2f} {limit:7} {aim:7.2f} {found.crest[0]:7.4f}"
            f" {crest.crest_bound(lines, flat, found.phases)[0]:7.4f} {found.starts:7} {wall:7.2f} ({cpu:.2f})"
            f" {found.crest[0] / anchor:12.3f}"
        )
        if found.crest[0] > aim:
            missed.append(name)
    assert not missed


def test_joint_input_output():
    blocks = []
    for f_hz, damping in ((2.0, 0.05), (6.0, 0.03)):
        w = 2 * np.pi * f_hz
        blocks.append(expm(np.array([[0, 1, 0], [-w * w, -2 * damping * w, w * w], [0, 0, 0]]) * 0.01))
    A, B = block_diag(*(b[:2, :2] for b in blocks)), np.vstack([b[:2, 2:] for b in blocks])
    plant = StateSpaceModel(A, B, [[1.0, 0, 0.5, 0]], [[0.0]], 0.01)
    print("\n100 lines through two modes   input  output       s (cpu)")
    for name, form in (("schroeder", {"phases": "schroeder"}), ("optimal", {"time_limit_s": 2.0})):
        s, wall, cpu = timed(lambda f=form: multisine(dt=0.01, period_s=10.24, band_hz=(0.05, 9.8), model=plant, **f))
        worst = s.recipe["crest_factor"] + s.recipe["output_crest_factor"]
        print(f"{name:28} {worst[0]:7.3f} {worst[1]:7.3f} {wall:7.2f} ({cpu:.2f})")
    assert max(worst) <= 1.54


def test_relative_peak_factors():
    print("\nrelative peak factor           limit    aim  largest  each                        s (cpu)")
    for lines, channels, limit, aim in ((31, 1, 1.0, 1.0), (36, 3, 1.0, 1.12), (36, 3, 10.0, 1.12)):
        s, wall, cpu = timed(
            lambda l=lines, c=channels, t=limit: multisine(
                dt=0.01, period_s=5.12, lines=list(range(1, l + 1)), channels=c, time_limit_s=t
            )
        )
        peaks = s.recipe["relative_peak_factor"]
        each = " ".join(f"{p:.3f}" for p in peaks)
        print(
            f"{lines:3} lines, {channels} channels {limit:14} {aim:6.2f} {max(peaks):8.3f}  {each:24} {wall:7.2f} ({cpu:.2f})"
        )
        assert max(peaks) <= aim
