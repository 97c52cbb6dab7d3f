"""Satellite that images targets."""

from __future__ import annotations

import logging
from typing import Any

from ..scene.targets import Target
from ..sim import dyn, fsw
from .access_satellite import AccessSatellite, is_integer


class ImagingSatellite(AccessSatellite):
    """Satellite whose steps end when a target is imaged or its window closes."""

    native_type = "ImagingSatellite"
    buffer_name = "image_buffer"
    dyn_type = dyn.ImagingDynModel
    fsw_type = fsw.ImagingFSWModel

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.target_types: Any = "target"
        self.latest_target: Target | None = None
        self.imaged = 0
        self.missed = 0

    @property
    def known_targets(self) -> list[Target]:
        """Targets that the satellite knows."""
        data = getattr(getattr(self, "data_store", None), "data", None)
        known: list[Target] = getattr(data, "known", [])
        return known

    def reset_overwrite_previous(self) -> None:
        """Forgets the images of the previous episode."""
        super().reset_overwrite_previous()
        self._tasked: Target | None = None
        self._image_number = 0
        self.imaged = 0
        self.missed = 0

    def event_number(self, kind: str) -> int:
        """Returns when an event of a kind was set; the one of an image stays set through other actions."""
        return self._image_number if kind == "imaged" else super().event_number(kind)

    def reset_pre_sim_init(self) -> None:
        """Gives the storage one buffer of images."""
        super().reset_pre_sim_init()
        self.sat_args["bufferNames"] = [self.buffer_name]
        self.sat_args["transmitterNumBuffers"] = len(self.sat_args["bufferNames"])

    def parse_target_selection(self, target_query: Any) -> Target:
        """Returns the target of an index of upcoming opportunities, a target or an id."""
        if is_integer(target_query):
            number = int(target_query) + 1
            if number < 1:
                raise IndexError(f"Target index {target_query} out of range.")
            found = self.find_next_opportunities(n=number, types=self.target_types)
            target: Target = found[-1]["object"]
            return target
        if isinstance(target_query, Target):
            return target_query
        if isinstance(target_query, str):
            for target in self.known_targets:
                if target.id == target_query:
                    return target
            raise ValueError(f"Target {target_query} not a known target!")
        raise TypeError(f"Invalid target_query! Cannot be a {type(target_query)}!")

    def enable_target_window(self, target: Target, max_duration: float | None = None) -> None:
        """Gives the image of a target, until its next window closes or `max_duration` seconds."""
        self._tasked = target
        self._image_number = self.simulator.next_event_number()
        self.command_target(self.target_number(target))
        # The simulation finds the window itself; the search here is for the log.
        if self.logger.isEnabledFor(logging.INFO):
            opening, closing = self._next_window(target)
            self.logger.info(f"{target} window enabled: {opening:.1f} to {closing:.1f}")
            limit = 1e9 if max_duration is None else max_duration
            end = min(closing, self.simulator.sim_time + limit)
            self.update_timed_terminal_event(end, info=f"for {target} window")

    def _next_window(self, target: Target) -> tuple[float, float]:
        """The next window of a target, whether or not it is known to be imaged."""
        number = self.target_number(target)
        now = self.simulator.sim_time
        for kind, object, open_s, close_s in self.simulator.native.opportunities(self.index):
            if kind == "target" and object == number and close_s > now:
                return open_s, close_s
        raise ValueError(f"{target} has no upcoming opportunity.")

    def task_target_for_imaging(self, target: Target, max_duration: float | None = None) -> None:
        """Points at a target and images it."""
        self.logger.info(f"{target} tasked for imaging")
        self.enable_target_window(target, max_duration=max_duration)
        self.latest_target = target

    def on_imaged(self) -> None:
        """Notes that the tasked target was imaged."""
        self.logger.info(f"imaged {self._tasked}")
        self.imaged += 1
        self.requires_retasking = True

    def on_timed_end(self, is_missed: bool = False) -> None:
        """Notes that a timed event ended the action; `is_missed` if a target's window closed."""
        super().on_timed_end()
        self.missed += is_missed

    def on_dead(self) -> None:
        """Removes the events of a satellite that left the environment."""
        super().on_dead()
        self._tasked = None
