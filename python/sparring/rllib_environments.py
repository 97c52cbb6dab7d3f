"""Environments of RLlib's new API stack, with the curriculum that those of a process share, and RLlib's names of them."""

from __future__ import annotations

import functools
import json
import socket
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from ray.rllib.env.multi_agent_env import MultiAgentEnv
from ray.tune.registry import register_env

from . import _native
from .connection import read_url
from .curriculum import Curriculum, CurriculumError
from .errors import invalid
from .parallel import ParallelEnvironment, parallel_env
from .vector import VectorEnvironment, make_vec


def register_environments() -> dict[str, str]:
    """Registers the environments with the current or next session of Ray; returns RLlib's names by constant.

    `ray.shutdown` removes the names, so that each session needs them again.
    """
    register_env("sparring/team", team_env)
    register_env("sparring/agents", agents_env)
    return {"TEAM": "sparring/team", "AGENTS": "sparring/agents"}


def team_env(config: Mapping[str, Any]) -> TeamVectorEnv:
    """Makes the environments of one env runner, with one agent each: `config.environment(sparring.rllib.TEAM, …)`.

    They are stepped together, which needs `env_runners(gym_env_vectorize_mode="vector_entry_point")`.

    Args:
        config: RLlib's env_config: arguments of `sparring.make_vec` without `telemetry`, which is not flat. `curriculum` has
            the arguments of `sparring.Curriculum`: `{"url": …, "run": …}`. Without `url`, each host uses its `SPARRING_URL`.
            Pass a token by `SPARRING_TOKEN` on each host, since RLlib writes env_configs to checkpoints and logs.

    Raises:
        ValueError: A value is unknown or out of range; the message names the field.
        CurriculumError: The server does not answer, has no such run, or rejects the request.
    """
    settings = _read_config(config)
    for name in ("autoreset_mode", "episode_statistics"):
        if name in settings:
            raise ValueError(f"`{name}` must be omitted: team_env sets the value that RLlib needs")
    if "num_envs" not in settings:
        raise ValueError("`gym_env_vectorize_mode` must be 'vector_entry_point'; pass it to config.env_runners(…)")
    # RLlib gives an env runner one core.
    settings.setdefault("threads", 1)
    make = functools.partial(make_vec, episode_statistics=False)
    envs: TeamVectorEnv = _with_curriculum(settings, lambda **arguments: TeamVectorEnv(make(**arguments)))
    return envs


def agents_env(config: Mapping[str, Any]) -> AgentsEnv:
    """Makes an environment with one agent per satellite or deputy: `config.environment(sparring.rllib.AGENTS, …)`.

    Args:
        config: RLlib's env_config: arguments of `sparring.parallel_env` without `telemetry`; `curriculum` as for `team_env`.
            All environments of an env runner share one curriculum.

    Raises:
        ValueError: A value is unknown or out of range; the message names the field.
        CurriculumError: The server does not answer, has no such run, or rejects the request.
    """
    settings = _read_config(config)
    env: AgentsEnv = _with_curriculum(settings, lambda **arguments: AgentsEnv(parallel_env(**arguments)))
    return env


def _read_config(config: Mapping[str, Any]) -> dict[str, Any]:
    settings = dict(config)
    if settings.get("observation") == "telemetry":
        raise invalid("observation", "tracks or state, which have a row per agent", settings["observation"])
    return settings


def open_curriculum(arguments: Mapping[str, Any]) -> Curriculum:
    """Opens the curriculum of an env_config on this host; without `url`, at the address in `SPARRING_URL`.

    Raises:
        ValueError: A value is unknown or out of range, or there is no run; the message names the field.
        CurriculumError: The server does not answer, has no such run, or rejects the request.
    """
    if not isinstance(arguments, Mapping) or not arguments.get("run"):
        raise invalid("curriculum", "a dict with the url of a server and the run that all env runners share", arguments)
    if arguments.get("settings") is not None:
        requirement = "omitted with `run`: create the run before, as `sparring.Curriculum(url, settings=…)` does"
        raise invalid("curriculum.settings", requirement, arguments["settings"])
    url = read_url(arguments.get("url"))
    try:
        return Curriculum(**{**arguments, "url": url})
    except CurriculumError as error:
        if not _native.is_loopback(url) or "no server answers" not in str(error):
            raise
        raise CurriculumError(
            f"{error}; {url} is an address of this host itself ({socket.gethostname()}): with several hosts, `url` must name the "
            "host of the server, and the server must serve others (--bind 0.0.0.0:8700, with tokens)"
        ) from error


