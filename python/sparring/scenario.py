"""Scenarios, what they are worth, and what was flown on them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from .tasks import task as find


def recipe_of(
    task: str,
    *,
    params: Mapping[str, float] | None = None,
    physics: Mapping[str, str] | None = None,
    layout: Mapping[str, Any] | None = None,
    level: int | None = None,
) -> dict[str, Any]:
    """A scenario without its seed, as the wire has it."""
    told = find(task)
    at: dict[str, float] = {}
    if level is not None:
        if isinstance(level, bool) or not isinstance(level, (int, np.integer)) or not 0 <= level < len(told.levels):
            raise ValueError(f"level: {level!r} is not from 0 to {len(told.levels) - 1}")
        at.update(told.levels[int(level)])
    at.update(plain_dict("params", params))
    recipe: dict[str, Any] = {"task": told.id, "params": {name: _number(name, value) for name, value in at.items()}}
    if physics:
        recipe["physics"] = plain_dict("physics", physics)
    if layout is not None:
        recipe["layout"] = plain_dict("layout", layout)
    return recipe


def plain_dict(name: str, value: Any) -> dict[str, Any]:
    """A mapping as a dict of its own; nothing is an empty one.

    Raises:
        ValueError: Something else, with the field.
    """
    if value is not None and not isinstance(value, Mapping):
        raise ValueError(f"{name}: {value!r} is no dict")
    return dict(value or {})


def _number(name: str, value: Any) -> float:
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
        raise ValueError(f"params.{name}: {value!r} is not a finite number")
    return float(value)


def to_json(name: str, value: Any) -> str:
    """JSON without what JSON does not have; numpy's numbers are numbers.

    Raises:
        ValueError: NaN, an infinity, or something that is no plain data, with the field.
    """
    try:
        return json.dumps(value, allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} is no number, text, list or dict")


class Scenario:
    """Task, params, physics options, layout and seed: `(scenario, actions)` decides every bit of an episode.

    >>> scenario = Scenario("kessler/survival", params={"debris": 40}, seed=7)
    >>> scenario.params["debris"], scenario.horizon
    (40.0, 50)
    """

    __slots__ = ("_native",)

    def __init__(
        self,
        task: str,
        *,
        params: Mapping[str, float] | None = None,
        physics: Mapping[str, str] | None = None,
        layout: Mapping[str, Any] | None = None,
        level: int | None = None,
        seed: int = 0,
    ) -> None:
        """
        Args:
            task: Its id, or its name alone.
            params: Those that are not at their defaults, or at the level's.
            physics: Options that are not at their defaults.
            layout: Explicit bodies that replace or extend what the generator would draw.
            level: A row of the task's table, for the params that are not given.
            seed: 0 to 2^51 - 1.

        Raises:
            ValueError: What is unknown or out of range, with the field.
        """
        fields = recipe_of(task, params=params, physics=physics, layout=layout, level=level)
        self._native = _native.NativeScenario(to_json("scenario", {**fields, "seed": plain_seed(seed)}))

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Scenario:
        """Reads the wire form (`GET /v1/scenarios/{id}`). Seeds of training and evaluation are read too; no environment
        begins them by hand."""
        return cls._of(_native.NativeScenario(to_json("scenario", dict(fields)), any_seed=True))

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """The same from text."""
        return cls._of(_native.NativeScenario(text, any_seed=True))

    @classmethod
    def _of(cls, native: _native.NativeScenario) -> Scenario:
        made = cls.__new__(cls)
        made._native = native
        return made

    def to_dict(self) -> dict[str, Any]:
        """The wire form, complete."""
        told: dict[str, Any] = json.loads(self._native.to_json())
        return told

    def to_json(self) -> str:
        """The same as text."""
        return self._native.to_json()

    @property
    def id(self) -> str:
        """The blake3 of its canonical form."""
        return self._native.id

    @property
    def task(self) -> str:
        """The task's id."""
        return self._native.task

    @property
    def seed(self) -> int:
        """Its seed."""
        return self._native.seed

    @property
    def params(self) -> dict[str, float]:
        """All params, those at their defaults too."""
        told = self.to_dict()["params"]
        return {param.name: float(told.get(param.name, param.default)) for param in find(self.task).params}

    @property
    def horizon(self) -> int:
        """Steps after which an episode is truncated."""
        return self._native.horizon

    @property
    def agents(self) -> int:
        """Agents at the start."""
        return self._native.agents

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and self._native == other._native

    def __hash__(self) -> int:
        return hash(self._native)

    def __repr__(self) -> str:
        return f"Scenario.from_json({self.to_json()!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Scenario.from_json, (self.to_json(),)


