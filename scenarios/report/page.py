"""One self-contained HTML page of a run: it opens offline and asks the network for nothing."""

import base64
import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

import tomli_w

from excite.files.atomic import written
from excite.types.channel import listed
from excite.types.signal import Signal
from excite.words import NONE
from identify.compare import Comparison
from scenarios.report.columns import columns_of, legend
from scenarios.report.figures import Drawn, of_view, stems
from scenarios.report.tables import certificate_text, expectations, ranking, true_poles
from scenarios.report.verdict import summary
from scenarios.run.results import RunResult, ViewResult

CSS = """
:root { color-scheme: light dark; --ink: #1c2126; --soft: #59636e; --page: #f6f7f8; --card: #fff; --line: #dfe3e7;
  --accent: #0b63a5; --good: #176b3a; --bad: #a3261d; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e7ea; --soft: #a2abb4; --page: #16191c; --card: #1f2429;
  --line: #363d44; --accent: #7dbcf0; --good: #6fcf97; --bad: #ff8f85; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1160px; padding: 2rem 1.25rem 4rem; background: var(--page); color: var(--ink);
  font: 15px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.3rem; margin: 2.8rem 0 .6rem; padding-top: .8rem; border-top: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 1.6rem 0 .4rem; }
p, ul { margin: .5rem 0; max-width: 76ch; }
a { color: var(--accent); }
nav ul { display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; list-style: none; padding: 0; max-width: none; }
.lead { border-left: 4px solid var(--accent); background: var(--card); padding: .6rem 1rem; margin: 1rem 0; }
.warning { border-left: 4px solid var(--bad); background: var(--card); padding: .4rem 1rem; margin: .6rem 0; }
.scroll { overflow-x: auto; margin: .8rem 0; background: var(--card); border: 1px solid var(--line);
  border-radius: 6px; }
table { border-collapse: collapse; width: 100%; font-size: .8rem; line-height: 1.4; font-variant-numeric: tabular-nums;
  overflow-wrap: normal; }
caption { text-align: left; padding: .55rem .7rem; color: var(--soft); }
th, td { padding: .35rem .5rem; text-align: left; vertical-align: top; border-top: 1px solid var(--line); }
thead th { vertical-align: bottom; border-top: 0; border-bottom: 2px solid var(--line); font-weight: 600; }
tbody th { font-weight: 600; min-width: 10rem; }
tbody th small { display: block; font-weight: 400; color: var(--bad); }
td.number, th.number { text-align: right; white-space: nowrap; }
thead th.number { white-space: normal; }
tr.reference { color: var(--soft); font-style: italic; }
td.text { min-width: 11rem; }
.met { color: var(--good); font-weight: 600; } .missed { color: var(--bad); font-weight: 600; }
figure { margin: 1rem 0 1.6rem; padding: .8rem; background: #fff; border: 1px solid var(--line); border-radius: 6px; }
figure img { display: block; width: 100%; max-width: 900px; height: auto; margin: 0 auto; }
figcaption { color: #4a525a; font-size: .87rem; padding: .6rem .4rem 0; }
pre { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: 6px; padding: .8rem;
  font-size: .82rem; overflow-wrap: normal; }
summary { cursor: pointer; color: var(--accent); }
@media print { body { max-width: none; background: #fff; } figure, tr { break-inside: avoid; } }
"""
DATA = "<p>The data of each picture lie beside it in the folder <code>figures</code>, as .csv and .json.</p>"


def write_report(result: RunResult, path: str | os.PathLike, figures: Mapping[str, Drawn]) -> Path:
    """Write the page with its figures, by file stem."""
    text = page(result, figures)
    with written(path) as temporary:
        Path(temporary).write_text(text, encoding="utf-8")
    return Path(path)


