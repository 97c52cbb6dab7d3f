"""One environment: all agents by one action, their observations side by side."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from typing import Any, TypeAlias

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from . import _native
from .curriculum import Curriculum, CurriculumError
from .scenario import Scenario, plain_dict, plain_seed, recipe_of
from .settings import Actions, Axes, Observation, Settings, View, action_space
from .window import FPS, Screen

#: What is flown from a reset on, and what is flown first.
Wished: TypeAlias = "tuple[_native.NativeScenario | None, _native.NativeScenario | None]"
#: What `reset` takes as options.
OPTIONS = ("scenario", "params", "level")


class Environment(gymnasium.Env[Any, Any]):
    """One environment of a task, whose agents act by one action.

    ## Action space

    | `actions` | world | space | what |
    |---|---|---|---|
    | `continuous` | kessler | `Box(-1, 1, (agents, 2))` | a change of velocity of each satellite, LU/TU |
    | `continuous` | docking | `Box(-1, 1, (agents, 3))` | a thrust of each deputy, N |
    | `discrete` | kessler | `MultiDiscrete([17] * agents)` | of each a row of `sparring.task(…).choices` |
    | `discrete` | docking | `MultiDiscrete([27] * agents)` | the same |

    Zero holds, and so does choice 0. With *tracks*, continuous actions are along each satellite's own radial and in-track
    directions, else along x and y, unless `axes` says.

    ## Observation space, float32

    | `observation` | world | space | what |
    |---|---|---|---|
    | `tracks` | kessler | `Box(-2, 2, (agents, 16 + 7·threats))` | own state, and the debris that comes nearest, scaled |
    | `telemetry` | kessler | `Dict` | three of them: |
    | | | `satellites (agents, 6)` | x, y, vx, vy, fuel, survival; LU, LU/TU |
    | | | `debris (4, bodies)` | rows of x, y, vx, vy |
    | | | `mask (bodies,)` | 1 where there is one and it is seen |
    | `state` | docking | `Box(-inf, inf, (agents, 8))` | x, y, z, vx, vy, vz, speed, the limit there; m, m/s |
    | `telemetry` | docking | `Dict(deputies (agents, 8))` | the same |

    `columns()` names every value in the order of the flat array.

    ## Rewards

    The team's, of this step; the episode's score (`info["score"]`) is their sum, held within the task's range.

    ## Starting state

    What the generator draws from params and seed, or a `layout`; from a fair start in kessler, unless `physics` says.

    ## Episode end

    | | kessler | docking |
    |---|---|---|
    | terminated | no satellite is left | every deputy has docked, crashed, left, collided, been too fast or run out of time |
    | truncated | at step 50, while some fly | as time runs out for some, which the task punishes: both flags are set |

    ## Infos

    `score`, and `alerts`: what happened, in words; of a reset `scenario`.

    Args:
        task: Its id, or its name alone: `kessler/survival`, which is flown unless told, or `survival`.
        params: Those that are not at their defaults (`sparring.parameter_space`), or at the level's.
        physics: Options that are not at their defaults.
        layout: Explicit bodies that replace or extend what the generator would draw.
        level: A row of the task's table (`sparring.levels`), for the params that are not given.
        observation: `tracks` or `telemetry` in kessler, `state` or `telemetry` in docking.
        threats: With *tracks*: pieces of debris a satellite sees (8).
        look_ahead: With *tracks*: steps over which they are foreseen (15).
        bodies: With *telemetry*: pieces of debris there is room for (as many as the params can have).
        actions: `continuous`, or `discrete`: a number for each agent out of `sparring.task(…).choices`.
        axes: Along which continuous actions are: each `agent`'s own, or the `world`'s.
        curriculum: Says which scenarios are flown, and is told how they went, as in `sparring.make_vec`; seeds and the rest of
            what says that are then its business.
        render_mode: `rgb_array`, or `human`: a window, which needs pygame.
        render_size: Width and height of a picture, pixels.

    Raises:
        ValueError: What is unknown or out of range, with the field.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": FPS}

    def __init__(
        self,
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
    ) -> None:
        settings = Settings(
            task, params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes, curriculum
        )
        self._settings = settings
        self._native = settings.native(1, autoreset_mode="disabled", threads=1, seed=None, single=True)
        self._view = View(settings, self._native)
        self.observation_space = self._view.space()
        self.action_space = action_space(settings, self._view)
        self.screen = Screen(render_mode, render_size, self.metadata)
        self.render_mode = render_mode
        self._history: list[npt.NDArray[np.float32]] = []
        self._flies = self._warned = False

    def __reduce__(self) -> tuple[Any, ...]:
        wish = {**self._settings.wish(), "render_mode": self.render_mode, "render_size": self.screen.size}
        return functools.partial(type(self), **wish), (), {"spec": self.spec}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode: of the scenario with this seed, or of the next in the row that the last seed began.

        Args:
            seed: 0 to 2^51 - 1.
            options: `scenario` (a `Scenario` or its dict) is flown now as it is, and the row goes on behind it; `params` and
                `level` replace the environment's, until the next reset that has either.

        Raises:
            ValueError: A seed, a scenario or an option that is none. Nothing has moved then.
        """
        plain = None if seed is None else plain_seed(seed)
        self._left_early()
        recipe, scenario = wished(self._settings, options)
        seen = self._native.reset([plain], recipes=[recipe], scenarios=[scenario])
        if plain is not None:
            super().reset(seed=plain)
        self._history, self._flies = [], True
        if self.render_mode == "human":
            self.render()
        return self._view.of(seen, single=True), {"scenario": self.scenario, **lesson(self._native, self._settings)}

    def _left_early(self) -> None:
        if self._settings.curriculum is not None and self._flies and self._history and not self._warned:
            self._warned = True
            left_early(len(self._history))

    def _abandon(self) -> None:
        """Gives up for good what is flown: nobody flies it to its end."""
        self._native.abandon()
        self._flies = False

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step of the world.

        Returns:
            Observation, the team's reward, terminated (nobody is left, by the rules of the task), truncated (the horizon cut
            somebody off), and info: `score`, the world's own number so far; `alerts`, what happened, in words.

        Raises:
            ValueError: An action that is none. Nothing has moved then.
            gymnasium.error.ResetNeeded: There is no episode, or it is over.
        """
        if not self._flies:
            raise ResetNeeded("nothing flies: call reset first")
        seen, rewards, terminations, truncations, ended = self._native.step(action)
        self._history.append(self._native.taken()[0])
        episode = self._native.episode(0)
        info = {"score": 0.0 if episode is None else episode[1], "alerts": self._native.alerts(0)}
        self._flies = not ended
        if self.render_mode == "human":
            self.render()
        terminated, truncated = bool(terminations[0]), bool(truncations[0])
        return self._view.of(seen, single=True), float(rewards[0]), terminated, truncated, info

    @property
    def scenario(self) -> Scenario | None:
        """What is flown; none before the first reset."""
        episode = self._native.episode(0)
        return None if episode is None else Scenario._of(episode[0])

    @property
    def history(self) -> npt.NDArray[np.float32]:
        """What was asked for in this episode, steps × agents that take part × values, along the world's axes: what
        `sparring.replay` and `sparring.critique` take, which cut it off and refuse it as the environment did."""
        scenario = self.scenario
        agents = self._view.agents if scenario is None else scenario.agents
        shape = (0, agents, self._view.values)
        return np.stack(self._history)[:, :agents] if self._history else np.zeros(shape, np.float32)

    def telemetry(self) -> dict[str, Any] | None:
        """What is seen now in the wire form of the public kessler-env, for built-in policies and language models."""
        text = self._native.telemetry(0)
        return None if text is None else dict(json.loads(text))

    def columns(self) -> list[str]:
        """What the values of an observation are called, in the order of the flat array."""
        return self._native.columns()

    def state_hash(self) -> bytes | None:
        """A digest of every bit of the state: equal where everything is."""
        return self._native.state_hash(0)

    def render(self) -> Any:
        """A picture (`rgb_array`), or nothing but a window (`human`)."""
        return self.screen.show(self._native, 0)

    def close(self) -> None:
        """Closes the window, if there is one, and gives back to the curriculum what is being flown."""
        self.screen.close()
        self._native.leave()


