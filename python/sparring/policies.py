"""The policies without a model."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from .scenario import Scenario, native_of, plain_seed


class Policy:
    """A built-in policy on one scenario. Its actions are along the world's axes: make environments with `axes="world"` for it."""

    def __init__(self, name: str, scenario: Scenario, seed: int = 0) -> None:
        self.name = name
        self._native = _native.NativePolicy(name, native_of(scenario), plain_seed(seed))

    def act(self, telemetry: Mapping[str, Any]) -> npt.NDArray[np.float64]:
        """What each agent does, agents × values, on what it sees: `Environment.telemetry()`, or what a server says."""
        return self._native.act(json.dumps(dict(telemetry)))


def policy(name: str, scenario: Scenario, seed: int = 0) -> Policy:
    """A built-in policy by name: `sparring.task(…).policies` has them, and what they do.

    Raises:
        ValueError: No such policy, or no scenario or seed.
    """
    return Policy(name, scenario, seed)
