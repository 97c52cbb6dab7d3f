"""Satellites: the agents of an environment.

A subclass sets `observation_spec`, `action_spec`, `dyn_type` and `fsw_type`.
"""

from .access_satellite import AccessSatellite
from .imaging_satellite import ImagingSatellite
from .satellite import Satellite

__all__ = ["AccessSatellite", "ImagingSatellite", "Satellite"]
