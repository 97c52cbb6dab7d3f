"""Tasks as data."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from typing import Any

from . import _native


@dataclass(frozen=True)
class Param:
    """One number that makes a task easier or harder."""

    name: str
    #: Its unit; empty for a pure number.
    unit: str
    min: float
    max: float
    #: The grid designers move on.
    step: float
    #: Only whole numbers make sense.
    whole: bool
    default: float
    #: Which way is harder: `up` or `down`.
    harder: str
    about: str


@dataclass(frozen=True, eq=False)
class Task:
    """What a task is."""

    id: str
    #: The world and its version, as `kessler@1`.
    world: str
    about: str
    #: Steps after which an episode is truncated, by default params.
    horizon: int
    #: Agents, by default params.
    agents: int
    params: tuple[Param, ...]
    #: Physics options, each with its choices; the first is the default.
    options: dict[str, tuple[str, ...]]
    #: Params of each level, from easy to hard.
    levels: tuple[dict[str, float], ...]
    score_range: tuple[float, float]
    #: What the values of an action are called, along the world's axes.
    action: tuple[str, ...]
    #: And along each agent's own; none in a world where agents have none.
    agent_axes: tuple[str, ...] | None
    #: Smallest and largest value of an action, and its unit.
    action_range: tuple[float, float, str]
    #: The actions that `actions="discrete"` chooses from, and what they are.
    choices: tuple[tuple[float, ...], ...]
    choices_about: str
    #: Built-in policies and what they do.
    policies: dict[str, str]

    @property
    def default_observation(self) -> str:
        """`tracks` where the world has such, else `state`."""
        return "state" if self.agent_axes is None else "tracks"


def tasks() -> list[str]:
    """The ids of all tasks.

    >>> tasks()[0]
    'kessler/survival'
    """
    return _native.tasks()


@functools.cache
def task(id: str) -> Task:
    """A task by its id, or by its name alone: `kessler/survival` or `survival`.

    Raises:
        ValueError: No such task; the message has those there are.
    """
    if not isinstance(id, str):
        raise ValueError(f"task: {id!r} is no name of one")
    card: dict[str, Any] = json.loads(_native.card(id))
    actions = card["actions"]
    return Task(
        id=card["id"],
        world=card["world"],
        about=card["about"],
        horizon=card["horizon"],
        agents=card["agents"],
        params=tuple(Param(**param) for param in card["params"]),
        options={option["name"]: tuple(option["choices"]) for option in card["options"]},
        levels=tuple(card["levels"]),
        score_range=(card["score_range"]["min"], card["score_range"]["max"]),
        action=tuple(actions["columns"]),
        agent_axes=tuple(card["agent_axes"]) if card["agent_axes"] else None,
        action_range=(actions["low"], actions["high"], actions["unit"]),
        choices=tuple(map(tuple, card["choices"]["rows"])),
        choices_about=card["choices"]["about"],
        policies={spec["name"]: spec["about"] for spec in card["policies"]},
    )


def parameter_space(id: str) -> dict[str, Param]:
    """The parameter space of a task: name, unit, bounds, step, and which direction is harder.

    >>> parameter_space("survival")["debris"].max
    1000.0
    """
    return {param.name: param for param in task(id).params}


def levels(id: str) -> tuple[dict[str, float], ...]:
    """The params of each level of a task, from easy to hard."""
    return tuple(dict(row) for row in task(id).levels)
