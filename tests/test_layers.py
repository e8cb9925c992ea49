"""The arrows between the rooms, the names that must not be used, and what library code must not do."""

import ast
from importlib import import_module

import click
import pytest
from paths import ROOT

from excite.generators import GENERATORS
from excite.types.signal import Signal
from identify.method import Method
from identify.registry import METHODS, method_class
from plants.registry import PLANTS, load_plant
from scenarios.cli.main import COMMANDS

MAY_IMPORT = {
    "excite": {"excite"},
    "plants": {"excite", "plants"},
    "identify": {"excite", "identify"},
    "scenarios": {"excite", "plants", "identify", "scenarios"},
}
SOURCES = [path.relative_to(ROOT) for room in MAY_IMPORT for path in sorted((ROOT / room).rglob("*.py"))]
# Packages on PyPI install modules of these names into packages called like ours.
TAKEN = {
    "identify/identify.py",
    "identify/cli.py",
    "identify/extensions.py",
    "identify/interpreters.py",
    "identify/vendor",
}
# Copied beside an exported file to be run there by itself: it may print and exit.
SCRIPTS = {"excite/files/crazyflie_player.py"}
FORBIDDEN_MODULES = {"pickle", "dill", "joblib", "shelve", "marshal"}
FORBIDDEN_CALLS = {"eval", "exec", "print", "input", "breakpoint"}
LIBRARY = [path for path in SOURCES if str(path) not in SCRIPTS]


def tree(path):
    return ast.parse((ROOT / path).read_text(encoding="utf-8"), str(path))


def imported(path):
    """Full names of the modules a file imports, at its top or inside functions."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield node.module


def test_every_room_is_looked_at():
    assert {path.parts[0] for path in SOURCES} == set(MAY_IMPORT)


@pytest.mark.parametrize("path", SOURCES, ids=str)
def test_imports_follow_the_arrows(path):
    allowed = MAY_IMPORT[path.parts[0]] | ({"scenarios"} if str(path) == "excite/__main__.py" else set())
    ours = {name for name in imported(path) if name.split(".")[0] in {*MAY_IMPORT, "tests"}}
    assert {name for name in ours if name.split(".")[0] not in allowed} == set()


@pytest.mark.parametrize("path", LIBRARY, ids=str)
def test_library_neither_unpickles_nor_evaluates_nor_prints(path):
    assert {name for name in imported(path) if name.split(".")[0] in FORBIDDEN_MODULES} == set()
    for node in ast.walk(tree(path)):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else None
        assert name not in FORBIDDEN_CALLS, f"{path}:{node.lineno}: {name}()"
        for keyword in node.keywords:
            if keyword.arg == "allow_pickle":
                assert ast.unparse(keyword.value) == "False", f"{path}:{node.lineno}: allow_pickle"


@pytest.mark.parametrize("path", [p for p in LIBRARY if p.parts[:2] != ("scenarios", "cli")], ids=str)
def test_only_the_command_line_exits(path):
    attributes = [node for node in ast.walk(tree(path)) if isinstance(node, ast.Attribute)]
    assert [node.lineno for node in attributes if ast.unparse(node) in ("sys.exit", "os.abort")] == []


def test_no_name_that_other_distributions_install():
    assert [name for name in TAKEN if (ROOT / name).exists()] == []


@pytest.mark.parametrize("name", METHODS)
def test_method_entries_resolve(name):
    assert issubclass(method_class(name), Method) and method_class(name).name == name


@pytest.mark.parametrize("name", PLANTS)
def test_plant_entries_resolve(name):
    assert load_plant(name).name == name


@pytest.mark.parametrize("name", COMMANDS)
def test_command_entries_resolve(name):
    module, attribute = COMMANDS[name].split(":")
    command = getattr(import_module(module), attribute)
    assert isinstance(command, click.Command) and command.name == name


def test_generator_entries_resolve():
    assert isinstance(GENERATORS["prbs"](order=3, dt=0.1), Signal)
    assert all(callable(GENERATORS[name]) for name in GENERATORS)
