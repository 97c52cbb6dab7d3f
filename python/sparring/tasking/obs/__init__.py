"""Observations of satellites: items of `observation_spec`."""

from typing import Any

from ..unsupported import missing_names, rso, sentence
from .observations import Eclipse, Observation, ResourceRewardWeight, Time
from .properties import OpportunityProperties, SatProperties

__all__ = [
    "Eclipse",
    "Observation",
    "OpportunityProperties",
    "ResourceRewardWeight",
    "SatProperties",
    "Time",
]

_get_missing = missing_names(
    __name__,
    {
        "RelativeProperties": sentence("RelativeProperties", "compute it in a `fn` of SatProperties from both satellites"),
        "RSOImagingProperties": rso("RSOImagingProperties"),
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
