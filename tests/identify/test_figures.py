"""Figures of a comparison: every registered one is labelled, says what the numbers say, and stands odd comparisons."""

import re
from dataclasses import replace
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from drawings import check_axes, check_figure, words
from wing import DT, METHODS, RANK_BY, comparison, data, truth

import excite.registry
from excite.figures.figure import Axis, Bars, Figure, Line, Panel, Points, Rule, Span
from excite.figures.svg import to_svg
from excite.models.model import Model
from excite.models.modes import continuous_poles
from excite.models.state_space import StateSpaceModel
from excite.types.experiment import Experiment
from identify.compare import Row, Trial
from identify.figures.bode import bode
from identify.figures.orders import order_figure
from identify.figures.outputs import outputs
from identify.figures.poles import poles
from identify.figures.ranking import ranking
from identify.figures.registry import FIGURES, figure_names, figures_of
from identify.figures.rows import best_rows, title
from identify.figures.singular_values import singular_values
from identify.metrics.fits import fit_percent
from identify.metrics.poles import pole_errors
from identify.orders.table import order_table
from identify.registry import load_method

OURS = ["ranking", "poles", "bode", "outputs", "singular-values"]


def with_models(change):
    """The comparison with every model changed."""
    rows = []
    for row in comparison().rows:
        trials = [
            trial if trial.estimate is None else replace(trial, estimate=replace(trial.estimate, model=change(trial)))
            for trial in row.trials
        ]
        rows.append(replace(row, trials=tuple(trials)))
    return replace(comparison(), rows=tuple(rows))


def marks(figure, kind, **like):
    """Marks of one kind and with the given attributes."""
    found = [mark for panel in figure.panels for mark in panel.marks if isinstance(mark, kind)]
    return [mark for mark in found if all(getattr(mark, key) == value for key, value in like.items())]


# --- all of them -----------------------------------------------------------------------------------------------------


def test_names_stand_in_their_order():
    assert figure_names()[: len(OURS)] == OURS
    assert list(figures_of(comparison())) == figure_names()


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_labelled_and_told_alike_by_picture_and_data(name):
    figure = FIGURES[name](comparison())
    check_figure(figure)
    assert figure.name == name and figure.title.startswith("wing / open")


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_stands_a_comparison_in_which_nothing_is_known(name):
    bare = replace(comparison(), truth=None, truth_score=None, band_hz=None, clean=None, validation=None)
    figure = FIGURES[name](bare)
    if name == "outputs":
        assert figure is None
    elif name != "ranking":  # the scores of the trials still hold errors
        check_figure(figure)


def test_without_any_model_there_is_little_to_draw():
    empty = replace(comparison(), truth=None, truth_score=None, band_hz=None, rows=comparison().rows[-1:])
    assert set(figures_of(empty)) == {"outputs"}
    assert poles(replace(comparison(), rows=comparison().rows[-1:])) is not None  # those of the truth


def test_each_label_has_one_colour_in_all_figures():
    seen = {}
    for figure in figures_of(comparison()).values():
        for panel in figure.panels:
            for mark in panel.marks:
                if isinstance(mark.colour, str):
                    seen.setdefault(mark.colour, set()).add(figure.colour(mark.colour))
    assert set(seen) == {"po_moesp", "short", "arx"} and len(set.union(*seen.values())) == 3
    assert all(len(colours) == 1 for colours in seen.values())
    given = figures_of(comparison(), {"arx": "#123456"})
    assert {figure.colour("arx") for name, figure in given.items() if name != "singular-values"} == {"#123456"}


def test_two_settings_of_one_method_stand_side_by_side():
    row = comparison().rows[0]
    other = replace(row, label="=2+2", trials=tuple(replace(trial, label="=2+2") for trial in row.trials))
    twice = replace(comparison(), rows=(row, other))
    assert [title(r) for r in best_rows(twice)] == [f"{row.label} n={row.order}", f"=2+2 n={row.order}"]
    for figure in figures_of(twice).values():
        check_figure(figure)
        assert f"=2+2 n={row.order}" in words(to_svg(figure))


def test_a_method_without_an_order_has_its_label_alone():
    row = replace(comparison().rows[0], order=None)
    alone = replace(comparison(), rows=(row,))
    assert title(row) == row.label
    for figure in figures_of(alone).values():
        check_figure(figure)


