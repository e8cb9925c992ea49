"""Missing samples split records: what is kept, what the estimate says, and when it is too little."""

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import ExciteError, Unsupported
from excite.types.experiment import Experiment
from identify.data.gaps import gap_free
from identify.data.records import Records
from identify.examples import series as example
from identify.fit import fit, unsupported
from identify.metrics.impulse import impulse_error
from identify.registry import load_method

METHODS = [
    "arx",
    "cva",
    "iem",
    "moesp",
    "n4sid",
    "parsim_k",
    "pbsid",
    "pi_moesp",
    "po_moesp",
    "ssarx",
    "ssinnov1",
    "ssinnov2",
    "wfa",
]


def with_gaps(data, u=(), y=()):
    """The record with the named samples of its last input and last output missing."""
    us, ys = data.u.copy(), data.y.copy()
    us[list(u), -1] = np.nan
    ys[list(y), -1] = np.nan
    return replace(data, u=us, y=ys)


@pytest.mark.parametrize("name", METHODS)
def test_a_gap_is_as_good_as_two_records(name):
    """Bit for bit, whichever channel misses which sample; the initial state is that of the record."""
    data, truth = example()
    order = 2 if name == "arx" else 4
    split = fit(with_gaps(data, u=[701], y=[700, 702]), name, order)
    two = fit((data.window(0, 700), data.window(703)), name, order)
    assert split.model.impulse(40).tobytes() == two.model.impulse(40).tobytes()
    assert len(split.x0) == 1 and split.x0[0].tobytes() == two.x0[0].tobytes() and len(two.x0) == 2
    assert impulse_error(split.model, truth) < 0.1


def test_the_estimate_says_what_the_gaps_cost():
    data, _ = example()
    estimate = fit((with_gaps(data, u=[0, 1], y=[1, 700, 710]), data), "po_moesp", 4)
    parts = [(2, 700), (711, 1500), (0, 1500)]  # 701 to 709 are fewer than 40
    columns = sum(b - a - 39 for a, b in parts)
    assert estimate.warnings == (
        f"4 of 3000 samples are incomplete (NaN): 3 gap-free parts, {columns} Hankel columns of 40 samples left; "
        "initial state: that of record 0 is the state at its sample 2",
    )
    assert len(estimate.x0) == 2
    first, second = data.window(2, 700), data.window(711)
    apart = fit((first, second, data), "po_moesp", 4)
    assert [x.tobytes() for x in estimate.x0] == [apart.x0[0].tobytes(), apart.x0[2].tobytes()]
    assert fit(data, "po_moesp", 4).warnings == ()


def test_too_little_left_is_refused_with_what_is_needed():
    data, _ = example()
    holes = with_gaps(data, y=range(0, 1500, 30))
    with pytest.raises(
        Unsupported, match=r"need 160 Hankel columns, but the data leave 0 in 50 gap-free parts; the largest"
    ):
        fit(holes, "ssarx", 4)
    with pytest.raises(ExciteError, match=r"record 1: each of its 1500 samples misses a value"):
        fit((data, with_gaps(data, u=range(1500))), "n4sid", 4)
    with pytest.raises(
        ExciteError, match=r"order 12 is above the largest possible, 11"
    ):  # 3 (30 - 12) columns of 12 rows
        fit(holes.window(0, 90), "arx", 12)


def test_parts_are_the_longest_stretches():
    data = Experiment(np.arange(12.0), np.arange(12.0), dt=0.5)
    assert gap_free((data,), 5).parts == (data,)
    holes = with_gaps(data, u=[4], y=[0, 5, 9])
    kept = gap_free((holes,), 3)
    assert [part.u[:, 0].tolist() for part in kept.parts] == [[1, 2, 3], [6, 7, 8]]
    assert (kept.first, kept.start, kept.samples, kept.missing) == ((0,), (1,), 12, 4)
    assert kept.parts[1].time_s[0] == 3.0
    longest = gap_free((data, holes, data), 7)  # no part is as long: the longest stays
    assert [len(part) for part in longest.parts] == [12, 3, 3, 12] and longest.first == (0, 1, 3)


def test_methods_that_cannot_take_gaps_name_them():
    data, _ = example()
    reason = unsupported(load_method("ho_kalman"), Records.of((data, with_gaps(data, y=[3]))))
    assert reason.startswith("record 1: sample 3 of channel 'y2' is missing (NaN), 1 in all; fill them")


def test_gaps_without_noise_leave_the_estimate_exact():
    data, truth = example(noise=0.0)
    for name in ("po_moesp", "n4sid", "ssarx"):
        model = fit(with_gaps(data, u=[300], y=range(800, 812)), name, 4).model
        assert impulse_error(model, truth) < 1e-8
