"""Actions that let a satellite go on."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Action that lets a satellite go on; None does so too.
NO_ACTION = (2**31) - 1


def is_no_action(action: Any) -> bool:
    """Returns whether an action lets the satellite go on."""
    if action is None:
        return True
    if type(action) is int:
        return action == NO_ACTION
    if isinstance(action, (int, np.integer)):
        return int(action) == NO_ACTION
    if isinstance(action, (float, np.floating, np.ndarray, list, tuple)):
        values = np.asarray(action)
        if values.size == 0 or values.dtype.kind not in "iuf":
            return False
        return bool(np.all(np.isclose(values, NO_ACTION, rtol=0.0, atol=1.0)))
    return False
