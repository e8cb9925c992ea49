"""Digests: one SHA-256 of values of any of the types that travel, and of the code that computes with them."""

import hashlib
import struct
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np


def digest(*values: Any) -> str:
    """Return the hexadecimal SHA-256 of values: numbers, text, arrays, lists, mappings, dataclasses of these.

    Equal values have equal digests, whatever the order of a mapping's keys; values of different types differ.
    """
    found = hashlib.sha256()
    for value in values:
        _feed(found, value)
    return found.hexdigest()


def _feed(found: Any, value: Any) -> None:
    if isinstance(value, Enum):
        value = f"{type(value).__name__}.{value.name}"
    if isinstance(value, np.ndarray) and value.dtype != object:
        found.update(f"array{value.dtype.str}{value.shape}".encode())
        found.update(np.ascontiguousarray(value).view(np.uint8).data if value.size else b"")
    elif isinstance(value, Mapping):
        found.update(f"mapping{len(value)}".encode())
        for key in sorted(value, key=repr):
            _feed(found, key)
            _feed(found, value[key])
    elif isinstance(value, (list, tuple)):
        found.update(f"list{len(value)}".encode())
        for each in value:
            _feed(found, each)
    elif is_dataclass(value) and not isinstance(value, type):
        found.update(f"{type(value).__module__}.{type(value).__qualname__}".encode())
        for each in fields(value):
            if not each.name.startswith("_"):
                _feed(found, getattr(value, each.name))
    elif isinstance(value, (float, np.floating)) and not isinstance(value, bool):
        found.update(b"float" + struct.pack("<d", value))
    elif value is None or isinstance(value, (bool, int, str, bytes, complex, np.generic)):
        found.update(f"{type(value).__name__}:{value!r};".encode())
    else:
        raise TypeError(f"digest: a {type(value).__name__} has none; give plain values, arrays or dataclasses")


@cache
def code_digest(*packages: str) -> str:
    """Return the digest of the source files of packages or modules, which changes with every version of the code."""
    found = hashlib.sha256()
    for package in packages:
        module = import_module(package)
        home = Path(module.__path__[0]) if hasattr(module, "__path__") else Path(str(module.__file__)).parent
        files = sorted(home.rglob("*.py")) if hasattr(module, "__path__") else [Path(str(module.__file__))]
        for path in files:
            found.update(f"{package}/{path.relative_to(home).as_posix()}".encode() + path.read_bytes())
    return found.hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
