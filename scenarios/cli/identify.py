"""excite identify."""

from pathlib import Path
from typing import Any

import click
import numpy as np

from excite.errors import placed
from scenarios.cli.common import Order, assignments, json_option
from scenarios.cli.output import new_file, print_json, print_lines
from scenarios.cli.reading import data_options, read_experiment


@click.command()
@click.argument("file", nargs=-1, required=True, type=click.Path())
@click.option("--method", required=True, metavar="NAME", help="Identification method; `excite methods` lists them.")
@click.option(
    "--order",
    type=Order(),
    metavar="N|RULE",
    help="Model order, or the rule that chooses it: gap (largest singular-value gap, also when not given), aic, aicc, bic.",
)
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Method setting, e.g. block_rows=20.")
@data_options
@click.option("-o", "out", type=click.Path(), help="Model file to write (JSON).")
@json_option
def identify(
    file: tuple[str, ...],
    method: str,
    order: int | str | None,
    settings: tuple[str, ...],
    out: str | None,
    as_json: bool,
    **reading: Any,
) -> int:
    """Identify a model from one or several data FILEs.

    Several files give one estimate from all of them.
    """
    from identify.estimate_json import estimate_to_dict
    from identify.fit import fit as identify_from
    from identify.registry import load_method
    from identify.score import score as score_estimate
    from scenarios.report.text import estimate_text
    from scenarios.run.store import write_json

    if out is not None:
        new_file(out, *file)
    chosen = load_method(method, **assignments(settings, "--set"))
    data = tuple(read_experiment(path, **reading) for path in file)
    with placed(", ".join(file)):
        estimate = identify_from(data, chosen, order)
    scores = [score_estimate(estimate, experiment).per_output for experiment in data]
    fit = {
        name: np.mean([s[f"fit_{name}"] for s in scores], axis=0)
        for name in ("simulation", "one_step")
        if f"fit_{name}" in scores[0]
    }
    result = estimate_to_dict(estimate, {"simulation": None, "one_step": None, **fit})
    if out is not None:
        write_json(Path(out), result)
    if as_json:
        print_json(result)
    else:
        print_lines(estimate_text(estimate, fit))
        if out is not None:
            click.echo(f"model written to {out}")
    return 0
