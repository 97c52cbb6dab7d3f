"""Actions of satellites: items of `action_spec`."""

from typing import Any

from ..unsupported import missing_names, rso, sentence
from .actions import Action
from .discrete_actions import (
    Broadcast,
    Charge,
    Desat,
    DiscreteAction,
    DiscreteFSWAction,
    Downlink,
    Drift,
    Image,
    NadirPoint,
    Scan,
)

__all__ = [
    "Action",
    "Broadcast",
    "Charge",
    "Desat",
    "DiscreteAction",
    "DiscreteFSWAction",
    "Downlink",
    "Drift",
    "Image",
    "NadirPoint",
    "Scan",
]

_ORBIT = "satellites keep their orbits; use discrete actions"
_get_missing = missing_names(
    __name__,
    {
        "AttitudeSetpoint": sentence("AttitudeSetpoint", "use NadirPoint, Charge, Scan or Image"),
        "ContinuousAction": sentence("ContinuousAction", "use discrete actions"),
        "ImageRSO": rso("ImageRSO"),
        "ImpulsiveThrust": sentence("ImpulsiveThrust", _ORBIT),
        "ImpulsiveThrustHill": sentence("ImpulsiveThrustHill", _ORBIT),
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
