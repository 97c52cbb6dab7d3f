"""Built-in policies without a model."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from .scenario import Scenario, check_seed, native_scenario
from .tasks import task


class Policy:
    """Built-in policy for one scenario.

    Its actions are along the world's axes: make environments with `axes="world"` for it.
    """

    def __init__(self, name: str, scenario: Scenario, seed: int = 0) -> None:
        self.name = name
        self._has_named_actions = bool(task(scenario.task).action_names)
        self._native = _native.NativePolicy(name, native_scenario(scenario), check_seed(seed))

    def act(self, telemetry: Mapping[str, Any]) -> npt.NDArray[Any]:
        """Returns the action of each agent: agents × values, or an integer for each agent if actions have names.

        Args:
            telemetry: Observation in the wire form: `Environment.telemetry()`, or a server's.
        """
        actions = self._native.act(json.dumps(dict(telemetry)))
        return actions[:, 0].astype(np.int64) if self._has_named_actions else actions


def policy(name: str, scenario: Scenario, seed: int = 0) -> Policy:
    """Makes a built-in policy by name; `sparring.task(…).policies` lists and describes them.

    Raises:
        ValueError: The policy is unknown, or the scenario or seed is invalid.
    """
    return Policy(name, scenario, seed)
