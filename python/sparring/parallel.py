"""One agent for each satellite or deputy: PettingZoo's parallel interface."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from .curriculum import Curriculum
from .scenario import Scenario, plain_dict, plain_seed
from .settings import Actions, Axes, Observation, Settings, View, agent_action_space
from .single import OPTIONS, left_early, lesson, wished
from .window import FPS, Screen

try:
    from pettingzoo import ParallelEnv
except ImportError:  # the base wheel does without: what is asked for then says what to install
    ParallelEnv = object


class ParallelEnvironment(ParallelEnv):
    """Agents `satellite_0`, … or `deputy_0`, …: each sees its own row, acts for itself and leaves when it is lost or done.

    Make one by `sparring.parallel_env`, which has the arguments.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array", "human"],
        "render_fps": FPS,
        "is_parallelizable": True,
        "name": "sparring_v0",
    }

    def __init__(self, settings: Settings, render_mode: str | None, render_size: tuple[int, int]) -> None:
        if ParallelEnv is object:
            from gymnasium.error import DependencyNotInstalled

            raise DependencyNotInstalled("pettingzoo is not installed: pip install 'sparring[pettingzoo]'")
        self._settings = settings
        self._native = settings.native(1, autoreset_mode="disabled", threads=1, seed=None, single=True)
        self._view = View(settings, self._native)
        name = settings.told.id.replace("/", "_")
        self.metadata = {**type(self).metadata, "name": f"sparring_{name}_v0"}
        self.possible_agents = [f"{self._view.name}_{number}" for number in range(self._view.agents)]
        self.agents: list[str] = []
        whole = self._view.mode == "telemetry"
        space = self._view.space if whole else self._view.agent_space
        self.observation_spaces = {agent: space() for agent in self.possible_agents}
        self.action_spaces = {agent: agent_action_space(settings, self._view) for agent in self.possible_agents}
        self.render_mode = render_mode
        self._screen = Screen(render_mode, render_size, self.metadata)
        self._steps, self._warned = 0, False

    def __reduce__(self) -> tuple[Any, ...]:
        wish = {**self._settings.wish(), "render_mode": self.render_mode, "render_size": self._screen.size}
        return functools.partial(parallel_env, **wish), ()

    def observation_space(self, agent: str) -> Any:
        """The space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begins an episode, as `sparring.Environment.reset`; agents that the scenario does without do not take part. Options
        that are unknown are not looked at.

        Raises:
            ValueError: A seed, a scenario or an option that is none.
            CurriculumError: A curriculum has nothing left to fly.
        """
        if self._settings.curriculum is not None and self.agents and self._steps and not self._warned:
            self._warned = True
            left_early(self._steps)
        # PettingZoo's wrappers and tests hand options through that are not ours.
        ours = {name: value for name, value in plain_dict("options", options).items() if name in OPTIONS}
        recipe, scenario = wished(self._settings, ours)
        plain = None if seed is None else plain_seed(seed)
        seen = self._native.reset([plain], recipes=[recipe], scenarios=[scenario])
        told = {"scenario": self.scenario, **lesson(self._native, self._settings)}
        _, left, _ = self._native.agents()
        self._steps = 0
        self.agents = [agent for agent, absent in zip(self.possible_agents, left[0], strict=True) if not absent]
        if self.render_mode == "human":
            self.render()
        rows = self._rows(seen)
        return {agent: rows[agent] for agent in self.agents}, {agent: dict(told) for agent in self.agents}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One step; agents that are not in `actions` hold. Infos of all agents have the episode's `score` so far, and
        `alerts`: what happened, in words.

        Raises:
            ValueError: An action that is none, or of nobody. Nothing has moved then.
            gymnasium.error.ResetNeeded: Nobody is there.
        """
        if not self.agents:
            raise ResetNeeded("nobody is there: call reset first")
        seen, *_, ended = self._native.step(self._joint(actions))
        self._steps += 1
        rewards, left, cut = self._native.agents()
        rows, here = self._rows(seen), self.agents
        numbers = [self.possible_agents.index(agent) for agent in here]
        terminations = {agent: bool(left[0, n]) for agent, n in zip(here, numbers, strict=True)}
        truncations = {agent: bool(cut[0, n]) for agent, n in zip(here, numbers, strict=True)}
        episode = self._native.episode(0)
        score, alerts = 0.0 if episode is None else episode[1], self._native.alerts(0)
        self.agents = [agent for agent in here if not (terminations[agent] or truncations[agent] or ended)]
        if self.render_mode == "human":
            self.render()
        return (
            {agent: rows[agent] for agent in here},
            {agent: float(rewards[0, n]) for agent, n in zip(here, numbers, strict=True)},
            terminations,
            truncations,
            {agent: {"score": score, "alerts": alerts} for agent in here},
        )

    def _joint(self, actions: Mapping[str, Any]) -> npt.NDArray[Any]:
        discrete = self._settings.actions == "discrete"
        shape = () if discrete else (self._view.values,)
        joint = np.zeros((self._view.agents, *shape), np.int64 if discrete else np.float32)
        for agent, action in plain_dict("actions", actions).items():
            if agent not in self.possible_agents:
                raise ValueError(f"actions.{agent}: no such agent; there are {', '.join(self.possible_agents)}")
            given = np.asarray(action)
            if given.dtype.kind not in ("iu" if discrete else "fiu") or given.shape != shape:
                wanted = "a whole number" if discrete else f"{self._view.values} numbers"
                raise ValueError(f"actions.{agent}: dtype {given.dtype} of shape {given.shape}, not {wanted}")
            joint[self.possible_agents.index(agent)] = given
        return joint

    def _rows(self, seen: npt.NDArray[np.float32]) -> dict[str, Any]:
        view = self._view.of(seen, single=True)
        if self._view.mode == "telemetry":
            return {agent: {name: part.copy() for name, part in view.items()} for agent in self.possible_agents}
        return {agent: view[number].copy() for number, agent in enumerate(self.possible_agents)}

    @property
    def scenario(self) -> Scenario | None:
        """What is flown; none before the first reset."""
        episode = self._native.episode(0)
        return None if episode is None else Scenario._of(episode[0])

    def render(self) -> Any:
        """A picture (`rgb_array`), or nothing but a window (`human`)."""
        return self._screen.show(self._native, 0)

    def close(self) -> None:
        """Closes the window, if there is one, and gives back to the curriculum what is being flown."""
        self._screen.close()
        self._native.leave()


def parallel_env(
    task: str | None = None,
    *,
    params: Mapping[str, float] | None = None,
    physics: Mapping[str, str] | None = None,
    layout: Mapping[str, Any] | None = None,
    level: int | None = None,
    observation: Observation | None = None,
    threats: int | None = None,
    look_ahead: int | None = None,
    bodies: int | None = None,
    actions: Actions = "continuous",
    axes: Axes | None = None,
    curriculum: Curriculum | None = None,
    render_mode: str | None = None,
    render_size: tuple[int, int] = (640, 640),
) -> ParallelEnvironment:
    """One environment with an agent for each satellite or deputy: a `pettingzoo.ParallelEnv`.

    Arguments are those of `sparring.Environment`; the task is docking/multiagent unless told.

    Raises:
        ValueError: What is unknown or out of range, with the field.
        gymnasium.error.DependencyNotInstalled: PettingZoo is missing.
    """
    if task is None and curriculum is None:
        task = "docking/multiagent"
    settings = Settings(task, params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes, curriculum)
    return ParallelEnvironment(settings, render_mode, render_size)
