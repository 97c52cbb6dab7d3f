"""Builder of a satellite's observation.

Most values come from the simulation in one call; the rest are functions of the user, in between.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from copy import deepcopy
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces

from ..scene.targets import Target
from ..utils.eclipses import NO_ECLIPSE, warn_of_no_eclipse
from ..utils.errors import no_opportunity
from ..utils.functional import vectorize_nested_dict
from ..utils.spec_items import SpecBuilder
from .observations import Eclipse, Plan, Time, as_number

_LIMIT = 1e16


def nested_obs_to_space(value: Any, dtype: Any) -> spaces.Space[Any]:
    """Returns the space of an observation: a dictionary of spaces, or a box."""
    if isinstance(value, dict):
        return spaces.Dict({key: nested_obs_to_space(item, dtype=dtype) for key, item in value.items()})
    if isinstance(value, list):
        shape: tuple[int, ...] = (len(value),)
    elif isinstance(value, (float, int)):
        shape = (1,)
    elif isinstance(value, np.ndarray):
        shape = value.shape
    else:
        raise TypeError(f"Cannot convert {value} to gym space.")
    return spaces.Box(low=-_LIMIT, high=_LIMIT, shape=shape, dtype=dtype)


class ObservationBuilder(SpecBuilder):
    """Observation of one satellite, as an array, dictionary or list."""

    def __init__(self, satellite: Any, obs_type: type = np.ndarray, dtype: Any = np.float64) -> None:
        super().__init__(satellite)
        self.obs_type = obs_type
        self.dtype = dtype
        self._vector_cache: Any = None
        self.obs_dict_cache = None
        self.obs_cache_time = 0.0
        self._target_changes = 0
        self.parts: list[Any] = []
        self._functions: list[Any] = []
        self._function_places: list[int] = []
        self._native_places: Any = None
        self._eclipses: list[tuple[int, float]] = []
        self.observation_spec: list[Any] = deepcopy(satellite.observation_spec)
        counts: dict[str, int] = {}
        for item in self.observation_spec:
            counts[item.name] = counts.get(item.name, 0) + 1
            if counts[item.name] > 1:
                item.name += f"_{counts[item.name]}"
            item.link_satellite(satellite)

    @property
    def obs_dict_cache(self) -> dict[str, Any] | None:
        """Observation of the current time by name; None makes the next one be computed anew."""
        return self._obs_dict_cache

    @obs_dict_cache.setter
    def obs_dict_cache(self, value: dict[str, Any] | None) -> None:
        self._obs_dict_cache = value
        self._vector_cache = None

    def items(self) -> list[Any]:
        """Returns the observations in the order of the spec."""
        return self.observation_spec

    def reset_post_sim_init(self) -> None:
        """Forgets the cached observation, and passes the simulator and the reset to each observation."""
        self.obs_dict_cache = None
        super().reset_post_sim_init()

    def native_items(self) -> list[dict[str, Any]]:
        """Returns the items that the simulation observes, and plans how to assemble the rest."""
        items: list[dict[str, Any]] = []
        self._target_changes = Target.changes
        self.parts, self._eclipses = [], []
        taken = 0
        for item in self.observation_spec:
            plan = _simple_plan(item) or item.plan()
            items += plan.items
            if isinstance(item, Eclipse) and plan.items:
                self._eclipses.append((taken, item.norm))
            for kind, content in plan.parts:
                if kind == "python":
                    self.parts.append(content)
                    continue
                if self.parts and isinstance(self.parts[-1], slice):
                    self.parts[-1] = slice(self.parts[-1].start, taken + content)
                else:
                    self.parts.append(slice(taken, taken + content))
                taken += content
        self._plan_places(taken)
        return items

    def obs_dict(self) -> dict[str, Any]:
        """Returns the observation by name; computed once for each time of the simulation."""
        now = self.simulator.sim_time
        if self.obs_dict_cache is None or now != self.obs_cache_time:
            self.obs_dict_cache = {}
            for item in self.observation_spec:
                value = item.get_obs()
                if isinstance(value, np.ndarray):
                    value = value.astype(self.dtype)
                self.obs_dict_cache[item.name] = value
            self.obs_cache_time = now
        return deepcopy(self.obs_dict_cache)

    def obs_ndarray(self) -> Any:
        """Returns the observation as a vector."""
        # The log has lines of each item; written messages and changed targets are known to Python only.
        is_logged = self.satellite.logger.isEnabledFor(logging.INFO)
        if is_logged or self.satellite.dynamics.is_overwritten or self._target_changes != Target.changes:
            return vectorize_nested_dict(self.obs_dict())[1]
        if self.obs_dict_cache is not None and self.simulator.sim_time == self.obs_cache_time:
            return vectorize_nested_dict(self.obs_dict_cache)[1]
        now = self.simulator.sim_time
        if self._vector_cache is None or self._vector_cache[0] != now:
            self._vector_cache = (now, self._vector(now))
        return self._vector_cache[1].copy()

    def _vector(self, now: float) -> Any:
        """The observation as a vector, from the simulation and from the user's functions."""
        try:
            values = self.simulator.native.observe(self.satellite.index)
        except ValueError as error:
            raise no_opportunity(error) from error
        for place, norm in self._eclipses:
            missing = [(time - now) / norm for time in NO_ECLIPSE]
            if values[place] == missing[0] and values[place + 1] == missing[1]:
                warn_of_no_eclipse()
        if not self._functions:
            return values
        found = [function() for function in self._functions]
        if self._native_places is not None and all(isinstance(value, float) for value in found):
            vector = np.empty(len(values) + len(found))
            vector[self._native_places] = values
            for place, value in zip(self._function_places, found, strict=True):
                vector[place] = value
            return vector
        return self._concatenated(values, iter(found))

    def _concatenated(self, values: Any, found: Iterator[Any]) -> Any:
        """Vector of numbers of the simulation and of what functions returned."""
        vectors = []
        for part in self.parts:
            value = values[part] if isinstance(part, slice) else next(found)
            if isinstance(value, dict):
                value = vectorize_nested_dict(value)[1]
            elif isinstance(value, np.ndarray):
                is_native = isinstance(part, slice)
                value = value if is_native else value.astype(self.dtype).ravel() if value.ndim else [value]
            elif not isinstance(value, list):
                value = [value]
            vectors.append(value)
        return np.concatenate(vectors)

    def _plan_places(self, count: int) -> None:
        """Plans the places of numbers of the simulation, `count` in all, and of functions that return one number."""
        self._functions = [part for part in self.parts if not isinstance(part, slice)]
        places: list[int] = []
        self._function_places = []
        width = 0
        for part in self.parts:
            size = part.stop - part.start if isinstance(part, slice) else 1
            if isinstance(part, slice):
                places += range(width, width + size)
            else:
                self._function_places.append(width)
            width += size
        self._native_places = np.array(places) if count else None

    def obs_array_keys(self) -> list[str]:
        """Returns the names of the vector's values."""
        return vectorize_nested_dict(self.obs_dict())[0]

    def obs_list(self) -> list[Any]:
        """Returns the observation as a list of numbers."""
        return list(self.obs_ndarray())

    def get_obs(self) -> Any:
        """Returns the observation in the form of `obs_type`."""
        if self.obs_type is np.ndarray:
            return self.obs_ndarray()
        if self.obs_type is dict:
            return self.obs_dict()
        if self.obs_type is list:
            return self.obs_list()
        raise ValueError(f"Invalid observation type: {self.obs_type}")

    @cached_property
    def observation_space(self) -> spaces.Space[Any]:
        """Space of the observation."""
        return nested_obs_to_space(self.get_obs(), dtype=self.dtype)

    @cached_property
    def observation_description(self) -> list[str]:
        """Names of the observation's values."""
        return self.obs_array_keys()


def _simple_plan(item: Any) -> Plan | None:
    """Plan of an observation of time or eclipses, which the simulation computes whole."""
    norm = as_number(item.norm) if hasattr(item, "norm") else None
    if type(item) is Eclipse and norm is not None:
        plan = Plan().add_native(2)
        plan.items = [{"type": "Eclipse", "name": item.name, "norm": norm}]
        return plan
    if type(item) is Time and (norm is not None or item.norm is None):
        plan = Plan().add_native(1)
        plan.items = [
            {
                "type": "Time",
                "name": item.name,
                "norm": "inf" if norm is None else norm,
                "observe_time_remaining": item.return_time_remaining,
            }
        ]
        return plan
    return None
