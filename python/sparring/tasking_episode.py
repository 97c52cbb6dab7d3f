"""Tools of tasking for language models, their texts and the checks of their arguments.

Integrations derive from `ScanningEpisode` or `ImagingEpisode` and step the episode in their own way.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .text_episode import TextEpisode, read_agent

_COMMON_PROMPT = (
    "A satellite dies when its battery is empty or a wheel exceeds its limit. Charge points the panel at the Sun, which brings "
    "nothing in an eclipse; desaturate slows the wheels, and takes power. Downlink empties the storage while a ground station "
    "is in view. Each tool gives one satellite a new action. When every satellite that needs an action has one, time passes "
    "until the first of them has finished."
)
#: Prompt of `tasking/scanning` before the first observation.
SCANNING_PROMPT = (
    "You task a satellite that scans the ground below while its storage is not full. Scan points the instrument down for three "
    "minutes. " + _COMMON_PROMPT + " Without further calls the satellite goes on with its last action to the end."
)
#: Prompt of the tasks with targets before the first observation.
IMAGING_PROMPT = (
    "You task satellites that image targets on the ground. Image points the instrument at a target; it succeeds while the "
    "target's window is open, if the satellite can turn to it in time, and earns the target's priority once. "
    + _COMMON_PROMPT
    + " Without further calls the satellites go on with their last actions to the end."
)


class TaskingEpisode(TextEpisode):
    """Episode of tasking whose tools step it, and describe the observation as text. Tasks add their own tools."""

    def __init__(self) -> None:
        super().__init__()
        #: Actions by satellite that wait for those of the others.
        self._given: dict[int, int] = {}

    def charge(self, satellite_id: int) -> str:
        """
        Points the solar panel of a satellite at the Sun for two minutes.

        Args:
            satellite_id: Number of the satellite, counted from 0.

        Returns:
            The observation, or which satellites need an action before time passes.
        """
        return self._give("charge", satellite_id)

    def downlink(self, satellite_id: int) -> str:
        """
        Sends the data of a satellite to the ground station in view, for one minute.

        Args:
            satellite_id: Number of the satellite, counted from 0.

        Returns:
            The observation, or which satellites need an action before time passes.
        """
        return self._give("downlink", satellite_id)

    def desaturate(self, satellite_id: int) -> str:
        """
        Slows the wheels of a satellite by its thrusters, for one minute.

        Args:
            satellite_id: Number of the satellite, counted from 0.

        Returns:
            The observation, or which satellites need an action before time passes.
        """
        return self._give("desaturate", satellite_id)

    def wait(self) -> str:
        """
        Lets time pass. Satellites without a new action go on with their last one.

        Returns:
            The observation at the end of the next action.
        """
        return self._pass_time()

    def telemetry(self) -> str:
        """
        Describes the satellites. No time passes.

        Returns:
            The current observation.
        """
        return self._describe()

    def _give(self, action: str, satellite_id: Any) -> str:
        """Gives a satellite an action; runs a step once all satellites that need one have it."""
        if self._over:
            return self._pass_time()
        telemetry = self._telemetry()
        satellites = telemetry["satellites"]
        satellite = read_agent("satellite_id", satellite_id, len(satellites))
        waiting = [one["id"] for one in satellites if one["needs_action"]]
        if satellite not in waiting:
            state = "busy" if satellites[satellite]["alive"] else "dead"
            raise ValueError(f"satellite {satellite} is {state}; satellites that need an action: {_listed(waiting)}")
        self._given[satellite] = telemetry["actions"].index(action)
        missing = [one for one in waiting if one not in self._given]
        if missing:
            return f"Satellite {satellite} will {action}. These satellites need an action, too: {_listed(missing)}."
        return self._pass_time()

    def _pass_time(self) -> str:
        actions = self._hold_action()
        for satellite, action in self._given.items():
            actions[satellite] = action
        self._given.clear()
        self._step(actions)
        return self._describe()

    def _begin(self) -> str:
        self._given.clear()
        return super()._begin()

    def _hold_action(self) -> npt.NDArray[Any]:
        return np.full(len(self._telemetry()["satellites"]), -1, np.int64)

    def _describe_running(self) -> str:
        return describe_tasking(self._telemetry())


class ScanningEpisode(TaskingEpisode):
    """Episode of `tasking/scanning` whose tools step it."""

    def scan(self, satellite_id: int) -> str:
        """
        Points the instrument of a satellite down for three minutes, and stores data while it does.

        Args:
            satellite_id: Number of the satellite, counted from 0.

        Returns:
            The observation, or which satellites need an action before time passes.
        """
        return self._give("scan", satellite_id)


class ImagingEpisode(TaskingEpisode):
    """Episode of a task with targets whose tools step it."""

    def image(self, satellite_id: int, target: int) -> str:
        """
        Points the instrument of a satellite at a target until the image is stored or the target's window closes.

        Args:
            satellite_id: Number of the satellite, counted from 0.
            target: Number of the target in the list of the satellite, counted from 0.

        Returns:
            The observation, or which satellites need an action before time passes.
        """
        count = sum(name.startswith("image_") for name in self._telemetry()["actions"])
        return self._give(f"image_{read_agent('target', target, count)}", satellite_id)


def describe_tasking(telemetry: Mapping[str, Any]) -> str:
    """Describes an observation of tasking in lines of text: alerts, the time, each satellite and its targets.

    Args:
        telemetry: Observation in the wire form: `Environment.telemetry()`, or a server's.
    """
    lines = [str(alert) for alert in telemetry["critical_alerts"]]
    lines.append(f"Second {telemetry['time_s']:.0f} of {telemetry['time_limit_s']:.0f}, score {telemetry['total_score']:.3f}.")
    for satellite in telemetry["satellites"]:
        lines.extend(_satellite_lines(satellite))
    return "\n".join(lines)


def _satellite_lines(satellite: Mapping[str, Any]) -> list[str]:
    name = f"Satellite {satellite['id']}"
    if not satellite["alive"]:
        return [f"{name} is dead."]
    if not satellite["needs_action"]:
        return [f"{name} is busy: {satellite['action'] or 'drifts'}."]
    fastest = max(abs(speed) for speed in satellite["wheels"])
    lines = [
        f"{name} needs an action. Battery {satellite['battery']:.0%}, storage {satellite['storage']:.0%}, fastest wheel "
        f"{fastest:.0%} of its limit. The instrument points {satellite['instrument_error_deg']:.0f}° from straight down, the "
        f"panel {satellite['sun_error_deg']:.0f}° from the Sun. {_eclipse_text(satellite)} {_station_text(satellite)}"
    ]
    for number, target in enumerate(satellite["targets"]):
        opens = "open" if target["open_s"] <= 0 else f"opens in {target['open_s']:.0f} s"
        lines.append(
            f"- target {number}: priority {target['priority']:.2f}, {opens}, closes in {target['close_s']:.0f} s, "
            f"{target['angle_deg']:.0f}° from the instrument"
        )
    return lines


def _eclipse_text(satellite: Mapping[str, Any]) -> str:
    start, end = satellite["eclipse_start_s"], satellite["eclipse_end_s"]
    return f"In eclipse for {end:.0f} s." if end < start else f"Eclipse in {start:.0f} s."


def _station_text(satellite: Mapping[str, Any]) -> str:
    opens, closes = satellite["station_open_s"], satellite["station_close_s"]
    return f"A station is in view for {closes:.0f} s." if opens <= 0 else f"A station comes into view in {opens:.0f} s."


def _listed(satellites: list[int]) -> str:
    return ", ".join(map(str, satellites)) or "none"