class _SharedCurricula:
    """Curricula of this process, counted by reference: environments with equal arguments share one, and the last closes it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[str, tuple[Curriculum, int]] = {}

    def acquire(self, arguments: Mapping[str, Any]) -> tuple[str, Curriculum]:
        key = json.dumps(dict(arguments) if isinstance(arguments, Mapping) else None, sort_keys=True)
        with self._lock:
            curriculum, users = self._open.get(key) or (open_curriculum(arguments), 0)
            self._open[key] = curriculum, users + 1
        return key, curriculum

    def release(self, key: str) -> None:
        with self._lock:
            curriculum, users = self._open.pop(key)
            if users > 1:
                self._open[key] = curriculum, users - 1
                return
        curriculum.close()


_SHARED_CURRICULA = _SharedCurricula()


def _with_curriculum(settings: dict[str, Any], make: Callable[..., Any]) -> Any:
    """Makes environments, with the shared curriculum of `settings["curriculum"]` if there is one."""
    arguments = settings.pop("curriculum", None)
    if arguments is None:
        return make(**settings)
    key, curriculum = _SHARED_CURRICULA.acquire(arguments)
    try:
        env = make(**settings, curriculum=curriculum)
    except BaseException:
        _SHARED_CURRICULA.release(key)
        raise
    env.curriculum, env._curriculum_key = curriculum, key
    return env


class TeamVectorEnv(VectorEnv[Any, Any, npt.NDArray[Any]]):
    """A `sparring.VectorEnvironment` with flat observations and actions, as RLlib's own modules need them.

    The rows of all agents are concatenated. The infos of an episode's first step have its `level` and whether to learn from
    it (`train`).
    """

    #: Shared curriculum, if there is one.
    curriculum: Curriculum | None = None
    _curriculum_key: str | None = None

    def __init__(self, envs: VectorEnvironment) -> None:
        #: The wrapped environments.
        self.envs = envs
        self.num_envs = envs.num_envs
        self.metadata = envs.metadata
        self.autoreset_mode = AutoresetMode.NEXT_STEP
        self.render_mode = envs.render_mode
        self.single_observation_space = _flatten(envs.single_observation_space)
        self.single_action_space = _flatten(envs.single_action_space)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._joint_shape = envs.action_space.shape
        self._ended = np.zeros(self.num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Begins an episode in every environment, as `sparring.VectorEnvironment.reset`."""
        observations, infos = self.envs.reset(seed=seed, options=options)
        begun = np.ones(self.num_envs, np.bool_) if not options else options.get("reset_mask", np.ones(self.num_envs, np.bool_))
        self._ended &= ~begun
        return observations.reshape(self.num_envs, -1), {**infos, **self._curriculum_infos(begun)}

    def step(
        self, actions: npt.NDArray[Any]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Runs one step; environments whose episode has ended begin the next one instead."""
        observations, rewards, terminations, truncations, infos = self.envs.step(np.asarray(actions).reshape(self._joint_shape))
        begun, self._ended = self._ended, terminations | truncations
        infos = {**infos, **self._curriculum_infos(begun)}
        return observations.reshape(self.num_envs, -1), rewards, terminations, truncations, infos

    def _curriculum_infos(self, begun: npt.NDArray[np.bool_]) -> dict[str, Any]:
        if self.curriculum is None or not begun.any():
            return {}
        return {"level": self.envs.levels, "_level": begun, "train": self.envs.train, "_train": begun}

    def render(self) -> tuple[Any, ...] | None:
        """Returns an image of every environment."""
        return self.envs.render()

    def close_extras(self, **_: Any) -> None:
        """Returns unfinished episodes; the last user of the curriculum closes it, which submits its results."""
        self.envs.close()
        key, self._curriculum_key = self._curriculum_key, None
        if key is not None:
            _SHARED_CURRICULA.release(key)


def _flatten(space: Any) -> Any:
    if isinstance(space, spaces.Box):
        return spaces.Box(space.low.reshape(-1), space.high.reshape(-1), dtype=np.float32)
    return space


class AgentsEnv(MultiAgentEnv):
    """A `sparring.ParallelEnvironment` as RLlib's `MultiAgentEnv`.

    RLlib's own wrapper of PettingZoo assumes that all episodes have the agents of the first one. It also misses the end of
    an episode in whose last step some agents terminate and the others are truncated.
    """

    #: Shared curriculum, if there is one.
    curriculum: Curriculum | None = None
    _curriculum_key: str | None = None

    def __init__(self, env: ParallelEnvironment) -> None:
        super().__init__()
        #: The wrapped environment.
        self.env = env
        self.metadata = dict(env.metadata)
        self.render_mode = env.render_mode
        self.possible_agents = list(env.possible_agents)
        self.agents = list(env.possible_agents)
        self.observation_spaces: dict[str, spaces.Space[Any]] = dict(env.observation_spaces)
        self.action_spaces: dict[str, spaces.Space[Any]] = dict(env.action_spaces)
        self.observation_space = spaces.Dict(self.observation_spaces)
        self.action_space = spaces.Dict(self.action_spaces)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begins an episode, as `sparring.ParallelEnvironment.reset`."""
        observations, infos = self.env.reset(seed=seed, options=options)
        self.agents = list(observations)
        return observations, infos

    def step(
        self, action_dict: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Runs one step; the results are of the agents that took part in it."""
        observations, rewards, terminations, truncations, infos = self.env.step(action_dict)
        self.agents = list(observations)
        over = not self.env.agents
        all_terminated = all(terminations.values())
        if over:
            # If every agent is done, RLlib treats the episode as terminated and does not bootstrap values at the horizon.
            # So the episode is truncated, not its agents.
            truncations = {}
        return (
            observations,
            rewards,
            {**terminations, "__all__": over and all_terminated},
            {**truncations, "__all__": over and not all_terminated},
            infos,
        )

    def render(self) -> Any:
        """Returns an image, or shows it in a window."""
        return self.env.render()

    def close(self) -> None:
        """Returns an unfinished episode; the last user of the curriculum closes it, which submits its results."""
        self.env.close()
        key, self._curriculum_key = self._curriculum_key, None
        if key is not None:
            _SHARED_CURRICULA.release(key)
