"""Environment of one member of a group, whose public methods are the tools of a language model."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from ..scenario import Scenario, bracket
from ..single import Environment
from ..tool_episode import Reward, ToolEpisode
from .group_episodes import GroupEpisodes


class ToolEnvironment(ToolEpisode):
    """Environment that a language model controls by tool calls. TRL offers every public method to the model.

    `EnvironmentFactory` makes it.
    """

    def __init__(self, episodes: GroupEpisodes, reward: Reward, max_debris: int) -> None:
        super().__init__(max_debris)
        self._episodes = episodes
        self._reward = reward
        self._environment: Environment | None = None
        self._train = True

    def reset(self, group_id: str = "", **_: Any) -> str:
        """Begins an episode of the scenario that all members with this `group_id` share.

        Returns:
            The goal and the first observation as text.

        Raises:
            CurriculumError: No episode is ready, and the server is unreachable or failed.
        """
        if self._environment is not None:
            self._episodes.release(self._environment, is_over=self._over)
            self._environment = None
        self._environment, self._train = self._episodes.acquire(group_id)
        return self._begin()

    def get_reward(self) -> float:
        """Holds for the remaining steps, so that a short answer has no advantage, and returns the reward of the episode.

        The reward is 0 for all members of a group that the curriculum only measures, so that the model does not learn from it.
        """
        environment = self._running()
        self._finish()
        if not self._train:
            return 0.0
        if self._reward == "score":
            return self._score
        assert environment.scenario is not None
        return _cached_bracket(environment.scenario).skill(self._score) or 0.0

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the episode; None before the first reset."""
        return None if self._environment is None else self._environment.scenario

    def _advance(self, burns: npt.NDArray[np.float32]) -> None:
        _, _, terminated, truncated, info = self._running().step(burns)
        self._score, self._over = info["score"], terminated or truncated

    def _telemetry(self) -> dict[str, Any]:
        return self._running().telemetry() or {}

    def _running(self) -> Environment:
        if self._environment is None:
            raise ResetNeeded("no episode is running: call reset() first")
        return self._environment


_cached_bracket = lru_cache(maxsize=256)(bracket)
