"""Scenarios, their brackets, and rollouts, replays and critiques of episodes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from .errors import invalid
from .tasks import task as find_task

#: Smallest difference between reference and floor for which a skill is defined.
MIN_SKILL_GAP = 0.05


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
        """Makes a scenario of a task.

        Args:
            task: Id or name of the task.
            params: Params that differ from their defaults, or from the level's.
            physics: Physics options that differ from their defaults.
            layout: Explicit bodies that replace or extend those of the generator.
            level: Index of a level, which sets the params that are not given.
            seed: Seed from 0 to 2^51 - 1.

        Raises:
            ValueError: A value is unknown or out of range; the message names the field.
        """
        recipe = make_recipe(task, params=params, physics=physics, layout=layout, level=level)
        self._native = _native.NativeScenario(to_json("scenario", {**recipe, "seed": check_seed(seed)}))

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Scenario:
        """Reads the wire form (`GET /v1/scenarios/{id}`).

        Seeds of training and evaluation are accepted too, but an environment cannot be reset to such a scenario.

        Raises:
            ValueError: A value is unknown or out of range; the message names the field.
        """
        return cls._wrap(_native.NativeScenario(to_json("scenario", dict(fields)), any_seed=True))

    @classmethod
    def from_json(cls, text: str) -> Scenario:
        """Reads the wire form from JSON; see `from_dict`."""
        return cls._wrap(_native.NativeScenario(text, any_seed=True))

    @classmethod
    def _wrap(cls, native: _native.NativeScenario) -> Scenario:
        scenario = cls.__new__(cls)
        scenario._native = native
        return scenario

    def to_dict(self) -> dict[str, Any]:
        """Returns the complete wire form."""
        fields: dict[str, Any] = json.loads(self._native.to_json())
        return fields

    def to_json(self) -> str:
        """Returns the complete wire form as JSON."""
        return self._native.to_json()

    @property
    def id(self) -> str:
        """Id: the blake3 hash of the canonical form."""
        return self._native.id

    @property
    def task(self) -> str:
        """Id of the task."""
        return self._native.task

    @property
    def seed(self) -> int:
        """Seed of all random draws."""
        return self._native.seed

    @property
    def params(self) -> dict[str, float]:
        """All params, including those at their defaults."""
        params = self.to_dict()["params"]
        return {param.name: float(params.get(param.name, param.default)) for param in find_task(self.task).params}

    @property
    def horizon(self) -> int:
        """Number of steps after which an episode is truncated."""
        return self._native.horizon

    @property
    def agents(self) -> int:
        """Number of agents at the start."""
        return self._native.agents

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scenario) and self._native == other._native

    def __hash__(self) -> int:
        return hash(self._native)

    def __repr__(self) -> str:
        return f"Scenario.from_json({self.to_json()!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Scenario.from_json, (self.to_json(),)


@dataclass(frozen=True)
class EpisodeOutcome:
    """Outcome of an episode."""

    #: Score of the task, within its range.
    score: float
    #: Sum of the rewards in the wire form.
    total_reward: float
    steps: int
    #: Number of agents lost.
    lost: int
    #: Degree to which the task's goal was held towards the end; None if the task has no goal.
    goal: float | None
    #: Fuel used by all agents, in the world's unit.
    fuel_used: float
    #: Duration, s; None in a world that counts steps.
    time_s: float | None = None
    #: (score - floor)/(reference - floor); only for plans of a bracket, and None if the gap is too small.
    skill: float | None = None
    #: Success by the task's rule; only for plans of a bracket.
    success: bool | None = None


@dataclass(frozen=True, eq=False)
class Bracket:
    """Floor and reference of a scenario, between which skill is measured."""

    #: Outcomes of the blind plans; the first plan is hold.
    panel: tuple[EpisodeOutcome, ...]
    #: Number of blind plans that succeed.
    panel_successes: int
    #: Score of acting without observations, by the task's rule.
    floor: float
    #: Outcome of the planner, which knows the scenario: a lower bound on the best outcome.
    reference: EpisodeOutcome
    #: Actions of the reference, steps × agents × values.
    reference_plan: npt.NDArray[np.float64] = field(repr=False)
    #: True if the reference succeeds.
    solvable: bool
    #: True if the reference succeeds and most blind plans do not, so that acting well matters.
    contested: bool
    #: Version of the planner.
    planner_version: int

    @property
    def hold(self) -> float:
        """Score of an agent that always holds."""
        return self.panel[0].score

    def skill(self, score: float) -> float | None:
        """Returns (score - floor)/(reference - floor), clipped to -1 to 1; None if the two differ by less than 0.05.

        Raises:
            ValueError: The score is not finite.
        """
        if not math.isfinite(score):
            raise invalid("score", "a finite number", score)
        gap = self.reference.score - self.floor
        return max(-1.0, min(1.0, (score - self.floor) / gap)) if gap >= MIN_SKILL_GAP else None


def bracket(scenario: Scenario) -> Bracket:
    """Computes floor and reference of a scenario, which takes some milliseconds.

    Raises:
        ValueError: The scenario has no fair start.
    """
    text, reference_plan = _native.bracket(native_scenario(scenario))
    fields = json.loads(text)
    return Bracket(
        panel=tuple(EpisodeOutcome(**outcome) for outcome in fields.pop("panel")),
        reference=EpisodeOutcome(**fields.pop("reference")),
        reference_plan=reference_plan,
        **fields,
    )


def rollout(scenario: Scenario, policy: str = "heuristic", seed: int = 0) -> tuple[EpisodeOutcome, npt.NDArray[np.float64]]:
    """Runs a built-in policy on a scenario; returns the outcome and the actions, steps × agents × values.

    Args:
        scenario: Scenario to run.
        policy: Name of a policy; `sparring.task(…).policies` lists them.
        seed: Seed of the policy.

    Raises:
        ValueError: The policy is unknown, or the scenario or seed is invalid.
    """
    text, actions = _native.rollout(native_scenario(scenario), policy, check_seed(seed))
    return EpisodeOutcome(**json.loads(text)), actions


def replay(scenario: Scenario, actions: npt.ArrayLike, stopped: str | None = None) -> EpisodeOutcome:
    """Replays the actions of a whole episode and returns its outcome.

    Args:
        scenario: Scenario of the episode.
        actions: Actions along the world's axes, steps × agents × values, as `Environment.history` has them.
        stopped: Why the log is shorter than the episode: `unparsable`, `too_long` or `too_late`; hold fills the rest.

    Raises:
        ValueError: There are too many or too few steps, or a value is not finite.
    """
    return EpisodeOutcome(**json.loads(_native.replay(native_scenario(scenario), actions, stopped)))


def critique(scenario: Scenario, actions: npt.ArrayLike, stopped: str | None = None) -> dict[str, Any]:
    """Analyses the failures of an episode, and the effect of each action.

    Args:
        scenario: Scenario of the episode.
        actions: As for `replay`.
        stopped: As for `replay`.

    Returns:
        A dict with `failures` and their geometry, `actions` with a verdict on each, and `assessment`, the value of the
        deterministic judge from -1 to 1.

    Raises:
        ValueError: As for `replay`.
    """
    critique: dict[str, Any] = json.loads(_native.critique(native_scenario(scenario), actions, stopped))
    return critique


def make_recipe(
    task: str,
    *,
    params: Mapping[str, float] | None = None,
    physics: Mapping[str, str] | None = None,
    layout: Mapping[str, Any] | None = None,
    level: int | None = None,
) -> dict[str, Any]:
    """Makes a recipe, a scenario without its seed, in the wire form."""
    spec = find_task(task)
    values: dict[str, float] = {}
    if level is not None:
        if isinstance(level, bool) or not isinstance(level, (int, np.integer)) or not 0 <= level < len(spec.levels):
            raise invalid("level", f"an integer from 0 to {len(spec.levels) - 1}", level)
        values.update(spec.levels[int(level)])
    values.update(copy_mapping("params", params))
    recipe: dict[str, Any] = {"task": spec.id, "params": {name: _check_number(name, value) for name, value in values.items()}}
    if physics:
        recipe["physics"] = copy_mapping("physics", physics)
    if layout is not None:
        recipe["layout"] = copy_mapping("layout", layout)
    return recipe


def native_scenario(scenario: Scenario) -> _native.NativeScenario:
    """Returns the compiled scenario.

    Raises:
        ValueError: The argument is not a `Scenario`.
    """
    if not isinstance(scenario, Scenario):
        raise invalid("scenario", "a sparring.Scenario", scenario)
    return scenario._native


def copy_mapping(field: str, value: Any) -> dict[str, Any]:
    """Copies a mapping to a dict; None gives an empty one.

    Raises:
        ValueError: The value is not a mapping; the message names the field.
    """
    if value is not None and not isinstance(value, Mapping):
        raise invalid(field, "a dict", value)
    return dict(value or {})


def check_seed(seed: Any) -> int:
    """Returns a seed as an int; the worlds check which seeds may be chosen.

    Raises:
        ValueError: The seed is not an integer of at most 53 bits.
    """
    if isinstance(seed, (bool, np.bool_)) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**53:
        raise invalid("seed", f"an integer from 0 to {2**51 - 1}", seed)
    return int(seed)


def to_json(field: str, value: Any) -> str:
    """Encodes plain data as JSON; NumPy's numbers and arrays are plain data too.

    Raises:
        ValueError: The value has NaN, an infinity or another type; the message names the field.
    """
    try:
        return json.dumps(value, allow_nan=False, default=_to_plain)
    except (TypeError, ValueError) as error:
        raise ValueError(f"`{field}` must be plain data: {error}") from error


def _check_number(name: str, value: Any) -> float:
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
        raise invalid(f"params.{name}", "a finite number", value)
    return float(value)


def _to_plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} is neither a number, a string, a list nor a dict")
