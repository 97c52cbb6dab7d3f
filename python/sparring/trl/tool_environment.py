"""Environments of one member of a group, whose public methods are the tools of a language model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from ..docking_episode import DOCKING_PROMPT, DockingEpisode
from ..scenario import Scenario, bracket
from ..single import Environment
from ..tasking_episode import IMAGING_PROMPT, SCANNING_PROMPT, ImagingEpisode, ScanningEpisode
from ..tasks import have_equal_agents
from ..text_episode import Reward, TextEpisode
from ..tool_episode import PROMPT, ToolEpisode
from .group_episodes import GroupEpisodes

#: Prompt before the first observation, by the tools of a run.
PROMPTS = {"kessler": PROMPT, "docking": DOCKING_PROMPT, "scanning": SCANNING_PROMPT, "imaging": IMAGING_PROMPT}
#: Tools of the tasks with targets, and of the others of tasking.
_TASKING_TOOLS = {"tasking/scanning": "scanning", "tasking/imaging": "imaging", "tasking/constellation": "imaging"}


class GroupEnvironment(TextEpisode):
    """Environment of one member of a group that runs in this process. The tools are those of a world.

    Args:
        episodes: Source of the episodes.
        reward: Result of `get_reward`.
        options: Arguments of the world's class.
    """

    def __init__(self, episodes: GroupEpisodes, reward: Reward, **options: Any) -> None:
        super().__init__(**options)
        self._episodes = episodes
        self._reward = reward
        self._environment: Environment | None = None
        self._train = True

    def reset(self, group_id: str = "", **_: Any) -> str:
        """Begins an episode of the scenario that all members with this `group_id` share.

        Returns:
            The goal and the first observation as text, which TRL appends to the prompt.

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

    def _advance(self, actions: npt.NDArray[Any]) -> None:
        _, _, terminated, truncated, info = self._running().step(actions)
        self._score, self._over = info["score"], terminated or truncated

    def _telemetry(self) -> dict[str, Any]:
        return self._running().telemetry() or {}

    def _running(self) -> Environment:
        if self._environment is None:
            raise ResetNeeded("no episode is running: call reset() first")
        return self._environment


class ToolEnvironment(GroupEnvironment, ToolEpisode):
    """Environment of kessler that a language model controls by tool calls. TRL offers every public method to the model.

    `EnvironmentFactory` makes it.
    """


class DockingEnvironment(GroupEnvironment, DockingEpisode):
    """Environment of docking that a language model controls by tool calls. TRL offers every public method to the model.

    `EnvironmentFactory` makes it.
    """

    def _hold_action(self) -> npt.NDArray[np.float32]:
        # All scenarios of a run have as many rows, of which a scenario with fewer deputies uses the first.
        return np.zeros(self._running().action_space.shape or (), np.float32)


class ScanningEnvironment(GroupEnvironment, ScanningEpisode):
    """Environment of `tasking/scanning` that a language model controls by tool calls.

    TRL offers every public method to the model. `EnvironmentFactory` makes it.
    """


class ImagingEnvironment(GroupEnvironment, ImagingEpisode):
    """Environment of a tasking task with targets that a language model controls by tool calls.

    TRL offers every public method to the model. `EnvironmentFactory` makes it.
    """


def tools_of(tasks: Sequence[str]) -> str:
    """Returns the key in `PROMPTS` of the tools of a run's tasks.

    Raises:
        ValueError: The tasks need different tools.
    """
    tools = {_TASKING_TOOLS.get(task, task.split("/")[0]) for task in tasks}
    if not have_equal_agents(tasks) or len(tools) != 1 or not tools <= set(PROMPTS):
        raise ValueError(
            "`curriculum` must be of a run with tasks of kessler, or with one task of docking or tasking, got "
            f"{', '.join(tasks)}; make a run for each of the others, and pass sparring.trl.Environments to the trainer"
        )
    return tools.pop()


def make_environment(tools: str, episodes: GroupEpisodes, reward: Reward, max_debris: int) -> GroupEnvironment:
    """Makes the environment of one member of a group, with these tools."""
    if tools == "docking":
        return DockingEnvironment(episodes, reward)
    if tools == "scanning":
        return ScanningEnvironment(episodes, reward)
    if tools == "imaging":
        return ImagingEnvironment(episodes, reward)
    return ToolEnvironment(episodes, reward, max_debris=max_debris)


_cached_bracket = lru_cache(maxsize=256)(bracket)
