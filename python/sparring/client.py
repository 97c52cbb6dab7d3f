"""Clients for all of a server's API: `Client` waits, `AsyncClient` is awaited."""

from __future__ import annotations

import asyncio
import json
import random
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
from .curriculum import plain_token
from .scenario import to_json

#: Seconds before asking again the first time, where the server does not say; twice as long each time after.
PAUSE_S = 0.2
#: Longest of these.
LONGEST_S = 10.0
#: A server with nothing to tell says that it lives every few seconds.
STREAM = httpx.Timeout(30.0, read=60.0)
#: Answers by which a server says that the same question may be answered later.
LATER = (429, 503)
#: What the server itself says so of has changed nothing, but for this: it was too slow, and whether it was done is not known.
PROBLEM, TIMED_OUT = "urn:sparring:problem:", "urn:sparring:problem:timed_out"
#: Answers of what is between here and the server, or of a server that fails.
BROKEN = (408, 500, 502, 504)


class ApiError(Exception):
    """What a server refuses, in its words.

    Attributes:
        status: HTTP's number.
        detail: One sentence.
        field: The field at fault, as a dotted path, where it is one.
        problem: All of the problem details (RFC 9457).
    """

    def __init__(self, status: int, problem: dict[str, Any]) -> None:
        self.status = status
        self.problem = problem
        self.detail = str(problem.get("detail") or problem.get("title") or "")
        self.field: str | None = problem.get("field")
        super().__init__(f"{status}: {self.field + ': ' if self.field else ''}{self.detail}")


class Unreachable(Exception):
    """Nobody answered, however often asked."""


class Event(NamedTuple):
    """What happened in a run."""

    #: Its number; `events(after=…)` goes on behind it.
    id: int
    #: What kind of thing.
    kind: str
    #: What exactly.
    data: Any


class _Setup:
    """What both clients are made with."""

    def __init__(self, url: str, token: str | None, timeout_s: float, patience_s: float) -> None:
        try:
            plain = httpx.URL(url)
        except (httpx.InvalidURL, TypeError) as error:
            raise ValueError(f"url: {url!r} is none: {error}") from error
        if plain.scheme not in ("http", "https") or not plain.host:
            raise ValueError(f"url: {url!r} is no address like http://127.0.0.1:8700")
        for name, value in (("timeout_s", timeout_s), ("patience_s", patience_s)):
            # Nothing is no patience, but no time either.
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not value >= 0.0 or (name == "timeout_s" and value == 0):
                raise ValueError(f"{name}: {value!r} is no number of seconds")
        token = plain_token(token)
        headers = {"Accept": "application/json", **({"Authorization": f"Bearer {token}"} if token else {})}
        self.url = url.rstrip("/")
        self.patience_s = patience_s
        # What is on this machine no proxy finds.
        away = not _native.is_local(url)
        self.options: dict[str, Any] = {"base_url": self.url, "headers": headers, "timeout": timeout_s, "trust_env": away}


def _content(body: Any) -> dict[str, Any]:
    return {} if body is None else {"content": to_json("body", body), "headers": {"Content-Type": "application/json"}}


def _present(query: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in query.items() if value is not None}


def _read(answer: httpx.Response) -> Any:
    if answer.is_success:
        try:
            return answer.json() if answer.content else None
        except ValueError as error:
            raise ApiError(answer.status_code, {"detail": f"no JSON came back: {answer.text[:200]}"}) from error
    try:
        problem = answer.json()
    except ValueError:
        problem = {"detail": answer.text[:500]}
    raise ApiError(answer.status_code, problem if isinstance(problem, dict) else {"detail": str(problem)})


def _undone(answer: httpx.Response) -> bool:
    try:
        kind = answer.json()["type"]
    except (ValueError, LookupError, TypeError):
        return False
    return isinstance(kind, str) and kind.startswith(PROBLEM) and kind != TIMED_OUT


class _Patience:
    """Whether to ask again, and when."""

    def __init__(self, most_s: float, again: bool) -> None:
        self._until = time.monotonic() + most_s
        self._again = again
        self._pause = PAUSE_S

    def _wait(self, seconds: float | None) -> float | None:
        # Spread, so that those who were refused together do not come back together.
        wait = seconds if seconds is not None else self._pause * random.uniform(0.5, 1.0)
        self._pause = min(2 * self._pause, LONGEST_S)
        return wait if time.monotonic() + wait < self._until else None

    def after(self, answer: httpx.Response) -> float | None:
        """Seconds to wait after this answer; none: it is the last word."""
        told = answer.headers.get("Retry-After", "")
        if answer.status_code in LATER and (self._again or _undone(answer)):
            return self._wait(float(told) if told.isdigit() else None)
        return self._wait(None) if answer.status_code in BROKEN and self._again else None

    def without(self, error: httpx.TransportError) -> float:
        """Seconds to wait where there is no answer.

        Raises:
            Unreachable: The question may not be asked again, or was for long enough.
        """
        unsent = isinstance(error, (httpx.ConnectError, httpx.ConnectTimeout, httpx.PoolTimeout))
        wait = self._wait(None) if self._again or unsent else None
        if wait is None:
            raise Unreachable(f"no answer: {error or type(error).__name__}") from error
        return wait


def _items(page: dict[str, Any]) -> list[Any]:
    lists = [value for value in page.values() if isinstance(value, list)]
    if len(lists) != 1:
        raise ValueError(f"operation: it answers {len(lists)} lists: ask page by page")
    return lists[0]


