"""Many environments as one: Gymnasium's vector interface over the compiled batch."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from .curriculum import Curriculum
from .scenario import Scenario, plain_dict, plain_seed
from .settings import Actions, Axes, Observation, Settings, View, action_space, agent_action_space
from .single import Wished, wished
from .window import FPS, Screen

#: Arrays a step may write: observations (as one flat or shaped array, see `VectorEnvironment.empty`), rewards, terminations,
#: truncations.
Out = tuple[npt.NDArray[np.float32], npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]


class VectorEnvironment(VectorEnv[Any, Any, npt.NDArray[Any]]):
    """Environments of one task, stepped together on threads of their own, with Python's lock let go.

    What is returned was written in place by the environments and is the caller's: an array is written again only once nobody has
    it, nor a view of it, any more. Environment k of a batch that was reset with seed s flies just what a single
    `sparring.Environment` flies that was reset with seed s + k, and goes on like it.

    Make one by `sparring.make_vec`, which has the arguments.
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
        #: Who says what is flown, where somebody does.
        self.curriculum = settings.curriculum
        self._native = settings.native(
            num_envs,
            autoreset_mode=MODES[autoreset_mode],
            threads=threads,
            seed=None,
            single=False,
        )
        self._view = View(settings, self._native)
        self.num_envs = num_envs
        self.metadata = {**type(self).metadata, "autoreset_mode": autoreset_mode}
        self.autoreset_mode = autoreset_mode
        self.single_observation_space = self._view.space()
        self.single_action_space = action_space(settings, self._view)
        #: The space of one agent's action.
        self.agent_action_space = agent_action_space(settings, self._view)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self._screen = Screen(render_mode, render_size, self.metadata)
        self._statistics = episode_statistics

    def __reduce__(self) -> tuple[Any, ...]:
        wish = {
            **self._settings.wish(),
            "num_envs": self.num_envs,
            "autoreset_mode": self.autoreset_mode,
            "threads": self.threads,
            "episode_statistics": self._statistics,
            "render_mode": self.render_mode,
            "render_size": self._screen.size,
        }
        return functools.partial(make_vec, **wish), (), {"spec": self.spec}

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
        out: npt.NDArray[np.float32] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode in every environment.

        Args:
            seed: Environment k gets seed + k; or a list with a seed or none for each.
            options: `reset_mask`, a numpy array of bools: whose episode begins; the others go on. And what
                `sparring.Environment.reset` takes, for all that begin; `scenario` may be a list with one for each.
            out: Where observations are written, an array as `empty()` gives it.

        Raises:
            ValueError: What is no seed, mask, scenario or array.
        """
        options = plain_dict("options", options)
        mask = options.pop("reset_mask", None)
        if mask is not None and not (isinstance(mask, np.ndarray) and mask.shape == (self.num_envs,)
                                     and mask.dtype == np.bool_ and mask.any()):  # fmt: skip
            raise ValueError(f"options.reset_mask: not a numpy array of {self.num_envs} bools of which one is true at least")
        seeds = self._seeds(seed)
        wishes = self._wished(options, mask)
        recipes, scenarios = ([wish[part] for wish in wishes] for part in (0, 1))
        seen = self._native.reset(seeds, mask, out, recipes, scenarios)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=seeds[0])
        return self._view.of(seen), {}

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, np.ndarray) and seed.ndim == 1:
            seed = list(seed)
        if not isinstance(seed, Sequence) or isinstance(seed, (str, bytes)):
            first = plain_seed(seed)
            return [first + k for k in range(self.num_envs)]
        seeds = [None if one is None else plain_seed(one) for one in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} seeds for {self.num_envs} environments")
        return list(seeds)

    def _wished(self, options: dict[str, Any], mask: npt.NDArray[np.bool_] | None) -> list[Wished]:
        if not options:
            return []
        given = options.get("scenario")
        if isinstance(given, str) or not isinstance(given, Sequence):
            wish = wished(self._settings, options)
            return [wish if mask is None or mask[env] else (None, None) for env in range(self.num_envs)]
        if len(given) != self.num_envs:
            raise ValueError(f"options.scenario: {len(given)} of them for {self.num_envs} environments")
        return [wished(self._settings, {**options, "scenario": one}) for one in given]

    def step(
        self, actions: Any, out: Out | None = None
    ) -> tuple[Any, npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """One step of every environment.

        Args:
            actions: Envs × agents × values (float32 is taken as it is, other numbers are converted); with discrete actions
                envs × agents.
            out: Arrays of the caller's own that are written and returned: what `empty()` gives, float64, bool and bool.

        Returns:
            Observations, team rewards, terminations, truncations, infos. Infos are empty but in steps that end episodes:
            `episode` has returns `r`, lengths `l` and times `t` of those in the mask `_episode`; in same-step mode `final_obs`
            has their last observations, and `final_info` is empty. Scores and alerts are not among them: ask `score(env)` of
            those that fly, and the curriculum or `sparring.replay` of those that ended.

        Raises:
            ValueError: Actions or arrays that are none, with the field. Nothing has moved then.
            gymnasium.error.ResetNeeded: An episode is over, or none has begun, and nothing resets it by itself.
        """
        if out is not None and not (isinstance(out, tuple) and len(out) == 4):
            raise ValueError("out: not a tuple of four arrays: observations, rewards, terminations, truncations")
        seen, rewards, terminations, truncations, ended = self._native.step(actions, out)
        infos = self._infos() if ended else {}
        return self._view.of(seen), rewards, terminations, truncations, infos

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        done, returns, lengths, seconds = self._native.episodes()
        if self._statistics:
            infos["episode"], infos["_episode"] = {"r": returns, "l": lengths, "t": seconds}, done
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            rows = self._view.rows(self._native.final_observations())
            last = np.empty(self.num_envs, dtype=object)
            for env, row in zip(np.flatnonzero(done).tolist(), rows, strict=True):
                last[env] = row
            infos["final_obs"], infos["_final_obs"] = last, done.copy()
            infos["final_info"], infos["_final_info"] = {}, done.copy()
        return infos

    def empty(self) -> npt.NDArray[np.float32]:
        """An array that `reset` and `step` write observations into: envs × agents × cells with *tracks*, else envs × cells."""
        width = self._view.width
        if self._view.mode == "tracks":
            return np.zeros((self.num_envs, self._view.agents, width // self._view.agents), np.float32)
        return np.zeros((self.num_envs, width), np.float32)

    def agents(self) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Of the last step, envs × agents: what each agent earned, who has left by the rules, whom the horizon cut off."""
        return self._native.agents()

    def absent(self) -> npt.NDArray[np.bool_]:
        """Envs × agents: who takes no part in what is flown now: the scenario does without, or they have left."""
        return self._native.absent()

    def taken(self) -> npt.NDArray[np.float32]:
        """What each agent did in the last step, envs × agents × values, along the world's axes."""
        return self._native.taken()

    def scenario(self, env: int) -> Scenario | None:
        """What an environment flies; none before the first reset."""
        episode = self._native.episode(self._one(env))
        return None if episode is None else Scenario._of(episode[0])

    def score(self, env: int) -> float | None:
        """The score so far of the episode that an environment flies."""
        episode = self._native.episode(self._one(env))
        return None if episode is None else episode[1]

    def columns(self) -> list[str]:
        """What the values of an observation are called, in the order of the flat array."""
        return self._native.columns()

    def state_hash(self, env: int) -> bytes | None:
        """A digest of every bit of an environment's state."""
        return self._native.state_hash(self._one(env))

    def _one(self, env: int) -> int:
        if isinstance(env, bool) or not isinstance(env, (int, np.integer)) or not 0 <= env < self.num_envs:
            raise ValueError(f"env: {env!r} is not from 0 to {self.num_envs - 1}")
        return int(env)

    @property
    def levels(self) -> npt.NDArray[np.int64]:
        """With a curriculum: the level of what each environment flies; -1 where it has none."""
        return self._native.lessons()[0]

    @property
    def train(self) -> npt.NDArray[np.bool_]:
        """With a curriculum: whether to learn from what each environment flies; some strategies only want to know how it goes."""
        return self._native.lessons()[1]

    @property
    def rests(self) -> npt.NDArray[np.bool_]:
        """With a curriculum: who has nothing left to fly; its rows are zeros."""
        return self._native.lessons()[2]

    def close_extras(self, **_: Any) -> None:
        """Gives back to the curriculum what is being flown; the curriculum itself is its owner's to close."""
        native = getattr(self, "_native", None)  # some versions of Gymnasium close what could not be made, too
        if native is not None:
            native.leave()

    @property
    def threads(self) -> int:
        """Threads that step it."""
        return self._native.threads

    def render(self) -> tuple[Any, ...] | None:
        """A picture of every environment."""
        if self.render_mode is None:
            return None
        return tuple(self._screen.show(self._native, env) for env in range(self.num_envs))


