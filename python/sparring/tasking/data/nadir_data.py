"""Rewarder of the time for which the ground is scanned."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .base import Data, DataStore, GlobalReward


class ScanningTime(Data):
    """Time of scanned data, s."""

    def __init__(self, scanning_time: float = 0.0) -> None:
        self.scanning_time = scanning_time

    def __add__(self, other: ScanningTime) -> ScanningTime:
        return self.__class__(self.scanning_time + other.scanning_time)


class ScanningTimeStore(DataStore):
    """Store that measures scanned time by the growth of the stored data."""

    data_type = ScanningTime

    def get_log_state(self) -> float:
        """Returns the stored data, bits."""
        level: float = self.satellite.dynamics.storage_level
        return level

    def compare_log_states(self, old_state: float, new_state: float) -> ScanningTime:
        """Returns the time of the data that a step added; less data is no time."""
        if new_state <= old_state:
            return ScanningTime(0.0)
        rate = self.satellite.dynamics.instrument.nodeBaudRate
        return ScanningTime((new_state - old_state) / rate)


class ScanningTimeReward(GlobalReward):
    """Rewarder of scanned time: `reward_fn` of it, by default the scenario's value a second."""

    data_store_type = ScanningTimeStore

    def __init__(self, reward_fn: Callable[[float], float] | None = None) -> None:
        super().__init__()
        self._reward_fn = reward_fn

    @property
    def is_linear(self) -> bool:
        """True if the reward is the scenario's value of each second."""
        return self._reward_fn is None

    @property
    def reward_fn(self) -> Callable[[float], float]:
        """Reward of a time in seconds."""
        if self._reward_fn is not None:
            return self._reward_fn
        value = self.scenario.value_per_second
        return lambda time: time * value

    def calculate_reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the reward of each satellite's scanned time."""
        function = self.reward_fn
        return {name: function(data.scanning_time) for name, data in new_data_dict.items()}
