"""Episode that a language model controls by tool calls: its steps and its text, without the tools, which are of a world."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, Literal

import numpy.typing as npt

from .errors import invalid

Reward = Literal["score", "skill"]


class TextEpisode(ABC):
    """Episode whose observations are text. Worlds derive classes with tools from it, integrations others that run a step."""

    def __init__(self) -> None:
        self._over = False
        self._score = 0.0
        self._steps = 0

    @property
    def over(self) -> bool:
        """True if the episode is over."""
        return self._over

    @property
    def score(self) -> float:
        """Score of the episode so far."""
        return self._score

    @abstractmethod
    def _advance(self, actions: npt.NDArray[Any]) -> None:
        """Runs one step with an action of each agent; updates `_score` and `_over`."""

    @abstractmethod
    def _telemetry(self) -> dict[str, Any]:
        """Returns the observation in the wire form of the world."""

    @abstractmethod
    def _hold_action(self) -> npt.NDArray[Any]:
        """Returns the actions of a step in which all agents hold."""

    @abstractmethod
    def _describe_running(self) -> str:
        """Describes the observation of an episode that is not over."""

    def _begin(self) -> str:
        """Begins to count steps and score; returns the goal and the first observation as text."""
        self._over, self._score, self._steps = False, 0.0, 0
        return f"{self._telemetry()['mission_objective']}\n{self._describe()}"

    def _finish(self) -> None:
        """Holds for the remaining steps, so that a short answer has no advantage."""
        while not self._over:
            self._step(self._hold_action())

    def _repeat(self, actions: npt.NDArray[Any], steps: int) -> None:
        """Runs the same actions for some steps, or until the episode is over."""
        for _ in range(steps):
            self._step(actions)
            if self._over:
                return

    def _step(self, actions: npt.NDArray[Any]) -> None:
        if self._over:
            # The model reads this message.
            raise ValueError(f"the episode is over; its score is {self._score:.3f}")
        self._advance(actions)
        self._steps += 1

    def _describe(self) -> str:
        """Describes the current observation, or the end of the episode."""
        if self._over:
            alerts = [str(alert) for alert in self._telemetry()["critical_alerts"]]
            return "\n".join([*alerts, f"The episode is over; its score is {self._score:.3f}."])
        return self._describe_running()


def read_number(name: str, value: Any) -> float:
    """Returns a number that the model sent.

    Raises:
        ValueError: The value is not a finite number; the model reads the message.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise invalid(name, "a number", value)
    return number


def read_duration(name: str, value: Any, maximum: int) -> int:
    """Returns a number of steps that the model sent, at most `maximum`.

    Raises:
        ValueError: The value is not a number of at least 1; the model reads the message.
    """
    count = read_number(name, value)
    if count < 1:
        raise invalid(name, f"from 1 to {maximum}", value)
    return int(min(count, maximum))


def read_agent(name: str, value: Any, agents: int) -> int:
    """Returns the number of an agent that the model sent.

    Raises:
        ValueError: There is no such agent; the model reads the message.
    """
    if isinstance(value, bool) or value not in range(agents):
        raise invalid(name, f"an integer from 0 to {agents - 1}", value)
    return int(value)
