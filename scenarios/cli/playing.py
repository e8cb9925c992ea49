"""What design, check and export do with a signal on its way out: limits, certificate, figure."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click

from excite import files
from excite.errors import DesignRefused, ExciteError, placed
from excite.limits.limits import Limits, check
from excite.limits.shaping import Shaped, shape
from excite.persistency.certificate import Certificate, certify
from excite.types.signal import Signal
from scenarios.cli.common import new_file

limits_option = click.option(
    "--limits", type=click.Path(), metavar="FILE", help="TOML file of hardware limits (amplitude, rate, bits, …)."
)
plot_option = click.option(
    "--plot",
    type=click.Path(),
    metavar="FILE",
    help="Draw signal, spectrum, autocorrelation and histogram (.png, .svg, .pdf, or its data: .json, .csv).",
)


def read_toml(path: str) -> dict:
    """Read a TOML file."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ExciteError(f"{path}: not a valid TOML file ({error}); mend it at that place") from None


def read_limits(path: str) -> Limits:
    """Read a TOML file with the fields of `excite.limits.limits.Limits`."""
    table = read_toml(path)
    with placed(path):
        return Limits.from_dict(table)


def refuse_rounded_excess(signal: Signal, limits: str | None, fmt: str) -> None:
    """Refuse an export whose own rounding leaves a limit; a converter with its bits given rounds back to the signal."""
    quantise = files.FORMATS[fmt].quantise if fmt in files.FORMATS else None
    if limits is None or quantise is None or read_limits(limits).bits is not None:
        return
    report = check(quantise(signal), read_limits(limits))
    if not report.ok:
        raise DesignRefused(
            f"{limits}: as {fmt} rounds it, {'; '.join(map(str, report.exceeded))}; lower that limit by as much, or give bits"
        )


@dataclass(frozen=True)
class Played:
    """A signal as it will be played, its certificate, and what shaping it cost when limits asked for it."""

    signal: Signal
    certificate: Certificate
    shaped: Shaped | None

    def to_dict(self) -> dict:
        """Plain values for JSON."""
        parts = {
            "recipe": self.signal.recipe and self.signal.recipe.to_dict(),
            "certificate": self.certificate.to_dict(),
        }
        return parts if self.shaped is None else {**parts, "shaping": self.shaped.to_dict()}

    def lines(self) -> list[str]:
        """What to tell the reader."""
        from scenarios.report.tables import certificate_text

        lines = certificate_text(self.certificate)
        if self.shaped is not None and self.shaped.bound:
            lines.append(f"shaped by {self.shaped.method} to keep: {', '.join(self.shaped.bound)}")
            changes = zip(self.signal.channels, self.shaped.loss.power_db, strict=True)
            lines.append(
                "change of power: " + ", ".join(f"{channel.name} {power:.2f} dB" for channel, power in changes)
            )
        return lines


def prepare(signal: Signal, limits: str | None, block_rows: int = 20) -> Played:
    """Shape a signal to its limits, if any, and certify what will be played; refuse what cannot be shaped."""
    if limits is None:
        return Played(signal, certify(signal, block_rows=block_rows), None)
    shaped = shape(signal, read_limits(limits), block_rows=block_rows)
    if not shaped.after.ok:
        raise DesignRefused(
            f"{limits}: {'; '.join(map(str, shaped.after.exceeded))}; lower the amplitude or widen the limit"
        )
    return Played(shaped.signal, shaped.certificate, shaped)


def plot_later(path: str | None) -> Callable[[Signal, str | None], None]:
    """Check --plot now and return what draws it, so that a bad name costs no work."""
    if path is None:
        return lambda signal, limits: None
    new_file(path)
    from excite.figures.save import save_figure
    from excite.figures.signal import signal_figure

    return lambda signal, limits: save_figure(signal_figure(signal, read_limits(limits) if limits else None), path)
