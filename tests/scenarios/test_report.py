"""The report: tables say what the data say, figures are labelled and small, the page is self-contained and escaped."""

import base64
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from matplotlib._pylab_helpers import Gcf

from excite.models.state_space import StateSpaceModel
from excite.persistency.certificate import certify
from excite.types.experiment import Experiment
from excite.types.loop import Loop
from excite.types.recipe import Recipe
from excite.types.recording import Roles
from excite.types.signal import Signal
from excite.types.truth import Truth
from identify.fit import fit
from identify.metrics.frequency import default_band
from identify.registry import method_class
from identify.score import Score, score
from scenarios.report import drawing, figures, model_figures, tables
from scenarios.report.page import page, write_report
from scenarios.report.rows import best_rows, trusted
from scenarios.report.verdict import summary, verdict
from scenarios.run.results import Row, RunResult, ViewResult
from scenarios.scenario.sampling_rule import Horizons
from scenarios.scenario.spec import Expectation, Scenario, ViewSpec, statistics

DT = 0.05
EVIL = "<script>alert(1)</script>"
OUTPUTS = (f"{EVIL} [deg]", 'cost $a$ & "b" [m/s]')
RANK_BY = ("pole_error_max", "frf_error_h2")


def block(wn, zeta):
    """Continuous modal block, discretised exactly: exp(-zeta wn dt) times a rotation."""
    angle, decay = wn * np.sqrt(1 - zeta**2) * DT, np.exp(-zeta * wn * DT)
    return decay * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


@cache
def truth():
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = block(1.0, 0.2), block(12.0, 0.1)
    B, C = np.array([[0.2, 0.1], [0, 0.3], [0.4, 0], [0.1, 0.5]]), np.array([[1.0, 0, 0.5, 0.2], [0.3, 1, 0, 0.6]])
    model = StateSpaceModel(A, B, C, np.zeros((2, 2)), DT, inputs=["flap [deg]", "tab [deg]"], outputs=list(OUTPUTS))
    return Truth(model, "exact", {"mass": (1.5, "kg")}, "any")


def data(seed, noise, loop=None):
    u = np.repeat(np.random.default_rng(seed).choice([-1.0, 1.0], (400, 2)), 2, axis=0)
    model = truth().model
    y = model.simulate(u)
    y = y + noise * y.std(0) * np.random.default_rng(seed + 100).standard_normal(y.shape)
    return Experiment(u, y, dt=DT, inputs=model.inputs, outputs=model.outputs, loop=loop)


def without_floor(judged):
    """A score without the distance from the floor, whose column would make the terminal's table wider than it may be."""
    return replace(judged, values={name: v for name, v in judged.values.items() if name != "fit_below_floor"})


def row(method, order, validation, clean, runs, loop, **settings):
    estimates = tuple(fit(data(k, 0.05, loop), method, order=order, **settings) for k in range(runs))
    scores = tuple(without_floor(score(e, validation, truth(), horizons=(4,), clean=clean)) for e in estimates)
    summary = {name: statistics([s.values[name] for s in scores]) for name in scores[0].values}
    rank = float(np.sqrt(np.prod([summary[m]["median"] for m in RANK_BY])))
    return Row(method, order, method_class(method).consistent_in_closed_loop, estimates, scores, summary, rank)


def view_result(name, closed, runs=2):
    loop = Loop("closed" if closed else "open")
    validation, clean = data(50, 0.05, loop), data(50, 0.0, loop)
    rows = [
        row("po_moesp", 4, validation, clean, runs, loop, block_rows=12),
        row("ssarx", 4, validation, clean, runs, loop, past=12, future=12),
        row("arx", 8, validation, clean, runs, loop),
    ]
    rows.sort(key=lambda r: r.rank_value)
    why = "too few samples"
    rows.append(Row("iem", 4, True, (None,) * runs, (Score({}, reason=why),) * runs, {}, np.inf, why))
    spec = ViewSpec(name, Roles(("flap", "tab"), tuple(OUTPUTS), closed=closed), False)
    return ViewResult(
        spec=spec,
        dt=DT,
        horizons=Horizons(1, 12, 12, ("past 12 rows & more",)),
        horizons_s=(0.2,),
        truth=truth(),
        band_hz=default_band(truth().poles, truth().model.dt),
        validation=validation,
        clean=clean,
        rows=tuple(rows),
        truth_score=score(truth().model, validation, truth(), clean=clean),
    )


