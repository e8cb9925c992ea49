"""excite orders."""

from dataclasses import asdict, fields
from typing import Any

import click
import numpy as np

from excite.errors import ExciteError, placed
from identify.orders.criteria import Criteria
from identify.orders.table import OrderTable
from scenarios.cli.common import assignments, json_option, parse_orders, plot_option_of
from scenarios.cli.output import new_file, print_json, print_lines, save_plot
from scenarios.cli.reading import data_options, read_experiment

CRITERION_KEYS = [field.name for field in fields(Criteria)]


@click.command()
@click.argument("file", nargs=-1, required=True, type=click.Path())
@click.option("--method", required=True, metavar="NAME", help="Identification method; `excite methods` lists them.")
@click.option(
    "--orders", "wanted", default="1:10", show_default=True, metavar="1:10", help="Orders: 4, or 2,4,8, or 2:10."
)
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Method setting, e.g. block_rows=20.")
@data_options
@plot_option_of("singular values, criteria and stabilisation diagram")
@json_option
def orders(
    file: tuple[str, ...],
    method: str,
    wanted: str,
    settings: tuple[str, ...],
    plot: str | None,
    as_json: bool,
    **reading: Any,
) -> int:
    """Say what speaks for each order of a model.

    Singular-value gap, information criteria, and poles that stay from order to order.
    """
    from identify.orders.table import order_table
    from identify.registry import load_method

    if plot is not None:
        new_file(plot, *file)
    chosen, listed = load_method(method, **assignments(settings, "--set")), parse_orders(wanted)
    data = tuple(read_experiment(path, **reading) for path in file)
    with placed(", ".join(file)):
        table = order_table(data, chosen, listed)
    if not table.chosen:
        raise ExciteError(f"{', '.join(file)}: no order of {wanted} could be fitted: {table.rows[0].reason}")
    if plot is not None:
        from identify.figures.orders import order_figure

        save_plot(order_figure(method, table), plot)
    if as_json:
        print_json(_to_dict(method, table))
    else:
        print_lines(_lines(table))
    return 0


def _to_dict(method: str, table: OrderTable) -> dict:
    return {
        "schema_version": 1,
        "method": method,
        "chosen": table.chosen,
        "orders": [
            {
                "order": row.order,
                "gap": row.gap,
                **(dict.fromkeys(CRITERION_KEYS) if row.criteria is None else asdict(row.criteria)),
                "largest_pole_modulus": row.radius,
                "reason": row.reason,
            }
            for row in table.rows
        ],
        "singular_values": next(
            (r.estimate.singular_values for r in reversed(table.rows) if r.estimate is not None), None
        ),
        "poles": [
            {
                "order": pole.order,
                "f_hz": pole.mode.f_hz,
                "damping": pole.mode.damping,
                "stable_frequency": pole.frequency,
                "stable_damping": pole.damping,
                "stable_shape": pole.shape,
            }
            for pole in table.poles
        ],
    }


def _lines(table: OrderTable) -> list[str]:
    from scenarios.report.tables import to_text

    criteria = [row.criteria for row in table.rows if row.criteria is not None]
    best_aic, best_bic = (
        min((getattr(c, name) for c in criteria if np.isfinite(getattr(c, name))), default=np.nan)
        for name in ("aic", "bic")
    )
    rows = []
    for row in table.rows:
        mine = [p for p in table.poles if p.order == row.order]
        stable = [p for p in mine if p.frequency and p.damping and p.shape]
        rows.append(
            [
                str(row.order),
                _number(row.gap),
                _number(None if row.criteria is None else row.criteria.aic - best_aic),
                _number(None if row.criteria is None else row.criteria.bic - best_bic),
                _number(row.radius),
                f"{len(stable)} of {len(mine)}" if mine else "",
                row.reason or "",
            ]
        )
    headers = ["order", "s(n)/s(n+1)", "AIC above best", "BIC above best", "max |pole|", "modes that stay", "failed"]
    if not any(row[-1] for row in rows):
        headers, rows = headers[:-1], [row[:-1] for row in rows]
    names = {"gap": "singular-value gap", "aic": "AIC", "aicc": "AICc", "bic": "BIC"}
    chosen = ", ".join(f"{names[key]}: {order}" for key, order in table.chosen.items())
    return [*to_text(headers, rows).splitlines(), f"best order by {chosen}"]


def _number(value: float | None) -> str:
    return "" if value is None or np.isnan(value) else f"{value:.4g}"
