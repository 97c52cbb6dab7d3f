"""What every kind of environment is made with, and the spaces that come of it."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from . import _native
from .curriculum import Curriculum
from .scenario import recipe_of, to_json
from .tasks import Task
from .tasks import task as find

Observation = Literal["tracks", "telemetry", "state"]
Actions = Literal["continuous", "discrete"]
Axes = Literal["agent", "world"]

#: Cells of *tracks* are within plus and minus this.
TRACKS_LIMIT = 2.0
#: Pieces of debris that *telemetry* has room for where a curriculum decides how many there are.
ROOM = 320
#: Values of one satellite, and rows of debris, in kessler's *telemetry*.
SATELLITE_VALUES = 6
DEBRIS_ROWS = ("x", "y", "vx", "vy")


@dataclass(frozen=True)
class Settings:
    """What an environment is, beside how many there are of it."""

    task: str | None
    params: Mapping[str, float] | None = None
    physics: Mapping[str, str] | None = None
    layout: Mapping[str, Any] | None = None
    level: int | None = None
    observation: Observation | None = None
    threats: int | None = None
    look_ahead: int | None = None
    bodies: int | None = None
    actions: Actions = "continuous"
    axes: Axes | None = None
    curriculum: Curriculum | None = None
    told: Task = field(init=False)

    def __post_init__(self) -> None:
        if self.curriculum is not None:
            if not isinstance(self.curriculum, Curriculum):
                raise ValueError(f"curriculum: {self.curriculum!r} is no sparring.Curriculum")
            for name in ("params", "physics", "layout", "level"):
                if getattr(self, name) is not None:
                    raise ValueError(f"{name}: the curriculum says what is flown")
            self._set(task=_task_of(self.curriculum, self.task))
        self._set(told=find("kessler/survival" if self.task is None else self.task))
        if self.curriculum is not None and self.told.default_observation == "tracks":
            # How many bodies there are is the curriculum's to say, and changes.
            self._set(bodies=ROOM if self.observation == "telemetry" and self.bodies is None else self.bodies)

    def _set(self, **fields: Any) -> None:
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def wish(self) -> dict[str, Any]:
        """By which arguments the same is made once more: a copy of an environment is made anew, as Gymnasium's `EzPickle` does.

        Raises:
            TypeError: It flies a curriculum, which has its threads where it is.
        """
        if self.curriculum is not None:
            raise TypeError("environments that fly a curriculum are not copied: make others, with the same run")
        return {one.name: getattr(self, one.name) for one in fields(self) if one.init}

    def seen(self) -> Observation:
        """How it is observed.

        Raises:
            ValueError: A mode the world does not have, or what does not belong to it.
        """
        default = self.told.default_observation
        seen = self.observation or default
        if seen not in (default, "telemetry"):
            raise ValueError(f"observation: {seen!r} is none of {default}, telemetry in {self.told.world}")
        for name, mode in (("threats", "tracks"), ("look_ahead", "tracks"), ("bodies", "telemetry")):
            if getattr(self, name) is not None and (seen != mode or default != "tracks"):
                raise ValueError(f"{name}: it belongs to {mode} of kessler, and this is {seen} of {self.told.world}")
        return seen  # type: ignore[return-value]

    def axis(self) -> Axes:
        """Along which axes continuous actions are: each agent's own with *tracks*, which are along them too."""
        if self.axes not in (None, "agent", "world"):
            raise ValueError(f"axes: {self.axes!r} is neither 'agent' nor 'world'")
        if self.axes == "agent" and self.told.agent_axes is None:
            raise ValueError(f"axes: agents have no axes of their own in {self.told.world}")
        return self.axes or ("agent" if self.seen() == "tracks" else "world")

    def native(
        self,
        envs: int,
        *,
        autoreset_mode: str,
        threads: int | None,
        seed: int | None,
        single: bool,
    ) -> _native.NativeBatch:
        """The environments themselves."""
        if self.actions not in ("continuous", "discrete"):
            raise ValueError(f"actions: {self.actions!r} is neither 'continuous' nor 'discrete'")
        for name, value, least in (("num_envs", envs, 1), ("threads", threads, 1), ("threats", self.threats, 0),
                                   ("look_ahead", self.look_ahead, 0), ("bodies", self.bodies, 0)):  # fmt: skip
            given = value is not None or name == "num_envs"
            if given and (isinstance(value, bool) or not isinstance(value, (int, np.integer))
                                      or not least <= value < 2**31):  # fmt: skip
                raise ValueError(f"{name}: {value!r} is not a whole number from {least} on")
        seen = self.seen()
        recipe = recipe_of(self.told.id, params=self.params, physics=self.physics, layout=self.layout, level=self.level)
        return _native.NativeBatch(
            to_json("scenario", recipe),
            envs,
            observe="tracks" if seen == "tracks" else "all",
            bodies=self.bodies,
            threats=8 if self.threats is None else self.threats,
            look_ahead=15 if self.look_ahead is None else self.look_ahead,
            axes=self.axis(),
            discrete=self.actions == "discrete",
            autoreset_mode=autoreset_mode,
            threads=threads,
            seed=secrets.randbits(50) if seed is None else seed,
            single=single,
            curriculum=None if self.curriculum is None else self.curriculum.attach(envs),
        )

    def agent_name(self) -> str:
        """What one agent is called."""
        return "satellite" if self.told.world.startswith("kessler") else "deputy"


