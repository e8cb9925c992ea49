"""C header: the samples as a static const int16 table with its scale, for firmware that plays them (C99)."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import readable
from excite.files.formats import Format
from excite.files.native import damaged
from excite.files.quantised import codes_of, decoded_table, quantised
from excite.files.sidecar import written_with_sidecar
from excite.files.table import Table
from excite.types.channel import Channel
from excite.types.signal import Signal

TOP = 2**15 - 1
OURS = "/* Excitation signal written by excite. value = code / 32767.0 * full_scale, held for DT_S. */"
TABLE = re.compile(r"static const int16_t \w+\[\w+\]\[\w+\] = \{\n(.*?)\n\};", re.DOTALL)
ENTRY = re.compile(r"static const (?:double|char \*const) (\w+?)(?:\[\w*\])? = (?:\{ )?(.*?)(?: \})?;\n")
STRING = re.compile(r'"((?:[^"\\]|\\[0-7]{3})*)"')


def quantise(signal: Signal) -> Signal:
    """Return what 16-bit codes play."""
    return quantised(signal, TOP)


def identifier(text: str) -> str:
    """Return a C identifier that resembles `text`; the prefix keeps it off keywords, digits and reserved names."""
    return "excite_" + re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")[:40].lower()


def literal(text: str) -> str:
    """Return a C string literal of `text` in UTF-8: anything but plain letters, digits and blanks as octal escapes."""
    plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _-+./=()[]^:"
    return '"' + "".join(c if c in plain else "".join(f"\\{b:03o}" for b in c.encode()) for c in text) + '"'


def write(table: Table, path: Path) -> None:
    """Write the header and its sidecar; identifiers come from the file's name, made safe."""
    codes, scale = codes_of(table, TOP)
    name = identifier(path.stem)
    big = name.upper()
    channels = [Channel.parse(column[2:]) for column in table.names[1:]]
    digest = hashlib.sha256(codes.astype("<i2").tobytes()).hexdigest()
    rows = ",\n".join("{" + ",".join(map(str, row)) + "}" for row in codes.tolist())
    text = f"""{OURS}
#ifndef {big}_H
#define {big}_H

#include <stdint.h>

#define {big}_SAMPLES {len(codes)}
#define {big}_CHANNELS {codes.shape[1]}

static const double {name}_dt_s = {table.meta["dt"]!r};
static const double {name}_full_scale[{big}_CHANNELS] = {{ {", ".join(map(repr, scale["full_scale"]))} }};
static const char *const {name}_names[{big}_CHANNELS] = {{ {", ".join(literal(c.name) for c in channels)} }};
static const char *const {name}_units[{big}_CHANNELS] = {{ {", ".join(literal(c.unit) for c in channels)} }};
/* SHA-256 of the codes as little-endian int16, channel by channel within each sample */
static const char *const {name}_sha256 = "{digest}";

static const int16_t {name}_codes[{big}_SAMPLES][{big}_CHANNELS] = {{
{rows}
}};

#endif
"""
    with written_with_sidecar(path, table, scale) as temporary:
        temporary.write_text(text, encoding="ascii", newline="\n")


def read(path: Path) -> Table:
    """Return the signal in a header that `write` made; no other C is understood."""
    raw = readable(path).read_bytes()
    text = raw.decode("ascii", errors="replace")
    found = TABLE.search(text)
    if not text.startswith(OURS) or not found:
        raise ExciteError(f"{path}: is not a header written by excite; only its own are read back")
    with damaged(str(path)):
        entries = {key.rpartition("_")[2]: value for key, value in ENTRY.findall(text[: found.start()])}
        names, units = ([_unescaped(s) for s in STRING.findall(entries[key])] for key in ("names", "units"))
        columns = [f"u:{n} [{u}]" if u or n.endswith("]") else f"u:{n}" for n, u in zip(names, units, strict=True)]
        rows = json.loads("[" + found[1].replace("{", "[").replace("}", "]") + "]")
        codes = np.array(rows, dtype=np.int16)
        if codes.ndim != 2 or hashlib.sha256(codes.astype("<i2").tobytes()).hexdigest() != entries["sha256"].strip('"'):
            raise ExciteError("the codes are not those of its SHA-256; export the signal again")
        known = {
            "dt": float(entries["s"]),
            "columns": ["time_s", *columns],
            "full_scale": [float(v) for v in entries["scale"].split(",")],
        }
    return decoded_table(codes, TOP, path, raw, known)


def _unescaped(text: str) -> str:
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), text).encode("latin-1").decode()


C_HEADER = Format(
    "C header with a constant int16 table and its scale, for firmware",
    (".h",),
    read,
    write,
    quantise,
    wants={"samples": "16 bits, every channel at full scale"},
)
