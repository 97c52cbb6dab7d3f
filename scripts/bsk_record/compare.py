"""Comparison of a new recording with its file."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

# Largest relative difference that another processor may cause: NumPy's rounding differs between processors.
TOLERANCE = 1e-6


class StructureError(Exception):
    """Path of a value that is missing, of another type, or another text."""


def compare_with_file(path: Path, content: bytes) -> tuple[bool, str]:
    """Returns whether a file holds the same recording as `content`, and a sentence that says how they differ."""
    if not path.is_file():
        return False, f"{path} is missing"
    stored, new = (json.loads(gzip.decompress(data)) for data in (path.read_bytes(), content))
    if stored == new:
        return True, "same"
    try:
        difference, place = largest_difference(stored, new, "")
    except StructureError as error:
        return False, f"differs at {error}"
    return difference <= TOLERANCE, f"largest relative difference {difference:.1e} at {place}"


def largest_difference(stored: Any, new: Any, path: str) -> tuple[float, str]:
    """Returns the largest difference of numbers, relative to numbers above 1, and the path of the value."""
    if isinstance(stored, dict) and isinstance(new, dict) and stored.keys() == new.keys():
        pairs = [(stored[key], new[key], f"{path}/{key}") for key in stored]
    elif isinstance(stored, list) and isinstance(new, list) and len(stored) == len(new):
        pairs = [(*items, f"{path}/{index}") for index, items in enumerate(zip(stored, new, strict=True))]
    elif isinstance(stored, float) and isinstance(new, float):
        return abs(stored - new) / max(1.0, abs(stored), abs(new)), path
    elif type(stored) is type(new) and stored == new:
        return 0.0, path
    else:
        raise StructureError(path)
    return max((largest_difference(*pair) for pair in pairs), default=(0.0, path))
