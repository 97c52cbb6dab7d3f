"""Rewarder of the change of a resource of the satellite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..obs.observations import ResourceRewardWeight
from .base import Data, DataStore, GlobalReward


class ResourceData(Data):
    """Change of a resource."""

    def __init__(self, resource_accumulated: float = 0.0) -> None:
        self.resource_accumulated = resource_accumulated

    def __add__(self, other: ResourceData) -> ResourceData:
        return ResourceData(self.resource_accumulated + other.resource_accumulated)

    def __repr__(self) -> str:
        return f"ResourceData(resource_accumulated={self.resource_accumulated})"


def _no_resource(satellite: Any) -> float:
    """Resource that no satellite has."""
    return 0.0


class ResourceDataStore(DataStore):
    """Store of the changes of a resource, the value of a function of the satellite."""

    data_type = ResourceData

    def __init__(self, *args: Any, resource_fn: Callable[[Any], float] = _no_resource, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.resource_fn = resource_fn

    def get_log_state(self) -> float:
        """Returns the resource of the satellite."""
        return self.resource_fn(self.satellite)

    def compare_log_states(self, old_state: float, new_state: float) -> ResourceData:
        """Returns the change of the resource."""
        return ResourceData(new_state - old_state)


class ResourceReward(GlobalReward):
    """Rewarder that pays `reward_weight` for each unit that `resource_fn` of a satellite gains.

    The weight may be a function that draws it at each reset.
    """

    data_store_type = ResourceDataStore

    def __init__(
        self,
        reward_weight: float | Callable[[], float] = 1.0,
        resource_fn: Callable[[Any], float] = _no_resource,
    ) -> None:
        super().__init__()
        self._reward_weight = reward_weight
        self.reward_weight: float
        self.resource_fn = resource_fn
        self.data_store_kwargs = {"resource_fn": resource_fn}

    def reset_pre_sim_init(self) -> None:
        """Draws the weight of an episode."""
        weight = self._reward_weight
        self.reward_weight = weight() if callable(weight) else weight

    def reset_post_sim_init(self) -> None:
        """Adds the weight to the observations of weights."""
        for satellite in self.scenario.satellites:
            for item in satellite.observation_builder.observation_spec:
                if isinstance(item, ResourceRewardWeight):
                    item.weight_vector.append(self.reward_weight)

    def calculate_reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the weighted change of each satellite's resource."""
        return {name: self.reward_weight * data.resource_accumulated for name, data in new_data_dict.items()}