def test_one_line_per_label_that_of_its_best_order():
    doubled = replace(comparison(), rows=(*comparison().rows, *comparison().rows))
    assert [r.label for r in best_rows(doubled)] == [r.label for r in comparison().rows[:3]]


# --- plug-ins --------------------------------------------------------------------------------------------------------


def drawn_by_a_plugin(compared):
    line = Line([1, 2], [1, 2], label="arx", colour="arx")
    return Figure("mine", compared.name, (Panel((line,), Axis("t", "s"), Axis("y", "m")),), "How.", "So.")


def fails(compared):
    raise ValueError(f"no <{compared.name}>")


def returns_nonsense(compared):
    return "a picture"


NOT_A_FUNCTION = 3


@pytest.fixture
def plugged(monkeypatch):
    """FIGURES with entry points of a package outside ours."""
    names = ("drawn_by_a_plugin", "fails", "returns_nonsense", "NOT_A_FUNCTION", "ranking")
    points = [EntryPoint(name, f"{__name__}:{name}", "excite.figures") for name in names]
    monkeypatch.setattr(excite.registry, "entry_points", lambda group: points if group == "excite.figures" else [])
    monkeypatch.setattr(EntryPoint, "load", lambda point: globals()[point.name])
    FIGURES.__dict__.pop("_plugins", None)
    yield FIGURES
    FIGURES.__dict__.pop("_plugins", None)


def test_figures_of_installed_packages_are_drawn_behind_ours(plugged):
    found = figures_of(comparison(), {"arx": "#123456"})
    assert list(found) == [*OURS, "drawn_by_a_plugin", "fails", "returns_nonsense"]
    assert found["drawn_by_a_plugin"].colour("arx") == "#123456" == found["bode"].colour("arx")
    assert found["drawn_by_a_plugin"].name == "drawn_by_a_plugin"


def test_a_figure_that_fails_says_why_and_takes_nothing_with_it(plugged):
    found = figures_of(comparison())
    assert found["fails"].verdict == "fails could not be drawn: ValueError: no <wing / open>."
    assert "ValueError: no <wing / open>" in words(to_svg(found["fails"]))
    assert "it returned a str, not a Figure" in found["returns_nonsense"].verdict


def test_what_is_no_figure_is_left_out_with_the_reason(plugged):
    skipped = " ".join(f"{name}: {reason}" for name, reason in plugged.skipped.items())
    assert "not a function from a Comparison" in skipped and "the name is taken by excite" in skipped


# --- one by one ------------------------------------------------------------------------------------------------------


def test_the_ranking_shows_the_medians_and_says_them():
    figure = ranking(comparison())
    assert [panel.x.label for panel in figure.panels] == ["worst pole error", "frequency-response error over the band"]
    for panel, metric in zip(figure.panels, RANK_BY, strict=True):
        bars = [mark for mark in panel.marks if isinstance(mark, Bars)]
        medians = [100 * np.median([t.score.values[metric] for t in row.trials]) for row in comparison().rows[:3]]
        np.testing.assert_allclose([bar.x_high[0] for bar in bars], medians)
        assert [text for _, text in panel.y.ticks] == [title(row) for row in comparison().rows]
        assert "failed" in [mark.text for mark in panel.marks if hasattr(mark, "text")]
    best = comparison().rows[0]
    error = 100 * best.summary["pole_error_max"]["median"]
    assert figure.verdict.startswith(f"{title(best)} comes first, worst pole off by {error:.3g} % and")


def test_a_metric_that_does_not_apply_to_a_row_is_absent_or_nan():
    first, second, *rest = comparison().rows
    gone = {k: v for k, v in first.summary.items() if k != "pole_error_max"}
    trials = [
        replace(t, score=replace(t.score, values={k: v for k, v in t.score.values.items() if k in gone}))
        for t in first.trials
    ]
    absent = replace(first, summary=gone, trials=tuple(trials))
    nan = replace(second, summary={**second.summary, "pole_error_max": dict.fromkeys(("q25", "median", "q75"), np.nan)})
    figure = ranking(replace(comparison(), rows=(absent, nan, *rest)))
    check_figure(figure)
    texts = [mark.text for mark in figure.panels[0].marks if hasattr(mark, "text")]
    assert texts.count("no value") == 2 and texts.count("failed") == 1
    assert ranking(replace(comparison(), rows=(absent,))).panels[0].x.label.startswith("frequency-response")


