"""Resets: the options that all environments accept, and the reset that single and parallel environments share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import numpy.typing as npt

from . import _native
from .curriculum import CurriculumError
from .errors import invalid
from .scenario import Scenario, check_seed, copy_mapping, make_recipe
from .settings import Settings

#: Options of `reset`.
RESET_OPTIONS = ("scenario", "params", "level")


class ResetRequest(NamedTuple):
    """Recipe and scenario that the options of a reset choose."""

    #: Replaces the recipe of this and later episodes.
    recipe: _native.NativeScenario | None = None
    #: Scenario to run once.
    scenario: _native.NativeScenario | None = None


class ResetResult(NamedTuple):
    """Result of a reset of a single environment."""

    #: Flat observation.
    observation: npt.NDArray[np.float32]
    info: dict[str, Any]


def read_reset_options(settings: Settings, options: Mapping[str, Any] | None) -> ResetRequest:
    """Reads the options of a reset.

    Raises:
        ValueError: An option is unknown or invalid; the message names the field.
    """
    options = copy_mapping("options", options)
    for name in options:
        if name not in RESET_OPTIONS:
            raise ValueError(f"`options.{name}` is unknown; the options are {', '.join(RESET_OPTIONS)}")
    recipe = None
    if "params" in options or "level" in options:
        params = {**(settings.params or {}), **copy_mapping("options.params", options.get("params"))}
        level = options.get("level", settings.level)
        fields = make_recipe(settings.spec.id, params=params, physics=settings.physics, layout=settings.layout, level=level)
        recipe = Scenario.from_dict({**fields, "seed": 0})._native
    scenario = options.get("scenario")
    if isinstance(scenario, Mapping):
        scenario = Scenario.from_dict(scenario)
    if scenario is not None and not isinstance(scenario, Scenario):
        raise invalid("options.scenario", "a sparring.Scenario or its dict", scenario)
    return ResetRequest(recipe, None if scenario is None else scenario._native)


class SingleBatch:
    """Batch of one environment: the common part of `Environment` and `ParallelEnvironment`."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.native = settings.make_batch(1, autoreset_mode="disabled", threads=1, seed=None, single=True)
        #: Steps since the last reset, if the episode has not ended.
        self._unfinished_steps = 0
        self._warned = False

    def reset(self, seed: int | None, options: Mapping[str, Any] | None) -> ResetResult:
        """Begins an episode and returns its first observation.

        Raises:
            ValueError: The seed, a scenario or an option is invalid; nothing changes then.
            CurriculumError: The curriculum has no episode left.
        """
        seed = None if seed is None else check_seed(seed)
        self._warn_unfinished()
        request = read_reset_options(self._settings, options)
        observation = self.native.reset([seed], recipes=[request.recipe], scenarios=[request.scenario])
        self._unfinished_steps = 0
        return ResetResult(observation, {"scenario": self.scenario, **self._curriculum_info()})

    def times(self) -> dict[str, Any]:
        """Returns the duration of the last step, and which agents need an action."""
        durations, needs_action = self.native.step_times()
        return {"d_ts": float(durations[0]), "requires_retasking": needs_action[0]}

    def count_step(self, ended: bool) -> None:
        """Records a step, and whether the episode ended."""
        self._unfinished_steps = 0 if ended else self._unfinished_steps + 1

    def abandon(self) -> None:
        """Abandons the episode, which the curriculum does not offer again."""
        self.native.abandon()
        self._unfinished_steps = 0

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the episode; None before the first reset."""
        episode = self.native.episode(0)
        return None if episode is None else Scenario._wrap(episode[0])

    @property
    def score(self) -> float:
        """Score of the episode so far."""
        episode = self.native.episode(0)
        return 0.0 if episode is None else episode[1]

    def _warn_unfinished(self) -> None:
        """Warns once about an unfinished episode: a curriculum learns from whole episodes only."""
        if self._settings.curriculum is None or not self._unfinished_steps or self._warned:
            return
        self._warned = True
        gymnasium.logger.warn(
            f"The episode was reset after {self._unfinished_steps} steps, before its end. The curriculum does not count it, and"
            " offers its scenario again. Run each episode to its end, and do not set max_episode_steps: scenarios have their own"
            " horizons."
        )

    def _curriculum_info(self) -> dict[str, Any]:
        """Returns the level of the episode and whether to train on it."""
        if self._settings.curriculum is None:
            return {}
        levels, train, idle = self.native.curriculum_info()
        if idle[0]:
            raise CurriculumError("no episode is left: the evaluation is complete")
        return {"level": int(levels[0]), "train": bool(train[0])}
