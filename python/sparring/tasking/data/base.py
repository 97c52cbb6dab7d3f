"""Bases of data, of a satellite's store of data, and of rewarders."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from typing import Any

from ..utils.functional import Resetable

logger = logging.getLogger(__name__)


class Data(ABC):
    """Base of units of data, which are added to each other."""

    @abstractmethod
    def __add__(self, other: Any) -> Any:
        """Combines two units of data."""

    def __copy__(self) -> Any:
        return self.__class__() + self


class DataStore(ABC):
    """Base of the data that one satellite has."""

    data_type: Any

    def __init__(self, satellite: Any, initial_data: Any = None) -> None:
        self.satellite = satellite
        self.staged_data: list[Any] = []
        self.data: Any = initial_data if initial_data else self.data_type()
        self.new_data: Any = self.data_type()

    def get_log_state(self) -> Any:
        """Returns what `compare_log_states` needs of the satellite at the end of a step."""
        return None

    @abstractmethod
    def compare_log_states(self, old_state: Any, new_state: Any) -> Any:
        """Returns the data that a step added, from the states before and after it."""

    def update_from_logs(self) -> Any:
        """Adds and returns the data of the last step; the first call only keeps the state."""
        if not hasattr(self, "log_state"):
            self.log_state = self.get_log_state()
            return self.data_type()
        old_state, self.log_state = self.log_state, self.get_log_state()
        new_data = self.compare_log_states(old_state, self.log_state)
        self.data += new_data
        self.new_data = new_data
        return new_data

    def stage_communicated_data(self, external_data: Any) -> None:
        """Keeps data of another satellite until all satellites have sent theirs."""
        self.staged_data.append(external_data)

    def update_with_communicated_data(self) -> None:
        """Adds the data that other satellites sent."""
        for staged in self.staged_data:
            self.data += staged
        self.staged_data = []


class GlobalReward(ABC, Resetable):
    """Base of rewarders: it makes the stores of data, and pays for new data."""

    data_store_type: Any
    datastore_type: Any

    def __init__(self) -> None:
        self.scenario: Any
        self.data: Any
        if not hasattr(self, "data_store_type"):
            # Older name of the attribute in BSK-RL.
            self.data_store_type = self.datastore_type
        self.data_type: Any = self.data_store_type.data_type
        self.data_store_kwargs: dict[str, Any] = {}
        self.cum_reward: dict[str, float] = {}

    def link_scenario(self, scenario: Any) -> None:
        """Links the rewarder to the scenario of its environment."""
        self.scenario = scenario

    def reset_overwrite_previous(self) -> None:
        """Forgets the previous episode."""
        self.data = self.data_type()
        self.cum_reward = {}

    def initial_data(self, satellite: Any) -> Any:
        """Returns what a satellite knows at the start."""
        return self.data_type()

    def create_data_store(self, satellite: Any) -> None:
        """Gives a satellite its store of data."""
        satellite.data_store = self.data_store_type(
            satellite, initial_data=self.initial_data(satellite), **self.data_store_kwargs
        )
        self.cum_reward[satellite.name] = 0.0

    @abstractmethod
    def calculate_reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the rewards of a step by satellite name, from the new data by name."""

    def reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the rewards of a step, and adds rewards and data to those of the episode."""
        reward = self.calculate_reward(new_data_dict)
        for name, value in reward.items():
            self.cum_reward[name] += value
        for new_data in new_data_dict.values():
            self.data += new_data
        if logger.isEnabledFor(logging.INFO):
            logger.info(f"Total reward: {nonzero(reward)}")
        return reward

    def is_truncated(self, satellite: Any) -> bool:
        """Returns whether the rewarder truncates the episode for a satellite."""
        return False

    def is_terminated(self, satellite: Any) -> bool:
        """Returns whether the rewarder terminates the episode for a satellite."""
        return False


def nonzero(reward: dict[str, float]) -> dict[str, float]:
    """Returns the rewards that are not zero."""
    return {name: value for name, value in reward.items() if value != 0}
