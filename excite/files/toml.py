"""TOML files."""

import os
import tomllib
from pathlib import Path
from typing import Any

from excite.errors import ExciteError

MOST_BYTES = 10_000_000


def read_toml(path: str | os.PathLike) -> dict[str, Any]:
    """Return the table in a TOML file (UTF-8, with or without BOM); errors name the file and the place in it."""
    try:
        if (size := Path(path).stat().st_size) > MOST_BYTES:
            raise ExciteError(f"{path}: {size} bytes exceed the limit of {MOST_BYTES}; numbers belong in a data file")
        return tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ExciteError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ExciteError(f"{path}: not a valid TOML file ({error}); correct it at that place") from None