def page(result: RunResult, figures: Mapping[str, Drawn]) -> str:
    """Return the page as HTML."""
    name, names = result.scenario.name, stems(result)
    sections = [("summary", "Summary", _summary(result)), ("design", "Design", _design(result, figures))]
    for stem, view in zip(names, result.views, strict=True):
        sections.append((f"view-{stem}", f"View {view.name}", _view(view, stem, figures)))
    if result.expectations:
        sections.append(("expectations", "Expectations", _expectations(result)))
    sections.append(("metrics", "What the metrics tell, and what they cannot", _legend()))
    sections.append(("made", "How it was made", _made(result)))
    contents = "".join(f'<li><a href="#{escape(key)}">{escape(title)}</a></li>' for key, title, _ in sections)
    body = "".join(
        f'<section id="{escape(key)}"><h2>{escape(title)}</h2>{html}</section>' for key, title, html in sections
    )
    description = f"<p>{escape(result.scenario.description)}</p>" if result.scenario.description else ""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">"
        f"<title>{escape(name)} · excite</title><style>{CSS}</style></head><body>"
        f'<header><h1>{escape(name)}</h1>{description}</header><nav aria-label="Contents"><ul>{contents}</ul></nav>'
        f"<main>{body}</main></body></html>\n"
    )


def _summary(result: RunResult) -> str:
    first, *others = summary(result)
    lead = ""
    for k, text in enumerate(others):
        name = result.views[k].name if k < len(result.views) else ""
        lead += f"<p><strong>{escape(name)}</strong>{escape(text[len(name) :])}</p>"
    return f'<p>{escape(first)}</p><div class="lead">{lead}</div>{DATA}'


def _design(result: RunResult, figures: Mapping[str, Drawn]) -> str:
    html = _figure(figures, "excitation", "Excitation of every channel over time, beside its spectrum")
    for warning in result.warnings:
        html += f'<p class="warning">{escape(warning)}</p>'
    for view in result.views:
        name = view.name
        html += f"<h3>Design rule for {escape(name)}</h3>{_list(view.rule.notes)}"
        if name in result.certificates:
            judged = "reference" if view.view.roles.closed else "input"
            html += f"<h3>Certificate of the {judged} for {escape(name)}</h3>"
            html += _list(certificate_text(result.certificates[name]))
    return html


def _view(view: ViewResult, stem: str, figures: Mapping[str, Drawn]) -> str:
    roles, name, found = view.view.roles, view.name, view.comparison
    kind = (
        "in closed loop: the input depends on the output through feedback"
        if roles.closed
        else "inputs free of feedback"
    )
    band = f", scored over {found.band_hz[0]:.3g} to {found.band_hz[1]:.3g} Hz" if found.band_hz else ""
    html = f"<p>From {escape(listed(roles.inputs))} to {escape(listed(roles.outputs))}, {kind}; "
    html += f"sampled every {found.uniform_dt * 1e3:.4g} ms{band}.</p>"
    html += _ranking(found)
    if warnings := _warnings(found):
        html += f"<details><summary>Warnings of the methods ({len(warnings)})</summary>{_list(warnings)}</details>"
    for key in of_view(stem):
        kind = key.removeprefix(f"{stem}-").replace("-", " ").capitalize()
        html += _figure(figures, key, f"{kind} in the view {name}")
    if found.truth is not None:
        valid = f"; {found.truth.valid_amplitude}" if found.truth.valid_amplitude else ""
        html += _table(*true_poles(found), f"Poles of the truth ({found.truth.kind}{valid})")
        if found.truth.parameters:
            rows = [[key, f"{value:.6g}", unit] for key, (value, unit) in found.truth.parameters.items()]
            table = _table(["parameter", "value", "unit"], rows, f"Parameters behind the truth of {name}")
            html += f"<details><summary>Parameters of the truth</summary>{table}</details>"
    return html


def _ranking(found: Comparison) -> str:
    """Return the ranking as two tables that fit the page: errors against the truth, and fits to the validation data.

    A note stands below the method's name, where it cannot be overlooked.
    """
    headers, rows = ranking(found)
    notes = [row[-1] if headers[-1] == "note" else "" for row in rows]
    fitted = {header for metric, header in zip(*columns_of(found), strict=True) if metric.needs_data}
    fits = [k for k, header in enumerate(headers) if header in fitted]
    errors = [k for k in range(3, len(headers)) if k not in fits and headers[k] != "note"]
    html = ""
    for what, chosen in (("errors against the truth", errors), ("fits to the validation run", fits)):
        kept = [k for k, row in enumerate(rows) if row[0] or any(row[c] != NONE for c in chosen)]
        if chosen:
            columns, shown = [0, 1, 2, *chosen], [notes[k] for k in kept]
            cells = [[rows[k][c] for c in columns] for k in kept]
            caption = f"View {found.name}, best method first: {what}, medians over the runs"
            html += _table([headers[c] for c in columns], cells, caption, lead=1, notes=shown)
    return html


