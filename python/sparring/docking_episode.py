"""Tools of docking for language models, their texts and the checks of their arguments.

Integrations derive from `DockingEpisode` and step the episode in their own way.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .text_episode import TextEpisode, read_agent, read_duration, read_number

#: Prompt before the first observation.
DOCKING_PROMPT = (
    "You dock deputies with a chief that circles the Earth. The chief is at (0, 0, 0): x points away from the Earth, y along "
    "the orbit, z across it; distances are in m, speeds in m/s. A deputy docks when it is within 0.5 m of the chief at 0.2 m/s "
    "or less, and must stay below its speed limit on the way. A deputy has a mass of 12 kg: a thrust of 0.12 N for 10 seconds "
    "changes its velocity by 0.1 m/s. Call thrust to push a deputy, coast to let time pass. Seconds that you do not use are "
    "spent coasting."
)
#: Maximum duration of one tool call, seconds.
MAX_CALL_S = 300


class DockingEpisode(TextEpisode):
    """Episode of docking whose tools step it, and describe the observation as text."""

    def thrust(self, deputy_id: int, thrust_x: float, thrust_y: float, thrust_z: float, seconds: int) -> str:
        """
        Pushes one deputy with a constant thrust for some seconds, while the others coast.

        Args:
            deputy_id: Number of the deputy, counted from 0.
            thrust_x: Thrust along x in N, -1 to 1.
            thrust_y: Thrust along y in N, -1 to 1.
            thrust_z: Thrust along z in N, -1 to 1.
            seconds: Duration in seconds, 1 to 300.

        Returns:
            The observation after the last second.
        """
        deputy = read_agent("deputy_id", deputy_id, len(self._telemetry()["deputies"]))
        thrust = (read_number("thrust_x", thrust_x), read_number("thrust_y", thrust_y), read_number("thrust_z", thrust_z))
        duration = read_duration("seconds", seconds, MAX_CALL_S)
        actions = self._hold_action()
        actions[deputy] = np.clip(thrust, -1.0, 1.0)
        self._repeat(actions, duration)
        return self._describe()

    def coast(self, seconds: int) -> str:
        """
        Lets some seconds pass without thrust.

        Args:
            seconds: Duration in seconds, 1 to 300.

        Returns:
            The observation after the last second.
        """
        self._repeat(self._hold_action(), read_duration("seconds", seconds, MAX_CALL_S))
        return self._describe()

    def _describe_running(self) -> str:
        return describe_docking(self._telemetry())


def describe_docking(telemetry: Mapping[str, Any]) -> str:
    """Describes an observation of docking in lines of text: alerts, the time, and each deputy.

    Args:
        telemetry: Observation in the wire form: `Environment.telemetry()`, or a server's.
    """
    lines = [str(alert) for alert in telemetry["critical_alerts"]]
    lines.append(
        f"Second {telemetry['time_s']:.0f} of {telemetry['time_limit_s']:.0f}, "
        f"thrust at most {telemetry['thrust_bound']:.2f} N along each axis"
    )
    for deputy in telemetry["deputies"]:
        if deputy["status"] != "active":
            lines.append(f"Deputy {deputy['id']} has left: {deputy['status']}")
            continue
        lines.append(
            f"Deputy {deputy['id']} at ({deputy['x']:.1f}, {deputy['y']:.1f}, {deputy['z']:.1f}), "
            f"{deputy['distance']:.1f} m from the chief, moving ({deputy['vx']:.3f}, {deputy['vy']:.3f}, {deputy['vz']:.3f}): "
            f"speed {deputy['speed']:.3f}, limit {deputy['speed_limit']:.3f}"
        )
        nearest = deputy["nearest"]
        if nearest is not None:
            lines.append(
                f"- deputy {nearest['id']} is {nearest['distance']:.1f} m from it, "
                f"with a relative speed of {nearest['relative_speed']:.3f}"
            )
    return "\n".join(lines)
