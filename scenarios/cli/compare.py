"""excite compare."""

from pathlib import Path

import click

from excite.errors import ExciteError
from scenarios.cli.common import (
    ProgressLine,
    assignments,
    data_options,
    json_option,
    print_json,
    print_lines,
    read_experiment,
)


@click.command()
@click.argument("file", nargs=-1, required=True, type=click.Path())
@click.option("--methods", required=True, metavar="A,B,…", help="Methods to compare.")
@click.option("--orders", default="2:6", show_default=True, metavar="2:10", help="Orders: 4, or 2,4,8, or 2:10.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Setting of every method that has it.")
@click.option("--validation", type=click.Path(), help="Validation record; else the last third of the last FILE is kept.")
@data_options
@click.option("-o", "folder", required=True, type=click.Path(), help="Folder for the models and comparison.json.")
@json_option
def compare(
    file: tuple[str, ...], methods: str, orders: str, settings: tuple[str, ...], validation: str | None, folder: str,
    as_json: bool, **reading: object,
) -> int:  # fmt: skip
    """Fit several methods and orders to the data in FILEs and rank them by fit on validation data."""
    from identify.method import load_method, method_class
    from identify.model_json import estimate_to_dict
    from identify.score import score
    from scenarios.report.tables import to_text
    from scenarios.store import write_json

    names, wanted, options = [m.strip() for m in methods.split(",")], parse_orders(orders), assignments(settings, "--set")
    kinds = {name: method_class(name) for name in names}
    for key in options:
        if not any(key in kind.__dataclass_fields__ for kind in kinds.values()):
            raise ExciteError(f"--set {key}: none of {', '.join(names)} has this setting")
    chosen = {
        name: load_method(name, **{k: v for k, v in options.items() if k in kind.__dataclass_fields__})
        for name, kind in kinds.items()
    }
    data = [read_experiment(path, **reading) for path in file]
    if validation:
        judged = read_experiment(validation, **reading)
    else:
        cut = 2 * len(data[-1]) // 3
        data[-1], judged = data[-1].window(0, cut), data[-1].window(cut)
    target = _folder(folder)
    progress, rows, factors = ProgressLine(), [], {}
    pairs = [(name, n) for name in chosen for n in wanted]
    for i, (name, n) in enumerate(pairs):
        method = chosen[name]
        row = {"method": name, "order": n, "values": {}, "reason": None}
        try:
            method.check(tuple(data), n)
            if method.factor_key() not in factors:
                factors[method.factor_key()] = method.prepare(tuple(data))
            estimate = method.fit(tuple(data), n, factors[method.factor_key()])
            result = score(estimate, judged)
            row["values"] = result.values
            write_json(target / f"{name}-n{n}.json", estimate_to_dict(estimate, result.per_output))
        except ExciteError as error:
            row["reason"] = str(error)
        rows.append(row)
        progress("identifying", i + 1, len(pairs))
    rows.sort(key=lambda row: -row["values"].get("fit_simulation_unclipped", float("-inf")))
    label = validation or f"last third of {file[-1]}"
    report = {"schema_version": 1, "validation": label, "rank_by": "fit_simulation", "rows": rows}
    write_json(target / "comparison.json", report)
    if as_json:
        print_json(report)
        return 0
    shown = ("fit_simulation", "fit_one_step", "vaf_simulation", "vaf_one_step")
    headers = ["rank", "method", "order", *(f"{name} %" for name in shown), "note"]
    text = [
        [str(i + 1), row["method"], str(row["order"]), *(_number(row["values"].get(name)) for name in shown), row["reason"] or ""]
        for i, row in enumerate(rows)
    ]
    print_lines([f"validation: {label}", *to_text(headers, text).splitlines()])
    return 0


def parse_orders(text: str) -> list[int]:
    """Parse 4, 2,4,8 or 2:10 (both ends included)."""
    try:
        if ":" in text:
            first, last = (int(part) for part in text.split(":"))
            orders = list(range(first, last + 1))
        else:
            orders = [int(part) for part in text.split(",")]
    except ValueError:
        orders = []
    if not orders or min(orders) < 1:
        raise ExciteError(f"--orders {text}: give positive whole numbers as 4, or 2,4,8, or 2:10")
    return orders


def _folder(name: str) -> Path:
    target = Path(name)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ExciteError(f"{name}: cannot be made a folder ({error.strerror}); choose another with -o") from None
    return target


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
