"""excite check."""

from dataclasses import asdict
from typing import Any

import click

from excite.errors import ExciteError
from excite.limits.limits import check as check_limits
from excite.limits.limits import load_limits
from excite.persistency.certificate import certify, verdict
from excite.persistency.regressors import information
from identify.method import Method
from identify.settings import load_methods
from scenarios.cli.common import assignments, json_option, limits_option, plot_option
from scenarios.cli.output import plot_later, print_json, print_lines
from scenarios.cli.reading import data_options, read_experiment, read_signal


@click.command()
@click.argument("file", type=click.Path())
@click.option("--order", type=click.IntRange(1), help="Order that is needed; exit code 3 when it is not reached.")
@click.option("--noise-floor", type=float, help="Standard deviation below which nothing counts as excitation.")
@click.option("--method", "methods", multiple=True, metavar="NAME", help="Judge whether it is enough for this method.")
@click.option("--model-order", type=click.IntRange(1), default=4, show_default=True, help="Model order for --method.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Setting of the methods that have it.")
@click.option("--arx", metavar="NA,NB", help="Judge the joint information of (y, u), as closed-loop data need it.")
@limits_option
@plot_option
@data_options
@json_option
def check(
    file: str,
    order: int | None,
    noise_floor: float | None,
    methods: tuple[str, ...],
    model_order: int,
    settings: tuple[str, ...],
    arx: str | None,
    limits: str | None,
    plot: str | None,
    as_json: bool,
    **reading: Any,
) -> int:
    """Certify the persistency of excitation of the inputs in FILE.

    Exit code 3 when it is not enough for what is asked.
    """
    from scenarios.report.tables import certificate_text

    draw = plot_later(plot)
    judged = load_methods(methods, assignments(settings, "--set"))
    bounds = None if limits is None else load_limits(limits)
    signal = read_signal(file, reading["inputs"], reading["dt"], reading["time"])
    certificate = certify(signal, order or 20, noise_floor)
    result: dict[str, Any] = {"schema_version": 1, "file": file, **certificate.to_dict()}
    lines, enough = certificate_text(certificate), not order or certificate.reached
    for method in judged:
        found = verdict(signal, *_needs(method, model_order), noise_floor)
        result.setdefault("verdicts", []).append(asdict(found))
        lines.append(str(found))
        enough = enough and found.ok
    if arx:
        joint = information(read_experiment(file, **reading), *_lags(arx))
        result["information"] = joint.to_dict()
        lines.append(str(joint))
        enough = enough and joint.ok
    if bounds is not None:
        report = check_limits(signal, bounds)
        result["limits"] = report.to_dict()
        lines += map(str, report.checks)
        enough = enough and report.ok
    draw(signal, bounds)
    if as_json:
        print_json(result)
    else:
        print_lines(lines)
    return 0 if enough else 3


def _needs(method: Method, order: int) -> tuple[str, int, int]:
    """Return what to call a method in a verdict, and the orders of excitation that it needs and that suffice."""
    settings = ", ".join(f"{key} {value}" for key, value in asdict(method).items())
    needs = method.required_excitation(order), method.sufficient_excitation(order)
    return f"{method.name} ({settings}) and order {order}", *needs


def _lags(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2 or not all(p.strip().isdigit() for p in parts):
        raise ExciteError(f"--arx {text}: give two whole numbers of lags, as 2,2")
    return int(parts[0]), int(parts[1])
