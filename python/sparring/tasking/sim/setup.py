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


def plain(value: Any, name: str = "argument") -> Any:
    """Returns a JSON value of a named argument; infinite numbers become "inf", and NaN is a ValueError."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, dict):
        return {key: plain(item, key) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), name)
    if isinstance(value, (list, tuple)):
        return [plain(item, name) for item in value]
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        number = float(value)
        if math.isnan(number):
            raise ValueError(f"`{name}` must be a number, got nan")
        if math.isinf(number):
            return "inf" if number > 0 else "-inf"
        return number
    if isinstance(value, ClassicElements) or all(hasattr(value, element) for element in _ELEMENTS):
        return {element: plain(getattr(value, element), element) for element in _ELEMENTS}
    raise TypeError(f"`{name}` must be a number, a text or a list of them, got {value!r}")


def setup_text(simulator: Any) -> str:
    """Returns the JSON text of the set-up of an episode."""
    simulator.number_targets()
    environment = simulator.environment
    communicator = environment["communicator"]
    env = _finite(
        {
            "cls": environment["cls"],
            "sim_rate": simulator.sim_rate,
            "max_step_duration": simulator.max_step_duration,
            "time_limit": simulator.time_limit,
            "failure_penalty": environment["failure_penalty"],
            "terminate_on_time_limit": environment["terminate_on_time_limit"],
            "rewarders": environment["rewarders"],
            "communicator": {**communicator, "min_period": communicator["min_period"] if communicator["min_period"] > 0 else 0.0},
            "scenario": {"value_per_second": environment["value_per_second"]},
        }
    )
    setup = {
        "env": env,
        "world_args": _finite(simulator.world.args),
        "satellites": [_satellite(satellite) for satellite in simulator.satellites],
        "targets": [place.describe() for place in simulator.places],
    }
    try:
        return json.dumps(setup, default=_converted, allow_nan=False)
    except (TypeError, ValueError):
        # Lists with infinite numbers are rare; other errors are raised again, with the name of the argument.
        return json.dumps(plain(setup), allow_nan=False)


def _converted(value: Any) -> Any:
    """JSON value of an argument of numpy's types, or of orbital elements."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return plain(value)


def _finite(args: dict[str, Any]) -> dict[str, Any]:
    """Arguments with "inf" in place of infinite numbers."""
    return {name: plain(value) if isinstance(value, float) and math.isinf(value) else value for name, value in args.items()}


def _satellite(satellite: Any) -> dict[str, Any]:
    """Describes a satellite with its realised arguments."""
    dynamics = dynamics_names(satellite.dyn_type)
    args = dict(satellite.sat_args)
    if "ContinuousImagingDynModel" in dynamics:
        for name in _NOT_OF_SCANNERS:
            args.pop(name, None)
    if "storageInit" in args and args["storageInit"] < 0:
        # A level that the storage cannot have leaves it empty, as in BSK-RL.
        args["storageInit"] = 0
    return {
        "name": satellite.name,
        "type": satellite.native_type,
        "variable_interval": bool(satellite.variable_interval),
        **_finite(satellite.generation_times()),
        "dyn": dynamics,
        "fsw": software_names(satellite.fsw_type),
        "sat_args": _finite(args),
        "actions": [action.describe() for action in satellite.action_builder.action_spec],
        "observations": satellite.observation_builder.native_items(),
    }
