"""Episode that a language model controls by tool calls: the tools, their texts and the checks of their arguments.

Integrations derive from `ToolEpisode` and step the episode in their own way: `sparring.trl` in this process, `sparring-verifiers`
in a session of the server.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .errors import invalid
from .text_obs import describe_telemetry

Reward = Literal["score", "skill"]

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


class ToolEpisode(ABC):
    """Episode of kessler whose tools step it, and describe the observation as text.

    Args:
        max_debris: Pieces of debris per satellite that are described after an action.
    """

    def __init__(self, max_debris: int) -> None:
        self._max_debris = max_debris
        self._over = False
        self._score = 0.0
        self._steps = 0

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
        if isinstance(satellite_id, bool) or satellite_id not in range(SATELLITES):
            raise invalid("satellite_id", "0, 1 or 2", satellite_id)
        burns = np.zeros((SATELLITES, 2), np.float32)
        delta_v = (_read_number("delta_vx", delta_vx), _read_number("delta_vy", delta_vy))
        burns[int(satellite_id)] = np.clip(delta_v, -1.0, 1.0)
        self._step(burns)
        return self._describe(self._max_debris)

    def hold(self, steps: int) -> str:
        """
        Does nothing for some steps.

        Args:
            steps: Number of steps, 1 to 50.

        Returns:
            The observation after the last step.
        """
        count = _read_number("steps", steps)
        if count < 1:
            raise invalid("steps", f"from 1 to {MAX_HOLD_STEPS}", steps)
        self._hold(int(min(count, MAX_HOLD_STEPS)))
        return self._describe(self._max_debris)

    def telemetry(self) -> str:
        """
        Describes more debris around each satellite. No time passes.

        Returns:
            The current observation.
        """
        return self._describe(TELEMETRY_DEBRIS)

    @property
    def over(self) -> bool:
        """True if the episode is over."""
        return self._over

    @property
    def score(self) -> float:
        """Score of the episode so far."""
        return self._score

    @abstractmethod
    def _advance(self, burns: npt.NDArray[np.float32]) -> None:
        """Runs one step with a change of velocity of each satellite; updates `_score` and `_over`."""

    @abstractmethod
    def _telemetry(self) -> dict[str, Any]:
        """Returns the observation in the wire form of the public kessler-env."""

    def _begin(self) -> str:
        """Begins to count steps and score; returns the goal and the first observation as text."""
        self._over, self._score, self._steps = False, 0.0, 0
        return f"{self._telemetry()['mission_objective']}\n{self._describe(self._max_debris)}"

    def _finish(self) -> None:
        """Holds for the remaining steps, so that a short answer has no advantage."""
        while not self._over:
            self._hold(MAX_HOLD_STEPS)

    def _hold(self, steps: int) -> None:
        for _ in range(steps):
            self._step(np.zeros((SATELLITES, 2), np.float32))
            if self._over:
                return

    def _step(self, burns: npt.NDArray[np.float32]) -> None:
        if self._over:
            # The model reads this message.
            raise ValueError(f"the episode is over; its score is {self._score:.3f}")
        self._advance(burns)
        self._steps += 1

    def _describe(self, max_debris: int) -> str:
        if self._over:
            alerts = [str(alert) for alert in self._telemetry()["critical_alerts"]]
            return "\n".join([*alerts, f"The episode is over; its score is {self._score:.3f}."])
        return f"Step {self._steps}.\n{describe_telemetry(self._telemetry(), max_debris)}"


def _read_number(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise invalid(name, "a number", value)
    return number