def test_the_poles_are_where_they_are():
    figure = poles(comparison())
    s = continuous_poles(truth().poles, DT)
    (crosses, *_) = marks(figure, Points, label="truth")
    np.testing.assert_allclose(np.sort(crosses.y), np.sort(s.imag[s.imag >= 0]))
    np.testing.assert_allclose(np.hypot(crosses.x, crosses.y), [1, 12], rtol=1e-9)
    for row in comparison().rows[:3]:
        errors = [pole_errors(truth().poles, t.estimate.model.poles(), DT) for t in row.trials]
        worst = 100 * np.median([max(e.relative.max(), float(e.missing > 0)) for e in errors])
        assert f"{worst:.3g} % for {title(row)}" in figure.verdict


def test_without_truth_the_poles_of_the_best_row_are_described():
    verdict = poles(replace(comparison(), truth=None)).verdict
    found = re.fullmatch(r"No truth is known; the least damped pole of (.*) lies at (.*) Hz with ζ (.*)\.", verdict)
    assert found[1] == title(comparison().rows[0])
    assert float(found[2]) == pytest.approx(12 / (2 * np.pi), rel=0.02)  # the mode of the wing with ζ 0.1
    assert float(found[3]) == pytest.approx(0.1, rel=0.1)


def test_the_bode_diagram_shows_truth_band_and_errors():
    figure = bode(comparison())
    assert figure.grid == (3, 2) and figure.panels[-1].columns == 2
    f = np.array(marks(figure, Line, label="truth")[0].x)
    np.testing.assert_allclose(
        marks(figure, Line, label="truth")[0].y, 20 * np.log10(np.abs(truth().model.frf(f)[:, 0, 0])), rtol=1e-9
    )
    assert [(m.x_low, m.x_high) for m in marks(figure, Span)] == [comparison().band_hz] * 5
    best = comparison().rows[0]
    errors = [
        np.linalg.norm(t.estimate.model.frf(f) - truth().model.frf(f), 2, axis=(1, 2))
        / np.linalg.norm(truth().model.frf(f), 2, axis=(1, 2))
        for t in best.trials
    ]
    (shown,) = [mark for mark in figure.panels[-1].marks if isinstance(mark, Line) and mark.label == title(best)]
    np.testing.assert_allclose(shown.y, 100 * np.median(errors, axis=0), rtol=1e-9)
    low, high = comparison().band_hz
    inside = (f >= low) & (f <= high)
    if (np.median(errors, axis=0)[inside] < 0.1).all():
        assert f"less than 10 % over the whole band for {title(best)}" in figure.verdict


class Response(Model):
    """Nothing but a frequency response, known up to 3 Hz."""

    def __init__(self, of):
        self.of, self.dt, self.inputs, self.outputs = of, of.dt, of.inputs, of.outputs

    def frf(self, f_hz):
        response = self.of.frf(f_hz)
        response[np.asarray(f_hz) > 3] = np.nan
        return response


def test_models_without_poles_have_a_frequency_response_alone():
    measured = with_models(lambda trial: Response(trial.estimate.model))
    check_figure(bode(measured))
    check_figure(bode(replace(measured, truth=None)))
    assert not marks(poles(measured), Points, label=title(comparison().rows[0]))
    assert poles(replace(measured, truth=None)) is None
    assert outputs(measured).verdict == "No method gave a model to simulate."


def test_the_outputs_are_those_of_the_score():
    figure = outputs(comparison())
    check_axes(figure)
    for row in comparison().rows[:3]:
        fit = row.trials[0].score.values["fit_clean"]
        assert f"{title(row)} to {fit:.1f} %" in figure.verdict
    (measured, noise_free) = (marks(figure, Line, label=name)[0] for name in ("measured", "noise-free"))
    assert set(measured.y) <= set(comparison().validation.y[:, 0])
    assert set(noise_free.y) <= set(comparison().clean.y[:, 0])


