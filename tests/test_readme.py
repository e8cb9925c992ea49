"""The README's code runs, what it names exists, and its drawing is that of the imports in the code."""

import ast
import inspect
import re
import shlex
from dataclasses import dataclass
from importlib import import_module

import click
import numpy as np
import pytest
from paths import ROOT

from excite.figures.save import AS_TEXT, PICTURES
from excite.generators import GENERATORS
from excite.registry import Registry
from excite.types.recording import Recording
from identify.compare import compare
from identify.examples import series as example
from identify.fit import fit
from identify.registry import METHODS
from identify.score import score
from plants.plant import Plant
from plants.registry import PLANTS
from scenarios.cli.design import Generators
from scenarios.cli.main import COMMANDS, cli, status
from scenarios.report.page import write_report
from scenarios.scenario.reading import shipped

README = (ROOT / "README.md").read_text(encoding="utf-8")
ROOMS = ("excite", "plants", "identify", "scenarios")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("code", blocks("python"))
def test_python_blocks_run(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})


def test_the_two_commands_come_first_and_set_everything_up():
    first, second, *_ = blocks("bash")
    for command in (first, second):
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install") and command.count("\n") == 1
    assert "excite run quadrotor_prbs" in first and "pytest" in second
    assert README.index(second) < 2500


def test_every_command_is_documented_and_every_documented_command_exists():
    documented = set(re.findall(r"^excite (\w+)", "".join(blocks("text")), re.MULTILINE)) | {"methods", "scenarios"}
    assert documented == set(COMMANDS)


