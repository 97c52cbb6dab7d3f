"""Dynamics models of satellites. `base` has the state, `basic` the platform, `imaging` the payload."""

from typing import Any

from ...unsupported import missing_names, rso, sentence
from .base import (
    AtmosphericDragDynModel,
    DisturbanceTorqueDynModel,
    DynamicsModel,
    DynamicsModelABC,
    EclipseDynModel,
)
from .basic import BasicDynamicsModel
from .communication import FullFeaturedDynModel, LOSCommDynModel
from .imaging import ContinuousImagingDynModel, GroundStationDynModel, ImagingDynModel

__all__ = [
    "AtmosphericDragDynModel",
    "BasicDynamicsModel",
    "ContinuousImagingDynModel",
    "DisturbanceTorqueDynModel",
    "DynamicsModel",
    "DynamicsModelABC",
    "EclipseDynModel",
    "FullFeaturedDynModel",
    "GroundStationDynModel",
    "ImagingDynModel",
    "LOSCommDynModel",
]

_DISTANCE = "check distances in an aliveness checker of a BasicDynamicsModel"
_get_missing = missing_names(
    __name__,
    {
        "ConjunctionDynModel": sentence("ConjunctionDynModel", _DISTANCE),
        "MaxRangeDynModel": sentence("MaxRangeDynModel", _DISTANCE),
        "RSODynModel": rso("RSODynModel"),
        "RSOInspectorDynModel": rso("RSOInspectorDynModel"),
        "RSOTargetDynModel": rso("RSOTargetDynModel"),
        "SpaceToSpaceImagingDynModel": rso("SpaceToSpaceImagingDynModel"),
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
