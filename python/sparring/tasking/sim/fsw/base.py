"""Base of the flight software models."""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from ...unsupported import sentence
from ...utils.functional import Resetable, check_aliveness_checkers
from .. import dyn

_Function = TypeVar("_Function", bound=Callable[..., Any])


def action(func: _Function) -> _Function:
    """Decorates a function of the flight software that an action of a satellite calls."""

    @wraps(func)
    def marked(self: Any, *args: Any, **kwargs: Any) -> Any:
        return func(self, *args, **kwargs)

    marked.is_action = True  # type: ignore[attr-defined]
    return marked  # type: ignore[return-value]


def call_of(name: str) -> Callable[..., None]:
    """Returns a function of the flight software that only actions of a satellite call."""

    def call(self: Any, *args: Any, **kwargs: Any) -> None:
        raise NotImplementedError(sentence(f"A direct call of {name}", "step the environment with an action that calls it"))

    call.__name__ = call.__qualname__ = name
    call.__doc__ = f"Function `{name}` of the flight software, which an action calls."
    return action(call)


class Task:
    """Part of the flight software whose functions have arguments with defaults."""

    is_software_task = True
    name = ""


class FSWModelABC(ABC, Resetable):
    """Base of the flight software models of a satellite."""

    @classmethod
    def _requires_dyn(cls) -> list[type]:
        """Dynamics models that the model needs."""
        return []

    def __init__(self, satellite: Any, fsw_rate: float, priority: int = 100, **kwargs: Any) -> None:
        self.satellite = satellite
        self.logger = satellite.logger.getChild(type(self).__name__)
        for required in self._requires_dyn():
            if not issubclass(satellite.dyn_type, required):
                satellite.logger.warning(
                    "Some sim model inheritance has changed. Explicitly include"
                    "BasicFSWModel and BasicDynamicsModel if your configurations no "
                    "longer work."
                )
                raise TypeError(f"{satellite.dyn_type} must be a subclass of {required} to use FSW model of type {type(self)}")
        self.fsw_rate = fsw_rate

    @property
    def simulator(self) -> Any:
        """Simulator of the episode."""
        return self.satellite.simulator

    @property
    def world(self) -> Any:
        """World model of the episode."""
        return self.satellite.simulator.world

    @property
    def dynamics(self) -> Any:
        """Dynamics model of the satellite."""
        return self.satellite.dynamics

    def is_alive(self, log_failure: bool = False) -> bool:
        """Returns whether all aliveness checkers of the model pass."""
        return check_aliveness_checkers(self, log_failure=log_failure)


class FSWModel(FSWModelABC):
    """Flight software that drifts and points at nadir."""

    @classmethod
    def _requires_dyn(cls) -> list[type]:
        return [*super()._requires_dyn(), dyn.DynamicsModel]

    action_drift = call_of("action_drift")
    action_nadir_point = call_of("action_nadir_point")
