"""Environments of satellite tasking under BSK-RL's names."""

from .constellation import ConstellationTasking
from .general import GeneralSatelliteTasking
from .no_action import NO_ACTION, is_no_action
from .single import SatelliteTasking

__all__ = [
    "NO_ACTION",
    "ConstellationTasking",
    "GeneralSatelliteTasking",
    "SatelliteTasking",
    "is_no_action",
]
