"""Settings that all kinds of environments share, and the spaces that follow from them."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from . import _native
from .curriculum import Curriculum
from .errors import invalid, one_of
from .scenario import make_recipe, to_json
from .tasks import Task, have_equal_agents
from .tasks import task as find_task

Observation = Literal["tracks", "telemetry", "state", "extended_state"]
Actions = Literal["continuous", "discrete", "few"]
Axes = Literal["agent", "world"]

#: Bound of the absolute value of a cell of *tracks*.
TRACKS_LIMIT = 2.0
#: Size of the debris array of *telemetry* if a curriculum chooses the number of pieces of debris.
CURRICULUM_BODIES = 320
#: Values per satellite in kessler's *telemetry*.
SATELLITE_VALUES = 6
#: Rows of the debris array in kessler's *telemetry*.
DEBRIS_ROWS = ("x", "y", "vx", "vy")
#: Default number of pieces of debris that a satellite observes in *tracks*.
DEFAULT_THREATS = 8
#: Default number of steps over which *tracks* predicts close approaches.
DEFAULT_LOOK_AHEAD = 15


@dataclass(frozen=True)
class Settings:
    """Settings of an environment, except the number of environments."""

    task: str | None
    params: Mapping[str, float] | None = None
    physics: Mapping[str, str] | None = None
    layout: Mapping[str, Any] | None = None
    level: int | None = None
    observation: Observation | None = None
    threats: int | None = None
    look_ahead: int | None = None
    bodies: int | None = None
    actions: Actions | None = None
    axes: Axes | None = None
    curriculum: Curriculum | None = None
    #: Description of the task.
    spec: Task = field(init=False)
    #: True if actions are indices of choices, false if they are numbers.
    is_discrete: bool = field(init=False)
    #: Actions that discrete actions choose from.
    choices: tuple[tuple[float, ...], ...] = field(init=False)

    def __post_init__(self) -> None:
        if self.curriculum is not None:
            if not isinstance(self.curriculum, Curriculum):
                raise invalid("curriculum", "a sparring.Curriculum", self.curriculum)
            for name in ("params", "physics", "layout", "level"):
                if getattr(self, name) is not None:
                    raise ValueError(f"`{name}` must be omitted with `curriculum`, which chooses the scenarios")
            self._set(task=_choose_task(self.curriculum, self.task))
        self._set(spec=find_task("kessler/survival" if self.task is None else self.task))
        self._set(is_discrete=self._reads_choices())
        self._set(choices=self.spec.few_choices if self.actions == "few" else self.spec.choices)
        if self.curriculum is not None and self.spec.default_observation == "tracks":
            # The number of bodies changes with the curriculum's scenarios.
            self._set(bodies=CURRICULUM_BODIES if self.observation == "telemetry" and self.bodies is None else self.bodies)

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _reads_choices(self) -> bool:
        if self.actions not in (None, *get_args(Actions)):
            raise one_of("actions", get_args(Actions), self.actions)
        if self.spec.action_names and self.actions == "continuous":
            raise invalid("actions", f"'discrete' in {self.spec.world}, whose actions have names", self.actions)
        return bool(self.spec.action_names) or self.actions in ("discrete", "few")

    def arguments(self) -> dict[str, Any]:
        """Returns the arguments that make an equal environment, for copies as by Gymnasium's `EzPickle`.

        Raises:
            TypeError: The environment has a curriculum, whose threads cannot be copied.
        """
        if self.curriculum is not None:
            raise TypeError("environments with a curriculum cannot be copied: make others with a curriculum of the same run")
        return {field.name: getattr(self, field.name) for field in fields(self) if field.init}

    def observation_mode(self) -> Observation:
        """Returns the observation mode.

        Raises:
            ValueError: The world has no such mode, or an argument does not belong to it.
        """
        default = self.spec.default_observation
        mode = self.observation or default
        modes = (default, "telemetry", *(("extended_state",) if self.spec.has_extended_state else ()))
        if mode not in modes:
            raise invalid("observation", f"{', '.join(modes[:-1])} or {modes[-1]} in {self.spec.world}", mode)
        for name, name_mode in (("threats", "tracks"), ("look_ahead", "tracks"), ("bodies", "telemetry")):
            if getattr(self, name) is not None and (mode != name_mode or default != "tracks"):
                raise ValueError(
                    f"`{name}` must be omitted with {mode} of {self.spec.world}: it applies to {name_mode} of kessler"
                )
        return mode  # type: ignore[return-value]

    def action_axes(self) -> Axes:
        """Returns the axes of continuous actions; the default for *tracks* is each agent's own.

        Raises:
            ValueError: The axes are unknown, or agents have no axes of their own.
        """
        if self.axes not in (None, *get_args(Axes)):
            raise one_of("axes", get_args(Axes), self.axes)
        if self.axes == "agent" and self.spec.agent_axes is None:
            raise invalid("axes", f"'world' in {self.spec.world}, whose agents have no axes of their own", self.axes)
        return self.axes or ("agent" if self.observation_mode() == "tracks" else "world")

    def make_batch(
        self,
        envs: int,
        *,
        autoreset_mode: str,
        threads: int | None,
        seed: int | None,
        single: bool,
    ) -> _native.NativeBatch:
        """Makes the compiled environments.

        Raises:
            ValueError: A value is unknown or out of range; the message names the field.
        """
        check_count("num_envs", envs, 1)
        for name, value, minimum in (("threads", threads, 1), ("threats", self.threats, 0),
                                     ("look_ahead", self.look_ahead, 0), ("bodies", self.bodies, 0)):  # fmt: skip
            if value is not None:
                check_count(name, value, minimum)
        mode = self.observation_mode()
        recipe = make_recipe(self.spec.id, params=self.params, physics=self.physics, layout=self.layout, level=self.level)
        return _native.NativeBatch(
            to_json("scenario", recipe),
            envs,
            observe={"tracks": "tracks", "extended_state": "extended"}.get(mode, "all"),
            bodies=self.bodies,
            threats=DEFAULT_THREATS if self.threats is None else self.threats,
            look_ahead=DEFAULT_LOOK_AHEAD if self.look_ahead is None else self.look_ahead,
            axes=self.action_axes(),
            discrete=self.is_discrete,
            few=self.actions == "few",
            autoreset_mode=autoreset_mode,
            threads=threads,
            seed=secrets.randbits(50) if seed is None else seed,
            single=single,
            curriculum=None if self.curriculum is None else self.curriculum.attach(envs),
        )

    def agent_name(self) -> str:
        """Returns the prefix of agents' names."""
        return "deputy" if self.spec.world.startswith("docking") else "satellite"

    def hold_actions(self, native: _native.NativeBatch) -> npt.NDArray[Any]:
        """Returns the actions of one environment in which all agents hold."""
        if self.is_discrete:
            return np.full(native.num_agents, self.spec.hold_choice, np.int64)
        return np.zeros((native.num_agents, native.action_size), np.float32)