@cache
def result():
    views = (view_result("wing / open", False), view_result("wing ? open", True))
    signal = Signal(data(0, 0.0).u, DT, ["flap [deg]", "tab [deg]"], 400, Recipe("prbs", {"seed": 3}))
    source = {"name": "demo", "seed": 3, "description": EVIL, "plant": {"name": "wing"}}
    scenario = Scenario(
        name="demo",
        seed=3,
        description=EVIL,
        plant=SimpleNamespace(name="wing", description=""),
        noise=True,
        inject="surface",
        excitation={"kind": "prbs"},
        views=tuple(s.spec for s in views),
        methods=(),
        estimation_runs=2,
        validation_runs=1,
        discard_s=0.0,
        rank_by=RANK_BY,
        bands_hz={},
        horizons_s=(0.2,),
        expect=(),
        source=source,
    )
    missed = Expectation("best.frf_error_h2.max", None, "best", "frf_error_h2", "max", "<=", 1e-9)
    met = Expectation("best.fit_clean.median", None, "best", "fit_clean", "median", ">=", 1.0)
    certificates = {s.spec.name: certify(signal, 10) for s in views}
    checked = ((missed, 0.1, False), (met, 98.0, True))
    return RunResult(scenario, Path("."), signal, certificates, views, checked, (f"beware of {EVIL}",))


@cache
def drawn():
    return figures.all_figures(result())


@cache
def svgs():
    return {name: drawing.to_svg(figure) for name, figure in drawn().items()}


@cache
def html():
    return page(result(), svgs())


# --- tables ----------------------------------------------------------------------------------------------------------


def test_ranking_shows_the_medians_and_quartiles_of_the_scores():
    view = result().views[0]
    headers, rows = tables.ranking(view)
    assert rows[0][1].startswith("linearisation floor") and rows[1][1] == "truth on the measured run"
    for place, (shown, row) in enumerate(zip(rows[2:5], view.rows, strict=False), 1):
        assert shown[:3] == [str(place), row.method, str(row.order)]
        values = [100 * s.values["pole_error_max"] for s in row.scores]
        cell = shown[headers.index("pole error max [%]")]
        found = [float(text) for text in re.findall(r"[\d.]+", cell)]
        np.testing.assert_allclose(found, np.percentile(values, [50, 25, 75]), rtol=6e-3)
        clean = np.median([s.values["fit_clean"] for s in row.scores])
        assert float(shown[headers.index("fit simulation, noise-free [%]")]) == pytest.approx(clean, abs=6e-3)
        ahead = np.median([s.values["fit_4_step"] for s in row.scores])
        assert float(shown[headers.index("fit 200 ms ahead [%]")]) == pytest.approx(ahead, abs=6e-3)
    assert float(rows[0][headers.index("fit simulation, noise-free [%]")]) == pytest.approx(100, abs=0.01)
    measured = view.truth_score.values["fit_simulation"]
    assert float(rows[1][headers.index("fit simulation, measured [%]")]) == pytest.approx(measured, abs=6e-3)
    assert rows[-1][0] == "–" and rows[-1][headers.index("note")] == "failed in 2 of 2 runs: too few samples"


def test_columns_without_numbers_are_dropped():
    headers, _ = tables.ranking(result().views[0])
    assert "integrator error [rad/s]" not in headers and "time-constant error [%]" not in headers


def test_biased_methods_are_marked_and_not_trusted_in_closed_loop():
    view = result().views[1]
    _, rows = tables.ranking(view)
    notes = {row[1]: row[-1] for row in rows}
    assert notes["po_moesp"] == "biased in closed loop" and "biased" not in notes["ssarx"]
    assert "surplus poles" in notes["arx"]
    moesp = next(r for r in view.rows if r.method == "po_moesp")
    first = replace(view, rows=(moesp, *(r for r in view.rows if r is not moesp)))
    assert trusted(first).method != "po_moesp"
    assert "ranks higher here, but is biased" in verdict(first, RANK_BY)
    assert "biases every method" in verdict(replace(view, rows=(moesp,)), RANK_BY)


def test_verdict_without_any_model_gives_the_reason():
    view = result().views[0]
    text = verdict(replace(view, rows=view.rows[-1:]), RANK_BY)
    assert text == "wing / open: no method gave a model (too few samples)."


