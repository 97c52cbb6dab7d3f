"""Single environments: one action for all agents, and one observation with a row per agent."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from .curriculum import Curriculum
from .rendering import FPS, Renderer
from .reset_request import SingleBatch
from .scenario import Scenario
from .settings import Actions, Axes, Observation, ObservationLayout, Settings, action_space


class Environment(gymnasium.Env[Any, Any]):
    """One environment of a task, whose agents act by one joint action.

    ## Action space

    | `actions` | world | space | meaning |
    |---|---|---|---|
    | `continuous` | kessler | `Box(-1, 1, (agents, 2))` | change of velocity of each satellite, LU/TU |
    | `continuous` | docking | `Box(-1, 1, (agents, 3))` | thrust of each deputy, N |
    | `discrete` | kessler | `MultiDiscrete([17] * agents)` | index into `sparring.task(…).choices` for each satellite |
    | `discrete` | docking | `MultiDiscrete([27] * agents)` | the same for each deputy |
    | `few` | kessler | `MultiDiscrete([5] * agents)` | index into `sparring.task(…).few_choices` for each satellite |
    | `few` | docking | `MultiDiscrete([13] * agents)` | the same for each deputy |
    | `discrete` | tasking | `MultiDiscrete([4] * agents)`, or 13 with targets | index into `sparring.task(…).action_names` |

    In kessler and docking, zero holds, and so does choice 0. In tasking, None and -1 stand for no new action: the agent goes
    on with the action before. None is accepted for all agents or for single ones.

    With *tracks*, continuous actions are along each satellite's own radial and in-track directions, else along x and y;
    `axes` overrides this.

    ## Observation space, float32

    | `observation` | world | space | meaning |
    |---|---|---|---|
    | `tracks` | kessler | `Box(-2, 2, (agents, 16 + 7·threats))` | own state and the nearest approaching debris, scaled |
    | `telemetry` | kessler | `Dict` with three parts: | |
    | | | `satellites (agents, 6)` | x, y, vx, vy, fuel, survival; LU, LU/TU |
    | | | `debris (4, bodies)` | rows of x, y, vx, vy |
    | | | `mask (bodies,)` | 1 for each piece of debris that exists and is visible |
    | `state` | docking | `Box(-inf, inf, (agents, 8))` | x, y, z, vx, vy, vz, speed, speed limit there; m, m/s |
    | `extended_state` | docking | `Box(-inf, inf, (agents, 20))` | these, time left, logs of bound and distance, direction |
    | | | | from the chief, velocity over twice the speed limit, and its part along that direction |
    | `telemetry` | docking | `Dict(deputies (agents, 8))` | those of `state` |
    | `state` | tasking | `Box(-inf, inf, (agents, n))` | resources, pointing and opportunities of each satellite |
    | `telemetry` | tasking | `Dict(satellites (agents, n))` | the same |

    `columns()` names every value in the order of the flat array.

    ## Rewards

    The reward is the team's reward of the step. The score (`info["score"]`) is the sum of rewards, clipped to the task's
    range.

    ## Starting state

    The generator draws it from params and seed, or a `layout` sets it. In kessler it is fair, unless a physics option
    disables this.

    ## Episode end

    | world | terminated | truncated |
    |---|---|---|
    | kessler | no satellite is left | at step 50, with satellites left |
    | docking | every deputy docked, crashed, left the area, collided, was too fast or timed out | timeout (both) |
    | tasking | no satellite is alive | at the time limit, with satellites alive |

    ## Infos

    A step has `score`, and `alerts`, messages about the step. A reset has `scenario` and, with a curriculum, `level` and
    `train`. Both have `d_ts`, the duration of the step in s, and `requires_retasking`, an array of which agents need an action.

    Args:
        task: Id or name: `kessler/survival` (the default) or `survival`.
        params: Params that differ from their defaults (`sparring.parameter_space`), or from the level's.
        physics: Physics options that differ from their defaults.
        layout: Explicit bodies that replace or extend those of the generator.
        level: Index of a level (`sparring.levels`), which sets the params that are not given.
        observation: `tracks` or `telemetry` in kessler, `state` or `telemetry` in docking and tasking, `extended_state` in
            docking.
        threats: Pieces of debris that a satellite observes in *tracks* (8).
        look_ahead: Steps over which *tracks* predicts close approaches (15).
        bodies: Size of the debris array of *telemetry* (by default the maximum for the params).
        actions: `continuous` (the default in kessler and docking), or `discrete`: for each agent an index into
            `sparring.task(…).choices`. `few` chooses from `few_choices`, which a policy explores faster. Tasking has only
            discrete actions.
        axes: Axes of continuous actions: each `agent`'s own, or the `world`'s.
        curriculum: Source of the scenarios, which receives the outcomes, as in `sparring.make_vec`. It replaces seeds,
            `params`, `physics`, `layout` and `level`.
        render_mode: `rgb_array`, or `human` for a window, which needs pygame.
        render_size: Width and height of an image, pixels.

    Raises:
        ValueError: A value is unknown or out of range; the message names the field.
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
        actions: Actions | None = None,
        axes: Axes | None = None,
        curriculum: Curriculum | None = None,
        render_mode: str | None = None,
        render_size: tuple[int, int] = (640, 640),
    ) -> None:
        settings = Settings(
            task, params, physics, layout, level, observation, threats, look_ahead, bodies, actions, axes, curriculum
        )
        self._settings = settings
        self._batch = SingleBatch(settings)
        self._native = self._batch.native
        self._layout = ObservationLayout(settings, self._native)
        self.observation_space = self._layout.space()
        self.action_space = action_space(settings, self._layout)
        self._hold = settings.hold_actions(self._native)
        self._renderer = Renderer(render_mode, render_size, self.metadata)
        self.render_mode = render_mode
        self._history: list[npt.NDArray[np.float32]] = []
        self._is_running = False

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = {**self._settings.arguments(), "render_mode": self.render_mode, "render_size": self._renderer.size}
        return functools.partial(type(self), **arguments), (), {"spec": self.spec}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode: the scenario of the seed, or the next scenario of the sequence that the last seed started.

        Args:
            seed: Seed from 0 to 2^51 - 1.
            options: `scenario` (a `Scenario` or its dict) is run once before the sequence continues; `params` and `level`
                replace the environment's until the next reset that has either.

        Raises:
            ValueError: The seed, a scenario or an option is invalid; nothing changes then.
            CurriculumError: The curriculum has no episode left.
        """
        observation, info = self._batch.reset(seed, options)
        if seed is not None:
            super().reset(seed=int(seed))
        self._history, self._is_running = [], True
        if self.render_mode == "human":
            self.render()
        return self._layout.view(observation, single=True), {**info, **self._batch.times()}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Runs one step of the world.

        Args:
            action: An action of the action space. A discrete action of a single agent may also be its index alone. None holds,
                as the whole action or as the action of one agent.

        Returns:
            The observation, the team's reward, terminated (no agent is left, by the rules of the task), truncated (the
            horizon cut off an agent), and info with `score` so far and `alerts`, messages about the step.

        Raises:
            ValueError: The action is invalid; nothing changes then.
            gymnasium.error.ResetNeeded: There is no episode, or it is over.
        """
        if not self._is_running:
            raise ResetNeeded("no episode is running: call reset() first")
        observation, rewards, terminations, truncations, ended = self._native.step(self._complete_action(action))
        self._history.append(self._native.last_actions()[0])
        self._batch.count_step(ended)
        info = {"score": self._batch.score, "alerts": self._native.alerts(0), **self._batch.times()}
        self._is_running = not ended
        if self.render_mode == "human":
            self.render()
        terminated, truncated = bool(terminations[0]), bool(truncations[0])
        return self._layout.view(observation, single=True), float(rewards[0]), terminated, truncated, info

    def _complete_action(self, action: Any) -> Any:
        """Replaces None, as an action of all agents or of one, by hold, and an index by the list of one agent's index."""
        if action is None:
            return self._hold
        if self._hold.shape == (1,) and isinstance(action, (int, np.integer)) and not isinstance(action, bool):
            return [action]
        if isinstance(action, (list, tuple)) and len(action) == len(self._hold):
            pairs = zip(action, self._hold, strict=True)
            return [hold if chosen is None else chosen for chosen, hold in pairs]
        return action

    def abandon(self) -> None:
        """Abandons the episode: with a curriculum, its scenario is not offered again."""
        self._batch.abandon()
        self._is_running = False

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the episode; None before the first reset."""
        return self._batch.scenario

    @property
    def history(self) -> npt.NDArray[np.float32]:
        """Actions of the episode so far, steps × agents × values, along the world's axes and before clamping.

        Agents that take no part are left out. `sparring.replay` and `sparring.critique` accept this array, and clamp and
        reject actions as the environment did.
        """
        scenario = self.scenario
        agents = self._layout.num_agents if scenario is None else scenario.agents
        shape = (0, agents, self._layout.action_size)
        return np.stack(self._history)[:, :agents] if self._history else np.zeros(shape, np.float32)

    def telemetry(self) -> dict[str, Any] | None:
        """Returns the observation in the wire form of the public kessler-env, for built-in policies and language models."""
        text = self._native.telemetry(0)
        return None if text is None else dict(json.loads(text))

    def columns(self) -> list[str]:
        """Returns the names of the values of an observation, in the order of the flat array."""
        return self._native.columns()

    def state_hash(self) -> bytes | None:
        """Returns a hash of every bit of the state."""
        return self._native.state_hash(0)

    def render(self) -> Any:
        """Returns an image in mode `rgb_array`; shows it in a window and returns None in mode `human`."""
        return self._renderer.render(self._native, 0)

    def close(self) -> None:
        """Closes the window, and returns an unfinished episode to the curriculum."""
        self._renderer.close()
        self._native.release()
