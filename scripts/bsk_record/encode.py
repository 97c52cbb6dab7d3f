"""JSON values of recordings, and their files."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

ELEMENTS = ("a", "e", "i", "Omega", "omega", "f")


def plain(value: Any) -> Any:
    """Returns a JSON value; infinite numbers become "inf", orbital elements an object."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return "inf" if math.isinf(value) else float(value)
    if all(hasattr(value, name) for name in ELEMENTS):
        return {name: plain(getattr(value, name)) for name in ELEMENTS}
    raise TypeError(f"A recording cannot hold {value!r}; convert it to numbers first.")


def finite(value: float | None) -> float | None:
    """Returns a number, or None where it is infinite."""
    return None if value is None or math.isinf(value) else float(value)


def file_bytes(recording: dict[str, Any]) -> bytes:
    """Returns the compressed JSON of a recording; equal recordings have equal bytes."""
    text = json.dumps(plain(recording), separators=(",", ":"), allow_nan=False)
    return gzip.compress(text.encode(), compresslevel=9, mtime=0)


def write_recording(path: Path, recording: dict[str, Any]) -> int:
    """Writes the file of a recording, and returns its size in bytes."""
    content = file_bytes(recording)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return len(content)
