"""Data that satellites collect, and the rewards that they earn."""

from typing import Any

from ..unsupported import missing_names, rso, sentence
from .base import GlobalReward
from .nadir_data import ScanningTimeReward
from .no_data import NoReward
from .resource_data import ResourceReward
from .unique_image_data import UniqueImageReward

__all__ = [
    "GlobalReward",
    "NoReward",
    "ResourceReward",
    "ScanningTimeReward",
    "UniqueImageReward",
]

_MIXED = "pass a tuple of rewarders to the environment"
_RSO_NAMES = ("RSOImageRecord", "RSOImageData", "RSOImageStore", "RSOImageReward")
_get_missing = missing_names(
    __name__,
    {
        "MixedData": sentence("MixedData", _MIXED),
        "MixedDataStore": sentence("MixedDataStore", _MIXED),
        "MixedReward": sentence("MixedReward", _MIXED),
        **{name: rso(name) for name in (*_RSO_NAMES, "RSOInspectionReward")},
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
