"""RLlib, on its EnvRunners, ConnectorV2 and RLModules: environments that fly a curriculum, a module for them, and a callback that
brings the curriculum's numbers into results.

run = sparring.Curriculum("http://127.0.0.1:8700", settings={"tasks": ["kessler/survival"]}).run
config = (
    PPOConfig()
    .environment(sparring.rllib.TEAM, env_config={"curriculum": {"url": "http://127.0.0.1:8700", "run": run}})
    .env_runners(num_env_runners=2, num_envs_per_env_runner=32, gym_env_vectorize_mode="vector_entry_point")
    .rl_module(rl_module_spec=sparring.rllib.module("kessler/survival"))
    .callbacks(sparring.rllib.CurriculumCallback)
)
algorithm = config.build_algo()
"""

from __future__ import annotations

import functools
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

try:
    from ray.rllib.callbacks.callbacks import RLlibCallback
    from ray.rllib.env.multi_agent_env import MultiAgentEnv
    from ray.tune.registry import register_env

    from .rllib_module import AgentsModule as AgentsModule
    from .rllib_module import act as act
    from .rllib_module import module as module
except ImportError as error:
    raise ImportError("sparring.rllib needs RLlib: pip install 'sparring[rllib]'") from error

from .curriculum import Curriculum, CurriculumError
from .parallel import ParallelEnvironment, parallel_env
from .vector import VectorEnvironment, make_vec

#: What RLlib knows `team_env` by: one agent acts for a whole environment.
TEAM = "sparring/team"
#: What RLlib knows `agents_env` by: a `MultiAgentEnv`, with an agent for each satellite or deputy.
AGENTS = "sparring/agents"


def team_env(config: Mapping[str, Any]) -> TeamVectorEnv:
    """Environments of one env runner, which one agent acts for: `config.environment(sparring.rllib.TEAM, env_config=…)`.

    RLlib asks for them by `env_runners(gym_env_vectorize_mode="vector_entry_point")`: they are stepped together.

    Args:
        config: RLlib's env_config: what `sparring.make_vec` takes, not `telemetry`, which is not flat; and `curriculum`, which
            says which one this env runner takes part in, as what `sparring.Curriculum` takes: `{"url": …, "run": …}`. A token
            is better put into each host's `SPARRING_TOKEN`: what is in a config is written into checkpoints and logs.

    Raises:
        ValueError: What is unknown or out of range, with the field.
        CurriculumError: No server, no such run, or it refuses.
    """
    settings = _settings(config)
    for name in ("autoreset_mode", "episode_statistics"):
        if name in settings:
            raise ValueError(f"{name}: RLlib wants it as it is here")
    if "num_envs" not in settings:
        raise ValueError("gym_env_vectorize_mode: it has to be 'vector_entry_point'")
    # RLlib gives an env runner one core.
    settings.setdefault("threads", 1)
    made: TeamVectorEnv = _flying(settings, lambda **wish: TeamVectorEnv(make_vec(**wish, episode_statistics=False)))
    return made


def agents_env(config: Mapping[str, Any]) -> AgentsEnv:
    """One environment with an agent for each satellite or deputy: `config.environment(sparring.rllib.AGENTS, env_config=…)`.

    Args:
        config: RLlib's env_config: what `sparring.parallel_env` takes, not `telemetry`; and `curriculum`, as in `team_env`.
            All environments of an env runner share one.

    Raises:
        ValueError: What is unknown or out of range, with the field.
        CurriculumError: No server, no such run, or it refuses.
    """
    made: AgentsEnv = _flying(_settings(config), lambda **wish: AgentsEnv(parallel_env(**wish)))
    return made


register_env(TEAM, team_env)
register_env(AGENTS, agents_env)


def _settings(config: Mapping[str, Any]) -> dict[str, Any]:
    settings = dict(config)
    if settings.get("observation") == "telemetry":
        raise ValueError("observation: telemetry has no row for each agent; take tracks or state")
    return settings