def test_summary_names_plant_method_and_expectations():
    text = " ".join(summary(result()))
    best = result().views[0].rows[0]
    assert "played on wing" in text and f"trust {best.method} at order 4" in text
    assert "2 runs to estimate from, 1 run with" in text and "Expectations met: 1 of 2." in text


def test_terminal_table_is_aligned_and_fits():
    for view in result().views:
        headers, rows = tables.ranking(view, compact=True)
        lines = tables.to_text(headers, rows, 140).split("\n")
        assert len(lines) == len(rows) + 1 and max(map(len, lines)) <= 140
        at = lines[0].index("order") + len("order")
        assert all(line[at - 1].isdigit() for line in lines[3:])


def test_poles_of_the_truth_with_frequency_and_damping():
    headers, rows = tables.true_poles(result().views[0])
    assert [row[0] for row in rows] == ["oscillatory"] * 2
    frequency, damping = headers.index("frequency [Hz]"), headers.index("damping [–]")
    np.testing.assert_allclose([float(r[frequency]) for r in rows], np.array([1, 12]) / (2 * np.pi), rtol=5e-3)
    assert [float(r[damping]) for r in rows] == [0.2, 0.1]
    assert all(float(r[-1]) < 20 for r in rows)


@pytest.mark.parametrize(
    "value, text",
    [
        (float("nan"), "–"),
        (float("inf"), "∞"),
        (0.0, "0"),
        (0.12345, "0.123"),
        (999.6, "1000"),
        (1234.4, "1234"),
        (1e9, "1.0e+09"),
        (-float("inf"), "−∞"),
    ],
)
def test_numbers_are_short(value, text):
    assert tables.number(value) == text


def test_certificate_in_words():
    cert = replace(certify(Signal(np.ones(40), 0.1, ["flap [deg]"]), 5), condition=np.inf)
    text = "\n".join(tables.certificate_text(cert))
    assert "order 1 only (5 asked for)" in text and "flap [deg]: rms 1, peak 1, crest factor 1" in text
    assert "40 samples of 0.1 s" in text and "∞" in text


# --- figures ---------------------------------------------------------------------------------------------------------


def test_every_figure_is_there_under_a_safe_and_distinct_name():
    kinds = {"ranking", "poles", "bode", "outputs", "singular-values"}
    expected = {"excitation"} | {f"{stem}-{kind}" for stem in ("wing_open", "wing_open_2") for kind in kinds}
    assert set(drawn()) == expected


def test_axes_have_labels_with_units():
    for name, figure in drawn().items():
        for axis in figure.axes:
            last = axis.get_subplotspec().is_last_row() or "poles" in name
            if last:
                assert "[" in axis.get_xlabel(), name
            if axis.get_subplotspec().is_first_col() and "ranking" not in name:
                assert "[" in axis.get_ylabel(), name


def test_drawing_leaves_no_global_state():
    before = dict(matplotlib.rcParams)
    figures.excitation(result().signal)
    assert dict(matplotlib.rcParams) == before and not Gcf.figs


def test_svg_is_small_well_formed_and_repeatable():
    for name, figure in drawn().items():
        text = drawing.to_svg(figure)
        assert len(text.encode()) < 300_000, name
        assert ET.fromstring(text).tag.endswith("svg")
    again = drawing.to_svg(figures.ranking(result().views[0]))
    assert again == drawing.to_svg(figures.ranking(result().views[0]))


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
    time, spectrum = figures.excitation(Signal(u[:, None], DT / 3)).axes
    assert time.get_title(loc="left") == shown
    assert time.get_ylim()[0] < u.min() <= u.max() < time.get_ylim()[1]
    assert bool(spectrum.texts) == (np.ptp(u) == 0)


def test_a_long_noisy_run_still_gives_small_figures():
    view = result().views[0]
    model, rng = truth().model, np.random.default_rng(0)
    u = rng.standard_normal((40_000, 2))
    clean = Experiment(u, model.simulate(u), dt=DT, inputs=model.inputs, outputs=model.outputs)
    noisy = replace(clean, y=clean.y + rng.standard_normal(clean.y.shape))
    long = replace(view, validation=noisy, clean=clean)
    assert len(drawing.to_svg(figures.outputs(long))) < 300_000
    assert len(drawing.to_svg(figures.excitation(Signal(rng.standard_normal((40_000, 6)), DT)))) < 300_000


