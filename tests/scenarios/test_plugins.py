"""Plug-ins that are bad are named and skipped; those that are odd are checked all the same."""

import pytest
from breaking import breakers, put_on_path, record
from installed import install, python

from excite.errors import ExciteError
from identify.registry import METHODS, load_method

BAD = """
from abc import abstractmethod
from dataclasses import dataclass
from identify.prediction_error.arx import Arx
from identify.method import Method

@dataclass(frozen=True)
class Misnamed(Arx):
    name = "arx"
    summary = "claims to be another"

@dataclass(frozen=True)
class Abstract(Method):
    name = "abstract"
    summary = "cannot do anything"

@dataclass(frozen=True)
class Endless(Method):
    name = "endless"
    summary = "has an order, however large"

    def realize(self, compressed, order, data):
        return None
"""


def test_bad_plug_ins_are_named_and_skipped_and_all_else_works(tmp_path):
    site = breakers(tmp_path, entries={"logged": "breakers:Logged", "arx": "breakers:Logged"})
    points = {
        "misnamed": "bad:Misnamed",
        "abstract": "bad:Abstract",
        "endless": "bad:Endless",
        "leaves": "leaves:Any",
        "absent": "no_module:Any",
    }
    install(site, "excite-bad", {"bad.py": BAD, "leaves.py": "import sys\nsys.exit('bye')"}, {"excite.methods": points})
    install(site, "excite-twin", {}, {"excite.methods": {"logged": "breakers:Nothing"}})
    garbled = install(tmp_path / "garbled", "excite-garbled")
    (garbled / "excite_garbled-0.1.dist-info/entry_points.txt").write_text("[excite.methods]\nno equals sign\n")
    code, out, _ = python("-m", "excite", "doctor", path=[site])
    assert code == 2 and "plug-in: method logged, from excite-breakers 0.1" in out
    for text in (
        "arx (breakers:Logged): the name is taken by excite",
        "misnamed (bad:Misnamed): it calls itself 'arx'; give the entry point that name",
        "abstract (bad:Abstract): lacks realize",
        "endless (bad:Endless): has an order, and no largest_order",
        "leaves (leaves:Any): SystemExit: bye",
        "absent (no_module:Any): ModuleNotFoundError",
        "logged (breakers:Nothing): the name is taken by excite-breakers (breakers:Logged)",
    ):
        assert f"plug-in of excite.methods left out: {text}" in out
    code, out, err = python("-m", "excite", "methods", path=[site, garbled])
    assert (code, err) == (0, "at import\n") and "logged" in out and "abstract" not in out
    code, _, err = python("-m", "excite", "methods", "leaves", path=[site])
    assert code == 2 and "method 'leaves' does not exist" in err
    argv = ("--methods", "arx,ssarx", "--orders", "2", "-o", tmp_path / "out")
    assert python("-m", "excite", "compare", *record(tmp_path), *argv, path=[site, garbled])[0] == 0
    code, out, _ = python("-m", "excite", "doctor", path=[site, garbled])
    assert code == 2 and "excite-garbled" in out and "plug-in: method logged" in out


def test_of_two_plug_ins_of_one_name_the_one_that_works_is_taken(tmp_path, monkeypatch):
    install(tmp_path / "site", "excite-a", {}, {"excite.methods": {"logged": "a_module:Logged"}})
    breakers(tmp_path, monkeypatch)
    assert (
        METHODS.distribution("logged") == ("excite-breakers", "0.1") and "logged (a_module:Logged)" in METHODS.skipped
    )


POSTPONED = """
from __future__ import annotations
from dataclasses import dataclass, field
from identify.method import Method
from identify.prediction_error.arx import Arx

@dataclass(frozen=True)
class Later(Arx):
    name = "later"
    summary = "annotations that are text"
    weight: float = field(default=1.0, metadata={"minimum": 0})
    inner: Method = Arx()
"""


def test_settings_are_checked_where_annotations_are_postponed(tmp_path, monkeypatch):
    points = {"excite.methods": {"later": "later_module:Later"}}
    put_on_path(install(tmp_path, "excite-later", {"later_module.py": POSTPONED}, points), monkeypatch)
    assert load_method("later", inner="ssarx").inner == load_method("ssarx")
    for settings, text in (
        ({"weight": "x"}, "give a finite number"),
        ({"weight": -1.0}, "at least 0"),
        ({"inner": 3}, "give"),
    ):
        with pytest.raises(ExciteError, match=f"later.{next(iter(settings))}: .*{text}"):
            load_method("later", **settings)


SCALED = """
from dataclasses import dataclass, replace
from identify.prediction_error.arx import Arx

@dataclass(frozen=True)
class Scaled(Arx):
    name = "scaled"
    summary = "an arx of another gain"

    def realize(self, compressed, order, data):
        found = super().realize(compressed, order, data)
        return replace(found, model=replace(found.model, b={gain} * found.model.b))
"""


def test_an_edited_plug_in_is_asked_again_and_its_errors_are_its_own(tmp_path):
    points = {"excite.methods": {"scaled": "scaled:Scaled"}}
    site = install(tmp_path / "site", "excite-scaled", {"scaled.py": SCALED.format(gain="1.0")}, points)
    argv = (
        "-m",
        "excite",
        "compare",
        *record(tmp_path),
        "--methods",
        "scaled,arx",
        "--orders",
        "2",
        "-o",
        tmp_path / "out",
    )
    first = python(*argv, path=[site])[1]
    assert python(*argv, path=[site])[1] == first
    (site / "scaled.py").write_text(SCALED.format(gain="0.5"))
    code, second, _ = python(*argv, path=[site])
    fresh = python(*argv[:-1], tmp_path / "fresh", path=[site])[1]
    rows = [[line for line in text.splitlines() if " scaled " in line] for text in (first, second, fresh)]
    assert code == 0 and rows[1] == rows[2] != rows[0]
    (site / "scaled.py").write_text(SCALED.format(gain="nothing"))
    asked = ("-m", "excite", "identify", *record(tmp_path), "--method", "scaled", "--order", "2")
    code, _, err = python(*asked, path=[site])
    assert code == 70 and "this is a bug of the plug-in package 'scaled'" in err
