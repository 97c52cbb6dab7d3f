"""Text of an episode's set-up, in the format of the project's recordings."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from ..utils.elements import ClassicElements
from .model_names import dynamics_names, software_names

_ELEMENTS = ("a", "e", "i", "Omega", "omega", "f")
#: Arguments that the models of a scanning satellite do not have, though an ImagingSatellite sets
#: the first one.
_NOT_OF_SCANNERS = ("bufferNames",)


def plain(value: Any) -> Any:
    """Returns a JSON value of an argument; infinite numbers become "inf"."""
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
        number = float(value)
        if math.isinf(number):
            return "inf" if number > 0 else "-inf"
        return number
    if isinstance(value, ClassicElements) or all(hasattr(value, name) for name in _ELEMENTS):
        return {name: plain(getattr(value, name)) for name in _ELEMENTS}
    raise TypeError(f"An argument must be a number, a text or a list of them, got {value!r}.")


def setup_text(simulator: Any) -> str:
    """Returns the JSON text of the set-up of an episode."""
    environment = simulator.environment
    env = {
        "cls": environment["cls"],
        "sim_rate": simulator.sim_rate,
        "max_step_duration": simulator.max_step_duration,
        "time_limit": simulator.time_limit,
        "failure_penalty": environment["failure_penalty"],
        "terminate_on_time_limit": environment["terminate_on_time_limit"],
        "rewarders": environment["rewarders"],
        "communicator": environment["communicator"],
        "scenario": {"value_per_second": environment["value_per_second"]},
    }
    setup = {
        "env": env,
        "world_args": simulator.world.args,
        "satellites": [_satellite(satellite) for satellite in simulator.satellites],
        "targets": [
            {"name": target.name, "r_LP_P_m": target.r_LP_P, "priority": target.priority} for target in environment["targets"]
        ],
    }
    return json.dumps(plain(setup), allow_nan=False)


def _satellite(satellite: Any) -> dict[str, Any]:
    """Describes a satellite with its realised arguments."""
    dynamics = dynamics_names(satellite.dyn_type)
    args = dict(satellite.sat_args)
    if "ContinuousImagingDynModel" in dynamics:
        for name in _NOT_OF_SCANNERS:
            args.pop(name, None)
    return {
        "name": satellite.name,
        "type": satellite.native_type,
        "variable_interval": satellite.variable_interval,
        **satellite.generation_times(),
        "dyn": dynamics,
        "fsw": software_names(satellite.fsw_type),
        "sat_args": args,
        "actions": [action.describe() for action in satellite.action_builder.action_spec],
        "observations": satellite.observation_builder.native_items(),
    }
