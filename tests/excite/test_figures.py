"""Figures as data and their renderers; the drawing of a signal; what becomes of long lines."""

import json
import os
import pickle
import re
import subprocess
import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from drawings import check_figure, check_numbers, strict, table, words
from matplotlib._pylab_helpers import Gcf

from excite.errors import ExciteError
from excite.figures.colours import PALETTE, Role, palette
from excite.figures.csv import as_text, to_csv
from excite.figures.figure import Axis, Band, Bars, Figure, Line, Panel, Points, Rule, Span, Text
from excite.figures.json import to_json
from excite.figures.matplotlib_figure import DRAW, to_matplotlib
from excite.figures.save import save_figure
from excite.figures.signal import signal_figure
from excite.figures.svg import to_svg
from excite.figures.thinning import thin
from excite.limits.limits import Limits
from excite.types.recipe import Recipe
from excite.types.signal import Signal

DT = 0.05
HOSTILE = (
    "<script>alert(1)</script>",
    'cost $a$ & "b"',
    "bell \a, escape \x1b[31m, line\u2028end",
    "=HYPERLINK(A1)",
    "]]> <!-- --> %s {0} \\",
    ' x="1.23456" style="font-family: none; "',
)


def example(label="squares"):
    """A figure with a mark of every kind."""
    x = np.arange(1.0, 6.0)
    left = (
        Span(2, 3, label="stripe", colour=Role.BAND),
        Line(x, x**2, label=label, colour=label, marker="square", style="dashed"),
        Line(x, [1, np.nan, 3, np.inf, 5], label="gaps", steps=True),
        Points(x, x, marker="cross", label="truth", colour=Role.TRUTH),
        Points(x[:2], x[:2], marker="tick"),
        Band(x, x, x**2, colour=label, alpha=0.2),
        Rule(x=2.5, style="dotted"),
        Rule(y=4),
        Text(0.5, 0.5, label, frame="panel", across="center", up="top"),
    )
    right = (Bars([1, 1], [2.0, 3.0], [0, 1], [0.5, 1.5], colour=label), Points([1.5], [0.2], marker="ring"))
    names = ((0.25, label), (1.25, "other"))
    return Figure(
        "example",
        f"Title of {label}",
        (
            Panel(left, Axis("time", "s"), Axis("way", "m", "log"), label),
            Panel(right, Axis("amount", "", limits=(0, 4)), Axis(ticks=names), "bars", column=1, legend="none"),
            Panel((Line(x, x - 3),), Axis("time", "s"), Axis("", "V", "symlog"), row=1, columns=2, legend="inside"),
        ),
        caption="How to read it.",
        verdict="It is so.",
        widths=(2, 1),
    )


# --- data ------------------------------------------------------------------------------------------------------------


def test_every_mark_is_in_the_example_and_has_a_renderer():
    assert {type(mark) for panel in example().panels for mark in panel.marks} == set(DRAW)


def test_the_numbers_of_a_mark_are_its_own():
    x = np.arange(3.0)
    line = Line(x, x)
    x[0] = 99
    assert line.x[0] == 0 and line.x.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        line.y[0] = 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Line([1, 2], [1, 2, 3], label="bent"), r"Line 'bent': shapes x \(2,\), y \(3,\); give \(k,\) arrays"),
        (lambda: Points([[1, 2]], [[1, 2]]), "arrays of one length"),
        (lambda: Rule(label="r"), "Rule 'r': x None, y None; give one of the two"),
        (lambda: Axis("f", "Hz", "log", limits=(0, 1)), r"Axis 'f \[Hz\]': limits \(0, 1\) of a log axis; give two"),
        (lambda: Axis(limits=(1, 1)), "give two different finite numbers"),
        (lambda: Axis(limits=(0, np.nan)), "give two different finite numbers"),
        (lambda: Figure("empty", "", ()), "Figure 'empty': no panels; give at least one"),
        (lambda: replace(example(), widths=(1, 2, 3)), "Figure 'example': 3 widths for 2; give one for each"),
    ],
)
def test_what_cannot_be_drawn_is_refused_when_it_is_made(make, message):
    with pytest.raises(ExciteError, match=message):
        make()


