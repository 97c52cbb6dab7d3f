"""Actions that are chosen by an index."""

from __future__ import annotations

import logging
from abc import abstractmethod
from typing import Any

import numpy as np
from gymnasium import spaces

from ..unsupported import sentence
from .actions import Action, ActionBuilder

logger = logging.getLogger(__name__)

#: Duration of an action without one, s: another event ends its step.
UNLIMITED_S = 1e9


class DiscreteActionBuilder(ActionBuilder):
    """Actions of a satellite that are numbered in the order of their items."""

    def __init__(self, satellite: Any) -> None:
        super().__init__(satellite)
        self.prev_action_key: str | None = None

    def reset_post_sim_init(self) -> None:
        """Forgets the previous action."""
        super().reset_post_sim_init()
        self.prev_action_key = None

    @property
    def action_space(self) -> spaces.Discrete:
        """Space of the indices of actions."""
        return spaces.Discrete(sum(item.n_actions for item in self.action_spec))

    @property
    def action_description(self) -> list[str]:
        """Names of the actions by index."""
        names: list[str] = []
        for item in self.action_spec:
            if item.n_actions == 1:
                names.append(item.name)
            else:
                names += [f"{item.name}_{index}" for index in range(item.n_actions)]
        return names

    def set_action(self, action: Any) -> None:
        """Gives an action by index, or one that `set_action_override` of an item accepts."""
        self.satellite.disable_timed_terminal_event()
        if type(action) is not int and not np.issubdtype(type(action), np.integer):
            self._set_override(action)
            return
        index = 0
        for item in self.action_spec:
            if index + item.n_actions > action:
                self.satellite.selected_index = int(action)
                key = item.set_action(action - index, prev_action_key=self.prev_action_key)
                self.satellite.selected_index = None
                self.prev_action_key = key
                return
            index += item.n_actions
        raise ValueError(f"Action index {action} out of range.")

    def _set_override(self, action: Any) -> None:
        """Gives an action that is no index to the first item that accepts it."""
        logger.warning(f"Action '{action}' is not an integer. Will attempt to use compatible set_action_override method.")
        for item in self.action_spec:
            override = getattr(item, "set_action_override", None)
            if override is None:
                continue
            try:
                self.prev_action_key = override(action, prev_action_key=self.prev_action_key)
            except (AttributeError, TypeError):
                continue
            return
        raise ValueError(f"Action '{action}' is not an integer and no compatible set_action_override method found.")


class DiscreteAction(Action):
    """Base of actions that are chosen by an index; an item has `n_actions` of them.

    `set_action_override`, where an item has one, accepts actions that are no index.
    """

    builder_type = DiscreteActionBuilder

    def __init__(self, name: str = "discrete_act", n_actions: int = 1) -> None:
        super().__init__(name=name)
        self.n_actions = n_actions

    @abstractmethod
    def set_action(self, action: int, prev_action_key: str | None = None) -> str:
        """Gives the action of a local index, and returns its key."""

    def describe(self) -> dict[str, Any]:
        """Returns the settings of the action for the simulation."""
        raise NotImplementedError(sentence(f"The action {type(self).__name__}", "inherit from one of the actions in `act`"))


def _check_unchanged(duration: float | None, simulated: float | None) -> None:
    """Raises NotImplementedError if a duration is not the one with which the episode began."""
    if duration is not simulated and duration != simulated:
        raise NotImplementedError(sentence("A duration that changes in an episode", "add an action for each duration"))


class DiscreteFSWAction(DiscreteAction):
    """Action that calls a function of the flight software for `duration` seconds.

    The step goes on to another event if no duration is given. With `reset_task`, the function is
    called again when the action follows itself.
    """

    def __init__(
        self,
        fsw_action: str,
        name: str | None = None,
        duration: float | None = None,
        reset_task: bool = False,
    ) -> None:
        super().__init__(name=fsw_action if name is None else name, n_actions=1)
        self.fsw_action = fsw_action
        self.reset_task = reset_task
        self.duration = UNLIMITED_S if duration is None else duration

    def set_action(self, action: int, prev_action_key: str | None = None) -> str:
        """Gives the action, and returns the function's name."""
        assert action == 0
        _check_unchanged(self.duration, self._simulated_duration)
        satellite = self.satellite
        if satellite.logger.isEnabledFor(logging.INFO):
            satellite.logger.info(f"{self.name} tasked for {self.duration} seconds")
        satellite.update_timed_terminal_event(self.simulator.sim_time + self.duration, info=f"for {self.fsw_action}")
        satellite.command_selected()
        return self.fsw_action

    def describe(self) -> dict[str, Any]:
        """Returns the settings of the action; the flight software must have the function."""
        function = getattr(self.satellite.fsw_type, self.fsw_action, None)
        if function is None:
            raise AttributeError(f"{self.satellite.fsw_type.__name__} has no action {self.fsw_action!r}")
        self._simulated_duration = self.duration
        return {
            "type": "DiscreteFSWAction",
            "name": self.name,
            "fsw_action": self.fsw_action,
            "reset_task": bool(self.reset_task),
            "duration": self.duration,
        }


