"""Typed clients for all operations of a server: `Client` blocks, `AsyncClient` is asynchronous."""

from __future__ import annotations

import asyncio
import json
import os
import random
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Any, NamedTuple
from urllib.parse import quote

try:
    import httpx
    import httpx_sse
except ImportError as error:
    raise ImportError("sparring.Client needs httpx and httpx-sse: pip install 'sparring[client]'") from error

from . import _native
from .api import operations
from .connection import read_ca_file, read_token, request_headers
from .curriculum import DEFAULT_URL
from .errors import invalid
from .scenario import to_json

#: Seconds before the first retry if the server names no delay; doubled after each retry.
RETRY_DELAY_S = 0.2
#: Maximum delay between retries, seconds.
MAX_RETRY_DELAY_S = 10.0
#: Timeouts of an event stream, in which the server sends a comment every few seconds.
STREAM_TIMEOUT = httpx.Timeout(30.0, read=60.0)
#: Statuses of a server that is busy or stopping.
BUSY_STATUSES = (429, 503)
#: Statuses of a proxy, or of a server that fails.
FAILURE_STATUSES = (408, 500, 502, 504)
#: Prefix of the server's own problem types. Except for `TIMED_OUT`, such a response means that the server changed nothing.
PROBLEM_PREFIX = "urn:sparring:problem:"
#: Problem type of a request that the server gave up: the client cannot know whether it was executed.
TIMED_OUT = "urn:sparring:problem:timed_out"


class ApiError(Exception):
    """The server rejected a request.

    Attributes:
        status: HTTP status.
        detail: Message of the server.
        field: Dotted path of the invalid field, if the server names one.
        problem: Complete problem details (RFC 9457).
    """

    def __init__(self, status: int, problem: dict[str, Any]) -> None:
        self.status = status
        self.problem = problem
        self.detail = str(problem.get("detail") or problem.get("title") or "")
        self.field: str | None = problem.get("field")
        super().__init__(f"{status}: {self.field + ': ' if self.field else ''}{self.detail}")


class ServerUnreachableError(Exception):
    """No server answers at the address of the client."""


class Event(NamedTuple):
    """Event of a run."""

    #: Number of the event; `events(after=…)` continues after it.
    id: int
    #: Kind of event, as `run` or `move`.
    kind: str
    #: Content of the event.
    data: Any


class _Connection:
    """Validated arguments of a client."""

    def __init__(
        self,
        url: str,
        token: str | None,
        ca_file: str | os.PathLike[str] | None,
        timeout_s: float,
        retry_timeout_s: float,
    ) -> None:
        try:
            parsed = httpx.URL(url)
        except (httpx.InvalidURL, TypeError) as error:
            raise invalid("url", f"an address such as {DEFAULT_URL}", url) from error
        if parsed.scheme not in ("http", "https") or not parsed.host:
            raise invalid("url", f"an address such as {DEFAULT_URL}", url)
        for name, value in (("timeout_s", timeout_s), ("retry_timeout_s", retry_timeout_s)):
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not value >= 0.0 or (name == "timeout_s" and value == 0):
                raise invalid(name, f"a number of seconds {'>' if name == 'timeout_s' else '>='} 0", value)
        token, ca_file = read_token(token), read_ca_file(ca_file)
        self.url = url.rstrip("/")
        self.retry_timeout_s = retry_timeout_s
        # A server on this machine is reached without a proxy.
        use_proxy = not _native.is_loopback(url)
        self.options: dict[str, Any] = {
            "base_url": self.url,
            "headers": request_headers(token),
            "timeout": timeout_s,
            "trust_env": use_proxy,
        }
        if ca_file is not None and parsed.scheme == "https":
            self.options["verify"] = _trust(ca_file)


def _trust(ca_file: str) -> ssl.SSLContext:
    """Returns TLS settings that trust only the certificate authorities of a file.

    Raises:
        ValueError: The file cannot be read, or has no certificate.
    """
    try:
        return ssl.create_default_context(cafile=ca_file)
    except (OSError, ssl.SSLError) as error:
        raise invalid("ca_file", f"a PEM file with certificates ({error})", ca_file) from error


