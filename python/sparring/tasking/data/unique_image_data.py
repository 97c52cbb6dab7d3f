"""Rewarder of the first image of each target."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from ..scene.targets import Target
from .base import Data, DataStore, GlobalReward


class UniqueImageData(Data):
    """Targets that are known, those that are known to be imaged, and the count of duplicates."""

    def __init__(
        self,
        imaged: Iterable[Target] | None = None,
        duplicates: int = 0,
        known: Iterable[Target] | None = None,
    ) -> None:
        listed = [] if imaged is None else list(imaged)
        self.imaged = set(listed)
        self.duplicates = duplicates + len(listed) - len(self.imaged)
        self.known = set(known or ())

    def __add__(self, other: UniqueImageData) -> UniqueImageData:
        imaged = self.imaged | other.imaged
        twice = len(self.imaged) + len(other.imaged) - len(imaged)
        duplicates = self.duplicates + other.duplicates + twice
        combined = self.__class__(imaged=imaged, duplicates=duplicates)
        # Large sets of known targets are shared, not copied: no method changes them.
        combined.known = _union(self.known, other.known)
        return combined


def _union(known: set[Target], other: set[Target]) -> set[Target]:
    """Union of two sets; one of them where it holds the other."""
    if other is known or other <= known:
        return known
    return other if known <= other else known | other


class UniqueImageStore(DataStore):
    """Store of images, which the simulation reports."""

    data_type = UniqueImageData

    def get_log_state(self) -> float:
        """Returns the number of images of the satellite."""
        count: float = self.satellite.image_count
        return count

    def compare_log_states(self, old_state: float, new_state: float) -> UniqueImageData:
        """Returns the image of a step, if there is one."""
        if new_state <= old_state:
            return UniqueImageData()
        assert self.satellite.latest_target is not None
        return UniqueImageData(imaged={self.satellite.latest_target})

    def update_target_colors(self, targets: Iterable[Target]) -> None:
        """Hook that colours imaged targets in Vizard; it does nothing."""


def own_priority(priority: float) -> float:
    """Returns the reward of a priority by default: the priority itself."""
    return priority


class UniqueImageReward(GlobalReward):
    """Rewarder of the first image of each target: `reward_fn` of its priority.

    Satellites that image a target in the same step share its reward. They leave out targets that
    they know to be imaged; communication spreads that knowledge.
    """

    data_store_type = UniqueImageStore

    def __init__(self, reward_fn: Callable[[float], float] = own_priority) -> None:
        super().__init__()
        self.reward_fn = reward_fn

    def initial_data(self, satellite: Any) -> UniqueImageData:
        """Returns the knowledge of all targets."""
        data: UniqueImageData = self.data_type(known=self.scenario.targets)
        return data

    def create_data_store(self, satellite: Any) -> None:
        """Gives a satellite its store and a filter that hides targets known to be imaged."""
        super().create_data_store(satellite)
        data_store = satellite.data_store

        def is_not_imaged(opportunity: dict[str, Any]) -> bool:
            is_target = opportunity["type"] == "target"
            return not is_target or opportunity["object"] not in data_store.data.imaged

        satellite.knowledge_filter = is_not_imaged

    def calculate_reward(self, new_data_dict: dict[str, Any]) -> dict[str, float]:
        """Returns the rewards of the targets that are imaged for the first time."""
        counts: dict[Target, int] = {}
        for data in new_data_dict.values():
            for target in data.imaged:
                counts[target] = counts.get(target, 0) + 1
        reward = {}
        for name, data in new_data_dict.items():
            reward[name] = 0.0
            for target in data.imaged:
                if target not in self.data.imaged:
                    reward[name] += self.reward_fn(target.priority) / counts[target]
        return reward
