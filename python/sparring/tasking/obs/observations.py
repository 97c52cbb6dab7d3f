"""Base of observations, and those of time, eclipses and weights of rewards."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from ..utils.spec_items import SpecItem

#: Description of an item for the simulation.
NativeItem = dict[str, Any]


def as_number(norm: Any) -> float | None:
    """Returns a divisor that the simulation can apply, or None: one other than a finite number or zero."""
    if not isinstance(norm, (int, float, np.integer, np.floating)) or isinstance(norm, bool):
        return None
    return float(norm) if norm != 0 and math.isfinite(norm) else None


class Observation(ABC, SpecItem):
    """Base of the items of `observation_spec`."""

    def __init__(self, name: str = "obs") -> None:
        super().__init__(name)

    @abstractmethod
    def get_obs(self) -> Any:
        """Returns the value: a number, list, array or dictionary of them."""

    def plan(self) -> Plan:
        """Returns which parts of the value the simulation computes."""
        return Plan().add_python(self.get_obs)


class Plan:
    """Parts of a value in order: numbers of the simulation, or functions that return the rest."""

    def __init__(self) -> None:
        self.items: list[NativeItem] = []
        #: Number of values to take from the simulation, or function to call.
        self.parts: list[tuple[str, Any]] = []

    def add_native(self, count: int) -> Plan:
        """Adds numbers that the simulation computes."""
        self.parts.append(("native", count))
        return self

    def add_python(self, function: Any) -> Plan:
        """Adds the value of a function."""
        self.parts.append(("python", function))
        return self


class Time(Observation):
    """Time of the simulation, or time left, divided by `norm` seconds or by the time limit."""

    def __init__(
        self,
        norm: float | None = None,
        name: str = "time",
        observe_time_remaining: bool = False,
    ) -> None:
        super().__init__(name=name)
        self.norm = norm
        self.return_time_remaining = observe_time_remaining

    def reset_post_sim_init(self) -> None:
        """Takes the time limit as divisor if there is none."""
        self._norm = self.simulator.time_limit if self.norm is None else self.norm

    def get_obs(self) -> float:
        """Returns the time divided by the norm."""
        time: float = self.simulator.sim_time
        if self.return_time_remaining:
            time = self.simulator.time_limit - time
        return time / self._norm


class Eclipse(Observation):
    """Times until the next eclipse begins and until the next one ends, divided by `norm` s."""

    def __init__(self, norm: float = 1.0, name: str = "eclipse") -> None:
        super().__init__(name=name)
        self.norm = norm

    def get_obs(self) -> list[float]:
        """Returns both times divided by the norm."""
        now = self.simulator.sim_time
        start, end = self.satellite.trajectory.next_eclipse(now)
        return [(start - now) / self.norm, (end - now) / self.norm]


class ResourceRewardWeight(Observation):
    """Weights of all `ResourceReward`s in the environment, divided by `norm`."""

    def __init__(self, name: str = "resource_reward_weight", norm: Any = 1.0) -> None:
        super().__init__(name=name)
        self.norm = norm
        self.weight_vector: list[float] = []

    def reset_overwrite_previous(self) -> None:
        """Forgets the weights of the previous episode; rewarders add theirs."""
        self.weight_vector = []

    def get_obs(self) -> Any:
        """Returns the weights divided by the norm."""
        return np.array(self.weight_vector) / self.norm
