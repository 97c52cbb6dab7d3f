"""Tools of kessler for language models, their texts and the checks of their arguments.

Integrations derive from `ToolEpisode` and step the episode in their own way: `sparring.trl` in this process, `sparring-verifiers`
in a session of the server.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .text_episode import TextEpisode, read_agent, read_duration, read_number
from .text_obs import describe_telemetry

#: Prompt before the first observation.
PROMPT = (
    "You fly three satellites around the Earth, which is at (0, 0); distances are in LU, a step is one TU. Debris that comes "
    "nearer than 2 LU destroys a satellite. Call fire_thrusters where something will pass too near: a change of velocity of 0.1 "
    "some steps before is enough, and costs fuel. Call hold where nothing will. Steps that you do not use are spent holding."
)
#: Pieces of debris per satellite that the tool `telemetry` describes.
TELEMETRY_DEBRIS = 8
#: Number of satellites of a kessler task.
SATELLITES = 3
#: Maximum number of steps of the tool `hold`: the horizon of kessler.
MAX_HOLD_STEPS = 50


class ToolEpisode(TextEpisode):
    """Episode of kessler whose tools step it, and describe the observation as text.

    Args:
        max_debris: Pieces of debris per satellite that are described after an action.
    """

    def __init__(self, max_debris: int) -> None:
        super().__init__()
        self._max_debris = max_debris

    def fire_thrusters(self, satellite_id: int, delta_vx: float, delta_vy: float) -> str:
        """
        Changes the velocity of one satellite, and lets one step pass.

        Args:
            satellite_id: Number of the satellite, 0 to 2.
            delta_vx: Change of its velocity along x, -1 to 1.
            delta_vy: Change of its velocity along y, -1 to 1.

        Returns:
            The observation after the last step.
        """
        satellite = read_agent("satellite_id", satellite_id, SATELLITES)
        burns = self._hold_action()
        delta_v = (read_number("delta_vx", delta_vx), read_number("delta_vy", delta_vy))
        burns[satellite] = np.clip(delta_v, -1.0, 1.0)
        self._step(burns)
        return self._describe()

    def hold(self, steps: int) -> str:
        """
        Does nothing for some steps.

        Args:
            steps: Number of steps, 1 to 50.

        Returns:
            The observation after the last step.
        """
        self._repeat(self._hold_action(), read_duration("steps", steps, MAX_HOLD_STEPS))
        return self._describe()

    def telemetry(self) -> str:
        """
        Describes more debris around each satellite. No time passes.

        Returns:
            The current observation.
        """
        return self._describe() if self.over else self._describe_debris(TELEMETRY_DEBRIS)

    def _hold_action(self) -> npt.NDArray[np.float32]:
        return np.zeros((SATELLITES, 2), np.float32)

    def _describe_running(self) -> str:
        return self._describe_debris(self._max_debris)

    def _describe_debris(self, max_debris: int) -> str:
        return f"Step {self._steps}.\n{describe_telemetry(self._telemetry(), max_debris)}"
