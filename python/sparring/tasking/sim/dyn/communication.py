"""Lines of sight between satellites."""

from __future__ import annotations

from typing import Any

from ...utils.functional import default_args
from ..parameters import Parameters
from .base import DynamicsModel
from .imaging import GroundStationDynModel


class LOSCommDynModel(DynamicsModel):
    """Satellite that sees which other satellites are in line of sight."""

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_los_comms(**kwargs)

    @default_args(losMaximumRange=-1.0)
    def setup_los_comms(self, losMaximumRange: float, **kwargs: Any) -> None:
        """Sets up lines of sight of at most `losMaximumRange` m; -1 is no limit."""
        self.losComms = Parameters(maximumRange=losMaximumRange)


class FullFeaturedDynModel(GroundStationDynModel, LOSCommDynModel):
    """Satellite with an instrument, ground stations and lines of sight."""
