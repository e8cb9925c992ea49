"""The report: tables say what the data say, figures are labelled and small, the page is self-contained and escaped."""

import base64
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from drawings import strict
from wing import DT, EVIL, OUTPUTS, RANK_BY, comparison, data

from excite.figures.svg import to_svg
from excite.persistency.certificate import certify
from excite.types.recipe import Recipe
from excite.types.recording import Roles
from excite.types.signal import Signal
from identify.figures.rows import best_rows
from scenarios.report import figures, tables
from scenarios.report.page import page, write_report
from scenarios.report.rows import trusted
from scenarios.report.verdict import summary, verdict
from scenarios.run.executor import Local
from scenarios.run.pieces import View
from scenarios.run.results import RunResult, ViewResult
from scenarios.scenario.sampling_rule import Horizons
from scenarios.scenario.spec import Expectation, Scenario


def view_result(name, closed):
    view = View(name, Roles(("flap", "tab"), tuple(OUTPUTS), closed=closed), True, 1)
    return ViewResult(view, Horizons(1, 12, 12, ("past 12 rows & more",)), comparison(2, closed, name))


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
        views=(),
        preset=None,
        parameters={},
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
    certificates = {s.name: certify(signal, 10) for s in views}
    checked = ((missed, 0.1, False), (met, 98.0, True))
    return RunResult(scenario, Path("."), signal, certificates, views, checked, (f"beware of {EVIL}",))


@cache
def drawn():
    return {name: figures.Drawn(each, to_svg(each)) for name, each in figures.all_figures(result()).items()}


@cache
def html():
    return page(result(), drawn())


# --- tables ----------------------------------------------------------------------------------------------------------


def test_ranking_shows_the_medians_and_quartiles_of_the_scores():
    view = result().views[0].comparison
    headers, rows = tables.ranking(view)
    assert rows[0][1].startswith("linearisation floor") and rows[1][1] == "truth on the measured run"
    for place, (shown, row) in enumerate(zip(rows[2:5], view.rows, strict=False), 1):
        assert shown[:3] == [str(place), row.label, str(row.order)]
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
    headers, _ = tables.ranking(result().views[0].comparison)
    assert "integrator error [rad/s]" not in headers and "time-constant error [%]" not in headers


def test_biased_methods_are_marked_and_not_trusted_in_closed_loop():
    view = result().views[1].comparison
    _, rows = tables.ranking(view)
    notes = {row[1]: row[-1] for row in rows}
    assert notes["po_moesp"] == "biased in closed loop" and "biased" not in notes["short"]
    assert "surplus poles" in notes["arx"]
    moesp = next(r for r in view.rows if r.method == "po_moesp")
    first = replace(view, rows=(moesp, *(r for r in view.rows if r is not moesp)))
    assert trusted(first).method != "po_moesp"
    assert "ranks higher here, but is biased" in verdict(first)
    assert "biases every method" in verdict(replace(view, rows=(moesp,)))


def test_verdict_without_any_model_gives_the_reason():
    view = result().views[0].comparison
    text = verdict(replace(view, rows=view.rows[-1:]))
    assert text == "wing / open: no method gave a model (too few samples)."


def test_summary_names_plant_method_and_expectations():
    text = " ".join(summary(result()))
    best = result().views[0].comparison.rows[0]
    assert "played on wing" in text and f"trust {best.label} at order 4" in text
    assert "2 runs to estimate from, 1 run with" in text and "Expectations met: 1 of 2." in text


def test_terminal_table_is_aligned_and_fits():
    for view in result().views:
        headers, rows = tables.ranking(view.comparison, compact=True)
        lines = tables.to_text(headers, rows, 140).split("\n")
        assert len(lines) == len(rows) + 1 and max(map(len, lines)) <= 140
        at = lines[0].index("order") + len("order")
        assert all(line[at - 1].isdigit() for line in lines[3:])


def test_poles_of_the_truth_with_frequency_and_damping():
    headers, rows = tables.true_poles(result().views[0].comparison)
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


def test_each_label_has_one_colour_in_the_whole_run():
    seen = {}
    for name, each in drawn().items():
        for panel in each.figure.panels:
            for mark in panel.marks:
                if isinstance(mark.colour, str):
                    seen.setdefault(mark.colour, set()).add(each.figure.colour(mark.colour))
                    assert mark.colour in ("po_moesp", "short", "arx"), name
    assert len(seen) == 3 and all(len(colours) == 1 for colours in seen.values())
    assert len(set.union(*seen.values())) == 3


def test_figures_are_written_as_pictures_and_data(tmp_path):
    written = figures.write_figures(figures.all_figures(result()), tmp_path, Local())
    assert {name: each.svg for name, each in written.items()} == {name: each.svg for name, each in drawn().items()}
    assert {p.name for p in tmp_path.iterdir()} == {
        f"{name}.{end}" for name in drawn() for end in ("svg", "json", "csv")
    }
    poles = strict((tmp_path / "wing_open-poles.json").read_text(encoding="utf-8"))
    assert poles["name"] == "poles" and poles["title"].startswith("wing / open: poles")
    assert (tmp_path / "wing_open-poles.svg").read_text(encoding="utf-8") == drawn()["wing_open-poles"].svg


def test_a_view_without_truth_has_no_poles_to_list():
    view = replace(result().views[0].comparison, truth=None, truth_score=None, band_hz=None)
    assert tables.true_poles(replace(view, rows=view.rows[-1:]))[1] == []


def test_lines_are_drawn_for_the_best_order_of_each_method():
    view = result().views[0].comparison
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
    for image, each in zip(images, drawn().values(), strict=True):
        assert len(image["alt"]) > 20 and each.figure.caption in image["alt"] and each.figure.verdict in image["alt"]
        svg = base64.b64decode(image["src"].split(",", 1)[1])
        assert ET.fromstring(svg).tag.endswith("svg")


def test_captions_and_verdicts_of_the_figures_stand_below_them():
    for name, each in drawn().items():
        said = f"<figcaption><strong>{escape(each.figure.verdict)}</strong> {escape(each.figure.caption)}</figcaption>"
        assert html().count(said) >= 1, name


def test_page_holds_scenario_verdict_and_certificate():
    text = html()
    assert "name = &quot;demo&quot;" in text and 'class="missed">missed' in text and 'class="met">met' in text
    assert "persistently exciting of order" in text and "past 12 rows &amp; more" in text
    assert "rewards bias" in text


def test_report_is_written_whole(tmp_path):
    path = write_report(result(), tmp_path / "report.html", drawn())
    assert path.read_text(encoding="utf-8") == html()
    assert list(tmp_path.iterdir()) == [path]
