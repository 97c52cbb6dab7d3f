"""Vector environment of composed satellites: their steps run side by side in compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space

from .._native import NativeTaskingBatch
from ..errors import invalid
from .general import GeneralSatelliteTasking, logger
from .no_action import NO_ACTION
from .single import SatelliteTasking
from .vector_specs import draw_setup, python_part

#: Action that lets a satellite go on, in arrays.
GO_ON = -1
_SEEDS = 2**32


class TaskingVectorEnv(VectorEnv[Any, Any, Any]):
    """Environments of the same composed satellites.

    With one satellite, observations and actions are arrays, envs × values and envs. With several, they are tuples with such an
    array for each satellite. The action -1 lets a satellite go on. After a reset with seed s, environment k runs BSK-RL's
    episode s + k; its later episodes follow from that seed.
    """

    def __init__(
        self,
        env: GeneralSatelliteTasking,
        num_envs: int,
        *,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
    ) -> None:
        """Creates environments from a first one, none of whose parts runs in Python.

        They are stepped on a number of threads, by default one per core.
        """
        self.num_envs = num_envs
        self.metadata = {**type(env).metadata, "autoreset_mode": autoreset_mode}
        self.autoreset_mode = autoreset_mode
        self.render_mode = None
        self._env = env
        self._is_single = isinstance(env, SatelliteTasking)
        state = np.random.get_state()
        # The observation is known once an episode was drawn.
        env.reset(seed=0)
        self.single_observation_space = env.observation_space
        self.single_action_space = env.action_space
        env.delete_simulator()
        np.random.set_state(state)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._native = NativeTaskingBatch(num_envs, len(env.satellites), threads)
        self._seeds: list[np.random.Generator | None] = [None] * num_envs
        self._is_over = np.ones(num_envs, np.bool_)
        self._observations: list[npt.NDArray[np.float64]] = []

    @property
    def threads(self) -> int:
        """Number of threads that step the environments."""
        threads: int = self._native.threads
        return threads

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode in every environment, or in those of the mask `options["reset_mask"]`.

        Seeds are from 0 to 2³² − 1; without one, an episode is drawn from the environment's last seed, or from the clock.
        """
        mask = (options or {}).get("reset_mask")
        if mask is not None and not (isinstance(mask, np.ndarray) and mask.shape == (self.num_envs,) and mask.dtype == np.bool_):
            raise invalid("options.reset_mask", f"a NumPy array of {self.num_envs} bools", mask)
        envs = list(range(self.num_envs)) if mask is None else np.flatnonzero(mask).tolist()
        seeds = self._read_seeds(seed)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
        self._start(envs, [seeds[env] for env in envs])
        self._is_over[envs] = False
        return self._view(), {"d_ts": np.zeros(self.num_envs), "requires_retasking": self._native.needs_action()}

    def _read_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """Seeds of all environments."""
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + env for env in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise invalid("seed", f"an integer, or a list of one seed per environment ({self.num_envs})", f"{len(seed)} seeds")
        return list(seed)

    def _start(self, envs: list[int], seeds: list[int | None]) -> None:
        """Draws and starts episodes, and observes them."""
        setups = []
        for env, seed in zip(envs, seeds, strict=True):
            drawn = seed
            generator = self._seeds[env]
            if drawn is None and generator is not None:
                drawn = int(generator.integers(_SEEDS))
            setups.append(draw_setup(self._env, drawn))
            if seed is not None or generator is None:
                self._seeds[env] = np.random.default_rng(self._env.seed)
        self._native.start(envs, setups)
        self._observe(envs)

    def _observe(self, envs: list[int]) -> None:
        """Updates the observations of some environments."""
        if not envs:
            return
        new = [self._native.observe(satellite, envs) for satellite in range(len(self._env.satellites))]
        if len(envs) == self.num_envs:
            self._observations = new
            return
        for rows, values in zip(self._observations, new, strict=True):
            rows[envs] = values

    def _view(self) -> Any:
        """Copies of the observations in the form of the space."""
        copies = tuple(rows.copy() for rows in self._observations)
        return copies[0] if self._is_single else copies

    def step(
        self, actions: Any
    ) -> tuple[Any, npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Runs one step of every environment.

        Infos have the durations `d_ts` (s) and `requires_retasking` (envs × satellites). In same-step mode, `final_obs` has the
        last observations of the episodes that ended.
        """
        mode = self.autoreset_mode
        if mode == AutoresetMode.DISABLED and self._is_over.any():
            raise ResetNeeded(f"the episode of environment {int(np.argmax(self._is_over))} is over; reset it")
        if not self._observations:
            raise ResetNeeded("no episode has begun; call reset")
        given = self._read_actions(actions)
        resetting = np.flatnonzero(self._is_over).tolist()
        active = ~self._is_over
        rewards, terminations, truncations, durations = self._native.step(given, active)
        if resetting:
            self._start(resetting, [None] * len(resetting))
        self._observe(np.flatnonzero(active).tolist())
        self._is_over = terminations | truncations
        infos: dict[str, Any] = {"d_ts": durations}
        if mode == AutoresetMode.SAME_STEP and self._is_over.any():
            infos |= self._restart()
        infos["requires_retasking"] = self._native.needs_action()
        return self._view(), rewards, terminations, truncations, infos

    def _restart(self) -> dict[str, Any]:
        """Begins the next episodes in the step in which some ended, and returns the last observations."""
        ended = self._is_over.copy()
        final = np.empty(self.num_envs, dtype=object)
        for env in np.flatnonzero(ended):
            last = tuple(rows[env].copy() for rows in self._observations)
            final[env] = last[0] if self._is_single else last
        envs = np.flatnonzero(ended).tolist()
        self._start(envs, [None] * len(envs))
        self._is_over = np.zeros(self.num_envs, np.bool_)
        return {"final_obs": final, "_final_obs": ended, "final_info": {}, "_final_info": ended.copy()}

    def _read_actions(self, actions: Any) -> npt.NDArray[np.int64]:
        """Actions of all environments, envs × satellites."""
        columns = [actions] if self._is_single else list(actions)
        given = np.stack([np.asarray(column) for column in columns], axis=1)
        if given.dtype.kind not in "iu" or given.shape != (self.num_envs, len(self._env.satellites)):
            raise invalid("actions", f"integers for {self.num_envs} environments and each satellite", actions)
        given = given.astype(np.int64)
        given[given == NO_ACTION] = GO_ON
        return given


def make_satellite_vec(
    task: str | None,
    num_envs: int,
    *,
    satellites: Any,
    autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    threads: int | None = None,
    **arguments: Any,
) -> TaskingVectorEnv | SyncVectorEnv:
    """Makes a vector environment from the arguments of `GeneralSatelliteTasking`, for `sparring.make_vec`.

    One satellite, not a list of one, makes environments like `SatelliteTasking`. If a part must run in Python at each step, such
    as an observed function, the environments are those of Gymnasium's `SyncVectorEnv`, and a line of the log names the part.
    """
    if satellites is None:
        raise TypeError(f"make_vec() got an unexpected keyword argument {next(iter(arguments))!r}")
    if task is not None:
        raise invalid("task", "None with `satellites`", task)
    if not isinstance(num_envs, int) or num_envs < 1:
        raise invalid("num_envs", "at least 1", num_envs)
    if not isinstance(satellites, list):
        first: GeneralSatelliteTasking = SatelliteTasking(satellites, **arguments)
    else:
        first = GeneralSatelliteTasking(satellites, **arguments)
    part = python_part(first)
    if part is None:
        return TaskingVectorEnv(first, num_envs, autoreset_mode=autoreset_mode, threads=threads)
    logger.info(f"{part} runs in Python, so that environments are stepped one by one")
    makers = [lambda: deepcopy(first) for _ in range(num_envs)]
    return SyncVectorEnv(makers, autoreset_mode=autoreset_mode)
