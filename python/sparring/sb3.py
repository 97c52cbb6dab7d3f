"""Stable-Baselines3: a `VecEnv`, a rollout buffer that skips inactive rows, and a callback for the curriculum's metrics.

curriculum = sparring.Curriculum.local(settings={"tasks": ["kessler/survival"]})
envs = sparring.sb3.vec_env(128, curriculum=curriculum)
model = PPO("MlpPolicy", envs, tensorboard_log="runs", **sparring.sb3.active_only(envs))
model.learn(1_000_000, callback=sparring.sb3.CurriculumCallback(curriculum))
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

try:
    from stable_baselines3.common.buffers import RolloutBuffer
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import KVWriter
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError("sparring.sb3 needs stable-baselines3: pip install 'sparring[sb3]'") from error

from .curriculum import Curriculum
from .errors import invalid
from .metrics import read_metrics
from .settings import check_count
from .trainer_metrics import TrainerReport
from .vector import VectorEnvironment, make_vec
from .vector_results import AgentResults

#: Function from the results of a step to the rewards of all agents, envs × agents, which become float32.
Reward = Callable[[AgentResults], npt.NDArray[Any]]


def vec_env(
    num_envs: int,
    task: str | None = None,
    *,
    curriculum: Curriculum | None = None,
    decision_steps: int = 1,
    reward: Reward | None = None,
    **environment: Any,
) -> AgentsVecEnv:
    """Makes environments for Stable-Baselines3 with one row per agent, so that one policy controls all agents.

    Without `reward`, each satellite of kessler has the team's reward, and each agent of the other worlds its own. `AgentsVecEnv`
    describes the rows, whose observations and rewards are float32.

    Args:
        num_envs: Number of environments; `envs.num_envs` is this times the number of agents.
        task: As for `sparring.make_vec`.
        curriculum: As for `sparring.make_vec`.
        decision_steps: Steps for which an action is repeated, or until an episode ends; rewards add up.
        reward: Function from the results of a step to the rewards of all agents, such as −1 for an own loss. Agents that have
            left get none.
        environment: Other arguments of `sparring.make_vec`; `observation` cannot be `telemetry`, which has no rows.

    Raises:
        ValueError: A value is unknown or out of range; the message names the field.
    """
    for name in ("autoreset_mode", "episode_statistics"):
        if name in environment:
            raise ValueError(f"`{name}` must be omitted: vec_env sets the value that Stable-Baselines3 needs")
    if environment.get("observation") == "telemetry":
        raise invalid("observation", "tracks or state, which have a row per agent", environment["observation"])
    check_count("decision_steps", decision_steps, 1)
    envs = make_vec(task, num_envs, curriculum=curriculum, autoreset_mode="same_step", **environment)
    return AgentsVecEnv(envs, decision_steps, reward)


def active_only(envs: VecEnv) -> dict[str, Any]:
    """Returns arguments of PPO and A2C that make them learn from active rows only.

    The trajectory of a row ends where its agent leaves: advantages and returns contain no later reward or value.

    A loaded model needs them again: `PPO.load(file, env=envs, **active_only(envs))`.

    Args:
        envs: Environments of `vec_env`, or a wrapper around them.

    Raises:
        ValueError: The environments are not of `vec_env`.
    """
    if not isinstance(envs.unwrapped, AgentsVecEnv):
        raise invalid("envs", "environments made by sparring.sb3.vec_env", envs)
    return {"rollout_buffer_class": ActiveRolloutBuffer, "rollout_buffer_kwargs": {"activity": _Activity(envs.unwrapped)}}


def policy_fn(model: Any, deterministic: bool = True) -> Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]:
    """Returns a function from observations to actions of all agents of all environments, for `sparring.evaluate`.

    Args:
        model: Model that was trained with `vec_env`.
        deterministic: False to sample actions.
    """

    def act(observations: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        actions, _ = model.predict(observations.reshape(-1, observations.shape[-1]), deterministic=deterministic)
        shaped: npt.NDArray[Any] = actions.reshape(*observations.shape[:2], *actions.shape[1:])
        return shaped

    return act


class AgentsVecEnv(VecEnv):
    """Vector environment with one row per agent of each environment.

    All rows of an environment are done once, in the last step of its episode, with `terminal_observation` and
    `TimeLimit.truncated`. Their infos have `episode`, with the team's return and length, as `Monitor` writes it:
    `evaluate_policy` uses it.

    In kessler, the row of a satellite has the team's reward in every step, also after the satellite is lost. In the other worlds,
    a row has the reward of its agent, and zeros once the agent has left or if the scenario does not have it. A function `reward`
    replaces both, and gives nothing to agents that have left. `active_only` hides rows without an active agent from PPO and A2C;
    other algorithms learn from all rows.
    """

    def __init__(self, envs: VectorEnvironment, decision_steps: int = 1, reward: Reward | None = None) -> None:
        #: The wrapped environments.
        self.envs = envs
        #: Steps for which an action is repeated.
        self.decision_steps = decision_steps
        self._reward = reward
        self._absent = np.zeros(0, np.bool_)
        discrete = envs.single_action_space.shape is not None and len(envs.single_action_space.shape) == 1
        observation_space, action_space = envs.single_observation_space, envs.single_action_space
        #: Number of agents of an environment.
        self.agents = observation_space.shape[0]  # type: ignore[index]
        agent_shape = (self.agents,) if discrete else action_space.shape or ()
        self._joint_shape = (envs.num_envs, *agent_shape)
        row = spaces.Box(observation_space.low[0], observation_space.high[0], dtype=np.float32)  # type: ignore[attr-defined]
        self.render_mode = envs.render_mode
        super().__init__(envs.num_envs * self.agents, row, envs.agent_action_space)
        self._started = time.time()
        self._has_team_rewards = envs._settings.spec.world.startswith("kessler")
        #: For each row of the last step: True if the learner should use it. False for agents that had left before, and for
        #: episodes that are not for training.
        self.active = np.zeros(self.num_envs, np.bool_)
        #: As `active`, for the next step. A row that is active only in the last step has ended its agent's trajectory.
        self.next_active = self.active

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Sets the seeds of the next reset; environment k gets seed + k, as in `sparring.make_vec`."""
        first = int(np.random.randint(0, 2**31)) if seed is None else seed
        self._seeds = [first + row // self.agents for row in range(self.num_envs)]
        return self._seeds

    def reset(self) -> npt.NDArray[np.float32]:
        """Begins an episode in every environment."""
        seeds = self._seeds[:: self.agents]
        observations, _ = self.envs.reset(seed=None if seeds[0] is None else seeds)
        self._reset_seeds()
        self._reset_options()
        self.next_active = self._active_rows()
        return self._rows(observations)

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Sets the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[dict[str, Any]]]:
        """Runs the step with the actions of `step_async`."""
        actions = self._actions.reshape(self._joint_shape)
        observations, team_rewards, _, _, env_infos = self.envs.step(actions, repeat=self.decision_steps)
        results = self.envs.agent_results()
        if self._reward is not None:
            # The end of an agent that has left is repeated in each later step.
            rewards = np.where(self._absent, 0.0, self._reward(results)).astype(np.float32).reshape(-1)
        elif self._has_team_rewards:
            rewards = np.repeat(team_rewards.astype(np.float32), self.agents)
        else:
            rewards = results.rewards.reshape(-1)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = np.zeros(self.num_envs, np.bool_)
        if "_episode" in env_infos:
            dones = np.repeat(env_infos["_episode"], self.agents)
            self._end_episodes(env_infos, results.truncations & ~results.terminations, infos)
        self.active, self.next_active = self.next_active, self._active_rows()
        return self._rows(observations), rewards, dones, infos

    def _end_episodes(self, env_infos: dict[str, Any], cut_off: npt.NDArray[np.bool_], infos: list[dict[str, Any]]) -> None:
        elapsed = round(time.time() - self._started, 6)
        episode = env_infos["episode"]
        for env in np.flatnonzero(env_infos["_episode"]):
            final = env_infos["final_obs"][env]
            for agent in range(self.agents):
                info = infos[env * self.agents + agent]
                info["episode"] = {"r": float(episode["r"][env]), "l": int(episode["l"][env]), "t": elapsed}
                info["terminal_observation"] = final[agent]
                info["TimeLimit.truncated"] = bool(cut_off[env, agent])

    def _rows(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return observations.reshape(self.num_envs, -1)

    def _active_rows(self) -> npt.NDArray[np.bool_]:
        self._absent = self.envs.absent_agents().copy()
        active = ~self._absent
        if self.envs.curriculum is not None:
            active &= self.envs.train[:, None]
        return active.reshape(-1)

    def close(self) -> None:
        """Returns unfinished episodes to the curriculum."""
        self.envs.close()

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """Returns an image of each environment."""
        return self.envs.render() or []

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute of the wrapped environments once per index."""
        value = self.render_mode if attr_name == "render_mode" else getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute of the wrapped environments."""
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method of the wrapped environments once; returns its result once per index."""
        result = getattr(self.envs, method_name)(*args, **kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Returns True for `Monitor`, since the infos have `episode`, and False for other wrappers; once per index."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


class _Activity:
    """Source of the active rows. A saved model does not include its environments; all rows are active then."""

    def __init__(self, envs: AgentsVecEnv | None = None) -> None:
        self._envs = envs

    def __reduce__(self) -> tuple[Any, ...]:
        return _Activity, ()

    def rows(self) -> npt.NDArray[np.bool_]:
        return np.ones(1, np.bool_) if self._envs is None else self._envs.active

    def next_rows(self) -> npt.NDArray[np.bool_]:
        return np.ones(1, np.bool_) if self._envs is None else self._envs.next_active


class ActiveRolloutBuffer(RolloutBuffer):
    """Rollout buffer that samples only rows that were active, and ends a row's trajectory before an inactive step."""

    def __init__(self, *args: Any, activity: _Activity, **settings: Any) -> None:
        self._activity = activity
        super().__init__(*args, **settings)

    def reset(self) -> None:
        """Clears the buffer for the next rollout."""
        #: True for active rows, steps × rows.
        self.active = np.zeros((self.buffer_size, self.n_envs), np.bool_)
        super().reset()

    def add(
        self,
        obs: npt.NDArray[Any],
        action: npt.NDArray[Any],
        reward: npt.NDArray[Any],
        episode_start: npt.NDArray[Any],
        value: Any,
        log_prob: Any,
    ) -> None:
        """Adds a step of all rows."""
        active = self._activity.rows()
        self.active[self.pos] = active
        # The advantage of a step includes the next step unless an episode starts there.
        super().add(obs, action, reward, np.logical_or(episode_start, ~active), value, log_prob)

    def compute_returns_and_advantage(self, last_values: Any, dones: npt.NDArray[np.bool_]) -> None:
        """Computes returns and advantages of the rollout."""
        super().compute_returns_and_advantage(last_values, np.logical_or(dones, ~self._activity.next_rows()))

    def get(self, batch_size: int | None = None) -> Any:
        """Yields minibatches of active rows; skips minibatches without any."""
        minibatches = super().get(batch_size)
        if self.active.any():
            return (rows for rows in minibatches if rows is not None)
        # Learners need at least one minibatch; this one has zero advantages and value errors, so it changes no weights.
        self.advantages[:] = 0.0
        self.returns[:] = self.values
        return islice(minibatches, 1)

    def _get_samples(self, batch_inds: npt.NDArray[np.int64], env: Any = None) -> Any:
        active = batch_inds[self.active.swapaxes(0, 1).reshape(-1)[batch_inds]]
        if active.size or not self.active.any():
            return super()._get_samples(active if active.size else batch_inds, env)
        return None


class CurriculumCallback(BaseCallback):
    """Increments the policy version with every rollout, and logs the curriculum's metrics with the learner's.

    It sends the numbers of the learner's logger (`train/…`, `rollout/…`, `time/…`) to the curriculum's run, at most once a
    second, when the logger writes them.

    Args:
        curriculum: Curriculum of the environments.
        every: Number of rollouts between two logs, >= 1.
        report: False to send no numbers of the learner to the server.

    Raises:
        ValueError: `every` is no integer >= 1.
    """

    def __init__(self, curriculum: Curriculum, every: int = 5, report: bool = True) -> None:
        super().__init__()
        self.curriculum = curriculum
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise invalid("every", "an integer >= 1", every)
        self.every = every
        self._rollouts = 0
        # A resumed run already has versions: this training continues from the newest.
        self._first_version = curriculum.policy_version
        self._writer = _ReportWriter(TrainerReport(curriculum if report else None))

    def _on_training_start(self) -> None:
        if self._writer not in self.logger.output_formats:  # a training that failed leaves it there
            self.logger.output_formats.append(self._writer)

    def _on_training_end(self) -> None:
        if self._writer in self.logger.output_formats:
            self.logger.output_formats.remove(self._writer)
        # The logger has not written the numbers of the last update.
        self._writer.write(self.logger.name_to_value, {}, self.num_timesteps)
        self._writer.report.finish()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._rollouts += 1
        if self._rollouts % self.every == 1 or self.every == 1:
            for name, value in read_metrics(self.curriculum).items():
                self.logger.record(name, value)

    def _on_rollout_start(self) -> None:
        # The policy has learned from the last rollout.
        self.curriculum.policy_version = self._first_version + self._rollouts


class _ReportWriter(KVWriter):
    """Output of SB3's logger to a run."""

    def __init__(self, report: TrainerReport) -> None:
        self.report = report

    def write(self, key_values: Mapping[str, Any], key_excluded: Mapping[str, Any], step: int = 0) -> None:
        self.report.add(step, key_values)

    def close(self) -> None:
        self.report.finish()
