"""Multi-agent environments: one agent per satellite or deputy, with PettingZoo's parallel interface."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from .curriculum import Curriculum
from .errors import invalid
from .rendering import FPS, Renderer
from .reset_request import RESET_OPTIONS, SingleBatch
from .scenario import Scenario, copy_mapping
from .settings import Actions, Axes, Observation, ObservationLayout, Settings, agent_action_space

try:
    from pettingzoo import ParallelEnv
except ImportError:  # optional dependency; the error of the constructor has the command that installs it
    ParallelEnv = object


class ParallelEnvironment(ParallelEnv):
    """Environment with agents `satellite_0`, … or `deputy_0`, …, each with its own observation and action.

    An agent leaves when it is lost or done. Use `sparring.parallel_env`, which documents the arguments.
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

            raise DependencyNotInstalled("sparring.parallel_env needs PettingZoo: pip install 'sparring[pettingzoo]'")
        self._settings = settings
        self._batch = SingleBatch(settings)
        self._native = self._batch.native
        self._layout = ObservationLayout(settings, self._native)
        name = settings.spec.id.replace("/", "_")
        self.metadata = {**type(self).metadata, "name": f"sparring_{name}_v0"}
        self.possible_agents = [f"{self._layout.agent_name}_{number}" for number in range(self._layout.num_agents)]
        self.agents: list[str] = []
        # In telemetry each agent observes everything.
        space = self._layout.space if self._layout.mode == "telemetry" else self._layout.agent_space
        self.observation_spaces = {agent: space() for agent in self.possible_agents}
        self.action_spaces = {agent: agent_action_space(settings, self._layout) for agent in self.possible_agents}
        self.render_mode = render_mode
        self._renderer = Renderer(render_mode, render_size, self.metadata)

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = {**self._settings.arguments(), "render_mode": self.render_mode, "render_size": self._renderer.size}
        return functools.partial(parallel_env, **arguments), ()

    def observation_space(self, agent: str) -> Any:
        """Returns the observation space of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Returns the action space of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begins an episode, as `sparring.Environment.reset`; ignores unknown options.

        Only agents that the scenario has take part. Each info has `d_ts`, 0, and `requires_retasking`.

        Raises:
            ValueError: The seed, a scenario or an option is invalid.
            CurriculumError: The curriculum has no episode left.
        """
        # PettingZoo's wrappers and tests pass options of their own.
        known = {name: value for name, value in copy_mapping("options", options).items() if name in RESET_OPTIONS}
        observation, info = self._batch.reset(seed, known)
        _, terminated, _ = self._native.agent_results()
        self.agents = [agent for agent, absent in zip(self.possible_agents, terminated[0], strict=True) if not absent]
        if self.render_mode == "human":
            self.render()
        rows = self._agent_rows(observation)
        times = self._step_times()
        return {agent: rows[agent] for agent in self.agents}, {agent: {**info, **times[agent]} for agent in self.agents}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Runs one step; agents without an action, and those whose action is None, hold.

        Returns:
            Observations, rewards, terminations, truncations and infos by agent. Each info has the episode's `score` so far,
            `alerts`, messages about the step, `d_ts`, its duration in s, and `requires_retasking`, true if the agent needs an
            action. All are empty after the end of an episode if there are no actions, as wrappers
            such as SuperSuit's `black_death_v3` expect.

        Raises:
            ValueError: An action is invalid or its agent is unknown; nothing changes then.
            gymnasium.error.ResetNeeded: There is no agent, and no episode has begun or there are actions.
        """
        if not self.agents and not actions and self._native.episode(0) is not None:
            return {}, {}, {}, {}, {}
        if not self.agents:
            raise ResetNeeded("no episode is running: call reset() first")
        observation, *_, ended = self._native.step(self._joint_action(actions))
        self._batch.count_step(ended)
        rewards, terminated, truncated = self._native.agent_results()
        rows, agents = self._agent_rows(observation), self.agents
        numbers = [self.possible_agents.index(agent) for agent in agents]
        terminations = {agent: bool(terminated[0, n]) for agent, n in zip(agents, numbers, strict=True)}
        truncations = {agent: bool(truncated[0, n]) for agent, n in zip(agents, numbers, strict=True)}
        score, alerts, times = self._batch.score, self._native.alerts(0), self._step_times()
        self.agents = [agent for agent in agents if not (terminations[agent] or truncations[agent] or ended)]
        if self.render_mode == "human":
            self.render()
        return (
            {agent: rows[agent] for agent in agents},
            {agent: float(rewards[0, n]) for agent, n in zip(agents, numbers, strict=True)},
            terminations,
            truncations,
            {agent: {"score": score, "alerts": alerts, **times[agent]} for agent in agents},
        )

    def _step_times(self) -> dict[str, dict[str, Any]]:
        times = self._batch.times()
        needs = zip(self.possible_agents, times["requires_retasking"], strict=True)
        return {agent: {"d_ts": times["d_ts"], "requires_retasking": bool(flag)} for agent, flag in needs}

    def _joint_action(self, actions: Mapping[str, Any]) -> npt.NDArray[Any]:
        joint = self._settings.hold_actions(self._native)
        discrete, shape = self._settings.is_discrete, joint.shape[1:]
        for agent, action in copy_mapping("actions", actions).items():
            if agent not in self.possible_agents:
                raise ValueError(f"`actions.{agent}` is unknown; the agents are {', '.join(self.possible_agents)}")
            if action is None:
                continue
            array = np.asarray(action)
            if array.dtype.kind not in ("iu" if discrete else "fiu") or array.shape != shape:
                expected = "an integer" if discrete else f"{self._layout.action_size} numbers"
                raise invalid(f"actions.{agent}", expected, action)
            joint[self.possible_agents.index(agent)] = array
        return joint

    def _agent_rows(self, observation: npt.NDArray[np.float32]) -> dict[str, Any]:
        view = self._layout.view(observation, single=True)
        if self._layout.mode == "telemetry":
            return {agent: {name: part.copy() for name, part in view.items()} for agent in self.possible_agents}
        return {agent: view[number].copy() for number, agent in enumerate(self.possible_agents)}

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the episode; None before the first reset."""
        return self._batch.scenario

    def render(self) -> Any:
        """Returns an image in mode `rgb_array`; shows it in a window and returns None in mode `human`."""
        return self._renderer.render(self._native, 0)

    def close(self) -> None:
        """Closes the window, and returns an unfinished episode to the curriculum."""
        self._renderer.close()
        self._native.release()


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
    actions: Actions | None = None,
    axes: Axes | None = None,
    curriculum: Curriculum | None = None,
    render_mode: str | None = None,
    render_size: tuple[int, int] = (640, 640),
) -> ParallelEnvironment:
    """Makes a `pettingzoo.ParallelEnv` with one agent per satellite or deputy.

    The arguments are those of `sparring.Environment`; the default task is docking/multiagent.

    Raises:
        ValueError: A value is unknown or out of range; the message names the field.
        gymnasium.error.DependencyNotInstalled: PettingZoo is not installed.
    """
    if task is None and curriculum is None:
        task = "docking/multiagent"
    settings = Settings(task, params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes, curriculum)
    return ParallelEnvironment(settings, render_mode, render_size)
