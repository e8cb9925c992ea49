"""Sweeps that an autopilot plays by itself: the parameters it documents, and the very sweep that was designed."""

from dataclasses import replace

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.files import FORMATS, export, load_signal, read_table
from excite.files.sidecar import sidecar
from excite.generators.prbs import prbs
from excite.generators.sweep import sweep
from excite.persistency.certificate import certify
from excite.types.channel import Channel
from excite.types.recipe import Recipe
from excite.types.signal import Signal


def autopilot_sweep(fmt, **changes):
    """The sweep that ArduPilot's documentation flies, or a sweep of PX4's fixed-wing autotune."""
    parts = {
        "dt": 0.0025,
        "start_hz": 0.5,
        "stop_hz": 40,
        "duration_s": 70,
        "amplitude": 15.0,
        "channels": ["roll [deg/s]"],
    }
    parts |= {"fade_in_s": 15, "fade_out_s": 2, "dwell_cycles": 2}
    if fmt == "px4":
        parts |= {"start_hz": 1, "stop_hz": 20, "duration_s": 20, "fade_in_s": 0, "fade_out_s": 0, "dwell_cycles": 0}
    return sweep(**parts | changes)


@pytest.mark.parametrize(("fmt", "form"), [("ardupilot", "log"), ("px4", "log"), ("px4", "linear")])
def test_the_autopilot_plays_the_sweep_that_was_designed(tmp_path, fmt, form):
    original = autopilot_sweep(fmt, form=form)
    path = tmp_path / f"s{FORMATS[fmt].extensions[0]}"
    export(original, fmt, path)
    again = load_signal(path)
    np.testing.assert_allclose(again.u, original.u, atol=0.01 * 15)
    assert (again.dt, again.channels, again.recipe) == (original.dt, original.channels, original.recipe)
    assert read_table(path).meta["certificate"]["rms"] == pytest.approx(certify(again).rms, rel=1e-12)
    assert read_table(path).meta["certificate"]["condition"] == pytest.approx(certify(again).condition, rel=1e-6)


def test_ardupilot_parameters(tmp_path):
    export(autopilot_sweep("ardupilot"), "ardupilot", tmp_path / "s.parm")
    lines = (tmp_path / "s.parm").read_text().splitlines()
    assert lines[0].startswith("#") and lines[1:] == [
        "SID_AXIS,7",
        "SID_MAGNITUDE,15",
        "SID_F_START_HZ,0.5",
        "SID_F_STOP_HZ,40",
        "SID_T_FADE_IN,15",
        "SID_T_REC,69.9974976",
        "SID_T_FADE_OUT,2",
    ]
    sidecar(tmp_path / "s.parm").unlink()
    alone = load_signal(tmp_path / "s.parm")
    assert alone.dt == 0.0025 and alone.channels == (Channel("roll", "deg/s"),)
    np.testing.assert_allclose(alone.u, autopilot_sweep("ardupilot").u, atol=0.15)


def test_px4_parameters(tmp_path):
    export(autopilot_sweep("px4"), "px4", tmp_path / "s.params")
    rows = [line.split("\t") for line in (tmp_path / "s.params").read_text().splitlines()[1:]]
    assert all(row[:2] == ["1", "1"] for row in rows)
    assert {row[2]: (float(row[3]), row[4]) for row in rows} == {
        "FW_AT_AXES": (1, "6"),
        "FW_AT_SYSID_F0": (1, "9"),
        "FW_AT_SYSID_F1": (20, "9"),
        "FW_AT_APPLY": (0, "6"),
        "FW_AT_SYSID_TIME": (pytest.approx(19.9975), "9"),
        "FW_AT_SYSID_TYPE": (2, "6"),
    }


@pytest.mark.parametrize(
    ("name", "axis"),
    [
        ("roll [deg]", 1),
        ("pitch [deg]", 2),
        ("yaw [deg]", 3),
        ("Pitch rate [deg/s]", 8),
        ("yaw_rate [deg/s]", 9),
        ("roll", 10),
        ("pitch [1]", 11),
        ("throttle", 13),
    ],
)
def test_ardupilot_axes(tmp_path, name, axis):
    export(autopilot_sweep("ardupilot", channels=[name], amplitude=0.5), "ardupilot", tmp_path / "s.parm")
    assert f"SID_AXIS,{axis}\n" in (tmp_path / "s.parm").read_text()