def test_labels_have_colours_and_a_run_may_give_others():
    assert example().colour("squares") == PALETTE[0] and example().colour(Role.TRUTH) == "#111111"
    assert replace(example(), colours={"squares": "#123456"}).colour("squares") == "#123456"


def test_colours_do_not_depend_on_the_order_of_names():
    assert palette(["b", "a"]) == palette(["a", "b", "a"])
    assert len({*palette("abcdefghij").values()}) == 10


def test_a_figure_travels():
    again = pickle.loads(pickle.dumps(example()))
    assert to_json(again) == to_json(example())


# --- renderers -------------------------------------------------------------------------------------------------------


def test_the_three_renderers_tell_the_same():
    check_figure(example())
    rows = table(to_csv(example()))
    assert {row["x_axis"] for row in rows} == {"time [s]", "amount [–]"}
    assert [row["y"] for row in rows if row["label"] == "gaps"] == ["1.0", "", "3.0", "", "5.0"]


def test_what_json_says_of_a_mark():
    told = strict(to_json(example()))
    span, line, gaps, *_ = told["panels"][0]["marks"]
    assert (span["mark"], span["role"], span["colour"]) == ("span", "band", Role.BAND.value)
    assert (line["mark"], line["of"], line["colour"], line["style"]) == ("line", "squares", PALETTE[0], "dashed")
    assert gaps["y"] == [1, None, 3, None, 5] and gaps["steps"] is True
    assert told["panels"][0]["y"]["scale"] == "log" and told["grid"]["widths"] == [2, 1]
    assert (told["caption"], told["verdict"]) == ("How to read it.", "It is so.")


def test_text_in_an_svg_is_text():
    drawn = words(to_svg(example()))
    for text in ("Title of squares", "time [s]", "way [m]", "amount [–]", "squares", "other", "gaps", "truth"):
        assert text in drawn, text
    assert "<dc:description>It is so. How to read it.</dc:description>" in to_svg(example())


def test_an_svg_is_repeatable_and_has_two_decimals():
    text = to_svg(example())
    assert text == to_svg(example())
    places = re.findall(r' (?:d|x|y|transform)="([^"]*)"', text)
    assert len(places) > 50 and not [place for place in places if re.search(r"\.\d{3}", place)]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_stay_text(name):
    figure = example(name)
    check_figure(figure)
    shown = "".join(c if c.isprintable() else "\ufffd" for c in name)
    drawn = words(to_svg(figure))
    assert drawn.count(shown) >= 2 and f"Title of {shown}" in drawn  # in the panel, and in the legend
    assert "<script" not in to_svg(figure)
    assert strict(to_json(figure))["panels"][0]["marks"][1]["label"] == name
    for row in table(to_csv(figure)):
        for cell in (row["panel"], row["label"], row["text"], row["x_axis"], row["y_axis"]):
            assert not cell.startswith(("=", "+", "-", "@")) and cell.isprintable()


