"""Vector environments: Gymnasium's vector interface over a compiled batch."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from .curriculum import Curriculum
from .errors import invalid, one_of
from .rendering import FPS, Renderer
from .reset_request import ResetRequest, read_reset_options
from .scenario import Scenario, check_seed, copy_mapping
from .settings import Actions, Axes, Observation, ObservationLayout, Settings, action_space, agent_action_space, check_count
from .vector_results import AgentResults, StepArrays, StepTimes

#: Name of each autoreset mode in the compiled module.
AUTORESET_NAMES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}


class VectorEnvironment(VectorEnv[Any, Any, npt.NDArray[Any]]):
    """Environments of one task, stepped together on compiled threads with the interpreter lock released.

    Returned arrays are written in place and belong to the caller: an array is reused only once no caller holds it or a view
    of it. After a reset with seed s, environment k runs the same episodes as a single `sparring.Environment` after a reset with
    seed s + k.

    Use `sparring.make_vec`, which documents the arguments.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        settings: Settings,
        num_envs: int,
        *,
        autoreset_mode: AutoresetMode,
        threads: int | None,
        episode_statistics: bool,
        render_mode: str | None,
        render_size: tuple[int, int],
    ) -> None:
        self._settings = settings
        #: Source of the scenarios; None without a curriculum.
        self.curriculum = settings.curriculum
        autoreset = AUTORESET_NAMES[autoreset_mode]
        self._native = settings.make_batch(num_envs, autoreset_mode=autoreset, threads=threads, seed=None, single=False)
        self._layout = ObservationLayout(settings, self._native)
        self.num_envs = num_envs
        self.metadata = {**type(self).metadata, "autoreset_mode": autoreset_mode}
        self.autoreset_mode = autoreset_mode
        self.single_observation_space = self._layout.space()
        self.single_action_space = action_space(settings, self._layout)
        #: Action space of one agent.
        self.agent_action_space = agent_action_space(settings, self._layout)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self._renderer = Renderer(render_mode, render_size, self.metadata)
        self._episode_statistics = episode_statistics

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = {
            **self._settings.arguments(),
            "num_envs": self.num_envs,
            "autoreset_mode": self.autoreset_mode,
            "threads": self.threads,
            "episode_statistics": self._episode_statistics,
            "render_mode": self.render_mode,
            "render_size": self._renderer.size,
        }
        return functools.partial(make_vec, **arguments), (), {"spec": self.spec}

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
        out: npt.NDArray[np.float32] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode in every environment.

        Args:
            seed: An int gives environment k the seed `seed + k`; a list has a seed or None for each environment.
            options: `reset_mask`, a NumPy array of bools, selects the environments that begin an episode. The options of
                `sparring.Environment.reset` apply to all of these; `scenario` may be a list with one for each environment.
            out: Array for the observations, as `empty_observations()` makes it.

        Raises:
            ValueError: A seed, the mask, a scenario or the array is invalid; nothing changes then.
        """
        options = copy_mapping("options", options)
        mask = options.pop("reset_mask", None)
        if mask is not None and not (isinstance(mask, np.ndarray) and mask.shape == (self.num_envs,)
                                     and mask.dtype == np.bool_ and mask.any()):  # fmt: skip
            raise invalid("options.reset_mask", f"a NumPy array of {self.num_envs} bools, at least one of them true", mask)
        seeds = self._read_seeds(seed)
        requests = self._read_requests(options, mask)
        recipes = [request.recipe for request in requests]
        scenarios = [request.scenario for request in requests]
        observations = self._native.reset(seeds, mask, out, recipes, scenarios)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=seeds[0])
        return self._layout.view(observations), self._times_info()

    def _read_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        seed = list(seed) if isinstance(seed, np.ndarray) and seed.ndim == 1 else seed
        if not isinstance(seed, Sequence) or isinstance(seed, (str, bytes)):
            first = check_seed(seed)
            return [first + k for k in range(self.num_envs)]
        seeds = [None if item is None else check_seed(item) for item in seed]
        if len(seeds) != self.num_envs:
            raise invalid("seed", f"an integer, or a list of one seed per environment ({self.num_envs})", f"{len(seeds)} seeds")
        return list(seeds)

    def _read_requests(self, options: dict[str, Any], mask: npt.NDArray[np.bool_] | None) -> list[ResetRequest]:
        if not options:
            return []
        scenarios = options.get("scenario")
        if isinstance(scenarios, str) or not isinstance(scenarios, Sequence):
            request = read_reset_options(self._settings, options)
            return [request if mask is None or mask[env] else ResetRequest() for env in range(self.num_envs)]
        if len(scenarios) != self.num_envs:
            raise invalid(
                "options.scenario",
                f"one scenario, or a list of one per environment ({self.num_envs})",
                f"{len(scenarios)} scenarios",
            )
        return [read_reset_options(self._settings, {**options, "scenario": scenario}) for scenario in scenarios]

    def step(
        self, actions: Any, out: StepArrays | None = None, repeat: int = 1
    ) -> tuple[Any, npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Runs one step of every environment.

        Args:
            actions: Envs × agents × values (float32 is used without conversion); discrete actions are
                envs × agents.
            out: Arrays that are written and returned: one of `empty_observations()`, and arrays of float64, bool and bool.
            repeat: Number of steps for which the actions are repeated. Rewards add up, and an environment whose episode ends
                waits for the others, so that each episode begins with an action of its own.

        Returns:
            Observations, team rewards, terminations, truncations and infos. In worlds whose steps have different durations
            infos have `d_ts` (s) and `requires_retasking` (envs × agents), as `step_times()` returns them. If an episode ended,
            `episode` has returns `r`, lengths `l` and times `t` of those in the mask `_episode`. In same-step mode
            `final_obs` has their last observations, and `final_info` is empty. Scores and alerts are not in the infos: see
            `score(env)` for running episodes, and the curriculum or `sparring.replay` for those that ended.

        Raises:
            ValueError: Actions or arrays are invalid; nothing changes then. The message names the field.
            gymnasium.error.ResetNeeded: An episode is over or none has begun, and autoreset is disabled.
        """
        if out is not None and not (isinstance(out, tuple) and len(out) == 4):
            raise invalid("out", "four arrays in a tuple (observations, rewards, terminations, truncations)", type(out))
        check_count("repeat", repeat, 1)
        observations, rewards, terminations, truncations, any_ended = self._native.step(actions, out, repeat)
        infos = {**self._times_info(), **(self._final_infos() if any_ended else {})}
        return self._layout.view(observations), rewards, terminations, truncations, infos

    def _times_info(self) -> dict[str, Any]:
        if self._settings.spec.time_limit_s is None:
            return {}
        durations, needs_action = self._native.step_times()
        return {"d_ts": durations, "requires_retasking": needs_action}

    def _final_infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        ended, returns, lengths, seconds = self._native.finished_episodes()
        if self._episode_statistics:
            infos["episode"], infos["_episode"] = {"r": returns, "l": lengths, "t": seconds}, ended
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            rows = self._layout.split(self._native.final_observations())
            final = np.empty(self.num_envs, dtype=object)
            for env, row in zip(np.flatnonzero(ended).tolist(), rows, strict=True):
                final[env] = row
            infos["final_obs"], infos["_final_obs"] = final, ended.copy()
            infos["final_info"], infos["_final_info"] = {}, ended.copy()
        return infos

    def empty_observations(self) -> npt.NDArray[np.float32]:
        """Makes an array for the observations of `reset` and `step`.

        Its shape is envs × agents × values with *tracks*, else envs × values.
        """
        size = self._layout.size
        if self._layout.mode == "tracks":
            agents = self._layout.num_agents
            return np.zeros((self.num_envs, agents, size // agents), np.float32)
        return np.zeros((self.num_envs, size), np.float32)

    def agent_results(self) -> AgentResults:
        """Returns rewards, terminations and truncations of the last step by agent, envs × agents."""
        return AgentResults(*self._native.agent_results())

    def step_times(self) -> StepTimes:
        """Returns the duration of the last step of each environment, and which agents need an action, envs × agents."""
        return StepTimes(*self._native.step_times())

    def absent_agents(self) -> npt.NDArray[np.bool_]:
        """Returns which agents take no part in the current episodes, envs × agents.

        An agent is absent if the scenario does not have it or it has left.
        """
        return self._native.absent_agents()

    def last_actions(self) -> npt.NDArray[np.float32]:
        """Returns each agent's action in the last step, envs × agents × values, along the world's axes."""
        return self._native.last_actions()

    def scenario(self, env: int) -> Scenario | None:
        """Returns an environment's scenario; None before the first reset."""
        episode = self._native.episode(self._check_env(env))
        return None if episode is None else Scenario._wrap(episode[0])

    def score(self, env: int) -> float | None:
        """Returns the score so far of an environment's episode; None before the first reset."""
        episode = self._native.episode(self._check_env(env))
        return None if episode is None else episode[1]

    @property
    def total_steps(self) -> int:
        """Steps of all environments since they were made; those that only began an episode do not count."""
        return self._native.total_steps

    def columns(self) -> list[str]:
        """Returns the names of the values of an observation, in the order of the flat array."""
        return self._native.columns()

    def state_hash(self, env: int) -> bytes | None:
        """Returns a hash of every bit of an environment's state."""
        return self._native.state_hash(self._check_env(env))

    def _check_env(self, env: int) -> int:
        if isinstance(env, bool) or not isinstance(env, (int, np.integer)) or not 0 <= env < self.num_envs:
            raise invalid("env", f"an integer from 0 to {self.num_envs - 1}", env)
        return int(env)

    @property
    def levels(self) -> npt.NDArray[np.int64]:
        """With a curriculum: the level of each environment's scenario, -1 if it has none."""
        return self._native.curriculum_info()[0]

    @property
    def train(self) -> npt.NDArray[np.bool_]:
        """With a curriculum: True for environments whose episode is for training; some strategies only measure scenarios."""
        return self._native.curriculum_info()[1]

    @property
    def idle(self) -> npt.NDArray[np.bool_]:
        """With a curriculum: True for environments for which no episode is left; their rows are zeros."""
        return self._native.curriculum_info()[2]

    def close_extras(self, **_: Any) -> None:
        """Returns unfinished episodes to the curriculum, which its owner closes."""
        # Some versions of Gymnasium also close an environment whose constructor failed.
        if (native := getattr(self, "_native", None)) is not None:
            native.release()

    @property
    def threads(self) -> int:
        """Number of threads that step the environments."""
        return self._native.threads

    def render(self) -> tuple[Any, ...] | None:
        """Returns an image of every environment; None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._renderer.render(self._native, env) for env in range(self.num_envs))


@overload
def make_vec(
    task: str | None = None,
    num_envs: int = 1,
    *,
    curriculum: Curriculum | None = None,
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
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    threads: int | None = None,
    episode_statistics: bool = True,
    render_mode: str | None = None,
    render_size: tuple[int, int] = (320, 320),
) -> VectorEnvironment: ...


@overload
def make_vec(
    task: None = None,
    num_envs: int = 1,
    *,
    satellites: Any,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    threads: int | None = None,
    **environment: Any,
) -> VectorEnv[Any, Any, Any]: ...


def make_vec(
    task: str | None = None,
    num_envs: int = 1,
    *,
    curriculum: Curriculum | None = None,
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
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    threads: int | None = None,
    episode_statistics: bool = True,
    render_mode: str | None = None,
    render_size: tuple[int, int] = (320, 320),
    satellites: Any = None,
    **environment: Any,
) -> VectorEnv[Any, Any, Any]:
    """Makes a `gymnasium.vector.VectorEnv` of environments of one task.

    Args:
        task: Id or name (default `kessler/survival`; with a curriculum, the tasks of its run).
        num_envs: Number of environments, up to 2^20.
        curriculum: Source of the scenarios of all tasks of its run, which receives the outcomes. It replaces seeds,
            `params`, `physics`, `layout` and `level`.
        params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes: As for
            `sparring.Environment`.
        autoreset_mode: One of Gymnasium's modes: `next_step`, `same_step`, `disabled`.
        threads: Number of threads (one per core). The calling thread steps fewer than 64 environments.
        episode_statistics: True to put `episode` into infos as Gymnasium's `RecordEpisodeStatistics` does.
        render_mode, render_size: `rgb_array`, and the width and height of an image in pixels.
        satellites: Satellite or list of satellites of `sparring.tasking`, for environments of these instead of a task.
        environment: Other arguments of `sparring.tasking.GeneralSatelliteTasking`, such as `scenario`, with `satellites`.

    Raises:
        ValueError: A value is unknown or out of range; the message names the field.

    >>> make_vec("kessler/survival", 4, level=3).reset(seed=7)[0].shape
    (4, 3, 72)
    """
    mode = _read_autoreset_mode(autoreset_mode)
    if satellites is not None or environment:
        from .tasking.vector import make_satellite_vec

        return make_satellite_vec(task, num_envs, satellites=satellites, autoreset_mode=mode, threads=threads, **environment)
    settings = Settings(task, params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes, curriculum)
    return VectorEnvironment(
        settings,
        num_envs,
        autoreset_mode=mode,
        threads=threads,
        episode_statistics=episode_statistics,
        render_mode=render_mode,
        render_size=render_size,
    )


def _read_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    for known, name in AUTORESET_NAMES.items():
        if mode in (known, name, known.name, known.value):
            return known
    raise one_of("autoreset_mode", tuple(AUTORESET_NAMES.values()), mode)
