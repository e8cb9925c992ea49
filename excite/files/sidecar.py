"""The JSON file beside a data file: what its format has no place for, and the SHA-256 that binds the two together."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from excite.files.atomic import written
from excite.files.table import Table


def sidecar(path: Path) -> Path:
    """Return the path of the JSON file that rides along with a data file: its name with .json appended."""
    return path.with_name(path.name + ".json")


@contextmanager
def written_with_sidecar(path: Path, table: Table, extra: Mapping | None = None) -> Iterator[Path]:
    """Yield a temporary file as `written` does; then write the sidecar: name, SHA-256, headers, `extra` and the meta."""
    with written(path) as temporary:
        yield temporary
        with open(temporary, "rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
    record = {"file": path.name, "sha256": digest, "columns": list(table.names), **(extra or {}), **table.meta}
    with written(sidecar(path)) as temporary:
        temporary.write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_sidecar(path: Path, raw: bytes) -> dict:
    """Return what a sidecar says about exactly these bytes of `path`, else nothing."""
    try:
        record = json.loads(sidecar(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(record, dict) or record.get("sha256") != hashlib.sha256(raw).hexdigest():
        return {}
    return {key: value for key, value in record.items() if key not in ("file", "sha256")}