def plain_seed(seed: Any) -> int:
    """A seed that is a whole number; whether it may be chosen the worlds say.

    Raises:
        ValueError: Something else.
    """
    if isinstance(seed, (bool, np.bool_)) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**53:
        raise ValueError(f"seed: {seed!r} is not a whole number from 0 to {2**51 - 1}")
    return int(seed)


@dataclass(frozen=True)
class Flown:
    """How an episode went."""

    #: The world's own number, in the task's range.
    score: float
    #: The sum of rewards, as the wire shows it.
    total_reward: float
    steps: int
    #: Agents lost.
    lost: int
    #: How well the task's goal was held towards the end, where it has one.
    goal: float | None
    #: Fuel spent by all agents, in the world's unit.
    fuel_used: float
    #: (score - floor)/(reference - floor), where that means something; of plans of a bracket only.
    skill: float | None = None
    #: The task's own rule; of plans of a bracket only.
    success: bool | None = None


@dataclass(frozen=True, eq=False)
class Bracket:
    """What a scenario is worth."""

    #: How each blind plan fared; hold is the first.
    panel: tuple[Flown, ...]
    #: How many of them succeed.
    panel_success: int
    #: The score of acting blindly, by the task's rule.
    floor: float
    #: What the planner earned, with hindsight: a lower bound on the best.
    reference: Flown
    #: The actions that earn it: steps × agents × values.
    witness: npt.NDArray[np.float64] = field(repr=False)
    #: The reference succeeds.
    solvable: bool
    #: It does, and acting blindly mostly does not: acting well matters here.
    contested: bool
    #: Version of the planner.
    planner: int

    @property
    def hold(self) -> float:
        """The score of doing nothing."""
        return self.panel[0].score

    def skill(self, score: float) -> float | None:
        """(score - floor)/(reference - floor) within -1 and 1; none where the two are nearer than 0.05."""
        if not math.isfinite(score):
            raise ValueError(f"score: {score!r} is none")
        gap = self.reference.score - self.floor
        return max(-1.0, min(1.0, (score - self.floor) / gap)) if gap >= 0.05 else None


def native_of(scenario: Scenario) -> _native.NativeScenario:
    """The compiled scenario behind it.

    Raises:
        ValueError: Something that is no scenario.
    """
    if not isinstance(scenario, Scenario):
        raise ValueError(f"scenario: {type(scenario).__name__} is no sparring.Scenario")
    return scenario._native


def bracket(scenario: Scenario) -> Bracket:
    """Floor and reference of a scenario, and whether acting well matters on it. Takes a millisecond to some.

    Raises:
        ValueError: A scenario that has no fair start.
    """
    text, witness = _native.bracket(native_of(scenario))
    told = json.loads(text)
    return Bracket(
        panel=tuple(Flown(**flown) for flown in told.pop("panel")),
        reference=Flown(**told.pop("reference")),
        witness=witness,
        **told,
    )


def replay(scenario: Scenario, actions: npt.ArrayLike, stopped: str | None = None) -> Flown:
    """What these actions earn: steps × agents × values, along the world's axes, whole.

    Args:
        scenario: What was flown.
        actions: As `Environment.history` has them.
        stopped: Why the log is shorter than the episode: `unparsable`, `too_long` or `too_late`; the rest is flown as hold.

    Raises:
        ValueError: Too many or too few steps, or what is not finite.
    """
    return Flown(**json.loads(_native.replay(native_of(scenario), actions, stopped)))


def critique(scenario: Scenario, actions: npt.ArrayLike, stopped: str | None = None) -> dict[str, Any]:
    """What an episode shows, from its actions alone: `failures` with their geometry, `actions` with a verdict on each, and
    `judged`, the word of the deterministic judge (-1 to 1).

    Raises:
        ValueError: As `replay`.
    """
    found: dict[str, Any] = json.loads(_native.critique(native_of(scenario), actions, stopped))
    return found


def fly(scenario: Scenario, policy: str = "heuristic", seed: int = 0) -> tuple[Flown, npt.NDArray[np.float64]]:
    """Flies a scenario by a built-in policy (`sparring.task(…).policies`): how it went, and what was done."""
    text, actions = _native.fly(native_of(scenario), policy, plain_seed(seed))
    return Flown(**json.loads(text)), actions
