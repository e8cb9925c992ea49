"""How the house is built: arrows, circles, sizes, names that must not be used, and what library code must not do."""

import ast
import io
import tokenize
from graphlib import CycleError, TopologicalSorter
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
TESTS = [path.relative_to(ROOT) for path in sorted((ROOT / "tests").rglob("*.py"))]
MOST_LINES = 400  # of a file
MOST_CODE = 60  # lines of a function that are neither docstring, comment nor blank
BESIDE = {"helpers", "bench", "outside"}  # folders of tests that are no room: shared code, timings, a package of others
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


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


def modules_imported(path, modules):
    """Our modules that a file imports: at its top, under TYPE_CHECKING or inside functions."""
    for node in ast.walk(tree(path)):
        names = [alias.name for alias in getattr(node, "names", ())]
        if isinstance(node, ast.Import):
            yield from modules & set(names)
        elif isinstance(node, ast.ImportFrom):
            yield from modules & {node.module, *(f"{node.module}.{name}" for name in names)}


def circle(graph):
    """The modules of one import circle, or None."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]


def test_no_modules_import_each_other_nor_in_a_longer_circle():
    """The rule counts every import, wherever it stands: one that a function or a type checker needs ties files as well."""
    names = {path: ".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in SOURCES}
    modules = set(names.values())
    assert circle({names[path]: set(modules_imported(path, modules)) - {names[path]} for path in SOURCES}) is None


def test_a_circle_would_be_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) and circle({"a": {"b"}, "b": {"a"}})
    assert circle({"a": {"b", "c"}, "b": {"c"}}) is None


@pytest.mark.parametrize("path", SOURCES + TESTS, ids=str)
def test_files_are_short(path):
    assert len((ROOT / path).read_text(encoding="utf-8").splitlines()) <= MOST_LINES


def lengths(source):
    """Name and lines of code of each function in a source."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    code = {n for token in tokens if token.type not in LAYOUT for n in range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first, docstring = node.body[0], ast.get_docstring(node, clean=False)
            said = set() if docstring is None else set(range(first.lineno, first.end_lineno + 1))
            yield node.name, len(code.intersection(range(node.lineno, node.end_lineno + 1)) - said)


@pytest.mark.parametrize("path", SOURCES, ids=str)
def test_functions_are_short(path):
    found = lengths((ROOT / path).read_text(encoding="utf-8"))
    assert [(name, count) for name, count in found if count > MOST_CODE] == []


def test_lines_of_code_are_counted():
    source = (
        'def f(\n    a,\n):\n    """Say\n\n    it."""\n    # why\n\n    b = (\n        a\n    )\n    return b  # done\n'
    )
    assert list(lengths(source)) == [("f", 7)]


def test_tests_mirror_the_rooms():
    folders = {path.parts[1] for path in TESTS if len(path.parts) > 2}
    assert folders == {*MAY_IMPORT, *BESIDE}


@pytest.mark.parametrize("path", [p for p in TESTS if p.parts[1] in MAY_IMPORT and p.name.startswith("test_")], ids=str)
def test_a_rooms_tests_are_about_that_room(path):
    """A file of tests imports from its room, or reaches it through a helper that does."""
    helpers = {helper.stem: helper for helper in TESTS if helper.parts[1] == "helpers"}
    seen, todo = set(), {path}
    while todo:
        names = set(imported(todo.pop()))
        seen |= {name.split(".")[0] for name in names}
        todo |= {helpers.pop(name) for name in names if name in helpers}
    assert path.parts[1] in seen


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