class _RetryPolicy:
    """Decides whether and when to send a request again."""

    def __init__(self, connection: _Connection, is_repeatable: bool) -> None:
        self._url = connection.url
        self._deadline = time.monotonic() + connection.retry_timeout_s
        self._is_repeatable = is_repeatable
        self._next_delay = RETRY_DELAY_S

    def _delay(self, requested: float | None) -> float | None:
        # Random delays spread clients that were rejected at the same time.
        delay = requested if requested is not None else self._next_delay * random.uniform(0.5, 1.0)
        self._next_delay = min(2 * self._next_delay, MAX_RETRY_DELAY_S)
        return delay if time.monotonic() + delay < self._deadline else None

    def after_response(self, response: httpx.Response) -> float | None:
        """Returns the seconds to wait before a retry; None if the response is final.

        Raises:
            ApiError: The version of the server does not work with this package.
        """
        version = response.headers.get("sparring-version")
        if version is not None and (problem := _native.server_version_problem(version)):
            raise ApiError(response.status_code, {"detail": problem})
        header = response.headers.get("Retry-After", "")
        if response.status_code in BUSY_STATUSES and (self._is_repeatable or _changed_nothing(response)):
            return self._delay(float(header) if header.isdigit() else None)
        return self._delay(None) if response.status_code in FAILURE_STATUSES and self._is_repeatable else None

    def after_error(self, error: httpx.TransportError) -> float:
        """Returns the seconds to wait before a retry after a request without response.

        Raises:
            ServerUnreachableError: The request is not safe to repeat, or was repeated for long enough.
        """
        is_unsent = isinstance(error, (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout))
        delay = self._delay(None) if self._is_repeatable or is_unsent else None
        if delay is None:
            reason = str(error) or type(error).__name__
            raise ServerUnreachableError(
                f"no server answers at {self._url}: {reason}; start one with `sparring serve`"
            ) from error
        return delay


class Client(operations.Operations):
    """Client that blocks until the server answers.

    Operations are grouped by resource: `client.runs.create(tasks=[…])`, `client.leases.create(run, groups=64)`. Arguments and
    results are those of the API, as typed dictionaries. Requests that are safe to repeat are repeated while the server is
    unreachable or busy, for up to `retry_timeout_s`: results, claims and acknowledgements count once.

    Args:
        url: Address of the server.
        token: Token (default `SPARRING_TOKEN`).
        ca_file: PEM file with the certificate authorities to trust for an https server (default `SPARRING_CA_FILE`, else those of
            the package certifi).
        timeout_s: Timeout of one request, seconds.
        retry_timeout_s: Time after which a request is not repeated any more, seconds.

    Raises:
        ApiError: The server rejects a request.
        ServerUnreachableError: The server does not answer.
        ValueError: The URL, the token, the file of certificate authorities or a timeout is invalid.
    """

    def __init__(
        self,
        url: str = DEFAULT_URL,
        *,
        token: str | None = None,
        ca_file: str | os.PathLike[str] | None = None,
        timeout_s: float = 60.0,
        retry_timeout_s: float = 60.0,
    ) -> None:
        self._connection = _Connection(url, token, ca_file, timeout_s, retry_timeout_s)
        self._http = httpx.Client(**self._connection.options)
        self._bind(self._send)

    def _send(self, method: str, path: str, query: dict[str, Any], body: Any, *, is_repeatable: bool) -> Any:
        retries = _RetryPolicy(self._connection, is_repeatable)
        while True:
            try:
                response = self._http.request(method, path, params=_without_none(query), **_encode(body))
                delay = retries.after_response(response)
            except httpx.TransportError as error:
                time.sleep(retries.after_error(error))
                continue
            if delay is None:
                return _read(response)
            time.sleep(delay)

    def paginate(self, operation: Callable[..., Any], *args: Any, **query: Any) -> Iterator[Any]:
        """Yields the items of all pages of an operation: `client.paginate(client.runs.list, archived=True)`.

        Items of shards whose servers do not answer are left out; `missing_shards` of a page names these shards.

        Raises:
            ValueError: The operation has no pages.
        """
        cursor = None
        while True:
            page = operation(*args, **query, cursor=cursor)
            yield from _items(page)
            cursor = page.get("next")
            if cursor is None:
                return

    def events(self, run: str, *, after: int | None = None) -> Iterator[Event]:
        """Yields the events of a run without end; reconnects after a lost connection and misses no event.

        Args:
            run: Id of the run.
            after: Number of the event to continue after (default: only new events).

        Raises:
            ApiError: The server rejects the request.
            ServerUnreachableError: The connection stays lost for `retry_timeout_s`.
        """
        last, retries = after, _RetryPolicy(self._connection, is_repeatable=True)
        while True:
            connected = False
            try:
                with httpx_sse.connect_sse(self._http, **_stream_request(run, last)) as stream:
                    delay = retries.after_response(stream.response)
                    if delay is None:
                        if not stream.response.is_success:
                            stream.response.read()
                            _read(stream.response)
                        connected = True
                        for message in stream.iter_sse():
                            last = int(message.id) if message.id else last
                            event = _read_event(message)
                            if event is not None:
                                yield event
                        retries, delay = _RetryPolicy(self._connection, is_repeatable=True), RETRY_DELAY_S
            except httpx.TransportError as error:
                # The time to retry begins when the connection is lost, even if the last event is much older.
                retries = _RetryPolicy(self._connection, is_repeatable=True) if connected else retries
                delay = retries.after_error(error)
            time.sleep(delay)

    def close(self) -> None:
        """Closes all connections to the server."""
        self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class AsyncClient(operations.AsyncOperations):
    """Asynchronous client; see `Client` for arguments, operations and errors."""

    def __init__(
        self,
        url: str = DEFAULT_URL,
        *,
        token: str | None = None,
        ca_file: str | os.PathLike[str] | None = None,
        timeout_s: float = 60.0,
        retry_timeout_s: float = 60.0,
    ) -> None:
        self._connection = _Connection(url, token, ca_file, timeout_s, retry_timeout_s)
        self._http = httpx.AsyncClient(**self._connection.options)
        self._bind(self._send)

    async def _send(self, method: str, path: str, query: dict[str, Any], body: Any, *, is_repeatable: bool) -> Any:
        retries = _RetryPolicy(self._connection, is_repeatable)
        while True:
            try:
                response = await self._http.request(method, path, params=_without_none(query), **_encode(body))
                delay = retries.after_response(response)
            except httpx.TransportError as error:
                await asyncio.sleep(retries.after_error(error))
                continue
            if delay is None:
                return _read(response)
            await asyncio.sleep(delay)

    async def paginate(self, operation: Callable[..., Awaitable[Any]], *args: Any, **query: Any) -> AsyncIterator[Any]:
        """Yields the items of all pages of an operation; see `Client.paginate`."""
        cursor = None
        while True:
            page = await operation(*args, **query, cursor=cursor)
            for item in _items(page):
                yield item
            cursor = page.get("next")
            if cursor is None:
                return

    async def events(self, run: str, *, after: int | None = None) -> AsyncIterator[Event]:
        """Yields the events of a run; see `Client.events`."""
        last, retries = after, _RetryPolicy(self._connection, is_repeatable=True)
        while True:
            connected = False
            try:
                async with httpx_sse.aconnect_sse(self._http, **_stream_request(run, last)) as stream:
                    delay = retries.after_response(stream.response)
                    if delay is None:
                        if not stream.response.is_success:
                            await stream.response.aread()
                            _read(stream.response)
                        connected = True
                        async for message in stream.aiter_sse():
                            last = int(message.id) if message.id else last
                            event = _read_event(message)
                            if event is not None:
                                yield event
                        retries, delay = _RetryPolicy(self._connection, is_repeatable=True), RETRY_DELAY_S
            except httpx.TransportError as error:
                retries = _RetryPolicy(self._connection, is_repeatable=True) if connected else retries
                delay = retries.after_error(error)
            await asyncio.sleep(delay)

    async def aclose(self) -> None:
        """Closes all connections to the server."""
        await self._http.aclose()

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()


