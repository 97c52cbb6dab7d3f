"""Session that steps one environment on the server, over a WebSocket (docs/reference/stepping.md)."""

from __future__ import annotations

import contextlib
import json
import ssl
import time
from typing import Any
from urllib.parse import quote

from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from sparring import _native
from sparring.connection import read_ca_file, read_token

#: Seconds to wait for the answer to a message. The last step of an episode is answered after its result is stored.
ANSWER_TIMEOUT_S = 120.0
#: Seconds before a rejected or lost message is sent again; doubled after each attempt.
RETRY_DELAY_S = 0.2
#: Maximum delay before a message is sent again, seconds.
MAX_RETRY_DELAY_S = 5.0
#: Statuses of a server that is busy, stopping, or behind a proxy that cannot reach it.
BUSY_STATUSES = (408, 429, 500, 502, 503, 504)
#: Codes of errors after which the server no longer has the session.
ENDED_CODES = ("unknown_session", "superseded", "idle_timeout", "stopping", "unauthenticated", "internal")


class SessionError(Exception):
    """The server rejected a message of a session, or lost the session.

    Attributes:
        code: Code of the error, or `unreachable`.
        field: Field at fault, if the server names one.
    """

    def __init__(self, code: str, detail: str, field: str | None = None) -> None:
        self.code = code
        self.field = field
        super().__init__(f"{field}: {detail}" if field else detail)


class _Delays:
    """Delays between attempts, until a deadline."""

    def __init__(self, timeout_s: float) -> None:
        self._deadline = time.monotonic() + timeout_s
        self._next = RETRY_DELAY_S

    def wait(self) -> bool:
        """Waits before the next attempt; returns False if the deadline would pass."""
        if time.monotonic() + self._next >= self._deadline:
            return False
        time.sleep(self._next)
        self._next = min(2 * self._next, MAX_RETRY_DELAY_S)
        return True


class Session:
    """Session of one environment. It survives a lost connection: an unanswered message is sent again and executed once.

    Args:
        url: Address of the server.
        request: Fields of the message `open`.
        max_wait_s: Seconds for which an unreachable or full server is tried again.

    Raises:
        SessionError: The server rejects the request, or cannot be reached in time.
    """

    def __init__(self, url: str, request: dict[str, Any], max_wait_s: float) -> None:
        self._url = url
        # A proxy in front of several servers finds the one of the run by the path.
        run = request.get("run")
        self._path = f"/v1/runs/{quote(run, safe='')}/sessions" if run else "/v1/sessions"
        self._max_wait_s = max_wait_s
        self._message_id = 0
        self._socket: ClientConnection | None = None
        self._stack = contextlib.ExitStack()
        #: Answer to `open`: task, scenario, episode and the first observation.
        self.opened = self._send({"type": "open", "version": 2, **request})

    def step(self, action: dict[str, Any]) -> dict[str, Any]:
        """Runs one step; returns the message `stepped`.

        Raises:
            SessionError: The server rejects the action, no longer has the session, or cannot be reached in time.
        """
        self._message_id += 1
        return self._send({"type": "step", "id": self._message_id, "action": action})

    def close(self) -> None:
        """Ends the session; the server takes an unfinished episode back."""
        if self._socket is not None:
            with contextlib.suppress(WebSocketException, OSError):
                self._exchange(self._socket, {"type": "close"})
            self._disconnect()

    def _send(self, message: dict[str, Any]) -> dict[str, Any]:
        """Sends a message until the server answers it; resumes the session after a lost connection."""
        delays = _Delays(self._max_wait_s)
        while True:
            try:
                answer = self._exchange(self._connected(message), message)
            except (WebSocketException, OSError) as error:
                self._disconnect()
                if isinstance(error, InvalidStatus) and error.response.status_code not in BUSY_STATUSES:
                    raise SessionError("rejected", f"{self._url} rejects the session: {_read_reason(error)}") from error
                if not delays.wait():
                    reason = str(error) or type(error).__name__
                    detail = f"no server answers at {self._url}: {reason}; start one with `sparring serve`"
                    raise SessionError("unreachable", detail) from error
                continue
            if answer["type"] != "error":
                return answer
            if message["type"] == "open" or answer["code"] in ENDED_CODES:
                self._disconnect()
            if not (answer["retryable"] and delays.wait()):
                raise SessionError(answer["code"], answer["detail"], answer["field"])

    def _connected(self, message: dict[str, Any]) -> ClientConnection:
        """Returns the connection; makes and resumes it if it was lost."""
        if self._socket is None:
            self._socket = self._stack.enter_context(self._connect())
            if message["type"] != "open":
                resumed = self._exchange(self._socket, {"type": "resume", "session": self.opened["session"]})
                if resumed["type"] == "error":
                    self._disconnect()
                    raise SessionError(resumed["code"], resumed["detail"], resumed["field"])
        return self._socket

    def _connect(self) -> contextlib.AbstractContextManager[ClientConnection]:
        token, ca_file = read_token(None), read_ca_file(None)
        is_secure = self._url.startswith("https://")
        connection: contextlib.AbstractContextManager[ClientConnection] = connect(
            self._url.replace("http", "ws", 1) + self._path,
            max_size=None,
            additional_headers={"Authorization": f"Bearer {token}"} if token else {},
            ssl=ssl.create_default_context(cafile=ca_file) if is_secure else None,
            # A server on this machine is reached without a proxy.
            proxy=None if _native.is_loopback(self._url) else True,
        )
        return connection

    def _exchange(self, socket: ClientConnection, message: dict[str, Any]) -> dict[str, Any]:
        socket.send(json.dumps(message))
        answer: dict[str, Any] = json.loads(socket.recv(ANSWER_TIMEOUT_S))
        return answer

    def _disconnect(self) -> None:
        self._socket = None
        with contextlib.suppress(WebSocketException, OSError):
            self._stack.close()


def _read_reason(error: InvalidStatus) -> str:
    """Returns the message of a rejected connection."""
    try:
        return str(json.loads(error.response.body or b"")["detail"])
    except (ValueError, LookupError, TypeError):
        return str(error)
