"""A signal on its way out: shaped to the limits of the hardware and certified as it will be played."""

from dataclasses import dataclass

from excite.errors import DesignRefused
from excite.files.formats import FORMATS
from excite.limits.limits import Limits, check
from excite.limits.shaping import Shaped, shape
from excite.persistency.certificate import Certificate, certify
from excite.types.signal import Signal


@dataclass(frozen=True, eq=False)
class Played:
    """A signal as it will be played, its certificate, and what shaping it cost (None where no limits asked for it)."""

    signal: Signal
    certificate: Certificate
    shaped: Shaped | None = None

    def to_dict(self) -> dict:
        """Plain values for JSON: recipe, certificate, and shaping where there was one."""
        recipe = None if self.signal.recipe is None else self.signal.recipe.to_dict()
        parts = {"recipe": recipe, "certificate": self.certificate.to_dict()}
        return parts if self.shaped is None else {**parts, "shaping": self.shaped.to_dict()}

    def changes(self) -> list[str]:
        """Return, in lines for a reader, what shaping changed; nothing where the limits did not bind."""
        if self.shaped is None or not self.shaped.bound:
            return []
        powers = zip(self.signal.channels, self.shaped.loss.power_db, strict=True)
        return [
            f"shaped by {self.shaped.method} to keep: {', '.join(self.shaped.bound)}",
            "change of power: " + ", ".join(f"{channel.name} {power:.2f} dB" for channel, power in powers),
        ]


def prepare(signal: Signal, limits: Limits | None = None, block_rows: int = 20) -> Played:
    """Shape a signal to its limits, if any, and certify what will be played.

    Parameters
    ----------
    signal : as it was designed.
    limits : of the hardware; None: the signal is played as it is.
    block_rows : order of persistency to certify.

    Raises
    ------
    DesignRefused where the limits cannot be kept.
    """
    if limits is None:
        return Played(signal, certify(signal, block_rows=block_rows))
    shaped = shape(signal, limits, block_rows=block_rows)
    if not shaped.after.ok:
        raise DesignRefused(f"{'; '.join(map(str, shaped.after.exceeded))}; lower the amplitude or widen the limit")
    return Played(shaped.signal, shaped.certificate, shaped)


def refuse_rounded_excess(signal: Signal, limits: Limits | None, fmt: str) -> None:
    """Refuse an export whose own rounding leaves a limit.

    A converter whose bits are among the limits rounds back to the signal, so that nothing can be exceeded.

    Parameters
    ----------
    signal : as it keeps the limits.
    fmt : name of the format that it is exported to.

    Raises
    ------
    DesignRefused naming the limits that the rounded signal exceeds.
    """
    quantise = FORMATS[fmt].quantise if fmt in FORMATS else None
    if limits is None or limits.bits is not None or quantise is None:
        return
    report = check(quantise(signal), limits)
    if not report.ok:
        raise DesignRefused(
            f"as {fmt} rounds it, {'; '.join(map(str, report.exceeded))}; lower that limit by as much, or give bits"
        )
