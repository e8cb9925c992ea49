"""Settings for several methods at once, and what is told of a method."""

import pytest

from excite.errors import ExciteError
from identify.describe import describe_method
from identify.registry import METHODS, load_method
from identify.settings import load_methods


def test_each_method_gets_the_settings_that_it_has():
    found = load_methods(["arx", "po_moesp", "ssarx"], {"block_rows": 10, "past": 30})
    assert found == [load_method("arx"), load_method("po_moesp", block_rows=10), load_method("ssarx", past=30)]
    assert load_methods([("ssarx", {"past": 12}), "ssarx"], {"past": 30}) == [
        load_method("ssarx", past=12),
        load_method("ssarx", past=30),
    ]
    assert load_methods([]) == []


@pytest.mark.parametrize(
    ("names", "settings", "message"),
    [
        (
            ["arx", "po_moesp"],
            {"block_row": 3},
            "'block_row': none of arx, po_moesp has this setting; did you mean 'block_rows'",
        ),
        (["arx", "po_mosp"], {}, "'po_mosp' does not exist; did you mean 'po_moesp'"),
        (["po_moesp"], {"block_rows": 0}, "po_moesp.block_rows: 0"),
    ],
)
def test_what_none_of_them_has_is_refused(names, settings, message):
    with pytest.raises(ExciteError, match=message):
        load_methods(names, settings)


@pytest.mark.parametrize("name", METHODS)
def test_a_description_explains_every_setting(name):
    described = describe_method(name)
    assert set(described["settings"]) == set(METHODS[name].setting_names())
    assert set(described["meanings"]) <= set(described["settings"])
    assert described["closed_loop"] is METHODS[name].consistent_in_closed_loop
    for setting in described["settings"].keys() - described["meanings"].keys():
        assert setting in described["description"], setting
