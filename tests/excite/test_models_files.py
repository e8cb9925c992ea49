"""Models as JSON: bit for bit and strict."""

import json

import numpy as np
import pytest
from random_models import PARAMETRIC

from excite.errors import ExciteError
from excite.files.models import KINDS, load_model, model_from_dict, model_to_dict, save_model
from excite.models.fir import FirModel
from excite.models.frequency_response import FrequencyResponse
from excite.models.model import Model
from excite.models.polynomial import PolynomialModel
from excite.models.state_space import ContinuousModel, StateSpaceModel


def examples():
    rng = np.random.default_rng(0)
    values = rng.standard_normal((3, 2, 2)) + 1j * rng.standard_normal((3, 2, 2))
    values[0] = complex(-0.0, -0.0)
    yield from (make(rng) for make in PARAMETRIC.values())
    yield FrequencyResponse([0.1, 0.2, 1 / 3], values, 0.5, np.abs(values), np.full((3, 2), 0.7), ["force [N]", "b"])
    yield FrequencyResponse([0.1], [[[1e-300]]])
    yield ContinuousModel([[-1 / 3]], [[1.0]], [[-0.0]], [[0.0]])
    yield StateSpaceModel(np.empty((0, 0)), np.empty((0, 2)), np.empty((1, 0)), [[1.0, 2.0]], 0.1)
    yield StateSpaceModel(
        [[0.5]], np.empty((1, 0)), [[1.0], [2.0]], np.empty((2, 0)), 0.1, K=[[0.1, 0.2]]
    )  # outputs only
    yield PolynomialModel([[[1.0]]], [[[0.1]]], 0.1, c=[[1.0], [0.0]], free=[True, True], inputs=["a [m/s]"])


def same(one, other):
    assert type(one) is type(other)
    for key, value in vars(one).items():
        if key.startswith("_") or key in ("lags", "input_filters", "noise_filters"):
            continue  # what is worked out when asked for
        if isinstance(value, np.ndarray):
            assert value.shape == getattr(other, key).shape and value.tobytes() == getattr(other, key).tobytes(), key
        else:
            assert value == getattr(other, key), key


def test_every_kind_is_among_the_examples():
    assert {type(model) for model in examples()} == set(KINDS.values())


@pytest.mark.parametrize("model", list(examples()), ids=lambda model: type(model).__name__)
def test_models_survive_json_bit_for_bit(model, tmp_path):
    same(model_from_dict(json.loads(json.dumps(model_to_dict(model), allow_nan=False)), "here"), model)
    save_model(model, tmp_path / "model.json")
    same(load_model(tmp_path / "model.json"), model)


class Oracle(Model):
    def frf(self, f_hz):
        return None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "state space"}, "here: kind 'state space' is no kind of model; did you mean 'state_space'"),
        ({"kind": None}, "here: kind None is no kind of model; pass a model that"),
        ({"A": [[1, 2]]}, r"here: StateSpaceModel\.A: shape \(1, 2\)"),
        ({"A": [[1], [1, 2]]}, r"here: "),
        ({"A": "text"}, r"here: "),
        ({"A": {"re": [[1]]}}, r'here: A: give complex arrays as \{"re"'),
        ({"A": {"re": [[0.5]], "im": [[1.0]]}}, r"here: StateSpaceModel\.A: not an array of real numbers"),
        ({"dt": None}, "here: .*dt"),
        ({"dt": "fast"}, "here: StateSpaceModel.dt: 'fast' is not a positive"),
        ({"inputs": [1]}, "here: "),
        ({"inputs": ["a", "b"]}, "here: channels u: 2 names for 1 columns"),
    ],
)
def test_what_is_no_model_is_refused_by_place(change, message):
    good = model_to_dict(StateSpaceModel([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1))
    with pytest.raises(ExciteError, match=message):
        model_from_dict({**good, **change}, "here")


def test_a_missing_key_is_named():
    good = model_to_dict(StateSpaceModel([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1))
    del good["C"]
    with pytest.raises(ExciteError, match="here: key 'C' is missing; pass a model"):
        model_from_dict(good, "here")


@pytest.mark.parametrize("text", ["", "[1, 2]", '{"kind": NaN}', "[" * 10**6], ids=["empty", "list", "nan", "deep"])
def test_files_that_hold_no_model_are_named(text, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(ExciteError, match=r"model\.json: .*; pass a model"):
        load_model(path)
    with pytest.raises(ExciteError, match=r"absent\.json: cannot be read"):
        load_model(tmp_path / "absent.json")


def test_a_model_without_a_form_is_refused():
    with pytest.raises(ExciteError, match="a Oracle has no JSON form"):
        model_to_dict(Oracle())


@pytest.mark.parametrize("kind", ["state_space", "polynomial", "fir"])
def test_inputs_of_another_width_are_refused_in_words(kind):
    model = {
        "state_space": StateSpaceModel([[0.5]], [[1.0, 2.0]], [[1.0]], [[0.0, 0.0]], 1.0),
        "polynomial": PolynomialModel([[[1.0]]], [[[1.0, 2.0]]], 1.0),
        "fir": FirModel([[[1.0, 2.0]]], 1.0),
    }[kind]
    with pytest.raises(ExciteError, match=r"u of shape \(5, 3\); give \(N, 2\), one column per input"):
        model.simulate(np.zeros((5, 3)))