def _event(told: httpx_sse.ServerSentEvent) -> Event | None:
    # An id alone, or the comment that keeps a stream open, comes as an event without data, which is none (WHATWG HTML, 9.2.6).
    return Event(int(told.id), told.event, json.loads(told.data)) if told.data else None


def _stream(run: str, after: int | None) -> dict[str, Any]:
    path = f"/v1/runs/{quote(run, safe='')}/events"
    return {"method": "GET", "url": path, "params": {} if after is None else {"after": after}, "timeout": STREAM}


class Client(operations.Operations):
    """Asks a server, and waits for its answer.

    Operations are grouped by what they are about: `client.runs.create(tasks=[…])`, `client.leases.take(run, groups=64)`. They
    take what the API takes and answer what it answers, as typed dictionaries. What is safe to ask again is asked again while
    the server is away or busy, up to `patience_s`: results, claims and acknowledgements count once, however often they come.

    Args:
        url: Where the server is.
        token: Where the server wants one; `SPARRING_TOKEN` unless told.
        timeout_s: Of one question.
        patience_s: Of a question asked again and again.

    Raises:
        ApiError: What the server refuses.
        Unreachable: Nobody answers.
        ValueError: A URL or a token that is none.
    """

    def __init__(
        self, url: str = "http://127.0.0.1:8700", *, token: str | None = None, timeout_s: float = 60.0, patience_s: float = 60.0
    ) -> None:
        self._setup = _Setup(url, token, timeout_s, patience_s)
        self._http = httpx.Client(**self._setup.options)
        self._begin(self._ask)

    def _ask(self, method: str, path: str, query: dict[str, Any], body: Any, *, again: bool) -> Any:
        patience = _Patience(self._setup.patience_s, again)
        while True:
            try:
                answer = self._http.request(method, path, params=_present(query), **_content(body))
                wait = patience.after(answer)
            except httpx.TransportError as error:
                time.sleep(patience.without(error))
                continue
            if wait is None:
                return _read(answer)
            time.sleep(wait)

    def every(self, operation: Callable[..., Any], *args: Any, **query: Any) -> Iterator[Any]:
        """All items of an operation that answers page by page: `client.every(client.runs.list, archived=True)`."""
        cursor = None
        while True:
            page = operation(*args, **query, cursor=cursor)
            yield from _items(page)
            cursor = page.get("next")
            if cursor is None:
                return

    def events(self, run: str, *, after: int | None = None) -> Iterator[Event]:
        """What happens in a run from now on, or from behind an event; goes on where it was when the connection drops."""
        last, patience = after, _Patience(self._setup.patience_s, True)
        while True:
            connected = False
            try:
                with httpx_sse.connect_sse(self._http, **_stream(run, last)) as stream:
                    wait = patience.after(stream.response)
                    if wait is None:
                        if not stream.response.is_success:
                            stream.response.read()
                            _read(stream.response)
                        connected = True
                        for told in stream.iter_sse():
                            last = int(told.id) if told.id else last
                            event = _event(told)
                            if event is not None:
                                yield event
                        patience, wait = _Patience(self._setup.patience_s, True), PAUSE_S
            except httpx.TransportError as error:
                # It counts from where the connection dropped, however long nothing had happened by then.
                patience = _Patience(self._setup.patience_s, True) if connected else patience
                wait = patience.without(error)
            time.sleep(wait)

    def close(self) -> None:
        """Lets its connections go."""
        self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class AsyncClient(operations.AsyncOperations):
    """The same as `Client`, to be awaited."""

    def __init__(
        self, url: str = "http://127.0.0.1:8700", *, token: str | None = None, timeout_s: float = 60.0, patience_s: float = 60.0
    ) -> None:
        self._setup = _Setup(url, token, timeout_s, patience_s)
        self._http = httpx.AsyncClient(**self._setup.options)
        self._begin(self._ask)

    async def _ask(self, method: str, path: str, query: dict[str, Any], body: Any, *, again: bool) -> Any:
        patience = _Patience(self._setup.patience_s, again)
        while True:
            try:
                answer = await self._http.request(method, path, params=_present(query), **_content(body))
                wait = patience.after(answer)
            except httpx.TransportError as error:
                await asyncio.sleep(patience.without(error))
                continue
            if wait is None:
                return _read(answer)
            await asyncio.sleep(wait)

    async def every(self, operation: Callable[..., Awaitable[Any]], *args: Any, **query: Any) -> AsyncIterator[Any]:
        """All items of an operation that answers page by page."""
        cursor = None
        while True:
            page = await operation(*args, **query, cursor=cursor)
            for item in _items(page):
                yield item
            cursor = page.get("next")
            if cursor is None:
                return

    async def events(self, run: str, *, after: int | None = None) -> AsyncIterator[Event]:
        """What happens in a run from now on, or from behind an event; goes on where it was when the connection drops."""
        last, patience = after, _Patience(self._setup.patience_s, True)
        while True:
            connected = False
            try:
                async with httpx_sse.aconnect_sse(self._http, **_stream(run, last)) as stream:
                    wait = patience.after(stream.response)
                    if wait is None:
                        if not stream.response.is_success:
                            await stream.response.aread()
                            _read(stream.response)
                        connected = True
                        async for told in stream.aiter_sse():
                            last = int(told.id) if told.id else last
                            event = _event(told)
                            if event is not None:
                                yield event
                        patience, wait = _Patience(self._setup.patience_s, True), PAUSE_S
            except httpx.TransportError as error:
                patience = _Patience(self._setup.patience_s, True) if connected else patience
                wait = patience.without(error)
            await asyncio.sleep(wait)

    async def aclose(self) -> None:
        """Lets its connections go."""
        await self._http.aclose()

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()