def _encode(body: Any) -> dict[str, Any]:
    return {} if body is None else {"content": to_json("body", body), "headers": {"Content-Type": "application/json"}}


def _without_none(query: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in query.items() if value is not None}


def _read(response: httpx.Response) -> Any:
    """Returns the JSON of a response, or raises its error."""
    if response.is_success:
        try:
            return response.json() if response.content else None
        except ValueError as error:
            detail = (
                f"the response must be JSON, got {response.text[:200]!r}; check that `url` is the address of a sparring server"
            )
            raise ApiError(response.status_code, {"detail": detail}) from error
    try:
        problem = response.json()
    except ValueError:
        problem = {"detail": response.text[:500]}
    raise ApiError(response.status_code, problem if isinstance(problem, dict) else {"detail": str(problem)})


def _changed_nothing(response: httpx.Response) -> bool:
    try:
        kind = response.json()["type"]
    except (ValueError, LookupError, TypeError):
        return False
    return isinstance(kind, str) and kind.startswith(PROBLEM_PREFIX) and kind != TIMED_OUT


def _items(page: dict[str, Any]) -> list[Any]:
    lists = [value for key, value in page.items() if isinstance(value, list) and key != "missing_shards"]
    if len(lists) != 1:
        raise ValueError(f"`operation` must be one that returns pages of items, but its response has {len(lists)} lists")
    return lists[0]


def _read_event(message: httpx_sse.ServerSentEvent) -> Event | None:
    # A message with only an id, or the comment that keeps a stream open, has no data (WHATWG HTML, 9.2.6).
    return Event(int(message.id), message.event, json.loads(message.data)) if message.data else None


def _stream_request(run: str, after: int | None) -> dict[str, Any]:
    path = f"/v1/runs/{quote(run, safe='')}/events"
    return {"method": "GET", "url": path, "params": {} if after is None else {"after": after}, "timeout": STREAM_TIMEOUT}