def _warnings(found: Comparison) -> list[str]:
    """Distinct warnings of each row, with the number of runs that gave them."""
    counts: dict[str, int] = {}
    for row in found.rows:
        for estimate in row.estimates:
            for warning in estimate.warnings:
                text = f"{row.title}: {warning}"
                counts[text] = counts.get(text, 0) + 1
    return [text + (f" ({count} runs)" if count > 1 else "") for text, count in counts.items()]


def _expectations(result: RunResult) -> str:
    headers, rows = expectations(result)
    return _table(headers, rows, "What the scenario expects, and what came out")


def _legend() -> str:
    caption = "Methods are ranked by the geometric mean of the medians of the metrics that the scenario names"
    return _table(["metric", "tells", "cannot tell"], legend(), caption)


def _made(result: RunResult) -> str:
    text = escape(tomli_w.dumps(dict(result.scenario.source)))
    recipe = escape(_recipe(result.signal))
    runs = f"estimation runs share one excitation under different noise; seed {result.scenario.seed}"
    again = "The scenario below, saved as a TOML file and run again, gives the same numbers"
    return (
        f"<p>{again}: {escape(runs)}.</p><details><summary>Scenario (TOML)</summary><pre>{text}</pre></details>"
        f"<details><summary>Recipe of the excitation</summary><p>{recipe}</p></details>"
    )


def _recipe(signal: Signal) -> str:
    recipe = signal.recipe
    return "" if recipe is None else ", ".join(f"{name} = {recipe[name]}" for name in recipe)


def _figure(figures: Mapping[str, Drawn], key: str, alt: str) -> str:
    if key not in figures:
        return ""
    figure = figures[key].figure
    data = base64.b64encode(figures[key].svg.encode("utf-8")).decode("ascii")
    verdict, caption = escape(figure.verdict), escape(figure.caption)
    said = f"<strong>{verdict}</strong> " if verdict else ""
    return (
        f'<figure id="figure-{escape(key)}"><img alt="{escape(alt)}. {verdict} {caption}" '
        f'src="data:image/svg+xml;base64,{data}"><figcaption>{said}{caption}</figcaption></figure>'
    )


def _list(items: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>" if items else ""


def _table(
    headers: Sequence[str],
    rows: Sequence[Sequence[str]],
    caption: str,
    *,
    lead: int = 0,
    notes: Sequence[str] | None = None,
) -> str:
    """Return a table whose column `lead` heads the rows, notes below those heads; rows without a rank are set back."""
    numeric = [all(_is_number(row[k]) for row in rows) for k in range(len(headers))]
    html = f'<div class="scroll" tabindex="0"><table><caption>{escape(caption)}</caption><thead><tr>'
    for k, header in enumerate(headers):
        html += f'<th scope="col"{_class(numeric[k])}>{escape(header)}</th>'
    html += "</tr></thead><tbody>"
    for place, row in enumerate(rows):
        html += "<tr>" if row[0] else '<tr class="reference">'
        for k, cell in enumerate(row):
            if k == lead:
                small = f"<small>{escape(notes[place])}</small>" if notes and notes[place] else ""
                html += f'<th scope="row"{_class(numeric[k])}>{escape(cell)}{small}</th>'
            else:
                verdict = f' class="{cell}"' if cell in ("met", "missed") else _class(numeric[k], len(cell) > 24)
                html += f"<td{verdict}>{escape(cell)}</td>"
        html += "</tr>"
    return html + "</tbody></table></div>"


def _class(number: bool, long: bool = False) -> str:
    return ' class="number"' if number else ' class="text"' if long else ""


def _is_number(cell: str) -> bool:
    return cell == "" or cell[0] in "–-−∞0123456789"
