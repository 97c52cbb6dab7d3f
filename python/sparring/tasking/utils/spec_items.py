"""Bases of the items of a satellite's specs (observations and actions), and of the builders that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .functional import Resetable


class SpecItem(Resetable):
    """Item of a spec: it has a name, and is linked to its satellite and to the simulator of each episode."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.satellite: Any
        self.simulator: Any

    def link_satellite(self, satellite: Any) -> None:
        """Links the item to its satellite."""
        self.satellite = satellite

    def link_simulator(self, simulator: Any) -> None:
        """Links the item to the simulator of the episode."""
        self.simulator = simulator


class SpecBuilder(Resetable):
    """Holder of the items of one satellite's spec, to which it passes the resets."""

    def __init__(self, satellite: Any) -> None:
        self.satellite = satellite
        self.simulator: Any

    def items(self) -> Sequence[Any]:
        """Returns the items in the order of the spec."""
        raise NotImplementedError

    def reset_overwrite_previous(self) -> None:
        """Passes the reset to each item."""
        for item in self.items():
            item.reset_overwrite_previous()

    def reset_pre_sim_init(self) -> None:
        """Passes the reset to each item."""
        for item in self.items():
            item.reset_pre_sim_init()

    def reset_during_sim_init(self) -> None:
        """Passes the reset to each item."""
        for item in self.items():
            item.reset_during_sim_init()

    def reset_post_sim_init(self) -> None:
        """Passes the simulator and the reset to each item."""
        self.simulator = self.satellite.simulator
        for item in self.items():
            item.link_simulator(self.simulator)
            item.reset_post_sim_init()
