"""Settings of a recorded episode, without any object of BSK-RL."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Component:
    """Class of BSK-RL by name, with the arguments of its constructor."""

    type: str
    args: dict[str, Any] = field(default_factory=dict)


def component(type_name: str, **args: Any) -> Component:
    """Names a class of BSK-RL with its arguments."""
    return Component(type_name, args)


@dataclass(frozen=True)
class SatelliteSpec:
    """Settings of one satellite; `sat_args` may hold functions that draw a value at each reset."""

    name: str
    type: str
    dyn: tuple[str, ...]
    fsw: tuple[str, ...]
    actions: tuple[Component, ...]
    observations: tuple[Component, ...]
    sat_args: dict[str, Any]
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class CommunicatorSpec:
    """Communication classes, composed in this order, and the shortest time between two exchanges in seconds."""

    types: tuple[str, ...] = ("NoCommunication",)
    min_period: float = 0.0


@dataclass(frozen=True)
class Episode:
    """Settings, seed and policy of one recorded episode."""

    name: str
    seed: int
    cls: str
    satellites: tuple[SatelliteSpec, ...]
    scenario: Component
    rewarders: tuple[Component, ...]
    policy: Any
    max_steps: int
    env: dict[str, Any] = field(default_factory=dict)
    world_args: dict[str, Any] = field(default_factory=dict)
    communicator: CommunicatorSpec = field(default_factory=CommunicatorSpec)
    orbits: Callable[[list[Any]], dict[Any, dict[str, Any]]] | None = None
    continues_after_death: bool = False
    traced: bool = False
