"""Stable-Baselines3: `vec_env` is a `VecEnv`, `flown_only` has PPO learn from what is flown alone, `CurriculumCallback`
brings the curriculum's numbers to TensorBoard.

curriculum = sparring.Curriculum.local(settings={"tasks": ["kessler/survival"]})
envs = sparring.sb3.vec_env(128, curriculum=curriculum)
model = PPO("MlpPolicy", envs, tensorboard_log="runs", **sparring.sb3.flown_only(envs))
model.learn(1_000_000, callback=sparring.sb3.CurriculumCallback(curriculum))
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

try:
    from stable_baselines3.common.buffers import RolloutBuffer
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError("sparring.sb3 needs stable-baselines3: pip install 'sparring[sb3]'") from error

from .curriculum import Curriculum, CurriculumError
from .vector import VectorEnvironment, make_vec


def vec_env(num_envs: int, task: str | None = None, *, curriculum: Curriculum | None = None, **environment: Any) -> AgentsVecEnv:
    """Environments for Stable-Baselines3, a row for each agent: one policy flies them all. In docking
    each is rewarded for itself, in kessler all for the team.

    Args:
        num_envs: Environments; `envs.num_envs` is this times the task's agents.
        task, curriculum, environment: As `sparring.make_vec`; not `telemetry`, which has no rows.

    Raises:
        ValueError: What is unknown or out of range, with the field.
    """
    for name in ("autoreset_mode", "episode_statistics"):
        if name in environment:
            raise ValueError(f"{name}: Stable-Baselines3 wants it as it is here")
    if environment.get("observation") == "telemetry":
        raise ValueError("observation: telemetry has no row for each agent; take tracks or state")
    return AgentsVecEnv(make_vec(task, num_envs, curriculum=curriculum, autoreset_mode="same_step", **environment))


class AgentsVecEnv(VecEnv):
    """A row for each agent of each environment.

    A row whose agent has left its episode is done, and is done again in every step until the others have: it earns nothing
    there, and `flown_only` keeps these rows from PPO. `episode` is in the infos of the first row of an environment, with the
    team's return and length; `VecMonitor`, which adds up each row by itself, has nothing to add.
    """

    def __init__(self, envs: VectorEnvironment) -> None:
        #: The environments themselves.
        self.envs = envs
        discrete = envs.single_action_space.shape is not None and len(envs.single_action_space.shape) == 1
        observed, acts = envs.single_observation_space, envs.single_action_space
        self.agents = observed.shape[0]  # type: ignore[index]
        self._acting = (envs.num_envs, self.agents) if discrete else (envs.num_envs, *acts.shape)  # type: ignore[misc]
        row = spaces.Box(observed.low[0], observed.high[0], dtype=np.float32)  # type: ignore[attr-defined]
        self.render_mode = envs.render_mode
        super().__init__(envs.num_envs * self.agents, row, envs.agent_action_space)
        self._begun = time.time()
        #: Of each row, in the last step: whether it is to be learned from. Not where the agent had left, nor where the
        #: curriculum only wants to know how it goes.
        self.counts = np.zeros(self.num_envs, np.bool_)
        self._flies = self.counts

    def _rows(self, seen: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return seen.reshape(self.num_envs, -1)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """The seeds of the next reset, of all rows: environment k gets seed + k, as of `sparring.make_vec`."""
        first = int(np.random.randint(0, 2**31)) if seed is None else seed
        self._seeds = [first + row // self.agents for row in range(self.num_envs)]
        return self._seeds

    def reset(self) -> npt.NDArray[np.float32]:
        """Begins an episode everywhere."""
        seeds = self._seeds[:: self.agents]
        seen, _ = self.envs.reset(seed=None if seeds[0] is None else seeds)
        self._reset_seeds()
        self._reset_options()
        self._flies = self._flying()
        return self._rows(seen)

    def _flying(self) -> npt.NDArray[np.bool_]:
        here = ~self.envs.absent()
        if self.envs.curriculum is not None:
            here &= self.envs.train[:, None]
        return here.reshape(-1)

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Says what all do."""
        self._actions = actions

    def step_wait(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[dict[str, Any]]]:
        """Has them do it."""
        seen, _, _, _, told = self.envs.step(self._actions.reshape(self._acting))
        earned, left, cut = self.envs.agents()
        rewards, terminated, truncated = earned.reshape(-1), left.reshape(-1), cut.reshape(-1)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        dones = terminated | truncated
        if "_episode" in told:
            self._end(told, dones, truncated & ~terminated, infos)
        self.counts, self._flies = self._flies, self._flying()
        return self._rows(seen), rewards, dones, infos

    def _end(
        self, told: dict[str, Any], dones: npt.NDArray[np.bool_], cut: npt.NDArray[np.bool_], infos: list[dict[str, Any]]
    ) -> None:
        now = round(time.time() - self._begun, 6)
        of = told["episode"]
        for env in np.flatnonzero(told["_episode"]):
            first = env * self.agents
            infos[first]["episode"] = {"r": float(of["r"][env]), "l": int(of["l"][env]), "t": now}
            last = told["final_obs"][env]
            for agent in range(self.agents):
                infos[first + agent]["terminal_observation"] = last[agent]
                infos[first + agent]["TimeLimit.truncated"] = bool(cut[first + agent])
            dones[first : first + self.agents] = True

    def close(self) -> None:
        """Gives back to the curriculum what is being flown."""
        self.envs.close()

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """A picture of each environment."""
        return self.envs.render() or []

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same of all: there is one object for them."""
        value = self.render_mode if attr_name == "render_mode" else getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Of all at once."""
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Of all at once."""
        told = getattr(self.envs, method_name)(*args, **kwargs)
        return [told for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """They are not."""
        return [False for _ in self._get_indices(indices)]


class _Flying:
    """Which rows count in the last step. A model that is saved does not take its environments along: then all do."""

    def __init__(self, envs: AgentsVecEnv | None = None) -> None:
        self._envs = envs

    def __reduce__(self) -> tuple[Any, ...]:
        return _Flying, ()

    def counts(self) -> npt.NDArray[np.bool_] | bool:
        return True if self._envs is None else self._envs.counts


class FlownBuffer(RolloutBuffer):
    """A rollout of which only the rows are given out that `AgentsVecEnv.counts` says."""

    def __init__(self, *args: Any, flying: _Flying, **settings: Any) -> None:
        self._flying = flying
        super().__init__(*args, **settings)

    def reset(self) -> None:
        """Begins a rollout."""
        self.flown = np.zeros((self.buffer_size, self.n_envs), np.bool_)
        super().reset()

    def add(self, *args: Any, **row: Any) -> None:
        """A step of all rows."""
        self.flown[self.pos] = self._flying.counts()
        super().add(*args, **row)

    def get(self, batch_size: int | None = None) -> Any:
        """Minibatches; those in which nobody flew are left out."""
        minibatches = super().get(batch_size)
        if self.flown.any():
            return (rows for rows in minibatches if rows is not None)
        # Learners want one, and means over it: by this neither policy nor value is to be moved.
        self.advantages[:] = 0.0
        self.returns[:] = self.values
        return islice(minibatches, 1)

    def _get_samples(self, batch_inds: npt.NDArray[np.int64], env: Any = None) -> Any:
        flown = batch_inds[self.flown.swapaxes(0, 1).reshape(-1)[batch_inds]]
        if flown.size or not self.flown.any():
            return super()._get_samples(flown if flown.size else batch_inds, env)
        return None


def flown_only(envs: VecEnv) -> dict[str, Any]:
    """Settings of PPO and A2C by which they learn from rows of agents that fly, and of no others.

    A model that was saved is told again: `PPO.load(file, env=envs, **flown_only(envs))`.

    Args:
        envs: Of `vec_env`, or a wrapper around it.

    Raises:
        ValueError: Other environments.
    """
    if not isinstance(envs.unwrapped, AgentsVecEnv):
        raise ValueError("envs: not of sparring.sb3.vec_env")
    return {"rollout_buffer_class": FlownBuffer, "rollout_buffer_kwargs": {"flying": _Flying(envs.unwrapped)}}


def act(model: Any, deterministic: bool = True) -> Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]:
    """Actions of all agents of all environments by a model that was trained with `vec_env`: for `sparring.evaluate`."""

    def of(seen: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        actions, _ = model.predict(seen.reshape(-1, seen.shape[-1]), deterministic=deterministic)
        shaped: npt.NDArray[Any] = actions.reshape(*seen.shape[:2], *actions.shape[1:])
        return shaped

    return of


class CurriculumCallback(BaseCallback):
    """Counts the policy's version up with every rollout, and writes the curriculum's numbers beside the learner's own: mastery,
    level, params, skill, the share of groups without variance.

    Args:
        curriculum: The curriculum.
        every: Rollouts between two looks at its numbers.
    """

    def __init__(self, curriculum: Curriculum, every: int = 5) -> None:
        super().__init__()
        self.curriculum = curriculum
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise ValueError(f"every: {every!r} is not a whole number from 1 on")
        self.every = every
        self._rollouts = 0
        # A run that goes on has policies already; what is flown at first is the newest of them.
        self._before = curriculum.policy_version

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._rollouts += 1
        if self._rollouts % self.every == 1 or self.every == 1:
            try:
                numbers = self.curriculum.numbers()
            except CurriculumError:
                return  # a server that is away costs a point of the curves, not the training
            for name, value in numbers.items():
                self.logger.record(f"curriculum/{name}", value)

    def _on_rollout_start(self) -> None:
        # What is flown from here on is by a policy that has learned from the last rollout.
        self.curriculum.policy_version = self._before + self._rollouts