def left_early(steps: int) -> None:
    """A curriculum learns only from whole episodes: who cuts all of them off would never know."""
    gymnasium.logger.warn(
        f"an episode was left after {steps} steps: the curriculum is not told, and its scenario is flown again. Horizons are the"
        " scenarios' own; leave max_episode_steps out"
    )


def lesson(native: Any, settings: Settings) -> dict[str, Any]:
    """What a curriculum says of the episode that one environment flies: its level, and whether to learn from it."""
    if settings.curriculum is None:
        return {}
    levels, train, rests = native.lessons()
    if rests[0]:
        raise CurriculumError("there is nothing left to fly: the evaluation is flown")
    return {"level": int(levels[0]), "train": bool(train[0])}


def wished(settings: Settings, options: Mapping[str, Any] | None) -> Wished:
    """What the options of a reset say: what is flown from then on, and what is flown first.

    Raises:
        ValueError: An option that is none, with the field.
    """
    options = plain_dict("options", options)
    for name in options:
        if name not in OPTIONS:
            raise ValueError(f"options.{name}: unknown; there are {', '.join(OPTIONS)}")
    recipe = None
    if "params" in options or "level" in options:
        params = {**(settings.params or {}), **plain_dict("options.params", options.get("params"))}
        level = options.get("level", settings.level)
        fields = recipe_of(settings.told.id, params=params, physics=settings.physics, layout=settings.layout, level=level)
        recipe = Scenario.from_dict({**fields, "seed": 0})._native
    scenario = options.get("scenario")
    if isinstance(scenario, Mapping):
        scenario = Scenario.from_dict(scenario)
    if scenario is not None and not isinstance(scenario, Scenario):
        raise ValueError("options.scenario: not a sparring.Scenario, nor the dict of one")
    return recipe, None if scenario is None else scenario._native