def test_a_measured_record_with_gaps_is_simulated_between_them():
    y = np.array(comparison().validation.y)
    y[300:350] = np.nan
    gappy = replace(comparison(), clean=None, validation=replace(comparison().validation, y=y))
    figure = outputs(gappy)
    check_figure(figure)
    assert "noise-free" not in figure.title + figure.caption + figure.verdict
    row = comparison().rows[0]
    line = marks(figure, Line, label=title(row))[0]
    shown = np.isnan(line.y)
    assert shown.any() and (np.abs(line.x[shown] - 325 * DT) <= 30 * DT).all()
    found = re.search(rf"{re.escape(title(row))} to (\S+) %", figure.verdict)
    whole = ~np.isnan(y).any(axis=1)
    simulated = row.trials[0].estimate.model.simulate(gappy.validation.u)  # from rest: near enough
    assert float(found[1]) == pytest.approx(fit_percent(y[whole], simulated[whole]).mean(), abs=2)
    none = replace(gappy, validation=replace(gappy.validation, y=np.full_like(y, np.nan)))
    assert outputs(none) is None


def test_a_diverging_simulation_keeps_to_the_range_of_the_data():
    wild = with_models(lambda trial: replace(m := trial.estimate.model.to_state_space(), A=m.A * 2.5))
    figure = outputs(wild)
    low, high = figure.panels[0].y.limits
    assert max(abs(low), abs(high)) < 2 * np.abs(comparison().validation.y).max()
    check_figure(figure)


def test_a_long_noisy_run_still_gives_small_figures():
    model, rng = truth().model, np.random.default_rng(0)
    u = rng.standard_normal((40_000, 2))
    clean = Experiment(u, model.simulate(u), dt=DT, inputs=model.inputs, outputs=model.outputs)
    noisy = replace(clean, y=clean.y + rng.standard_normal(clean.y.shape))
    check_figure(outputs(replace(comparison(), validation=noisy, clean=clean)))


def test_singular_values_with_the_order_used_and_that_of_the_truth():
    figure = singular_values(comparison())
    names = {title(row) for row in comparison().rows[:3] if row.label != "arx"}
    assert {mark.label for mark in marks(figure, Line)} == names
    assert [mark.x for mark in marks(figure, Rule)] == [4.5]
    for line in marks(figure, Line):
        assert line.y[0] == 1 and (np.diff(line.y) <= 0).all()
        ratios = line.y[:-1] / line.y[1:]
        assert f"after {ratios.argmax() + 1} for {line.label} (by a factor of {ratios.max():.3g})" in figure.verdict
    assert {mark.x[0] for mark in marks(figure, Points, marker="ring")} == {4}


def test_many_channels_show_their_diagonal():
    model = truth().model
    wide = StateSpaceModel(model.A, np.tile(model.B, (1, 2)), np.tile(model.C, (2, 1)), np.zeros((4, 4)), DT)
    trial = comparison().rows[0].trials[0]
    trial = Trial("wide", "wide", 4, "run 0", replace(trial.estimate, model=wide), trial.score)
    row = Row("wide", "wide", 4, True, (trial,), comparison().rows[0].summary, {}, 1.0)
    figure = bode(replace(comparison(), truth=None, rows=(row,)))
    check_figure(figure)
    assert [panel.title for panel in figure.panels] == [f"u{k} → y{k}" for k in range(1, 5)] and figure.grid == (2, 2)


# --- orders ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "settings"), [(name, settings) for name, _, settings in METHODS])
def test_the_orders_are_drawn_and_the_verdict_is_the_choice(method, settings):
    table = order_table(data(0, 0.05), load_method(method, **settings), range(1, 7))
    figure = order_figure(method, table)
    check_figure(figure)
    values, criteria, diagram = figure.panels
    assert (values.title, criteria.title, diagram.title) == ("singular values", "criteria", "stabilisation diagram")
    for name in ("aic", "bic"):
        (line,) = [mark for mark in criteria.marks if mark.label == name.upper()]
        assert line.x[line.y.argmin()] == table.chosen[name] and line.y.min() == 0
        assert re.search(rf"{name.upper()}[^;]* for order {table.chosen[name]}\b", figure.verdict)
    assert sum(len(mark.x) for mark in diagram.marks) == sum(pole.mode.f_hz > 0 for pole in table.poles)
