"""Plain values: what JSON and TOML can hold, and nothing else; comparisons between runs rest on them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from excite.errors import ExciteError
from excite.generators import prbs
from excite.plain import plain
from excite.types.channel import Channel
from excite.types.frozen import Frozen

LEAVES = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3))
PLAIN = st.recursive(LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=2), inner))


@given(PLAIN)
def test_plain_values_stay_as_they_are_and_strict_json_takes_them(value):
    strict = plain(value)
    assert json.loads(json.dumps(strict, allow_nan=False)) == strict == plain(strict)
    assert repr(plain(value, "here", finite=False)) == repr(value)


def test_arrays_tuples_mappings_channels_and_recipes_become_plain():
    value = Frozen(a=np.array([[1.0, np.nan]]), b=(1, np.float32(0.5), np.bool_(True)), c=Channel("flap", "deg"))
    found = plain(value, "here")
    assert found == {"a": [[1.0, None]], "b": [1, 0.5, True], "c": "flap [deg]"}
    assert [type(each) for each in found["b"]] == [int, float, bool]
    assert plain([np.inf], finite=False) == [np.inf] and plain(np.array(2.0)) == 2.0 and plain({1: 2}) == {"1": 2}
    recipe = prbs(order=3, dt=0.1).recipe
    assert plain({"recipe": recipe}) == {"recipe": recipe.to_dict()}


def test_what_has_no_plain_form_is_refused_by_its_place_or_passed_through():
    with pytest.raises(ExciteError, match=r"here\.f\[1\]: a function cannot be written; give numbers, text, lists"):
        plain({"f": [1, plain]}, "here")
    assert plain({"f": [1, plain]}) == {"f": [1, plain]}
