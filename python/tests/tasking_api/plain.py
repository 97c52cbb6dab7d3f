"""Values that programs returned as JSON, and their comparison."""

from __future__ import annotations

import math

import numpy as np

DIGITS = 10
#: Largest difference, relative to numbers above 1: windows differ by up to 0.05 s, wheels by 0.02 rad/s.
TOLERANCE = 1e-4


def plain(value):
    """Returns a JSON value with rounded numbers."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)) or value is None:
        return None if value is None else bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.{DIGITS}g}")
    return str(value)


def differences(expected, got, path=""):
    """Returns the places where two JSON values differ by more than the tolerance."""
    if isinstance(expected, dict) and isinstance(got, dict):
        if list(expected) != list(got):
            return [f"{path}: keys {list(expected)} and {list(got)}"]
        return [line for key in expected for line in differences(expected[key], got[key], f"{path}/{key}")]
    if isinstance(expected, list) and isinstance(got, list):
        if len(expected) != len(got):
            return [f"{path}: lengths {len(expected)} and {len(got)}"]
        pairs = enumerate(zip(expected, got, strict=True))
        return [line for index, (first, second) in pairs for line in differences(first, second, f"{path}/{index}")]
    if is_number(expected) and is_number(got):
        close = math.isclose(expected, got, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
        return [] if close or expected == got else [f"{path}: {expected} and {got}"]
    return [] if expected == got else [f"{path}: {expected!r} and {got!r}"]


def is_number(value):
    """Returns whether a value is a number other than a truth value."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)