def _task_of(curriculum: Curriculum, task: str | None) -> str:
    tasks = curriculum.tasks
    over = ", ".join(tasks)
    worlds = {one.split("/")[0] for one in tasks}
    if len(worlds) > 1 or (len(tasks) > 1 and worlds == {"docking"}):
        raise ValueError(
            f"curriculum: its run is over {over}, whose agents differ; one over kessler, or one task of docking, can be flown"
        )
    if task is not None and find(task).id not in tasks:
        raise ValueError(f"task: the curriculum's run is over {over}, not {task}")
    return tasks[0] if task is None else find(task).id


class View:
    """How flat observations of a batch are seen."""

    def __init__(self, settings: Settings, native: _native.NativeBatch) -> None:
        self.mode = settings.seen()
        self.name = settings.agent_name()
        self.agents, self.values, self.width = native.sizes
        self.kessler = settings.told.default_observation == "tracks"
        self.bodies = (self.width - self.agents * SATELLITE_VALUES) // 5 if self.kessler else 0

    def _box(self, *shape: int) -> spaces.Box:
        return spaces.Box(-np.inf, np.inf, shape, np.float32)

    def agent_space(self) -> spaces.Box:
        """Of one agent's row."""
        if self.mode == "tracks":
            return spaces.Box(-TRACKS_LIMIT, TRACKS_LIMIT, (self.width // self.agents,), np.float32)
        return self._box(self.width // self.agents)

    def space(self) -> spaces.Box | spaces.Dict:
        """Of one environment."""
        if self.mode != "telemetry":
            low, high = (-TRACKS_LIMIT, TRACKS_LIMIT) if self.mode == "tracks" else (-np.inf, np.inf)
            return spaces.Box(low, high, (self.agents, self.width // self.agents), np.float32)
        if not self.kessler:
            return spaces.Dict({"deputies": self._box(self.agents, self.width // self.agents)})
        return spaces.Dict({
            "satellites": self._box(self.agents, SATELLITE_VALUES),
            "debris": self._box(len(DEBRIS_ROWS), self.bodies),
            "mask": spaces.Box(0.0, 1.0, (self.bodies,), np.float32),
        })  # fmt: skip

    def of(self, flat: npt.NDArray[np.float32], *, single: bool = False) -> Any:
        """Views of the array, none of them a copy."""
        lead = () if single else flat.shape[:1]
        if self.mode == "tracks":
            return flat
        if self.mode == "state":
            return flat.reshape(*lead, self.agents, self.width // self.agents)
        if not self.kessler:
            return {"deputies": flat.reshape(*lead, self.agents, self.width // self.agents)}
        own = self.agents * SATELLITE_VALUES
        known = own + len(DEBRIS_ROWS) * self.bodies
        return {
            "debris": flat[..., own:known].reshape(*lead, len(DEBRIS_ROWS), self.bodies),
            "mask": flat[..., known:],
            "satellites": flat[..., :own].reshape(*lead, self.agents, SATELLITE_VALUES),
        }

    def rows(self, flat: npt.NDArray[np.float32]) -> list[Any]:
        """The same of each environment by itself."""
        seen = self.of(flat)
        if self.mode != "telemetry":
            return list(seen)
        if not self.kessler:
            return [{"deputies": row} for row in seen["deputies"]]
        # All at once: views of views are what takes time where some tens of episodes end in a step.
        parts = zip(seen["debris"], seen["mask"], seen["satellites"], strict=True)
        return [{"debris": debris, "mask": mask, "satellites": satellites} for debris, mask, satellites in parts]


def action_space(settings: Settings, view: View) -> spaces.Box | spaces.MultiDiscrete:
    """Of one environment: all its agents."""
    if settings.actions == "discrete":
        return spaces.MultiDiscrete([len(settings.told.choices)] * view.agents)
    low, high, _ = settings.told.action_range
    return spaces.Box(low, high, (view.agents, view.values), np.float32)


def agent_action_space(settings: Settings, view: View) -> spaces.Box | spaces.Discrete:
    """Of one agent."""
    if settings.actions == "discrete":
        return spaces.Discrete(len(settings.told.choices))
    low, high, _ = settings.told.action_range
    return spaces.Box(low, high, (view.values,), np.float32)