@pytest.mark.parametrize(
    ("fmt", "changes", "message"),
    [
        ("ardupilot", {"dwell_cycles": 0}, "a sweep of form log with dwell_cycles = 2 .* says .*'dwell_cycles': 0"),
        ("ardupilot", {"form": "linear"}, "says .*'form': 'linear'"),
        ("ardupilot", {"offset": 1.0}, r"'offset': \[1.0\]"),
        ("ardupilot", {"fade_out_s": 6}, "fade_out_s = 6, but SID_T_FADE_OUT of ArduPilot takes 0 to 5"),
        (
            "ardupilot",
            {"duration_s": 256, "dt": 0.01},
            "duration_s = 255.99, but SID_T_REC of ArduPilot takes 0 to 255",
        ),
        ("ardupilot", {"channels": ["flap [deg]"]}, r"channel 'flap \[deg\]' is no axis that ArduPilot sweeps"),
        ("ardupilot", {"channels": ["roll [rad]"]}, r"name the channel one of: roll \[deg\], "),
        ("ardupilot", {"channels": 2}, "2 channels, but ArduPilot sweeps one axis per flight"),
        (
            "ardupilot",
            {"channels": ["roll"], "amplitude": 1.5},
            "amplitude 1.5 of a mixer output; ArduPilot takes 0 to 1",
        ),
        ("px4", {"fade_in_s": 1}, r"fades of \[1.0, 0.0\] s, but PX4 plays none"),
        ("px4", {"stop_hz": 40}, "stop_hz = 40, but FW_AT_SYSID_F1 of PX4 takes 0.1 to 30"),
        ("px4", {"duration_s": 4}, "duration_s = 3.9975, but FW_AT_SYSID_TIME of PX4 takes 5 to 120"),
        ("px4", {"channels": ["roll [deg]"]}, "is no axis that PX4 sweeps"),
    ],
)
def test_what_an_autopilot_cannot_play_is_refused(tmp_path, fmt, changes, message):
    with pytest.raises(ExciteError, match=message):
        export(autopilot_sweep(fmt, **changes), fmt, tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("fmt", ["ardupilot", "px4"])
def test_only_the_sweep_of_the_recipe_itself_is_exported(tmp_path, fmt):
    for data in (Signal(np.ones(9), 0.1, recipe=Recipe("noise")), prbs(order=5, dt=0.1)):
        with pytest.raises(ExciteError, match=r"the signal's recipe says .*'kind': '(noise|prbs)'"):
            export(data, fmt, tmp_path / "s")
    whole = autopilot_sweep(fmt)
    for lost in ("offset", "amplitude", "start_hz", "fade_in_s"):
        kept = {key: value for key, value in whole.recipe.parameters.items() if key != lost}
        recipe = replace(whole.recipe, parameters=kept)
        with pytest.raises(ExciteError, match=f"recipe of the sweep is incomplete .KeyError: '{lost}'"):
            export(replace(whole, recipe=recipe), fmt, tmp_path / "s")
    with pytest.raises(ExciteError, match=r"recipe of the sweep is incomplete .TypeError"):
        soon = replace(whole.recipe, parameters={**whole.recipe.parameters, "start_hz": "soon"})
        export(replace(whole, recipe=soon), fmt, tmp_path / "s")
    for shaped in (replace(whole, u=np.clip(whole.u, -10, 10)), replace(whole, u=whole.u[:-400])):
        with pytest.raises(ExciteError, match="not those of the recipe's sweep"):
            export(shaped, fmt, tmp_path / "s")


@pytest.mark.parametrize("text", ["SID_AXIS,7\n", "SID_AXIS,x\n", "\xff\0", "SID_F_START_HZ\n"])
def test_damaged_parameter_files(tmp_path, text):
    (tmp_path / "s.parm").write_text(text)
    with pytest.raises(ExciteError, match=r"s\.parm: "):
        load_signal(tmp_path / "s.parm")