@pytest.mark.parametrize("cell", ["=1+1", "+1", "-1+2", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_spreadsheet_executes_no_cell(cell):
    assert as_text(cell).startswith("'") and as_text(cell).isprintable()
    assert as_text("a=1") == "a=1" and as_text("") == ""


def test_long_names_are_cut_in_the_picture_alone():
    name = "a" * 500
    figure = example(name)
    cut = [text for text in words(to_svg(figure)) if "aaa" in text]
    assert len(cut) == 5 and max(map(len, cut)) <= 110  # title, panel, legend, tick, and the words in the panel
    assert all(text.endswith("…") for text in cut)
    assert table(to_csv(figure))[1]["label"] == name


def test_a_legend_names_each_label_once():
    figure = replace(example(), panels=[*example().panels, replace(example().panels[0], row=2)])
    assert len(to_matplotlib(figure).legends[0].get_texts()) == 4


def test_drawing_leaves_no_global_state():
    before = {key: dict.__getitem__(matplotlib.rcParams, key) for key in dict.keys(matplotlib.rcParams)}
    environment = dict(os.environ)
    to_svg(example())
    to_matplotlib(example())
    assert {key: dict.__getitem__(matplotlib.rcParams, key) for key in before} == before
    assert not Gcf.figs and dict(os.environ) == environment


def test_the_picture_is_the_same_whatever_the_users_own_settings():
    plain = to_svg(example())
    with matplotlib.rc_context({"lines.linewidth": 9, "text.color": "red", "axes.facecolor": "black", "font.size": 30}):
        assert to_svg(example()) == plain


@pytest.mark.parametrize("backend", ["nonsense", "module://no.such.module", "tkagg", ""])
def test_no_back_end_is_needed(backend, tmp_path):
    script = (
        "import os, sys; from excite.figures.figure import *; from excite.figures.save import save_figure\n"
        "figure = Figure('f', 'F', (Panel((Line([1, 2], [1, 2]),), Axis('t', 's'), Axis('y', 'm')),))\n"
        f"[save_figure(figure, {str(tmp_path)!r} + end) for end in ('/a.png', '/a.svg', '/a.pdf')]\n"
        "print(os.environ['MPLBACKEND'], 'matplotlib.pyplot' in sys.modules, 'tkinter' in sys.modules)"
    )
    environment = {**os.environ, "MPLBACKEND": backend}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert done.stdout == f"{backend} False False\n" and done.stderr == ""
    assert {p.suffix for p in tmp_path.iterdir()} == {".png", ".svg", ".pdf"}


# --- files -----------------------------------------------------------------------------------------------------------


def test_the_extension_says_how_a_figure_is_written(tmp_path):
    starts = {".png": b"\x89PNG", ".svg": b"<svg", ".pdf": b"%PDF", ".json": b'{"schema_version": 1', ".csv": b"panel,"}
    for extension, start in starts.items():
        save_figure(example(), tmp_path / f"a{extension}")
        save_figure(example(), str(tmp_path / f"A{extension.upper()}"))
        assert (tmp_path / f"a{extension}").read_bytes().startswith(start)
        assert (tmp_path / f"a{extension}").read_bytes() == (tmp_path / f"A{extension.upper()}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 10
    strict((tmp_path / "a.json").read_text(encoding="utf-8"))


def test_another_extension_is_refused_and_nothing_written(tmp_path):
    for name in ("figure.xyz", "figure"):
        with pytest.raises(ExciteError, match=r"--plot .*figure.*: extension '.*'; name a .png, .svg, .pdf, .json or"):
            save_figure(example(), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_drawing_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    path.write_text("old")
    monkeypatch.setattr(json, "dumps", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        save_figure(example(), path)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


# --- a signal --------------------------------------------------------------------------------------------------------


def excitation(signal):
    """The figure of the report."""
    return signal_figure(signal, panels=("time", "spectrum"), windowed=True)


@pytest.mark.parametrize(
    ("u", "shown"),
    [
        (np.ones(150), "u1"),
        (np.repeat([0.0, 1.0], 6000), "u1"),  # the step comes after what would be drawn of a longer record
        (np.tile([1.0, -1.0, -1.0], 4000), "u1 (the first 3.03 s)"),  # two turns every 0.05 s
        (np.sin(np.arange(12_000) / 40), "u1 (the first 20 s)"),
    ],
)
def test_the_excitation_is_drawn_as_far_as_it_can_be_told_apart(u, shown):
    time, spectrum = excitation(Signal(u[:, None], DT / 3)).panels
    assert time.title == shown
    assert time.y.limits[0] < u.min() <= u.max() < time.y.limits[1]
    texts = [mark for mark in spectrum.marks if isinstance(mark, Text)]
    assert bool(texts) == (np.ptp(u) == 0)


@pytest.mark.parametrize(
    "u", [np.ones((1, 1)), np.zeros((2, 2)), np.ones((150, 1)), np.eye(40)[:, :8], np.arange(7.0)[:, None]]
)
def test_every_signal_has_a_figure(u):
    check_figure(signal_figure(Signal(u, DT, period=2 if len(u) > 1 else None)))
    check_figure(excitation(Signal(u, DT)))


def test_the_lines_of_sines_are_their_amplitudes():
    t = np.arange(400) * DT
    u = 3 + 2 * np.sin(2 * np.pi * t) + 0.5 * np.cos(np.pi * np.arange(400))  # 1 Hz, and the Nyquist frequency
    _, spectrum = excitation(Signal(u[:, None], DT, ["flap [deg]"], period=400)).panels
    (line,) = spectrum.marks
    np.testing.assert_allclose(line.x, [1, 10])
    np.testing.assert_allclose(line.y, [2, 0.5])
    assert spectrum.title == "line amplitude (one period)" and spectrum.y.text == "[deg]"


def test_what_a_signal_says_of_itself():
    t = np.arange(400) * DT
    sine = np.column_stack([np.sin(2 * np.pi * t), np.zeros(400)])
    verdict = signal_figure(Signal(sine, DT, ["flap [deg]", "tab [deg]"])).verdict
    assert verdict == "Crest factor 1.41; 90 % of the power (mean aside) lies below 1 Hz; tab is constant."
    square = Signal(np.tile([1.0, -1.0], 50)[:, None], DT, ["flap [deg]"], recipe=Recipe("prbs", {}))
    assert signal_figure(square).title == "Excitation: prbs" and "Crest factor 1;" in signal_figure(square).verdict


def test_limits_are_drawn_and_judged():
    signal = Signal(np.sin(np.arange(400) / 7)[:, None] * [1, 2], DT, ["flap [deg]", "tab [deg]"])
    kept, left = (signal_figure(signal, Limits(amplitude=amplitude)) for amplitude in (3.0, 1.5))
    assert kept.verdict.endswith("; all samples within the limits.")
    assert left.verdict.endswith("; tab beyond its limits.")
    rules = [mark.y for mark in left.panels[0].marks if isinstance(mark, Rule)]
    assert rules == [-1.5, 1.5] and left.panels[0].y.limits[1] > 1.5


def test_a_signal_of_many_channels_shows_the_first():
    figure = signal_figure(Signal(np.random.default_rng(0).standard_normal((40_000, 9)), DT))
    assert figure.grid == (6, 4) and figure.title.endswith("(first 6 of 9 channels)")
    check_figure(figure)
    assert [panel.x.shared for panel in figure.panels] == [True] * 20 + [False] * 4


# --- long lines ------------------------------------------------------------------------------------------------------


def test_thinning_keeps_extremes():
    x = np.arange(1, 100_001.0)
    y = np.sin(x / 5000)
    y[[777, 55_555]] = 9, -9
    for log in (False, True):
        thin_x, thin_y = thin(x, y, 500, log)
        assert len(thin_x) <= 500 and thin_y.max() == 9 and thin_y.min() == -9 and (np.diff(thin_x) > 0).all()


def test_thinning_keeps_gaps():
    x = np.arange(10_000.0)
    y = np.sin(x / 50)
    y[4000:6000] = np.nan
    y[7000] = np.nan  # too short to be seen
    thin_x, thin_y = thin(x, y, 500)
    gap = (thin_x > 4050) & (thin_x < 5950)
    assert (
        gap.sum() > 40
        and np.isnan(thin_y[gap]).all()
        and np.isfinite(thin_y[~gap & (np.abs(thin_x - 5000) > 1050)]).all()
    )


def test_thinned_lines_are_the_same_in_every_renderer():
    check_numbers(excitation(Signal(np.random.default_rng(0).standard_normal((40_000, 1)), DT)))
