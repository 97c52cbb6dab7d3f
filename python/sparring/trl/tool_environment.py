"""Environment of one member of a group, whose public methods are the tools of a language model."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from ..errors import invalid
from ..scenario import Scenario, bracket
from ..single import Environment
from ..text_obs import describe_telemetry
from .group_episodes import GroupEpisodes

Reward = Literal["score", "skill"]

#: Pieces of debris per satellite that the tool `telemetry` describes.
TELEMETRY_DEBRIS = 8
#: Number of satellites of a kessler task.
SATELLITES = 3
#: Maximum number of steps of the tool `hold`: the horizon of kessler.
MAX_HOLD_STEPS = 50


class ToolEnvironment:
    """Environment that a language model controls by tool calls. TRL offers every public method to the model.

    `EnvironmentFactory` makes it.
    """

    def __init__(self, episodes: GroupEpisodes, reward: Reward, max_debris: int) -> None:
        self._episodes = episodes
        self._reward = reward
        self._max_debris = max_debris
        self._environment: Environment | None = None
        self._train = True
        self._over = False
        self._score = 0.0
        self._steps = 0

    def reset(self, group_id: str = "", **_: Any) -> str:
        """Begins an episode of the scenario that all members with this `group_id` share.

        Returns:
            The goal and the first observation as text.

        Raises:
            CurriculumError: No episode is ready, and the server is unreachable or failed.
        """
        if self._environment is not None:
            self._episodes.release(self._environment, is_over=self._over)
            self._environment = None
        self._environment, self._train = self._episodes.acquire(group_id)
        self._over, self._score, self._steps = False, 0.0, 0
        return f"{self._telemetry()['mission_objective']}\n{self._describe(self._max_debris)}"

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
        burn = np.zeros((SATELLITES, 2), np.float32)
        delta_v = (_read_number("delta_vx", delta_vx), _read_number("delta_vy", delta_vy))
        burn[int(satellite_id)] = np.clip(delta_v, -1.0, 1.0)
        self._step(burn)
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

    def get_reward(self) -> float:
        """Holds for the remaining steps, so that a short answer has no advantage, and returns the reward of the episode.

        The reward is 0 for all members of a group that the curriculum only measures, so that the model does not learn from it.
        """
        environment = self._running()
        while not self._over:
            self._hold(MAX_HOLD_STEPS)
        if not self._train:
            return 0.0
        if self._reward == "score":
            return self._score
        assert environment.scenario is not None
        return _cached_bracket(environment.scenario).skill(self._score) or 0.0

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the episode; None before the first reset."""
        return None if self._environment is None else self._environment.scenario

    @property
    def over(self) -> bool:
        """True if the episode is over."""
        return self._over

    @property
    def score(self) -> float:
        """Score of the episode so far."""
        return self._score

    def _running(self) -> Environment:
        if self._environment is None:
            raise ResetNeeded("no episode is running: call reset() first")
        return self._environment

    def _telemetry(self) -> dict[str, Any]:
        return self._running().telemetry() or {}

    def _hold(self, steps: int) -> None:
        for _ in range(steps):
            self._step(np.zeros((SATELLITES, 2), np.float32))
            if self._over:
                return

    def _step(self, action: npt.NDArray[np.float32]) -> None:
        environment = self._running()
        if self._over:
            # The model reads this message.
            raise ValueError(f"the episode is over; its score is {self._score:.3f}")
        _, _, terminated, truncated, info = environment.step(action)
        self._score, self._over, self._steps = info["score"], terminated or truncated, self._steps + 1

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


_cached_bracket = lru_cache(maxsize=256)(bracket)