def test_the_identify_example_runs_on_a_file_of_that_form(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    data, _ = example()
    np.savetxt(tmp_path / "dryer.dat", np.column_stack([data.u[:, 0], data.y[:, 0]]))
    (line,) = (b for b in blocks("bash") if b.startswith("excite identify"))
    assert status(line.split()[1:]) == 0
    assert "po_moesp, order 4, dt 0.08 s" in capsys.readouterr().out


def test_files_and_folders_it_names_exist():
    named = re.findall(r"`((?:excite|plants|identify|scenarios|tests)/[\w./-]*)`", README)
    for name in named + re.findall(r"\]\(([\w./]+)\)", README):
        assert (ROOT / name).exists(), name


def test_modules_it_names_can_be_imported():
    for name in re.findall(r"`((?:plants|identify|scenarios)(?:\.\w+)+)`", README):
        module, _, attribute = name.rpartition(".")
        assert hasattr(import_module(module), attribute), name


def commands():
    """Every command line in the README, as words after `excite`."""
    lines = [line for block in blocks("bash") for part in block.splitlines() for line in part.split("&&")]
    inline = [f"excite {line}" for line in re.findall(r"`excite ([a-z][^`]*)`", README)]
    found = [re.search(r"\bexcite (.+)", line) for line in (*lines, *inline)]
    return [shlex.split(match[1]) for match in found if match]


def options(command):
    return {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}


def command_of(words):
    """The command that the words call, with those of `excite design` one level below."""
    context, command = click.Context(cli), cli.get_command(click.Context(cli), words[0])
    if isinstance(command, Generators) and len(words) > 1:
        command = command.get_command(context, words[1])
    return command


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_options_of_the_commands_it_names_exist(words):
    known = options(command_of(words)) | {"--help"}
    assert {word for word in words if re.match(r"--?[a-z]", word)} <= known


def test_options_that_it_names_alone_exist():
    every = {option for name in COMMANDS for option in options(command_of([name]))} | {"--help"}
    every |= {option for name in GENERATORS for option in options(command_of(["design", name]))}
    named = {word for text in re.findall(r"`(--[^`]*)`", README) for word in text.split() if word.startswith("--")}
    assert {"--loop", "--level", "--plot", "--limits"} <= named <= every


def test_scenarios_plants_and_methods_it_names_exist():
    assert set(re.findall(r"\bexcite run (\w+)", README)) - {"SCENARIO"} <= set(shipped())
    rows = [re.findall(r"`(\w+)`", line.split("|")[1]) for line in section("The plants").splitlines() if "|" in line]
    assert sorted(name for row in rows for name in row) == sorted(PLANTS)
    named = re.findall(r"`(\w+)` *[,|]", "".join(line.split("|")[-2] + "|" for line in table(section("The plants"))))
    assert set(named) <= set(shipped())
    assert set(re.findall(r"`([a-z_\d]+)`", section("Which method when"))) <= {*METHODS, "input_delay"}


def section(title):
    return README.split(f"## {title}\n")[1].split("\n## ")[0]


def table(text):
    """The rows of a Markdown table, without its head."""
    return [line for line in text.splitlines() if line.startswith("| ")][1:]


def test_the_table_of_additions_names_every_registry_where_it_stands():
    found = {}
    for row in table(README.split("\n### Add a ")[1].split("\n## ")[0]):
        *_, folder, _, where, group, _ = row.split("|")
        name, path = re.findall(r"`([\w./]+)`", where)
        registry = getattr(import_module(path.removesuffix(".py").replace("/", ".")), name)
        assert isinstance(registry, Registry) and f"\n{name}: Registry" in (ROOT / path).read_text(encoding="utf-8")
        assert path.startswith(re.search(r"`(\w+)/", folder)[1])
        found[name] = re.search(r"`([\w.]+)`", group)[1]
        assert registry.group == found[name]
    guide = (ROOT / "scenarios/guide/plug-ins.md").read_text(encoding="utf-8")
    assert found == dict(re.findall(r"\| `([A-Z_]+)` in `[\w./]+` \| `([\w.]+)` \|", guide))


@pytest.mark.parametrize("words", [["check"], ["export"], ["orders"], ["plants"], ["design", "prbs"]], ids=" ".join)
def test_help_of_plot_names_every_kind_of_file(words):
    (option,) = (p for p in command_of(words).params if "--plot" in p.opts)
    assert set(re.findall(r"\.[a-z]{3,4}\b", option.help)) == {*AS_TEXT, *PICTURES}


# The drawing of the rooms ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Box:
    """A room of the drawing: its corners, its name, and the names in each of its lines."""

    top: int
    bottom: int
    left: int
    right: int
    room: str
    rows: tuple[tuple[str, ...], ...]


def marked(comment):
    return re.search(rf"<!-- {comment} -->\n```text\n(.*?)```", README, re.DOTALL)[1].splitlines()


def drawing():
    """The boxes of the drawing, and its arrows as pairs of rooms."""
    lines, opened, boxes = marked("drawing of the rooms"), {}, []
    for y, line in enumerate(lines):
        for edge in re.finditer(r"\+-+\+", line):
            if edge.span() not in opened:
                opened[edge.span()] = y
                continue
            (left, right), top = edge.span(), opened.pop(edge.span())
            inside = [text[left + 1 : right - 1] for text in lines[top + 1 : y]]
            rows = [text.split() for text in inside if re.match(r" {3}\S", text)]
            boxes.append(Box(top, y, left, right, inside[0].split()[0].rstrip("/"), tuple(map(tuple, rows))))
    assert not opened

    def room(y, x, edge):
        return next(box.room for box in boxes if getattr(box, edge) == y and box.left <= x < box.right)

    arrows = set()
    for y, line in enumerate(lines):
        for head in re.finditer(r"(?<= )v(?= |$)", line):
            x, start = head.start(), y - 1
            while lines[start][x : x + 1] == "|":
                start -= 1
            arrows.add((room(start, x, "bottom"), room(y + 1, x, "top")))
    return boxes, arrows


def unit(module):
    """The sub-package, or the file at the top of a room, that a module belongs to: "identify/steps/", "identify/fit.py"."""
    room, *rest = module.split(".")
    if not rest:
        return f"{room}/__init__.py"
    return f"{room}/{rest[0]}/" if (ROOT / room / rest[0]).is_dir() else f"{room}/{rest[0]}.py"


def imports():
    """Pairs (unit, imported unit) of all files of the rooms; only `python -m excite` hands over to the command line."""
    pairs = set()
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        *folders, name = path.relative_to(ROOT).with_suffix("").parts
        if (folders, name) == (["excite"], "__main__"):
            continue
        here = unit(".".join(folders if name == "__init__" else [*folders, name]))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                modules = [f"{node.module}.{alias.name}" for alias in node.names]
            pairs |= {(here, unit(module)) for module in modules if module.split(".")[0] in ROOMS}
    return {(a, b) for a, b in pairs if a != b}


def test_arrows_of_the_drawing_are_the_imports_between_the_rooms():
    boxes, arrows = drawing()
    assert sorted(box.room for box in boxes) == sorted(ROOMS)
    found = {(a.split("/")[0], b.split("/")[0]) for a, b in imports()}
    assert arrows == {(a, b) for a, b in found if a != b}


@pytest.mark.parametrize("room", ROOMS)
def test_lines_of_a_room_import_from_their_own_and_from_those_below(room):
    (box,) = (box for box in drawing()[0] if box.room == room)
    line = {f"{room}/{name}": k for k, names in enumerate(box.rows) for name in names}
    assert len(line) == sum(map(len, box.rows)) and all((ROOT / name).exists() for name in line)
    assert {f"{path.parent.relative_to(ROOT)}/" for path in (ROOT / room).glob("*/__init__.py")} <= line.keys()
    inside = {(a, b) for a, b in imports() if a in line and b in line}
    assert [(a, b) for a, b in sorted(inside) if line[a] > line[b]] == []
    for name, k in line.items():  # what stands above the last line uses something of its own line or below
        assert k == len(box.rows) - 1 or any(a == name and line[b] >= k for a, b in inside), name


def test_data_flow_as_drawn():
    types, rooms = marked("flow of the data")
    makers = {
        "Signal": GENERATORS["prbs"],
        "Recording": Plant.run,
        "Experiment": Recording.experiment,
        "Estimate": fit,
        "Score": score,
        "Comparison": compare,
    }
    first, *made, last = re.split(r" *-> ", types)
    assert first == "scenario.toml" and last == "report" and made == list(makers)
    homes = ["scenarios", *(maker.__module__.split(".")[0] for maker in makers.values())]
    assert rooms.split() == [*homes, write_report.__module__.split(".")[0]]
    for name, maker in makers.items():
        returned = inspect.signature(maker).return_annotation
        assert getattr(returned, "__name__", returned) == name
