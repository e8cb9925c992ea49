"""Files of arbitrary-waveform generators: one channel per file, codes at full scale, rate and units in the sidecar.

A generator repeats a file's samples at a rate set on its front panel; only Keysight's file carries rate and levels. So
the sidecar's `playback` says what to set: samples per second, repetitions per second, volts at full scale. A channel in V
(or without unit) plays its own volts; any other unit plays +-1 V, and `playback` says what 1 V stands for.

Sources
-------
Keysight : .arb of the 33500 and 33600 series, the text header published with the Trueform generators (File Format:1.10,
  Channel Count, Sample Rate, High Level, Low Level, Data Type:"short", Data Points, Data), codes -32767 ... 32767 from
  low to high level; 8 to 1 000 000 points, +-10 V into an open circuit, up to 250 MSa/s (33500 without options).
Rigol RAF : DG1000Z User's Guide, "File Type", p. 2-75: 16-bit words, lower 14 bits from 0x0000 (low) to 0x3FFF (high),
  no header; little endian, 8192 is zero (sigrok wiki, "File format:Rigol RAF"); 8 to 16384 points (DG1000Z Programming
  Guide, DATA:DAC16, p. 2-173). A DG4000 wants exactly 16384.
Rigol 16 bit : .arb, up to 16384 little-endian words, zero at 0x8000.
Siglent : .bin of the SDG series, int16 little endian, two's complement, 2 to 16384 points (SDG1000X; application note
  "16-bit step arb").
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import readable
from excite.files.formats import Format
from excite.files.quantised import codes_of, decoded_table, quantised
from excite.files.sidecar import written_with_sidecar
from excite.files.table import Table
from excite.types.channel import Channel
from excite.types.signal import Signal

VOLTS = {"": 1.0, "V": 1.0, "mV": 1e-3}
MOST_VOLTS = 10.0
UNITS = (
    f"V, mV or none: plays its own volts, up to +-{MOST_VOLTS:g} V; any other unit plays +-1 V, and `playback` in the sidecar "
    "says what 1 V stands for"
)
HEADER = re.compile(rb"\s*(?:Copyright:|File Format:)")
KEYSIGHT_MOST_HZ = 250e6


@dataclass(frozen=True)
class Generator:
    """What one family of generators takes: its name, codes -top ... top around `zero` as `kind`, and how many points."""

    name: str
    top: int
    kind: str
    zero: int
    least: int
    most: int

    def quantise(self, signal: Signal) -> Signal:
        """Return what the generator plays; refuse a length it does not hold. Nothing is ever resampled or padded."""
        points = len(signal.u)
        if not self.least <= points <= self.most:
            raise ExciteError(
                f"{points} samples, but {self.name} holds {self.least} to {self.most} points; "
                f"export {'one period, a coarser dt or a shorter signal' if points > self.most else 'a longer signal'}"
            )
        played = quantised(signal, self.top)
        for channel, peak in zip(signal.channels, np.abs(signal.u).max(0), strict=True):
            volts = VOLTS.get(channel.unit, 0) * peak
            if volts > MOST_VOLTS:
                raise ExciteError(
                    f"channel {channel}: peak {volts:g} V, but {self.name} plays at most {MOST_VOLTS:g} V"
                )
        return played

    def write(self, table: Table, path: Path) -> None:
        """Write one channel's codes without any header, and the sidecar."""
        codes, scale = codes_of(table, self.top)
        with written_with_sidecar(path, table, scale | _playback(table, scale)) as temporary:
            temporary.write_bytes((codes + self.zero).astype(self.kind).tobytes())

    def read(self, path: Path) -> Table:
        """Return the channel in a file of codes: in units when the sidecar is there, else +-1 is full scale."""
        return self.decode(readable(path).read_bytes(), path)

    def format(self, extension: str) -> Format:
        """Return the format of this family's files of codes."""
        summary = f"waveform for {self.name}"
        return Format(summary, (extension,), self.read, self.write, self.quantise, True, self.wants())

    def wants(self, more: str = "") -> dict[str, str]:
        """Return in words what a signal must be."""
        return {"units": UNITS, "samples": f"{self.least} to {self.most} points, codes of +-{self.top}{more}"}

    def decode(self, raw: bytes, path: Path) -> Table:
        """Return the channel that the bytes of a file hold."""
        if len(raw) % 2 or not self.least <= len(raw) // 2 <= self.most:
            raise ExciteError(
                f"{path}: {len(raw)} bytes are not {self.least} to {self.most} points of 2 bytes for {self.name}"
            )
        codes = np.frombuffer(raw, self.kind).astype(np.int32) - self.zero
        if np.abs(codes).max() > self.top + 1:
            raise ExciteError(f"{path}: code {np.abs(codes).max()} is beyond the {self.top} of {self.name}")
        return decoded_table(codes[:, None], self.top, path, raw)


