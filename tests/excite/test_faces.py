"""Package faces: names are there, each is what it says, and nothing is loaded before it is asked for."""

import ast
from importlib import import_module

import pytest
from installed import python
from paths import ROOT

FACES = ("excite", "excite.files", "excite.generators", "identify", "plants", "scenarios.cli")


def loaded_by(code):
    """Names of the top-level packages that are loaded after some code."""
    status, out, err = python("-c", f"{code}\nimport sys; print(*{{name.split('.')[0] for name in sys.modules}})")
    assert status == 0, err
    return set(out.split())


@pytest.mark.parametrize("package", FACES)
def test_names_types_and_homes_agree(package):
    module = import_module(package)
    source = ROOT.joinpath(*package.split("."), "__init__.py").read_text(encoding="utf-8")
    block = next(node for node in ast.parse(source).body if isinstance(node, ast.If))
    typed = {alias.name: node.module for node in block.body for alias in node.names}
    assert sorted(typed) == sorted(module.__all__) and set(typed) <= set(dir(module))
    for name, home in typed.items():
        assert getattr(module, name) is getattr(import_module(home), name), name


def test_errors_load_nothing_else():
    assert not {"numpy", "scipy", "mujoco", "matplotlib", "h5py", "click"} & loaded_by("import excite.errors")


def test_files_and_signals_load_no_format_that_nobody_asked_for():
    assert "h5py" not in loaded_by("from excite.files import load_experiment, FORMATS; list(FORMATS)")
    assert "numpy" not in loaded_by("import excite, identify, plants, scenarios.cli, excite.files")


@pytest.mark.parametrize(
    "first", ["import identify.score", "from identify import score", "import identify.conformance"]
)
def test_a_submodule_does_not_take_the_place_of_a_function(first):
    code = f"{first}\nimport identify, identify.score\nfrom identify import score, conformance\n"
    code += "assert callable(score) and identify.score is score and conformance.__name__ == 'identify.conformance'"
    assert python("-c", code)[0] == 0


def test_a_name_that_is_not_there_is_an_attribute_error():
    import excite

    with pytest.raises(AttributeError, match="module 'excite' has no attribute 'prsb'"):
        excite.prsb  # noqa: B018
    with pytest.raises(ImportError):
        from excite import prsb  # noqa: F401
