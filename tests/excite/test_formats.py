"""The table of formats: what each says of itself, who answers for an extension, and plug-ins."""

import json
from pathlib import Path

import pytest
from installed import install, python

from excite.errors import ExciteError
from excite.files.autopilot import ARDUPILOT
from excite.files.formats import FORMATS, WANTS, Format, by_extension, describe_format, named, writable
from excite.registry import Registry


def test_every_format_says_what_it_is_and_what_it_wants():
    for name in FORMATS:
        described = describe_format(name)
        assert described["summary"] and described["extensions"] and (described["reads"] or described["writes"])
        assert set(described["wants"]) <= set(WANTS) and described["package"] is None
        assert bool(described["wants"]) or not described["plays"], name
        json.dumps(described, allow_nan=False)


def test_wishes_are_those_that_are_checked():
    wants = FORMATS["ardupilot"].wants
    for key, (parameter, low, _) in ARDUPILOT.ranges.items():
        assert f"{key} " in wants["recipe"] and parameter in wants["recipe"] and f"{low:g}" in wants["recipe"]
    assert "inf" not in wants["recipe"] and all(str(axis) in wants["channels"] for axis in ARDUPILOT.axes.values())
    assert "8 to 1000000 points" in FORMATS["keysight"].wants["samples"]
    assert "10001 to 60000" in FORMATS["crazyflie"].wants["channels"]


def test_the_first_in_the_table_answers_for_a_shared_extension():
    assert (named(".csv"), named(".mat"), named(".arb")) == (
        ["csv", "crazyflie"],
        ["mat", "hdf5"],
        ["keysight", "rigol"],
    )
    assert by_extension("x.MAT") is FORMATS["mat"] and named(".xyz") == []
    with pytest.raises(ExciteError, match=r"x\.dat: extension '\.dat': this format is only read; write one of \.csv"):
        writable("x.dat")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"extensions": ("csv",)}, r"Format\.extensions: \('csv',\)"),
        ({"extensions": (".CSV",)}, r"in lower case"),
        ({"extensions": ()}, r"Format\.extensions"),
        ({"read": None}, "neither read nor write"),
        ({"wants": {"chanels": "one"}}, "'chanels'; did you mean 'channels'"),
    ],
)
def test_a_format_that_cannot_be_is_refused(given, message):
    with pytest.raises(ExciteError, match=message):
        Format(**{"summary": "x", "extensions": (".x",), "read": lambda path: None, **given})


MODULE = """
from excite.files.formats import Format
from excite.files.text import read, write
MINE = Format("mine", (".mine", ".csv"), read, write)
NOT_ONE = "text"
"""


def test_plugins_come_last_and_those_that_are_none_are_left_out(tmp_path):
    points = {"mine": "one:MINE", "not_one": "one:NOT_ONE", "csv": "one:MINE", "gone": "nowhere:MINE"}
    install(tmp_path, "excite-one", {"one.py": MODULE}, {"excite.formats": points})
    code = """
import json
from excite.files.formats import FORMATS, by_extension, describe_format, named
from excite.files import load_signal, save_signal
from excite import prbs
signal = prbs(order=4, dt=0.1)
save_signal(signal, "s.mine")
assert (load_signal("s.mine").u == signal.u).all()
print(json.dumps([named(".csv"), describe_format("mine"), FORMATS.skipped]))
"""
    status, out, err = python("-c", code, path=[tmp_path], cwd=tmp_path)
    assert status == 0, err
    order, described, skipped = json.loads(out)
    assert order == ["csv", "crazyflie", "mine"] and described["package"] == "excite-one 0.1"
    assert {key.split()[0]: reason.split(";")[0] for key, reason in skipped.items()} == {
        "not_one": "is a str",
        "csv": "the name is taken by excite",
        "gone": "ModuleNotFoundError: No module named 'nowhere'",
    }
    assert not Path(tmp_path / "s.csv").exists()


def test_the_table_is_a_registry_of_one_line_each():
    assert isinstance(FORMATS, Registry) and FORMATS.group == "excite.formats"
    assert all(isinstance(FORMATS[name], Format) for name in FORMATS)
