"""Rewarder that pays nothing."""

from __future__ import annotations

from typing import Any

from .base import Data, DataStore, GlobalReward


class NoData(Data):
    """Unit of no data."""

    def __add__(self, other: Any) -> NoData:
        return self.__class__()


class NoDataStore(DataStore):
    """Store that has no data."""

    data_type = NoData

    def compare_log_states(self, old_state: Any, new_state: Any) -> NoData:
        """Returns a unit of no data."""
        return self.data_type()


class NoReward(GlobalReward):
    """Rewarder that pays nothing."""

    data_store_type = NoDataStore

    def calculate_reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns zero for each satellite."""
        return dict.fromkeys(new_data_dict, 0.0)
