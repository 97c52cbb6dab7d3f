"""Satellite of an environment: its models, arguments, observation and actions."""

from __future__ import annotations

import inspect
import logging
from abc import ABC
from typing import Any

import numpy as np
from gymnasium import spaces

from ..act.actions import select_action_builder
from ..obs.builder import ObservationBuilder
from ..sim import dyn, fsw
from ..sim.model_names import check_model, has_own_checks
from ..unsupported import sentence
from ..utils.functional import (
    AbstractClassProperty,
    Resetable,
    collect_default_args,
    compose_types,
    safe_dict_merge,
)
from .trajectory import Trajectory


class Satellite(ABC, Resetable):
    """Base of all satellites."""

    dyn_type: Any = AbstractClassProperty()
    fsw_type: Any = AbstractClassProperty()
    observation_spec: Any = AbstractClassProperty()
    action_spec: Any = AbstractClassProperty()

    #: Class of the satellite in the simulation.
    native_type = "Satellite"

    @classmethod
    def get_dyn_type(cls) -> type:
        """Returns the class of the dynamics model, composed of all that `dyn_type` lists."""
        return _composed(cls, "_dyn_type", cls.dyn_type, dyn.DynamicsModel, "Dyn")

    @classmethod
    def get_fsw_type(cls) -> type:
        """Returns the class of the flight software model, composed of all in `fsw_type`."""
        return _composed(cls, "_fsw_type", cls.fsw_type, fsw.FSWModel, "FSW")

    @classmethod
    def default_sat_args(cls, **kwargs: Any) -> dict[str, Any]:
        """Returns the arguments of all models with their defaults, and with those given."""
        software = cls.get_fsw_type()
        defaults = collect_default_args(cls.get_dyn_type())
        defaults = safe_dict_merge(defaults, collect_default_args(software))
        for name in dir(software):
            member = getattr(software, name)
            if not name.startswith("__") and inspect.isclass(member) and issubclass(member, fsw.Task):
                defaults = safe_dict_merge(defaults, collect_default_args(member))
        for name, value in kwargs.items():
            if name not in defaults:
                raise KeyError(f"{name} not a valid key for sat_args")
            defaults[name] = value
        return defaults

    def __init__(
        self,
        name: str,
        sat_args: dict[str, Any] | None = None,
        obs_type: type = np.ndarray,
        dtype: Any = np.float64,
        variable_interval: bool = True,
    ) -> None:
        """Creates a satellite of an environment.

        `sat_args` has values of the models' arguments, or functions that a reset calls for them.
        `obs_type` is `numpy.ndarray`, `dict` or `list`. Events of the satellite end a step unless
        `variable_interval` is false. Environments number satellites of the same name.
        """
        self.name = name
        self.logger = logging.getLogger(__name__).getChild(name)
        self.sat_args_generator = self.default_sat_args(**(sat_args or {}))
        self.sat_args: dict[str, Any]
        self.simulator: Any
        self.fsw: Any
        self.dynamics: Any
        self.data_store: Any
        self.trajectory: Any
        self.requires_retasking: bool
        self.variable_interval = variable_interval
        #: Number of the satellite in the simulation.
        self.index = 0
        #: Index of the action that is being given, for actions that confirm it.
        self.selected_index: int | None = None
        self._command: tuple[int | None, int | None] | None = None
        self._timed_event: tuple[float, str] | None = None
        self._timed_number = 0
        self._is_alive = True
        #: Number of images in the episode that the simulation reported.
        self.image_count = 0
        self.time_of_death: float | None = None
        self.observation_builder = ObservationBuilder(self, obs_type=obs_type, dtype=dtype)
        self.action_builder = select_action_builder(self)
        self.fsw_type = self.get_fsw_type()
        self.dyn_type = self.get_dyn_type()
        check_model(self.dyn_type)
        check_model(self.fsw_type)
        for item in self.action_builder.action_spec:
            item.describe()

    def __getstate__(self) -> dict[str, Any]:
        # Composed classes have no name by which pickle finds them.
        return {key: value for key, value in vars(self).items() if key not in ("dyn_type", "fsw_type")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.fsw_type = self.get_fsw_type()
        self.dyn_type = self.get_dyn_type()

    @property
    def name(self) -> str:
        """Name of the satellite in its environment."""
        return self._name

    @name.setter
    def name(self, value: str) -> None:
        if not isinstance(value, str) or not value:
            raise ValueError("Satellite name must be a nonempty string.")
        self._name = value

    @property
    def id(self) -> str:
        """Name of the satellite, under its older name in BSK-RL."""
        return self.name

    def generate_sat_args(self, **kwargs: Any) -> None:
        """Draws the arguments of an episode, and replaces those given."""
        self.sat_args = {name: value() if callable(value) else value for name, value in self.sat_args_generator.items()}
        for name, value in kwargs.items():
            if name not in self.sat_args:
                raise KeyError(f"{name} not a valid key for sat_args")
            self.sat_args[name] = value
        self.logger.debug("Satellite initialized with %s", self.sat_args)

    def generation_times(self) -> dict[str, Any]:
        """Returns the times for which access windows are computed; none without access."""
        names = ("generation_duration", "initial_generation_duration")
        return dict.fromkeys((*names, "max_generation_duration_beyond_initial"))

    def reset_overwrite_previous(self) -> None:
        """Forgets the previous episode."""
        self.requires_retasking = True
        self._timed_event = None
        self._command = None
        self._is_alive = True
        self.image_count = 0
        self.time_of_death = None
        self.observation_builder.reset_overwrite_previous()
        self.action_builder.reset_overwrite_previous()

    def reset_pre_sim_init(self) -> None:
        """Checks the orbit, before the simulation is created."""
        is_state_given = self.sat_args["rN"] is not None and self.sat_args["vN"] is not None
        is_any_given = self.sat_args["rN"] is not None or self.sat_args["vN"] is not None
        is_elements_given = self.sat_args["oe"] is not None
        if is_state_given == is_elements_given or (is_elements_given and is_any_given):
            raise ValueError("Orbit is over or underspecified. Provide either (rN, vN) or (oe, mu)")
        self.trajectory = Trajectory(self)
        self.observation_builder.reset_pre_sim_init()
        self.action_builder.reset_pre_sim_init()

    def set_simulator(self, simulator: Any, index: int) -> None:
        """Links the satellite to the simulator of the episode, which numbers it."""
        self.simulator = simulator
        self.index = index

    def set_dynamics(self, dyn_rate: float) -> Any:
        """Creates and returns the dynamics model of the episode."""
        self.dynamics = self.dyn_type(self, dyn_rate, **self.sat_args)
        return self.dynamics

    def set_fsw(self, fsw_rate: float) -> Any:
        """Creates and returns the flight software model of the episode."""
        self.fsw = self.fsw_type(self, fsw_rate, **self.sat_args)
        self._has_own_checks = has_own_checks(self.dyn_type) and has_own_checks(self.fsw_type)
        self._alive_run = -1
        return self.fsw

    def reset_during_sim_init(self) -> None:
        """Passes the reset to observations and actions."""
        self.observation_builder.reset_during_sim_init()
        self.action_builder.reset_during_sim_init()

    def reset_post_sim_init(self) -> None:
        """Passes the reset to observations and actions."""
        self.observation_builder.reset_post_sim_init()
        self.action_builder.reset_post_sim_init()

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Space of the satellite's observation."""
        space: spaces.Space[Any] = self.observation_builder.observation_space
        return space

    def get_obs(self) -> Any:
        """Returns the observation of the satellite."""
        return self.observation_builder.get_obs()

    @property
    def observation_description(self) -> Any:
        """Names of the observation's values."""
        return self.observation_builder.observation_description

    @property
    def action_space(self) -> spaces.Space[Any]:
        """Space of the satellite's actions."""
        return self.action_builder.action_space

    def set_action(self, action: Any) -> None:
        """Gives an action to the satellite."""
        self.action_builder.set_action(action)

    @property
    def action_description(self) -> Any:
        """Names of the satellite's actions."""
        return self.action_builder.action_description

    def is_alive(self, log_failure: bool = True) -> bool:
        """Returns whether all aliveness checkers pass, and did so at each earlier call."""
        if not self._is_alive:
            return False
        simulator, dynamics = self.simulator, self.dynamics
        run = simulator.run_count
        if (
            self._has_own_checks
            and dynamics.written_run != run
            and "is_alive" not in dynamics.__dict__
            and "is_alive" not in self.fsw.__dict__
        ):
            # No class, message or object changes a check: the simulation makes them, once after each run.
            if self._alive_run == run:
                return True
            if simulator.native.is_alive(self.index):
                self._alive_run = run
                return True
        self._is_alive = bool(dynamics.is_alive(log_failure=log_failure) and self.fsw.is_alive(log_failure=log_failure))
        if not self._is_alive:
            self.record_death(self.simulator.sim_time)
        return self._is_alive

    def record_death(self, time: float) -> None:
        """Keeps the time of death, s, if none is known."""
        if self.time_of_death is None:
            self.time_of_death = time

    def update_timed_terminal_event(self, t_close: float, info: str = "", extra_actions: Any = None) -> None:
        """Notes the time, s, at which the simulation ends the action that is being given."""
        if extra_actions is not None:
            raise NotImplementedError(sentence("extra_actions of a timed event", "act after the step that it ends"))
        self.disable_timed_terminal_event()
        if self.logger.isEnabledFor(logging.INFO):
            self.logger.info(f"setting timed terminal event at {t_close:.1f}")
        self._timed_event = (t_close, info)
        self._timed_number = self.simulator.next_event_number()

    def disable_timed_terminal_event(self) -> None:
        """Forgets the time at which the current action ends."""
        self._timed_event = None

    def event_number(self, kind: str) -> int:
        """Returns when an event of a kind was set, among all events of the episode; 0 for a search."""
        return self._timed_number if kind in ("missed", "timed") else 0

    def command_selected(self) -> None:
        """Gives the action that is being set to the simulation."""
        self._command = (self.selected_index, None)

    def command_target(self, target: int) -> None:
        """Gives the image of a target, by its number, to the simulation."""
        self._command = (None, target)

    def check_command(self) -> None:
        """Raises NotImplementedError if the action that was set reached no simulation."""
        if self._command is None or self._command == (None, None):
            raise NotImplementedError(sentence("An action with commands of its own", "inherit from an action in `act`"))

    def take_command(self) -> tuple[int | None, int | None]:
        """Returns and forgets the action for the next run: its index or a target's number."""
        command, self._command = self._command, None
        return (None, None) if command is None else command

    def on_timed_end(self, is_missed: bool = False) -> None:
        """Notes that a timed event ended the action; `is_missed` if a target's window closed."""
        if self.logger.isEnabledFor(logging.INFO):
            time, info = self._timed_event or (self.simulator.log_time, "")
            self.logger.info(f"timed termination at {time:.1f} " + info)
        self.requires_retasking = True

    def on_dead(self) -> None:
        """Removes the events of a satellite that left the environment."""
        self._timed_event = None
        self.simulator.native.set_dead(self.index)


def _composed(cls: type, cache: str, models: Any, base: type, name: str) -> type:
    """Composes models once for each class of satellites."""
    if cache not in vars(cls):
        listed = models if isinstance(models, (list, tuple)) else (models,)
        setattr(cls, cache, compose_types(*listed, base, name=name))
    composed: type = vars(cls)[cache]
    return composed