KEYSIGHT = Generator("a Keysight 33500/33600", 2**15 - 1, "<i2", 0, 8, 1_000_000)
RIGOL = Generator("a 16-bit Rigol", 2**15 - 1, "<u2", 0x8000, 8, 16384)
RIGOL_RAF = Generator("a Rigol with 14-bit RAF files", 2**13 - 1, "<u2", 0x2000, 8, 16384)
SIGLENT = Generator("a Siglent SDG", 2**15 - 1, "<i2", 0, 2, 16384)


def quantise_keysight(signal: Signal) -> Signal:
    """Return what a Keysight generator plays; refuse a length, rate or level beyond it."""
    if 1 / signal.dt > KEYSIGHT_MOST_HZ:
        raise ExciteError(
            f"dt = {signal.dt:g} s is {1 / signal.dt:g} samples/s, but {KEYSIGHT.name} plays {KEYSIGHT_MOST_HZ:g}"
        )
    return KEYSIGHT.quantise(signal)


def write_keysight(table: Table, path: Path) -> None:
    """Write one channel as Keysight's text format, levels and rate in its header, and the sidecar."""
    codes, scale = codes_of(table, KEYSIGHT.top)
    playback = _playback(table, scale)
    rate, volts = (playback["playback"][key] for key in ("sample_rate_hz", "volts_at_full_scale"))
    header = {
        "File Format": "1.10",
        "Checksum": 0,
        "Channel Count": 1,
        "Sample Rate": repr(rate),
        "High Level": repr(volts),
        "Low Level": repr(-volts),
        "Data Type": '"short"',
        "Data Points": len(codes),
    }
    lines = [*(f"{key}:{value}" for key, value in header.items()), "Data:", *map(str, codes[:, 0].tolist()), ""]
    with written_with_sidecar(path, table, scale | playback) as temporary:
        temporary.write_text("\n".join(lines), encoding="ascii", newline="\n")


def read_arb(path: Path) -> Table:
    """Return the channel of an .arb file: Keysight's text (volts from its levels), else 16-bit Rigol codes."""
    raw = readable(path).read_bytes()
    if not HEADER.match(raw):
        return RIGOL.decode(raw, path)
    head, _, body = raw.partition(b"\nData:")
    fields = dict(line.split(":", 1) for line in head.decode("latin-1").splitlines() if ":" in line)
    try:
        numbers = np.array(body.split(), dtype=np.float64)
        if fields.get("Data Type", "").strip().strip('"').lower() == "float":
            numbers = numbers * KEYSIGHT.top
        rate, high, low = (float(fields[key]) for key in ("Sample Rate", "High Level", "Low Level"))
        expected = int(fields["Data Points"])
    except (ValueError, KeyError) as error:
        raise ExciteError(f"{path}: is not a Keysight .arb file of numbers ({error}); save it again") from error
    if len(numbers) != expected or not len(numbers) or not (np.abs(numbers) <= KEYSIGHT.top + 1).all():
        raise ExciteError(f"{path}: Data Points:{expected}, but {len(numbers)} samples within +-{KEYSIGHT.top} follow")
    if not (np.isfinite([rate, high, low]).all() and rate > 0 and high > low):
        raise ExciteError(
            f"{path}: Sample Rate {rate}, levels {low} to {high}; give a positive rate and High above Low"
        )
    codes = numbers[:, None]
    if high != -low:  # foreign files may have an offset
        codes = (codes * (high - low) / 2 + KEYSIGHT.top * (high + low) / 2) / max(abs(high), abs(low))
    known = {"dt": 1 / rate, "columns": ["time_s", "u:u1 [V]"], "full_scale": [max(abs(high), abs(low))]}
    return decoded_table(codes, KEYSIGHT.top, path, raw, known)


def _playback(table: Table, scale: dict) -> dict:
    """Return what to set on the front panel, for the sidecar."""
    channel, full_scale = Channel.parse(table.names[1][2:]), scale["full_scale"][0]
    volts = full_scale * VOLTS[channel.unit] if channel.unit in VOLTS else 1.0
    rate = 1 / table.meta["dt"]
    return {
        "playback": {
            "sample_rate_hz": round(rate) if abs(rate - round(rate)) < 1e-9 * rate else rate,
            "repetition_hz": rate / len(table.values),
            "volts_at_full_scale": volts,
            "units_per_volt": full_scale / volts,
        }
    }


KEYSIGHT_FILE = Format(
    f"waveform for {KEYSIGHT.name}",
    (".arb",),
    read_arb,
    write_keysight,
    quantise_keysight,
    one_channel=True,
    wants=KEYSIGHT.wants(f", at most {KEYSIGHT_MOST_HZ:g} samples/s"),
)
RIGOL_FILE, RAF_FILE, SIGLENT_FILE = RIGOL.format(".arb"), RIGOL_RAF.format(".raf"), SIGLENT.format(".bin")
