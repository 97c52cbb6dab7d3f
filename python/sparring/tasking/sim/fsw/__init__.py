"""Flight software models of satellites: the actions they can do, and their arguments."""

from typing import Any

from ...unsupported import missing_names, rso, sentence
from .base import FSWModel, FSWModelABC, Task, action
from .basic import BasicFSWModel, SteeringFSWModel
from .imaging import ContinuousImagingFSWModel, ImagingFSWModel, SteeringImagerFSWModel

__all__ = [
    "BasicFSWModel",
    "ContinuousImagingFSWModel",
    "FSWModel",
    "FSWModelABC",
    "ImagingFSWModel",
    "SteeringFSWModel",
    "SteeringImagerFSWModel",
    "Task",
    "action",
]

_get_missing = missing_names(
    __name__,
    {
        "MagicOrbitalManeuverFSWModel": sentence(
            "MagicOrbitalManeuverFSWModel", "satellites keep their orbits; use a BasicFSWModel"
        ),
        "RSOInspectorFSWModel": rso("RSOInspectorFSWModel"),
        "SpaceToSpaceImagingFSWModel": rso("SpaceToSpaceImagingFSWModel"),
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
