"""Bases of actions, and of the builder that gives a satellite's actions to the simulation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import deepcopy
from typing import Any

from gymnasium import spaces

from ..utils.functional import AbstractClassProperty
from ..utils.spec_items import SpecBuilder, SpecItem


def select_action_builder(satellite: Any) -> ActionBuilder:
    """Returns the builder that all actions of a satellite have in common."""
    types = [item.builder_type for item in satellite.action_spec]
    if any(builder_type != types[0] for builder_type in types):
        raise NotImplementedError("Heterogenous action builders not supported.")
    builder: ActionBuilder = types[0](satellite)
    return builder


class ActionBuilder(ABC, SpecBuilder):
    """Actions of one satellite."""

    def __init__(self, satellite: Any) -> None:
        super().__init__(satellite)
        self.action_spec: list[Any] = deepcopy(satellite.action_spec)
        for item in self.action_spec:
            item.link_satellite(satellite)

    def items(self) -> list[Any]:
        """Returns the actions in the order of the spec."""
        return self.action_spec

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


class Action(ABC, SpecItem):
    """Base of the items of `action_spec`."""

    builder_type: Any = AbstractClassProperty()

    def __init__(self, name: str = "act") -> None:
        super().__init__(name)

    @abstractmethod
    def set_action(self, action: Any, prev_action_key: str | None = None) -> Any:
        """Gives the action to the satellite."""