def check_count(name: str, value: Any, minimum: int) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not minimum <= value < 2**31:
        raise invalid(name, f"an integer >= {minimum}", value)


def _choose_task(curriculum: Curriculum, task: str | None) -> str:
    """Returns a task that represents all tasks of a run, which must have equal agents."""
    tasks = curriculum.tasks
    listed = ", ".join(tasks)
    if not have_equal_agents(tasks):
        raise ValueError(
            f"`curriculum` must be of a run whose tasks have equal agents, got {listed}; choose tasks of kessler, or one task of"
            " another world"
        )
    if task is not None and find_task(task).id not in tasks:
        raise invalid("task", f"one of the run's tasks, {listed}", task)
    return tasks[0] if task is None else find_task(task).id


class ObservationLayout:
    """Layout of the flat observations of a batch."""

    def __init__(self, settings: Settings, native: _native.NativeBatch) -> None:
        self.mode = settings.observation_mode()
        self.agent_name = settings.agent_name()
        #: Name of the agents' part in *telemetry*.
        self.agents_part = "deputies" if self.agent_name == "deputy" else "satellites"
        self.num_agents = native.num_agents
        self.action_size = native.action_size
        #: Values of one environment's observation.
        self.size = native.observation_size
        self.is_kessler = settings.spec.default_observation == "tracks"
        self.bodies = (self.size - self.num_agents * SATELLITE_VALUES) // 5 if self.is_kessler else 0

    def agent_space(self) -> spaces.Box:
        """Returns the observation space of one agent."""
        if self.mode == "tracks":
            return spaces.Box(-TRACKS_LIMIT, TRACKS_LIMIT, (self.size // self.num_agents,), np.float32)
        return _unbounded(self.size // self.num_agents)

    def space(self) -> spaces.Box | spaces.Dict:
        """Returns the observation space of one environment."""
        if self.mode != "telemetry":
            low, high = (-TRACKS_LIMIT, TRACKS_LIMIT) if self.mode == "tracks" else (-np.inf, np.inf)
            return spaces.Box(low, high, (self.num_agents, self.size // self.num_agents), np.float32)
        if not self.is_kessler:
            return spaces.Dict({self.agents_part: _unbounded(self.num_agents, self.size // self.num_agents)})
        return spaces.Dict({
            "satellites": _unbounded(self.num_agents, SATELLITE_VALUES),
            "debris": _unbounded(len(DEBRIS_ROWS), self.bodies),
            "mask": spaces.Box(0.0, 1.0, (self.bodies,), np.float32),
        })  # fmt: skip

    def view(self, flat: npt.NDArray[np.float32], *, single: bool = False) -> Any:
        """Returns observations as views of a flat array, without copying."""
        lead = () if single else flat.shape[:1]
        if self.mode == "tracks":
            return flat
        if self.mode in ("state", "extended_state"):
            return flat.reshape(*lead, self.num_agents, self.size // self.num_agents)
        if not self.is_kessler:
            return {self.agents_part: flat.reshape(*lead, self.num_agents, self.size // self.num_agents)}
        satellites_end = self.num_agents * SATELLITE_VALUES
        debris_end = satellites_end + len(DEBRIS_ROWS) * self.bodies
        return {
            "debris": flat[..., satellites_end:debris_end].reshape(*lead, len(DEBRIS_ROWS), self.bodies),
            "mask": flat[..., debris_end:],
            "satellites": flat[..., :satellites_end].reshape(*lead, self.num_agents, SATELLITE_VALUES),
        }

    def split(self, flat: npt.NDArray[np.float32]) -> list[Any]:
        """Returns one observation per environment, as views of a flat array."""
        observations = self.view(flat)
        if self.mode != "telemetry":
            return list(observations)
        if not self.is_kessler:
            return [{self.agents_part: row} for row in observations[self.agents_part]]
        # Slicing each environment separately would dominate the time of steps in which tens of episodes end.
        parts = zip(observations["debris"], observations["mask"], observations["satellites"], strict=True)
        return [{"debris": debris, "mask": mask, "satellites": satellites} for debris, mask, satellites in parts]


def _unbounded(*shape: int) -> spaces.Box:
    return spaces.Box(-np.inf, np.inf, shape, np.float32)


def action_space(settings: Settings, layout: ObservationLayout) -> spaces.Box | spaces.MultiDiscrete:
    """Returns the action space of one environment: the actions of all its agents."""
    if settings.is_discrete:
        return spaces.MultiDiscrete([len(settings.choices)] * layout.num_agents)
    low, high, _ = settings.spec.action_range
    return spaces.Box(low, high, (layout.num_agents, layout.action_size), np.float32)


def agent_action_space(settings: Settings, layout: ObservationLayout) -> spaces.Box | spaces.Discrete:
    """Returns the action space of one agent."""
    if settings.is_discrete:
        return spaces.Discrete(len(settings.choices))
    low, high, _ = settings.spec.action_range
    return spaces.Box(low, high, (layout.action_size,), np.float32)
