"""Several rewarders in one environment."""

from __future__ import annotations

import logging
from typing import Any

from .base import Data, DataStore, GlobalReward, nonzero

logger = logging.getLogger(__name__)


class ComposedData(Data):
    """Units of data of several kinds, in the order of their rewarders."""

    def __init__(self, *data: Any) -> None:
        self.data = data

    def __add__(self, other: ComposedData) -> ComposedData:
        left, right = self.data, other.data
        if not left:
            left = tuple(type(item)() for item in right)
        elif not right:
            right = tuple(type(item)() for item in left)
        if len(left) != len(right):
            raise ValueError("ComposedData units must have the same number of data types.")
        return ComposedData(*[first + second for first, second in zip(left, right, strict=True)])

    def __getattr__(self, name: str) -> Any:
        for item in self.__dict__.get("data", ()):
            if hasattr(item, name):
                return getattr(item, name)
        raise AttributeError(f"No Data in ComposedData has attribute '{name}'")

    def __repr__(self) -> str:
        return f"ComposedData({', '.join(repr(item) for item in self.data)})"


class ComposedDataStore(DataStore):
    """Stores of several kinds of data of one satellite."""

    data_type = ComposedData

    def __init__(
        self,
        satellite: Any,
        *data_store_types: Any,
        initial_data: ComposedData | None = None,
        data_store_kwargs: list[dict[str, Any]] | None = None,
    ) -> None:
        super().__init__(satellite, initial_data)
        if data_store_kwargs is None:
            data_store_kwargs = [{} for _ in data_store_types]
        if len(data_store_types) != len(data_store_kwargs):
            raise ValueError("data_store_types and data_store_kwargs must have the same length.")
        self.data_stores = tuple(
            store_type(satellite, **kwargs) for store_type, kwargs in zip(data_store_types, data_store_kwargs, strict=True)
        )
        self.pass_data()

    def pass_data(self) -> None:
        """Gives each store its part of the data."""
        for store, data in zip(self.data_stores, self.data.data, strict=False):
            store.data = data

    def __getattr__(self, name: str) -> Any:
        if name != "log_state":
            for store in self.__dict__.get("data_stores", ()):
                if hasattr(store, name):
                    return getattr(store, name)
        raise AttributeError(f"No DataStore in ComposedDataStore has attribute '{name}'")

    def get_log_state(self) -> list[Any]:
        """Returns the states of all stores."""
        return [store.get_log_state() for store in self.data_stores]

    def compare_log_states(self, old_state: list[Any], new_state: list[Any]) -> ComposedData:
        """Returns the data of a step of all stores."""
        states = zip(self.data_stores, old_state, new_state, strict=True)
        return ComposedData(*[store.compare_log_states(old, new) for store, old, new in states])

    def update_from_logs(self) -> Any:
        """Adds and returns the data of the last step."""
        new_data = super().update_from_logs()
        self.pass_data()
        return new_data

    def update_with_communicated_data(self) -> None:
        """Adds the data that other satellites sent."""
        super().update_with_communicated_data()
        self.pass_data()


class ComposedReward(GlobalReward):
    """Sum of the rewards of several rewarders."""

    data_store_type = ComposedDataStore

    def __init__(self, *rewarders: GlobalReward) -> None:
        super().__init__()
        self.rewarders = rewarders

    def pass_data(self) -> None:
        """Gives each rewarder its part of the data."""
        for rewarder, data in zip(self.rewarders, self.data.data, strict=False):
            rewarder.data = data

    def __getattr__(self, name: str) -> Any:
        for rewarder in self.__dict__.get("rewarders", ()):
            if hasattr(rewarder, name):
                return getattr(rewarder, name)
        raise AttributeError(f"No GlobalReward in ComposedReward has attribute '{name}'")

    def reset_pre_sim_init(self) -> None:
        """Passes the reset to each rewarder."""
        for rewarder in self.rewarders:
            rewarder.reset_pre_sim_init()

    def reset_post_sim_init(self) -> None:
        """Passes the reset to each rewarder."""
        for rewarder in self.rewarders:
            rewarder.reset_post_sim_init()

    def reset_overwrite_previous(self) -> None:
        """Passes the reset to each rewarder."""
        super().reset_overwrite_previous()
        for rewarder in self.rewarders:
            rewarder.reset_overwrite_previous()

    def link_scenario(self, scenario: Any) -> None:
        """Links all rewarders to the scenario."""
        super().link_scenario(scenario)
        for rewarder in self.rewarders:
            rewarder.link_scenario(scenario)

    def initial_data(self, satellite: Any) -> ComposedData:
        """Returns what a satellite knows at the start, of all kinds."""
        return ComposedData(*[item.initial_data(satellite) for item in self.rewarders])

    def create_data_store(self, satellite: Any) -> None:
        """Gives a satellite its stores. Access filters of single rewarders do not apply."""
        satellite.data_store = ComposedDataStore(
            satellite,
            *[item.data_store_type for item in self.rewarders],
            initial_data=self.initial_data(satellite),
            data_store_kwargs=[item.data_store_kwargs for item in self.rewarders],
        )
        satellite.knowledge_filter = None
        self.cum_reward[satellite.name] = 0.0
        for rewarder in self.rewarders:
            rewarder.cum_reward[satellite.name] = 0.0

    def calculate_reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the sum of all rewards by satellite."""
        total: dict[str, float] = {}
        if not all(data.data for data in new_data_dict.values()):
            return total
        for number, rewarder in enumerate(self.rewarders):
            reward = rewarder.calculate_reward({name: data.data[number] for name, data in new_data_dict.items()})
            paid = nonzero(reward)
            if paid:
                logger.info(f"{type(rewarder).__name__} reward: {paid}")
            for name, value in reward.items():
                total[name] = total.get(name, 0.0) + value
                rewarder.cum_reward[name] += value
        return total

    def reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the rewards of a step, and adds its data to each rewarder's."""
        reward = super().reward(new_data_dict)
        self.pass_data()
        return reward

    def is_truncated(self, satellite: Any) -> bool:
        """Returns whether any rewarder truncates the episode."""
        return any(rewarder.is_truncated(satellite) for rewarder in self.rewarders)

    def is_terminated(self, satellite: Any) -> bool:
        """Returns whether any rewarder terminates the episode."""
        return any(rewarder.is_terminated(satellite) for rewarder in self.rewarders)