MODES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    for known, word in MODES.items():
        if mode in (known, word, known.name, known.value):
            return known
    raise ValueError(f"autoreset_mode: {mode!r} is none of {', '.join(MODES.values())}")


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
    actions: Actions = "continuous",
    axes: Axes | None = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    threads: int | None = None,
    episode_statistics: bool = True,
    render_mode: str | None = None,
    render_size: tuple[int, int] = (320, 320),
) -> VectorEnvironment:
    """Many environments of one task: a `gymnasium.vector.VectorEnv`.

    Args:
        task: Its id, or its name alone (`kessler/survival`; with a curriculum what its run is over).
        num_envs: How many, up to 2^20.
        curriculum: Says which scenarios are flown, of all tasks of its run, and is told how they went. Then `params`, `physics`,
            `layout` and `level` are its business.
        params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes: As `sparring.Environment`.
        autoreset_mode: Gymnasium's three: `next_step`, `same_step`, `disabled`.
        threads: That step them (one for each core); fewer than 64 environments are stepped by the caller's.
        episode_statistics: Infos have `episode`, as Gymnasium's `RecordEpisodeStatistics` writes it; off, to wrap that around.
        render_mode: `rgb_array`.
        render_size: Width and height of a picture, pixels.

    Raises:
        ValueError: What is unknown or out of range, with the field.

    >>> envs = make_vec("kessler/survival", 4, level=3)
    >>> seen, _ = envs.reset(seed=7)
    >>> seen.shape
    (4, 3, 72)
    """
    settings = Settings(
        task,
        params,
        physics,
        layout,
        level,
        observation,
        threats,
        look_ahead,
        bodies,
        actions,
        axes,
        curriculum,
    )
    return VectorEnvironment(
        settings,
        num_envs,
        autoreset_mode=_mode(autoreset_mode),
        threads=threads,
        episode_statistics=episode_statistics,
        render_mode=render_mode,
        render_size=render_size,
    )
