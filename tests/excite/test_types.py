"""The types that travel: validated once, read-only, errors that name place, value and remedy."""

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.models.state_space import StateSpaceModel
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.recording import Recording, Roles
from excite.types.signal import Signal
from excite.types.truth import Truth


def recording(**options):
    t = np.arange(6) * 0.5
    values = np.column_stack([t, t**2, -t])
    roles = {"a": Roles(("u1",), ("y1", "y2"), every=2), "b": Roles(("u1",), ("y1",), ("y2",), closed=True)}
    given = {"dt": 0.5, "views": roles, "default": "a", "period": 4, "loop": Loop("closed")} | options
    return Recording(t, values, ("u1 [V]", "y1 [m]", "y2"), **given)


def test_plain_arrays_become_an_experiment():
    data = Experiment([1, 2, 3], [[1, 2], [3, 4], [5, 6]], dt=0.1)
    assert data.u.shape == (3, 1) and data.y.shape == (3, 2) and len(data) == 3
    assert [c.name for c in data.inputs + data.outputs] == ["u1", "y1", "y2"]
    np.testing.assert_allclose(data.time_s, [0, 0.1, 0.2])
    assert not data.loop.closed


@pytest.mark.parametrize("key", ["u", "y", "time_s"])
def test_arrays_are_read_only_copies(key):
    source = np.ones((3, 1)) * np.arange(3)[:, None]
    data = Experiment(source, source, dt=1.0)
    with pytest.raises(ValueError, match="read-only"):
        getattr(data, key)[0] = 9
    source[0] = 7
    assert data.u[0, 0] == 0


def test_missing_samples_are_allowed_in_experiments_and_not_in_signals():
    assert np.isnan(Experiment([1, np.nan], [1, 2], dt=1.0).u[1, 0])
    with pytest.raises(ExciteError, match=r"Signal\.u: sample 1, column 0 is nan; every value must be finite"):
        Signal([1, np.nan], 1.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Experiment([1, np.inf], [1, 2], dt=1.0), r"Experiment\.u: sample 1, column 0 is inf"),
        (lambda: Experiment([1, 2], [1, 2, 3], dt=1.0), r"Experiment\.y: 3 samples, but u has 2"),
        (lambda: Experiment([], [], dt=1.0), r"Experiment\.u: shape \(0, 1\)"),
        (lambda: Experiment([1j], [1], dt=1.0), r"Experiment\.u: values of type complex128 are not real"),
        (lambda: Experiment([1], [1]), "give dt in seconds, or time_s"),
        (lambda: Experiment([1], [1], dt=-1.0), r"Experiment\.dt: -1\.0 is not a positive finite number"),
        (lambda: Experiment([1], [1], dt="fast"), r"Experiment\.dt: 'fast' is not a positive"),
        (
            lambda: Experiment([1, 2], [1, 2], time_s=[0, 0]),
            r"Experiment\.time_s: time does not increase after sample 0",
        ),
        (lambda: Experiment([1, 2], [1, 2], dt=1.0, period=0), r"Experiment\.period: 0; give a positive number"),
        (lambda: Experiment([[1, 2]], [1], dt=1.0, inputs=["a", "a"]), "duplicate names"),
        (lambda: Experiment([[1, 2]], [1], dt=1.0, inputs=["a"]), "1 names for 2 columns"),
        (lambda: Signal([1.0], 1.0, period=2.5), r"Signal\.period: 2\.5"),
        (lambda: Loop("closed", sign=0), r"Loop\.sign: 0; use -1 or 1"),
        (lambda: Loop("closed", entry="somewhere"), r"Loop\.entry: 'somewhere'; known: plant input, set-point"),
        (lambda: Channel(" a"), "channel name ' a'"),
        (
            lambda: StateSpaceModel([[1]], [[1, 2]], [[1]], [[0]], 1.0),
            r"StateSpaceModel\.B: shape \(1, 2\), expected \(1, 1\)",
        ),
        (lambda: StateSpaceModel([[np.nan]], [[1]], [[1]], [[0]], 1.0), r"StateSpaceModel\.A: .* finite values"),
        (lambda: recording(default="c"), r"Recording\.default: 'c'; known: a, b"),
        (lambda: recording().experiment("aa"), "view 'aa' is not recorded"),
        (lambda: recording().experiment(Roles(("uu1",), ("y1",))), "no recorded channel 'uu1'; did you mean 'u1'"),
        (lambda: Truth(StateSpaceModel([[1]], [[1]], [[1]], [[0]], 1.0), "about right"), r"Truth\.kind: 'about right'"),
    ],
)
def test_bad_values_are_refused_by_name(make, message):
    with pytest.raises(ExciteError, match=message):
        make()


def test_one_recording_serves_several_experiments():
    flight = recording()
    a, b = flight.experiment(), flight.experiment("b")
    assert a.dt == 1.0 and len(a) == 3 and a.period == 2 and not a.loop.closed
    assert [str(c) for c in a.inputs + a.outputs] == ["u1 [V]", "y1 [m]", "y2"]
    assert b.dt == 0.5 and b.loop.closed and b.references[0].name == "y2"
    np.testing.assert_array_equal(a.y[:, 1], flight.values[::2, 2])
    np.testing.assert_array_equal(b.reference, flight.values[:, 2:])


def test_windows_and_decimation_keep_roles_and_time():
    data = Experiment(np.arange(10), np.arange(10), dt=0.1, reference=np.arange(10), period=4, references=["r [deg]"])
    part = data.window(2, 8).decimate(2)
    assert part.dt == pytest.approx(0.2) and part.period == 2 and part.references[0].unit == "deg"
    np.testing.assert_allclose(part.time_s, [0.2, 0.4, 0.6])
    np.testing.assert_array_equal(part.reference[:, 0], [2, 4, 6])
    uneven = Experiment([1, 2, 3], [1, 2, 3], time_s=[0, 1, 10])
    with pytest.raises(ExciteError, match="sampling is not uniform"):
        uneven.decimate(2)


def test_signals_are_sampled_finer_and_coarser():
    signal = Signal(np.repeat([1.0, -1, 1], 4), 0.01, period=12)
    fine, coarse = signal.sampled(0.005), signal.sampled(0.04)
    assert len(fine.u) == 24 and fine.period == 24 and (fine.u[::2] == signal.u).all()
    assert coarse.u[:, 0].tolist() == [1, -1, 1] and coarse.period == 3
    assert signal.sampled(0.01).u.shape == signal.u.shape
    with pytest.raises(ExciteError, match=r"0\.003 s is neither a whole fraction nor a whole multiple"):
        signal.sampled(0.003)


@pytest.mark.parametrize("text", ["flap", "flap [deg]", "a [b] [m/s2]", "rate [deg/s]"])
def test_channels_read_what_they_write(text):
    assert str(Channel.parse(text)) == text
    assert Channel.parse(str(Channel("flap", "deg"))) == Channel("flap", "deg")