class Charge(DiscreteFSWAction):
    """Points the solar panel at the Sun."""

    def __init__(self, name: str | None = None, duration: float | None = None) -> None:
        super().__init__(fsw_action="action_charge", name=name, duration=duration)


class Drift(DiscreteFSWAction):
    """Stops controlling the attitude."""

    def __init__(self, name: str | None = None, duration: float | None = None) -> None:
        super().__init__(fsw_action="action_drift", name=name, duration=duration)


class NadirPoint(DiscreteFSWAction):
    """Aligns the body with the Hill frame."""

    def __init__(self, name: str | None = None, duration: float | None = None) -> None:
        super().__init__(fsw_action="action_nadir_point", name=name, duration=duration)


class Desat(DiscreteFSWAction):
    """Desaturates the wheels by thrusters; full wheels need several actions."""

    def __init__(self, name: str | None = None, duration: float | None = None) -> None:
        super().__init__(fsw_action="action_desat", name=name, duration=duration, reset_task=True)


class Downlink(DiscreteFSWAction):
    """Sends stored data while a ground station is in range."""

    def __init__(self, name: str | None = None, duration: float | None = None) -> None:
        super().__init__(fsw_action="action_downlink", name=name, duration=duration)


class Scan(DiscreteFSWAction):
    """Scans the ground below."""

    def __init__(self, name: str | None = None, duration: float | None = None) -> None:
        super().__init__(fsw_action="action_nadir_scan", name=name, duration=duration)


class Image(DiscreteAction):
    """Images one of the next `n_ahead_image` targets that are not known to be imaged.

    The action ends with the image, when the target's window closes, or after `max_duration`
    seconds. It also accepts a target or the id of one.
    """

    def __init__(self, n_ahead_image: int, max_duration: float | None = None, name: str = "action_image") -> None:
        super().__init__(name=name, n_actions=n_ahead_image)
        self.max_duration = max_duration

    def image(self, target: Any, prev_action_key: str | None = None) -> str:
        """Gives the image of a target (index, target or id), and returns the target's id."""
        _check_unchanged(self.max_duration, self._simulated_duration)
        target = self.satellite.parse_target_selection(target)
        if target.id != prev_action_key:
            self.satellite.task_target_for_imaging(target, max_duration=self.max_duration)
        else:
            self.satellite.enable_target_window(target, max_duration=self.max_duration)
        identifier: str = target.id
        return identifier

    def set_action(self, action: int, prev_action_key: str | None = None) -> str:
        """Images the target of a local index."""
        self.satellite.logger.info(f"target index {action} tasked")
        return self.image(action, prev_action_key)

    def set_action_override(self, action: Any, prev_action_key: str | None = None) -> str:
        """Images a target that is given as such or by its id."""
        return self.image(action, prev_action_key)

    def describe(self) -> dict[str, Any]:
        """Returns the settings of the action."""
        self._simulated_duration = self.max_duration
        return {
            "type": "Image",
            "name": self.name,
            "n_ahead_image": self.n_actions,
            "max_duration": UNLIMITED_S if self.max_duration is None else self.max_duration,
        }


class Broadcast(DiscreteAction):
    """Sends known data to other satellites at the end of the step, after `duration` seconds.

    It has an effect with a `BroadcastCommunication` only.
    """

    def __init__(self, name: str = "action_broadcast", duration: float | None = None) -> None:
        super().__init__(name=name, n_actions=1)
        self.duration = UNLIMITED_S if duration is None else duration
        self.broadcast_pending = False

    def reset_post_sim_init(self) -> None:
        """Forgets a broadcast of the previous episode."""
        super().reset_post_sim_init()
        self.broadcast_pending = False

    def set_action(self, action: int, prev_action_key: str | None = None) -> str:
        """Gives the action, and returns its name."""
        assert action == 0
        _check_unchanged(self.duration, self._simulated_duration)
        self.broadcast_pending = True
        self.satellite.update_timed_terminal_event(self.simulator.sim_time + self.duration, info="for broadcast")
        self.satellite.command_selected()
        return self.name

    def describe(self) -> dict[str, Any]:
        """Returns the settings of the action."""
        self._simulated_duration = self.duration
        return {"type": "Broadcast", "name": self.name, "duration": self.duration}
