"""Episode that a language model controls by tool calls, in a session of the server."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Mapping
from typing import Any, get_type_hints

import numpy.typing as npt

from sparring.tool_episode import ToolEpisode

from .session import Session, SessionError

#: Tools that the language model may call.
TOOLS: dict[str, Callable[..., str]] = {
    tool.__name__: tool for tool in (ToolEpisode.fire_thrusters, ToolEpisode.hold, ToolEpisode.telemetry)
}
#: JSON types of the arguments of tools.
JSON_TYPES = {int: "integer", float: "number"}


class SessionEpisode(ToolEpisode):
    """Episode that the tools step on the server. Its methods are thread-safe, and block until the server answers.

    Args:
        url: Address of the server.
        request: Fields of the message `open`: the run, and the episode or the group.
        max_debris: Pieces of debris per satellite that are described after an action.
        max_wait_s: Seconds for which an unreachable or full server is tried again.

    Raises:
        SessionError: The episode is not free, or the server cannot be reached in time.
    """

    def __init__(self, url: str, request: Mapping[str, Any], max_debris: int, max_wait_s: float) -> None:
        super().__init__(max_debris)
        self._session = Session(url, dict(request), max_wait_s)
        self._observation: dict[str, Any] = self._session.opened["observation"]
        self._lock = threading.Lock()
        #: Id of the episode.
        self.episode: str = self._session.opened["episode"]
        #: Id of the scenario.
        self.scenario: str = self._session.opened["scenario"]
        #: Id of the task.
        self.task: str = self._session.opened["task"]
        #: Number of tool calls that were rejected.
        self.invalid_calls = 0
        #: Receipt of the result, from the server's replay; None before the end of the episode.
        self.receipt: dict[str, Any] | None = None
        #: Goal and first observation as text.
        self.first_text = self._begin()

    @property
    def lease(self) -> str:
        """Id of the lease, which is a part of the id of the episode."""
        return self.episode.split("_")[1]

    def call(self, name: str, arguments: Mapping[str, Any]) -> str:
        """Calls a tool; returns its text for the model.

        Raises:
            ValueError: The tool or an argument is invalid; the episode does not change.
            SessionError: The server lost the session, or cannot be reached in time.
        """
        with self._lock:
            if self._over:
                return self._describe()
            try:
                return self._call(name, arguments)
            except ValueError:
                self.invalid_calls += 1
                raise

    def finish(self) -> dict[str, Any]:
        """Holds for the remaining steps and ends the session; returns the receipt of the result.

        Raises:
            SessionError: The server has no score of the episode, or cannot be reached in time.
        """
        with self._lock:
            self._finish()
            self._session.close()
            receipt = self.receipt or {}
            if receipt.get("score") is None:
                reason = receipt.get("detail") or f"the status of its result is {receipt.get('status')}"
                raise SessionError("lost", f"the server has no score of episode {self.episode}: {reason}")
            return receipt

    def abandon(self) -> None:
        """Ends the session without a result."""
        with self._lock:
            self._session.close()

    def _call(self, name: str, arguments: Mapping[str, Any]) -> str:
        tool = TOOLS.get(name)
        if tool is None:
            raise ValueError(f"there is no tool {name!r}; the tools are {', '.join(TOOLS)}")
        if not isinstance(arguments, Mapping):
            raise ValueError(f"the arguments of {name} must be a JSON object, got {arguments!r}")
        try:
            bound = inspect.signature(tool).bind(self, **arguments)
        except TypeError as error:
            raise ValueError(f"{name}: {error}") from error
        return tool(*bound.args, **bound.kwargs)

    def _advance(self, burns: npt.NDArray[Any]) -> None:
        entries = [
            {"satellite_id": number, "delta_vx": x, "delta_vy": y} for number, (x, y) in enumerate(burns.tolist()) if x or y
        ]
        stepped = self._session.step({"burns": entries})
        self._observation, self._over = stepped["observation"], stepped["done"]
        if self._over:
            self.receipt = stepped["reported"]
            self._score = float((self.receipt or {}).get("score") or 0.0)

    def _telemetry(self) -> dict[str, Any]:
        return self._observation


def tool_schemas() -> list[dict[str, Any]]:
    """Returns the tools in the form of the chat API, from their signatures and docstrings."""
    return [{"type": "function", "function": _describe_tool(tool)} for tool in TOOLS.values()]


def _describe_tool(tool: Callable[..., str]) -> dict[str, Any]:
    lines = inspect.cleandoc(tool.__doc__ or "").splitlines()
    texts = dict(line.strip().split(": ", 1) for line in lines if line.startswith("    ") and ": " in line)
    hints = get_type_hints(tool)
    names = [name for name in inspect.signature(tool).parameters if name != "self"]
    properties = {name: {"type": JSON_TYPES[hints[name]], "description": texts[name]} for name in names}
    parameters = {"type": "object", "properties": properties, **({"required": names} if names else {})}
    return {"name": tool.__name__, "description": lines[0], "parameters": parameters}
