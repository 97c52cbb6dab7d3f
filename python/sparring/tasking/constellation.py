"""Environment of several satellites as agents, for PettingZoo."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from .general import GeneralSatelliteTasking
from .unsupported import sentence
from .utils.logging_config import ROOT

if TYPE_CHECKING:
    ParallelEnv = object
else:
    try:
        from pettingzoo.utils.env import ParallelEnv
    except ImportError:  # optional dependency; the constructor's error names it
        ParallelEnv = object

logger = logging.getLogger(ROOT + ".gym")


class ConstellationTasking(GeneralSatelliteTasking, ParallelEnv):
    """Environment whose agents are satellites; one that dies leaves, and the others go on."""

    def __init__(
        self,
        *args: Any,
        meta_agent_groupings: dict[str, list[str]] | None = None,
        only_retask_idle_meta_agent_members: bool = False,
        **kwargs: Any,
    ) -> None:
        """Creates an environment; all arguments are those of `GeneralSatelliteTasking`."""
        if not TYPE_CHECKING and ParallelEnv is object:
            from gymnasium.error import DependencyNotInstalled

            raise DependencyNotInstalled("ConstellationTasking needs PettingZoo: pip install 'sparring[pettingzoo]'")
        if meta_agent_groupings or only_retask_idle_meta_agent_members:
            raise NotImplementedError(sentence("meta_agent_groupings", "give each satellite an agent of its own"))
        super().__init__(*args, **kwargs)
        self.newly_dead: list[str] = []
        self._agents_time: float | None = None
        self._agents: list[str] = []
        self._spaces: dict[str, Any] = {}

    @classmethod
    def native_class(cls) -> str:
        """Name of the environment's class in the simulation."""
        return "ConstellationTasking"

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Draws and starts an episode, and returns the first observations and infos by agent."""
        self.newly_dead = []
        self._agents_time = None
        return super().reset(seed=seed, options=options)

    @property
    def agents(self) -> list[str]:
        """Names of the satellites that are alive before the time limit."""
        if "simulator" not in self.__dict__:
            return []
        if self._agents_time is None or self._agents_time != self.simulator.sim_time:
            is_over = self._is_truncated()
            self._agents = [satellite.name for satellite in self.satellites if satellite.is_alive() and not is_over]
            self._agents_time = self.simulator.sim_time
        return self._agents

    @property
    def num_agents(self) -> int:
        """Number of agents that take part."""
        return len(self.agents)

    @property
    def possible_agents(self) -> list[str]:
        """Names of all satellites."""
        return [satellite.name for satellite in self.satellites]

    @property
    def max_num_agents(self) -> int:
        """Number of all satellites."""
        return len(self.satellites)

    @property
    def previously_dead(self) -> list[str]:
        """Names of the satellites that left before the last step."""
        here = {*self.agents, *self.newly_dead}
        return [name for name in self.possible_agents if name not in here]

    @property
    def observation_spaces(self) -> dict[str, Any]:
        """Spaces of observations by agent; resets the environment if it was never reset."""
        self._require_simulator()
        return {satellite.name: satellite.observation_space for satellite in self.satellites}

    def observation_space(self, agent: str) -> spaces.Space[Any]:  # type: ignore[override]
        """Returns the space of an agent's observation."""
        space: spaces.Space[Any] = self.observation_spaces[agent]
        return space

    @property
    def action_spaces(self) -> dict[str, Any]:
        """Spaces of actions by agent."""
        return {name: self.action_space(name) for name in self.possible_agents}

    def action_space(self, agent: str) -> spaces.Space[Any]:  # type: ignore[override]
        """Returns the space of an agent's action, always the same object."""
        if agent not in self._spaces:
            by_name = {satellite.name: satellite for satellite in self.satellites}
            self._spaces[agent] = by_name[agent].action_space
        space: spaces.Space[Any] = self._spaces[agent]
        return space

    def _present(self) -> list[Any]:
        """Satellites that took part in the last step."""
        gone = self.previously_dead
        return [satellite for satellite in self.satellites if satellite.name not in gone]

    def _get_obs(self) -> dict[str, Any]:
        return {satellite.name: self._observation(satellite) for satellite in self._present()}

    def _get_reward(self) -> dict[str, float]:
        rewards = {}
        for satellite in self.satellites:
            reward = self.reward_dict.get(satellite.name, 0.0)
            if not satellite.is_alive():
                reward += self.failure_penalty
            rewards[satellite.name] = reward
        return {satellite.name: rewards[satellite.name] for satellite in self._present()}

    def _get_terminated(self) -> dict[str, bool]:
        present = self._present()
        if self.terminate_on_time_limit and self._is_truncated():
            return {satellite.name: True for satellite in present}
        return {satellite.name: not satellite.is_alive() or self.rewarder.is_terminated(satellite) for satellite in present}

    def _get_truncated(self) -> dict[str, bool]:
        is_over = self._is_truncated()
        return {satellite.name: is_over or self.rewarder.is_truncated(satellite) for satellite in self._present()}

    def _get_info(self) -> dict[str, Any]:
        common = {"d_ts": self.latest_step_duration}
        info: dict[str, Any] = {
            satellite.name: {"requires_retasking": satellite.requires_retasking, **common} for satellite in self._present()
        }
        info["__common__"] = common
        return info

    def step(self, actions: dict[str, Any]) -> Any:
        """Steps the simulation until a satellite needs an action.

        Satellites without an action go on. Returns PettingZoo's tuple of dictionaries.
        """
        logger.info("=== STARTING STEP ===")
        before = self.agents
        given = {name: _only_member(action) for name, action in actions.items()}
        unknown = [name for name in given if name not in self.possible_agents]
        if unknown:
            raise KeyError(unknown[0])
        self._step([given.get(satellite.name) for satellite in self.satellites])
        after = self.agents
        self.newly_dead = [name for name in before if name not in after]
        for name in self.newly_dead:
            satellite = self.get_satellite(name)
            if not satellite.is_alive():
                satellite.on_dead()
        observation = self._get_obs()
        reward = self._get_reward()
        terminated = self._get_terminated()
        truncated = self._get_truncated()
        info = self._get_info()
        if logger.isEnabledFor(logging.INFO):
            logger.info(f"Step reward: { {k: v for k, v in reward.items() if v != 0} }")
            for word, flags in (("terminated", terminated), ("truncated", truncated)):
                if any(flags.values()):
                    logger.info(f"Episode {word}: {[name for name, flag in flags.items() if flag]}")
        return observation, reward, terminated, truncated, info


def _only_member(action: Any) -> Any:
    """Action of an agent's only satellite: agents may give a list of one action for each of their satellites."""
    return action[0] if isinstance(action, (list, tuple, np.ndarray)) else action
