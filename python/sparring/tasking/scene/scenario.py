"""Base of scenarios, and the scenario of scanning."""

from __future__ import annotations

from typing import Any

from ..utils.functional import Resetable


class Scenario(Resetable):
    """Base of scenarios; it has nothing to observe."""

    def __init__(self) -> None:
        self.satellites: list[Any]
        self.utc_init: str

    def link_satellites(self, satellites: list[Any]) -> None:
        """Links the scenario to the satellites of its environment."""
        self.satellites = satellites

    def validate_satellite_names(self, satellites: list[Any]) -> None:
        """Hook that may reject names before the environment numbers equal ones."""

    def after_step(self, sim_time: float) -> None:
        """Hook that may change the scenario after the rewards of a step."""


class UniformNadirScanning(Scenario):
    """Ground that is worth `value_per_second` wherever it is scanned."""

    def __init__(self, value_per_second: float = 1.0) -> None:
        super().__init__()
        self.value_per_second = value_per_second
