"""Descriptions of tasks and their parameters."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from . import _native
from .errors import invalid


@dataclass(frozen=True)
class Param:
    """Numeric parameter that makes a task easier or harder."""

    name: str
    #: Unit; empty for a pure number.
    unit: str
    min: float
    max: float
    #: Step of the grid that designers use.
    step: float
    #: True if only integers are valid.
    whole: bool
    default: float
    #: Direction in which the task gets harder: `up` or `down`.
    harder: str
    description: str


@dataclass(frozen=True, eq=False)
class Task:
    """Description of a task."""

    id: str
    #: World and its version, as `kessler@1`.
    world: str
    description: str
    #: Number of steps after which an episode is truncated, with default params.
    horizon: int
    #: Number of agents, with default params.
    agents: int
    #: Duration of an episode with default params, s; None in a world whose steps have equal durations.
    time_limit_s: float | None
    params: tuple[Param, ...]
    #: Choices of each physics option; the first is the default.
    options: dict[str, tuple[str, ...]]
    #: Params of each level, from easy to hard.
    levels: tuple[dict[str, float], ...]
    #: Start rungs: values of the param `start_scale`, from the easiest start to 1; empty if the task has none.
    start_rungs: tuple[float, ...]
    score_range: tuple[float, float]
    #: Names of the values of an action along the world's axes.
    action_columns: tuple[str, ...]
    #: Names of the values of an action along the agent's own axes; None if agents have no axes of their own.
    agent_axes: tuple[str, ...] | None
    #: Names of the actions by index; empty if actions are numbers within `action_range`.
    action_names: tuple[str, ...]
    #: Minimum and maximum of each value of an action, and its unit.
    action_range: tuple[float, float, str]
    #: Actions that `actions="discrete"` chooses from.
    choices: tuple[tuple[float, ...], ...]
    #: Actions that `actions="few"` chooses from: hold, and a handful that suffices to do the task.
    few_choices: tuple[tuple[float, ...], ...]
    #: Choice of an agent that holds. It is -1 if no choice is hold: the agent goes on with the action before.
    hold_choice: int
    #: Description of these actions.
    choices_description: str
    #: Names and descriptions of the built-in policies.
    policies: dict[str, str]

    @property
    def default_observation(self) -> str:
        """Default observation mode: `tracks` in a world that has it, else `state`."""
        return "state" if self.agent_axes is None else "tracks"

    @property
    def has_extended_state(self) -> bool:
        """True if the world has the observation mode `extended_state`."""
        return self.world.startswith("docking")


def tasks() -> list[str]:
    """Returns the ids of all tasks.

    >>> tasks()[0]
    'kessler/survival'
    """
    return _native.tasks()


@functools.cache
def task(id: str) -> Task:
    """Returns the description of a task.

    Args:
        id: Id or name: `kessler/survival` or `survival`.

    Raises:
        ValueError: The task is unknown; the message lists all tasks.
    """
    if not isinstance(id, str):
        raise invalid("task", "the id of a task", id)
    info: dict[str, Any] = json.loads(_native.task_info(id))
    actions = info["actions"]
    return Task(
        id=info["id"],
        world=info["world"],
        description=info["description"],
        horizon=info["horizon"],
        agents=info["agents"],
        time_limit_s=info["time_limit_s"],
        params=tuple(Param(**param) for param in info["params"]),
        options={option["name"]: tuple(option["choices"]) for option in info["options"]},
        levels=tuple(info["levels"]),
        start_rungs=tuple(info["start_rungs"]),
        score_range=(info["score_range"]["min"], info["score_range"]["max"]),
        action_columns=tuple(actions["columns"]),
        agent_axes=tuple(info["agent_axes"]) if info["agent_axes"] else None,
        action_names=tuple(actions["names"]),
        action_range=(actions["low"], actions["high"], actions["unit"]),
        choices=tuple(map(tuple, info["choices"]["rows"])),
        few_choices=tuple(map(tuple, info["few_choices"]["rows"])),
        hold_choice=-1 if info["choices"]["hold"] is None else info["choices"]["hold"],
        choices_description=info["choices"]["description"],
        policies={policy["name"]: policy["description"] for policy in info["policies"]},
    )


def parameter_space(id: str) -> dict[str, Param]:
    """Returns the params of a task by name, with unit, bounds, step and the direction that is harder.

    >>> parameter_space("survival")["debris"].max
    1000.0
    """
    return {param.name: param for param in task(id).params}


def levels(id: str) -> tuple[dict[str, float], ...]:
    """Returns the params of each level of a task, from easy to hard."""
    return tuple(dict(row) for row in task(id).levels)


def have_equal_agents(ids: Iterable[str]) -> bool:
    """Returns true if one agent can act in all tasks: they are tasks of kessler, or one task."""
    ids = set(ids)
    return len(ids) <= 1 or all(id.startswith("kessler/") for id in ids)
