"""Environment of one satellite, for Gymnasium."""

from __future__ import annotations

from typing import Any

from .general import GeneralSatelliteTasking
from .sats import Satellite


class SatelliteTasking(GeneralSatelliteTasking):
    """Environment of one satellite, with its own observation and action."""

    def __init__(self, satellite: Satellite, *args: Any, **kwargs: Any) -> None:
        """Creates an environment of a satellite; other arguments are those of the base."""
        super().__init__(satellite, *args, **kwargs)
        if len(self.satellites) != 1:
            raise ValueError("SatelliteTasking must be initialized with a single satellite.")

    @property
    def action_space(self) -> Any:  # type: ignore[override]
        """Space of the satellite's actions."""
        return self.satellite.action_space

    @property
    def observation_space(self) -> Any:  # type: ignore[override]
        """Space of the satellite's observation; resets the environment if it was never reset."""
        self._require_simulator()
        return self.satellite.observation_space

    @property
    def satellite(self) -> Satellite:
        """The satellite of the environment."""
        return self.satellites[0]

    def step(self, action: Any) -> Any:
        """Steps the simulation until the satellite needs an action."""
        return super().step([action])

    def _get_obs(self) -> Any:
        return self.satellite.get_obs()

    def _get_info(self) -> dict[str, Any]:
        info = super()._get_info()
        own = info.pop(self.satellite.name)
        return {**info, **own}
