"""Scenarios: what there is to observe in an environment."""

from typing import Any

from ..unsupported import missing_names, rso, sentence
from .scenario import Scenario, UniformNadirScanning
from .targets import CityTargets, UniformTargets

__all__ = ["CityTargets", "Scenario", "UniformNadirScanning", "UniformTargets"]

_RSO_NAMES = ("RSOPoints", "SphericalRSO", "RSOTarget", "RSOTargetCatalog", "RSOTargets")
_get_missing = missing_names(
    __name__,
    {
        "MixedScenario": sentence("MixedScenario", "use one scenario for all satellites"),
        **{name: rso(name) for name in (*_RSO_NAMES, "RSOPriorityEvent")},
    },
)


def __getattr__(name: str) -> Any:
    return _get_missing(name)