class _Shared:
    """The curricula of this process: environments that wish for the same share one, and the last to leave closes it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[str, tuple[Curriculum, int]] = {}

    def join(self, wish: Mapping[str, Any]) -> tuple[str, Curriculum]:
        if not isinstance(wish, Mapping) or not wish.get("run"):
            raise ValueError("curriculum: not a dict with the url of a server and a run of it, which all env runners share")
        name = json.dumps(dict(wish), sort_keys=True)
        with self._lock:
            curriculum, users = self._open.get(name) or (Curriculum(**wish), 0)
            self._open[name] = curriculum, users + 1
        return name, curriculum

    def leave(self, name: str) -> None:
        with self._lock:
            curriculum, users = self._open.pop(name)
            if users > 1:
                self._open[name] = curriculum, users - 1
                return
        # What was flown is handed in, and what was not is given back.
        curriculum.close()


_SHARED = _Shared()


def _flying(settings: dict[str, Any], make: Callable[..., Any]) -> Any:
    wish = settings.pop("curriculum", None)
    if wish is None:
        return make(**settings)
    name, curriculum = _SHARED.join(wish)
    try:
        env = make(**settings, curriculum=curriculum)
    except BaseException:
        _SHARED.leave(name)
        raise
    env.curriculum, env._member = curriculum, name
    return env


class TeamVectorEnv(VectorEnv[Any, Any, npt.NDArray[Any]]):
    """A `sparring.VectorEnvironment` whose observations and actions are flat, which is what RLlib's own modules take: the rows of
    all agents, one after another. `infos` of an episode's first step say its `level` and whether to learn from it (`train`)."""

    #: The curriculum that is flown, if one is.
    curriculum: Curriculum | None = None
    _member: str | None = None

    def __init__(self, envs: VectorEnvironment) -> None:
        #: The environments themselves.
        self.envs = envs
        self.num_envs = envs.num_envs
        self.metadata = envs.metadata
        self.autoreset_mode = AutoresetMode.NEXT_STEP
        self.render_mode = envs.render_mode
        self.single_observation_space = _flat(envs.single_observation_space)
        self.single_action_space = _flat(envs.single_action_space)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._acting = envs.action_space.shape
        self._over = np.zeros(self.num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Begins an episode in every environment, as `sparring.VectorEnvironment.reset`."""
        seen, infos = self.envs.reset(seed=seed, options=options)
        begun = np.ones(self.num_envs, np.bool_) if not options else options.get("reset_mask", np.ones(self.num_envs, np.bool_))
        self._over &= ~begun
        return seen.reshape(self.num_envs, -1), {**infos, **self._lessons(begun)}

    def step(
        self, actions: npt.NDArray[Any]
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """One step of every environment; those whose episode was over begin the next instead."""
        seen, rewards, terminations, truncations, infos = self.envs.step(np.asarray(actions).reshape(self._acting))
        begun, self._over = self._over, terminations | truncations
        return seen.reshape(self.num_envs, -1), rewards, terminations, truncations, {**infos, **self._lessons(begun)}

    def _lessons(self, begun: npt.NDArray[np.bool_]) -> dict[str, Any]:
        if self.curriculum is None or not begun.any():
            return {}
        return {"level": self.envs.levels, "_level": begun, "train": self.envs.train, "_train": begun}

    def render(self) -> tuple[Any, ...] | None:
        """A picture of every environment."""
        return self.envs.render()

    def close_extras(self, **_: Any) -> None:
        """Hands in what was flown, and gives back what is being flown."""
        self.envs.close()
        member, self._member = self._member, None
        if member is not None:
            _SHARED.leave(member)


def _flat(space: Any) -> Any:
    if isinstance(space, spaces.Box):
        return spaces.Box(space.low.reshape(-1), space.high.reshape(-1), dtype=np.float32)
    return space


class AgentsEnv(MultiAgentEnv):
    """A `sparring.ParallelEnvironment` as RLlib takes it. RLlib's own wrapper of PettingZoo's environments takes the agents of
    its first episode for all there are, and does not see the end of one in whose last step some agents were lost and the others
    cut off."""

    #: The curriculum that is flown, if one is.
    curriculum: Curriculum | None = None
    _member: str | None = None

    def __init__(self, env: ParallelEnvironment) -> None:
        super().__init__()
        #: The environment itself.
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
        seen, infos = self.env.reset(seed=seed, options=options)
        self.agents = list(seen)
        return seen, infos

    def step(
        self, action_dict: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One step: who is told something took part in it."""
        seen, rewards, terminations, truncations, infos = self.env.step(action_dict)
        self.agents = list(seen)
        over = not self.env.agents
        lost = all(terminations.values())
        if over:
            # Where every agent is done by itself, RLlib takes the episode for terminated, and values nothing behind the
            # horizon: it has to be the episode that is cut off, not its agents.
            truncations = {}
        return (
            seen,
            rewards,
            {**terminations, "__all__": over and lost},
            {**truncations, "__all__": over and not lost},
            infos,
        )

    def render(self) -> Any:
        """A picture, or nothing but a window."""
        return self.env.render()

    def close(self) -> None:
        """Gives back what is being flown; the last environment of an env runner hands in what was flown."""
        self.env.close()
        member, self._member = self._member, None
        if member is not None:
            _SHARED.leave(member)


class CurriculumCallback(RLlibCallback):
    """Tells the curricula of all env runners after each iteration which version of the policy flies from then on (the number of
    iterations that it learned from, after those that the run knew before), and writes the curriculum's numbers into the result
    as `curriculum/…`: mastery, level, params, skill, the share of groups without variance, and what became of the episodes of
    all env runners. Episodes that the curriculum only wants to know the outcome of are not learned from."""

    def __init__(self) -> None:
        super().__init__()
        self._curriculum: Curriculum | None = None
        self._before = 0
        self._idle: set[str] = set()

    def on_algorithm_init(self, *, algorithm: Any, **_: Any) -> None:
        """Looks for the curriculum in the env_config."""
        wish = algorithm.config.env_config.get("curriculum")
        if wish is not None:
            # It flies nothing: env runners have their own.
            self._curriculum = Curriculum(wish.get("url", "http://127.0.0.1:8700"), wish["run"], token=wish.get("token"))
            self._begin(algorithm, self._curriculum)

    def _begin(self, algorithm: Any, curriculum: Curriculum) -> None:
        self._before = max(0, curriculum.policy_version - algorithm.iteration)
        _tell(algorithm, self._before + algorithm.iteration)

    def on_train_result(self, *, algorithm: Any, result: dict[str, Any], **_: Any) -> None:
        """Says the version, and brings the numbers."""
        if self._curriculum is None:
            return
        flown = _tell(algorithm, self._before + result["training_iteration"])
        try:
            numbers = self._curriculum.numbers()
        except CurriculumError:
            # A server that is away for a while costs no training.
            numbers = {}
        result["curriculum"] = {**numbers, **{f"episodes/{name}": value for name, value in flown.items()}}

    def on_checkpoint_loaded(self, *, algorithm: Any, **_: Any) -> None:
        """What flies next has learned from as many iterations as the checkpoint."""
        if self._curriculum is not None:
            self._begin(algorithm, self._curriculum)

    def on_env_runners_recreated(self, *, algorithm: Any, **_: Any) -> None:
        """Env runners that were lost come back without knowing which version flies."""
        if self._curriculum is not None:
            _tell(algorithm, self._before + algorithm.iteration)

    def on_episode_start(self, *, episode: Any, **_: Any) -> None:
        """Marks what is not to be learned from."""
        if not _lesson(episode).get("train", True):
            self._idle.add(episode.id_)

    def on_sample_end(self, *, env_runner: Any, samples: list[Any], **_: Any) -> None:
        """Leaves out what is not to be learned from."""
        if self._idle and not env_runner.config.in_evaluation:
            over = {episode.id_ for episode in samples if episode.is_done}
            samples[:] = [episode for episode in samples if episode.id_ not in self._idle]
            self._idle -= over


def _lesson(episode: Any) -> Mapping[str, Any]:
    infos = episode.get_infos(0)
    # With several agents, each has the same.
    first = next(iter(infos.values()), None) if infos else None
    return first if isinstance(first, Mapping) else infos or {}


def _tell(algorithm: Any, version: int) -> dict[str, float]:
    """Tells all env runners the version; what became of their episodes, together."""
    told: dict[str, float] = {}
    for group in (algorithm.env_runner_group, algorithm.eval_env_runner_group):
        if group is not None:
            for stats in group.foreach_env_runner(functools.partial(_told, version)):
                for name, value in stats.items():
                    # The server is away from those that wait; what else there is adds up.
                    told[name] = max(told.get(name, 0.0), value) if name == "away_s" else told.get(name, 0.0) + value
    return told


def _told(version: int, env_runner: Any) -> dict[str, float]:
    whole = getattr(env_runner, "env", None)
    if whole is None:
        return {}
    team = isinstance(whole.unwrapped, TeamVectorEnv)
    parts = [whole] if team else getattr(whole, "envs", [])
    curricula: set[Curriculum | None] = {getattr(env.unwrapped, "curriculum", None) for env in parts}
    told: dict[str, float] = {}
    for curriculum in filter(None, curricula):
        curriculum.policy_version = version
        for name, value in curriculum.stats().items():
            if isinstance(value, (int, float)):
                told[name] = told.get(name, 0.0) + float(value)
    return told