def test_a_diverging_simulation_keeps_to_the_range_of_the_data():
    view = result().views[0]
    first = view.rows[0]
    model = first.estimates[0].model
    wild = replace(first.estimates[0], model=replace(model, A=model.A * 2.5))
    figure = figures.outputs(replace(view, rows=(replace(first, estimates=(wild, wild)),)))
    low, high = figure.axes[0].get_ylim()
    assert max(abs(low), abs(high)) < 2 * np.abs(view.validation.y).max()
    drawing.to_svg(figure)


def test_figures_without_truth_or_models():
    view = replace(result().views[0], truth=None, truth_score=None, band_hz=None)
    assert model_figures.poles(view) is not None and model_figures.bode(view) is not None
    empty = replace(view, rows=view.rows[-1:])
    drawn = {key for key, draw in figures.VIEW_FIGURES.items() if draw(empty, {"iem": "#000000"}) is not None}
    assert drawn == {"outputs"}
    assert tables.true_poles(empty)[1] == []


def test_thinning_keeps_extremes():
    x = np.arange(1, 100_001.0)
    y = np.sin(x / 5000)
    y[[777, 55_555]] = 9, -9
    for log in (False, True):
        thin_x, thin_y = drawing.thin(x, y, 500, log)
        assert len(thin_x) <= 500 and thin_y.max() == 9 and thin_y.min() == -9 and (np.diff(thin_x) > 0).all()


def test_colours_do_not_depend_on_the_order_of_names():
    assert drawing.colours(["b", "a"]) == drawing.colours(["a", "b", "a"])
    assert len({*drawing.colours("abcdefghij").values()}) == 10


def test_lines_are_drawn_for_the_best_order_of_each_method():
    view = result().views[0]
    doubled = replace(view, rows=(*view.rows, *view.rows))
    assert [r.method for r in best_rows(doubled)] == [r.method for r in view.rows[:3]]


# --- page ------------------------------------------------------------------------------------------------------------


class Checker(HTMLParser):
    VOID = ("meta", "img", "br")

    def __init__(self):
        super().__init__()
        self.open, self.images, self.tags, self.links, self.ids = [], [], set(), [], []

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.tags.add(tag)
        self.links += [v for k, v in attributes.items() if k in ("src", "href", "srcset", "action", "data")]
        self.ids.append(attributes.get("id"))
        if tag == "img":
            self.images.append(attributes)
        if tag == "th":
            assert attributes.get("scope") in ("row", "col")
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed():
    checker = Checker()
    checker.feed(html())
    checker.close()
    assert checker.open == []
    return checker


def test_page_is_balanced_and_refers_to_nothing_outside():
    checker = parsed()
    assert "script" not in checker.tags and "link" not in checker.tags
    assert all(link.startswith(("#", "data:image/svg+xml;base64,")) for link in checker.links)
    assert "url(" not in html() and "@import" not in html()
    targets = [link[1:] for link in checker.links if link.startswith("#")]
    ids = [i for i in checker.ids if i]
    assert targets and set(targets) <= set(ids) and len(ids) == len(set(ids))


def test_names_and_descriptions_are_escaped():
    assert "<script" not in html() and "&lt;script&gt;alert(1)&lt;/script&gt;" in html()
    assert html().count("&lt;script&gt;") >= 4  # description, warning, channel, scenario file


def test_all_figures_are_embedded_with_alternative_text():
    images = parsed().images
    assert len(images) == len(drawn())
    for image in images:
        assert len(image["alt"]) > 20
        svg = base64.b64decode(image["src"].split(",", 1)[1])
        assert ET.fromstring(svg).tag.endswith("svg")


def test_page_holds_scenario_verdict_and_certificate():
    text = html()
    assert "name = &quot;demo&quot;" in text and 'class="missed">missed' in text and 'class="met">met' in text
    assert "persistently exciting of order" in text and "past 12 rows &amp; more" in text
    assert "rewards bias" in text


def test_report_is_written_whole(tmp_path):
    path = write_report(result(), tmp_path / "report.html", svgs())
    assert path.read_text(encoding="utf-8") == html()
    assert list(tmp_path.iterdir()) == [path]
