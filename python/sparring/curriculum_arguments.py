"""Arguments of `Curriculum`: their types and limits."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

Form = Literal["auto", "groups", "columns"]
Purpose = Literal["train", "probe", "eval"]

#: Maximum number of groups of a lease.
MAX_LEASE_GROUPS = 1024
#: Maximum of each integer argument of `Curriculum`.
INTEGER_LIMITS = {
    "lease_groups": MAX_LEASE_GROUPS,
    "group_size": 1024,
    "ahead": 2**20,
    "buffer": 2**31,
    "ttl_s": 24 * 3600,
}


def check_modes(form: str, purpose: str) -> None:
    """Checks form and purpose.

    Raises:
        ValueError: One of them is unknown, or they do not go together.
    """
    if form not in ("auto", "groups", "columns"):
        raise ValueError(f"form: {form!r} is none of auto, groups, columns")
    if purpose not in ("train", "probe", "eval"):
        raise ValueError(f"purpose: {purpose!r} is none of train, probe, eval")
    if purpose == "eval" and form == "columns":
        raise ValueError("form: an evaluation is reported as groups")


def check_numbers(max_wait_s: Any, **integers: Any) -> None:
    """Checks the numeric arguments.

    Raises:
        ValueError: A number is out of range; the message names the field.
    """
    for name, value in integers.items():
        limit = INTEGER_LIMITS[name]
        if value is None and name in ("lease_groups", "group_size"):
            continue
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= limit:
            raise ValueError(f"{name}: must be an integer from 1 to {limit}, got {value!r}")
    if not isinstance(max_wait_s, (int, float, np.number)) or not 0.0 <= max_wait_s < 1e9:
        raise ValueError(f"max_wait_s: must be a number of seconds >= 0, got {max_wait_s!r}")
