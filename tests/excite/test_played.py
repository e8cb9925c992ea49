"""A signal on its way out: shaped where limits ask for it, certified as it is played, refused where it cannot be."""

import json

import numpy as np
import pytest

from excite.errors import DesignRefused, ExciteError
from excite.generators import multisine, prbs
from excite.limits.limits import Limits, check, load_limits
from excite.limits.played import prepare, refuse_rounded_excess
from excite.persistency.certificate import certify


def loud():
    return multisine(dt=0.01, period_s=2.0, band_hz=[0.5, 10.0], amplitude=6.0, phases="schroeder")


def test_without_limits_the_signal_is_played_as_it_is():
    signal = prbs(order=5, dt=0.1)
    played = prepare(signal, block_rows=10)
    assert played.signal is signal and played.shaped is None and played.changes() == []
    assert played.certificate == certify(signal, 10)
    assert set(played.to_dict()) == {"recipe", "certificate"}


def test_with_limits_what_is_played_keeps_them_and_is_what_is_certified():
    limits = Limits(amplitude=4.0, rate=100.0)
    played = prepare(loud(), limits)
    assert check(played.signal, limits).ok and played.certificate == certify(played.signal, 20)
    assert played.changes()[0].startswith("shaped by quadratic program to keep: low, high, rate")
    assert "u1" in played.changes()[1] and played.shaped.loss.power_db[0] < 0
    json.dumps(played.to_dict(), allow_nan=False)
    assert prepare(played.signal, limits).changes() == []


def test_what_limits_leave_nothing_of_is_refused():
    with pytest.raises(ExciteError, match="limits"):
        prepare(loud(), Limits(low=1.0, high=1.0))


def test_rounding_beyond_a_limit_is_refused_unless_the_converter_is_among_the_limits():
    signal = prbs(order=5, dt=0.02, channels=["roll"])
    angle = type(signal)(np.full_like(signal.u, 0.1) * np.sign(signal.u), signal.dt, signal.channels)
    limits = Limits(amplitude=0.1)  # float32 makes 0.1 larger
    assert check(angle, limits).ok
    with pytest.raises(
        DesignRefused, match=r"as crazyflie_player rounds it, .*; lower that limit by as much, or give bits"
    ):
        refuse_rounded_excess(angle, limits, "crazyflie_player")
    for given, fmt in (
        (None, "crazyflie_player"),
        (limits, "csv"),
        (Limits(amplitude=0.1, bits=8), "crazyflie_player"),
    ):
        refuse_rounded_excess(angle, given, fmt)


def test_limits_come_from_a_file_and_errors_name_it(tmp_path):
    path = tmp_path / "limits.toml"
    path.write_text("\N{BYTE ORDER MARK}amplitude = [1.0, 2.0]\nbits = 8\n", encoding="utf-8")
    assert (load_limits(path).amplitude, load_limits(str(path)).bits) == ([1.0, 2.0], 8)
    for text, message in (
        ("amplitud = 1.0", "no key 'amplitud'; did you mean 'amplitude'"),
        ("amplitude = -1.0", "amplitude"),
        ("amplitude = ", "not a valid TOML file"),
        ("a = " + "[" * 5000, "not a valid TOML file"),
    ):
        path.write_text(text)
        with pytest.raises(ExciteError, match=message) as caught:
            load_limits(path)
        assert str(path) in str(caught.value)
    with pytest.raises(ExciteError, match=r"absent\.toml: cannot be read"):
        load_limits(tmp_path / "absent.toml")
