"""Bases of actions, and of the builder that gives a satellite's actions to the simulation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import deepcopy
from typing import Any

from gymnasium import spaces

from ..utils.functional import AbstractClassProperty, Resetable


def select_action_builder(satellite: Any) -> ActionBuilder:
    """Returns the builder that all actions of a satellite have in common."""
    types = [item.builder_type for item in satellite.action_spec]
    if any(builder_type != types[0] for builder_type in types):
        raise NotImplementedError("Heterogenous action builders not supported.")
    builder: ActionBuilder = types[0](satellite)
    return builder


class ActionBuilder(ABC, Resetable):
    """Actions of one satellite."""

    def __init__(self, satellite: Any) -> None:
        self.satellite = satellite
        self.simulator: Any
        self.action_spec: list[Any] = deepcopy(satellite.action_spec)
        for item in self.action_spec:
            item.link_satellite(satellite)

    def reset_overwrite_previous(self) -> None:
        """Passes the reset to each action."""
        for item in self.action_spec:
            item.reset_overwrite_previous()

    def reset_pre_sim_init(self) -> None:
        """Passes the reset to each action."""
        for item in self.action_spec:
            item.reset_pre_sim_init()

    def reset_during_sim_init(self) -> None:
        """Passes the reset to each action."""
        for item in self.action_spec:
            item.reset_during_sim_init()

    def reset_post_sim_init(self) -> None:
        """Passes the reset and the simulator to each action."""
        self.simulator = self.satellite.simulator
        for item in self.action_spec:
            item.link_simulator(self.simulator)
            item.reset_post_sim_init()

    @property
    @abstractmethod
    def action_space(self) -> spaces.Space[Any]:
        """Space of the satellite's actions."""

    @property
    @abstractmethod
    def action_description(self) -> Any:
        """Names of the actions."""

    @abstractmethod
    def set_action(self, action: Any) -> None:
        """Gives an action to the satellite."""


class Action(ABC, Resetable):
    """Base of the items of `action_spec`."""

    builder_type: Any = AbstractClassProperty()

    def __init__(self, name: str = "act") -> None:
        self.name = name
        self.satellite: Any
        self.simulator: Any

    def link_satellite(self, satellite: Any) -> None:
        """Links the action to its satellite."""
        self.satellite = satellite

    def link_simulator(self, simulator: Any) -> None:
        """Links the action to the simulator of the episode."""
        self.simulator = simulator

    @abstractmethod
    def set_action(self, action: Any, prev_action_key: str | None = None) -> Any:
        """Gives the action to the satellite."""
