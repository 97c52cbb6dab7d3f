"""Trajectory feed of a run, read from NATS JetStream by a durable consumer.

    import sparring

    with sparring.feed.nats("nats://127.0.0.1:4222", "my-run", consumer="trainer") as feed:
        for group in feed:                  # acknowledges the group before
            learn(group)

A group is the one that `GET /v1/runs/{run}/trajectories` returns. Trainers with the same `consumer` share the groups of the run;
each further name of a consumer receives all of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import threading
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any, TypeVar

from .feed_options import check_idle, check_options, stream_name

if TYPE_CHECKING:
    from nats.aio.msg import Msg

    from .api.types import DeliveredGroup

#: Header of a message whose group is in the object store.
OBJECT_HEADER = "Sparring-Object"
#: Longest request for a group, seconds; then it is repeated.
REQUEST_S = 5.0
#: Timeout of other requests to NATS, seconds.
TIMEOUT_S = 10.0
#: Pause before a failed request is repeated, seconds.
RETRY_S = 0.5
#: How long a stream may be missing while the server creates it again, and a user while NATS is configured, seconds.
MISSING_S = 60.0
#: Number of acknowledged groups that are known, so that none of them is delivered again.
KNOWN_GROUPS = 100_000

_Result = TypeVar("_Result")


class FeedError(Exception):
    """The feed of a run cannot be read from NATS."""


def nats(
    server: str,
    run: str,
    *,
    consumer: str = "trainer",
    cluster: str = "default",
    credentials: str | os.PathLike[str] | None = None,
    ca_file: str | os.PathLike[str] | None = None,
    idle_s: float | None = None,
    ack_wait_s: float = 30.0,
    forget_after_s: float = 86_400.0,
) -> NatsFeed:
    """Opens the feed of a run for a trainer that blocks.

    Args:
        server: Address of the NATS server, such as nats://127.0.0.1:4222 or tls://nats.example.com; several of a cluster with
            commas between them.
        run: Id of the run, with its shard if it has one; its policy needs `"delivery": "nats"`.
        consumer: Name of the durable consumer. Trainers with the same name share the groups.
        cluster: Name of the servers (`sparring serve --nats-name`).
        credentials: File with the credentials of a NATS account (.creds) or the seed of an nkey (SU…).
        ca_file: File with the certificate authorities of the NATS server, in PEM. With it, or with an address tls://, the
            connection is encrypted, or fails.
        idle_s: Ends the iteration after so many seconds without a group; None waits for ever.
        ack_wait_s: Time after which NATS delivers the group of a dead trainer again, 1 to 31 536 000 seconds (a year).
            While this process lives, it keeps its group.
        forget_after_s: Time without this trainer after which NATS forgets the consumer, 1 to 31 536 000 seconds (a year).
            Until then, groups wait for it, and the feed fills up.

    Raises:
        FeedError: NATS cannot be reached or rejects the user, or the run has no feed on it.
        ImportError: The package nats-py is missing, or nkeys, which `credentials` need.
        ValueError: A value is out of range, or a file cannot be used; the message names the argument.
    """
    options: dict[str, Any] = {"consumer": consumer, "cluster": cluster, "credentials": credentials, "ca_file": ca_file}
    options |= {"idle_s": idle_s, "ack_wait_s": ack_wait_s, "forget_after_s": forget_after_s}
    return NatsFeed(AsyncNatsFeed(server, run, **options))


class AsyncNatsFeed:
    """Asynchronous feed: `async with AsyncNatsFeed(server, run) as feed: async for group in feed: …`. Arguments as for `nats`."""

    def __init__(
        self,
        server: str,
        run: str,
        *,
        consumer: str = "trainer",
        cluster: str = "default",
        credentials: str | os.PathLike[str] | None = None,
        ca_file: str | os.PathLike[str] | None = None,
        idle_s: float | None = None,
        ack_wait_s: float = 30.0,
        forget_after_s: float = 86_400.0,
    ) -> None:
        names = {"run": run, "consumer": consumer, "cluster": cluster}
        check_options(server, names, {"ack_wait_s": ack_wait_s, "forget_after_s": forget_after_s})
        check_idle(idle_s)
        self._run, self._consumer, self._cluster = run, consumer, cluster
        self._idle_s, self._ack_wait_s, self._forget_after_s = idle_s, ack_wait_s, forget_after_s
        self._stream = stream_name(cluster, run)
        try:
            from .feed_connection import NatsConnection

            self._client = NatsConnection(server, credentials, ca_file)
        except ImportError as error:
            raise ImportError(
                "sparring.feed.nats needs nats-py, and nkeys for `credentials`: pip install 'sparring[nats]'"
            ) from error
        self._js = self._client.jetstream(timeout=TIMEOUT_S)
        self._subscription: Any = None
        self._held: Msg | None = None
        self._held_id = 0
        self._keeper: asyncio.Task[None] | None = None
        self._acknowledged: dict[int, None] = {}

    async def open(self) -> None:
        """Connects, and creates the consumer if it does not exist. `async with` calls it.

        Raises:
            FeedError: NATS cannot be reached or rejects the user, or the run has no feed on it.
        """
        from nats.js.errors import NotFoundError

        try:
            await self._client.open()
            await self._subscribe()
        except NotFoundError as error:
            await self._client.close()
            raise FeedError(
                f'the run {self._run} has no feed on NATS: set its policy with `"delivery": "nats"`, and check `cluster`'
            ) from error
        except Exception as error:
            await self._client.close()
            raise FeedError(f"the feed of the run {self._run} cannot be opened: {self._client.explain(error)}") from error

    async def close(self) -> None:
        """Returns the group that is not acknowledged to the other trainers of the consumer, and disconnects."""
        await self.release()
        with contextlib.suppress(Exception):
            await asyncio.wait_for(self._client.flush(), TIMEOUT_S)
        await self._client.close()

    async def receive(self, timeout_s: float | None = None) -> DeliveredGroup | None:
        """Acknowledges the group before, and waits for the next one.

        Args:
            timeout_s: Longest wait in seconds; None waits for ever.

        Returns:
            The group, or None after the timeout.

        Raises:
            FeedError: The run has no feed on NATS any more, or NATS does not know the user any more.
        """
        await self.acknowledge()
        loop = asyncio.get_running_loop()
        ends_at = None if timeout_s is None else loop.time() + timeout_s
        while True:
            left = REQUEST_S if ends_at is None else ends_at - loop.time()
            if left <= 0.0:
                return None
            message = await self._fetch(min(left, REQUEST_S))
            if message is None:
                self._check_connection()
            group = None if message is None else await self._accept(message)
            if group is not None:
                return group

    async def acknowledge(self) -> bool:
        """Acknowledges the current group: the trainer has used it. Returns False if NATS did not confirm it in time.

        A group that is not confirmed does not come again in this process: it is acknowledged when NATS delivers it the next time.
        """
        message, self._held = self._held, None
        if message is None:
            return True
        self._stop_keeping()
        self._acknowledged[self._held_id] = None
        if len(self._acknowledged) > KNOWN_GROUPS:
            del self._acknowledged[next(iter(self._acknowledged))]
        return await _confirm(message)

    async def release(self) -> None:
        """Returns the current group unused: NATS delivers it again, without waiting for `ack_wait_s`; others may come before."""
        message, self._held = self._held, None
        self._stop_keeping()
        if message is not None:
            with contextlib.suppress(Exception):
                await message.nak()

    async def state(self) -> dict[str, Any] | None:
        """Reads the state of the run: `state`, `policy_version`, `policy` and `version`. None if the run was deleted."""
        from nats.js.errors import KeyNotFoundError

        bucket = await self._js.key_value(f"SPARRING_{self._cluster}_RUNS")
        try:
            entry = await bucket.get(f"runs.{self._run}")
        except KeyNotFoundError:
            return None
        state: dict[str, Any] = json.loads(entry.value or b"null")
        return state

    async def __aenter__(self) -> AsyncNatsFeed:
        await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __aiter__(self) -> AsyncNatsFeed:
        return self

    async def __anext__(self) -> DeliveredGroup:
        group = await self.receive(self._idle_s)
        if group is None:
            raise StopAsyncIteration
        return group

    async def _subscribe(self) -> None:
        """Creates the durable consumer if it does not exist, and subscribes to its messages."""
        from nats.js.api import AckPolicy, ConsumerConfig, DeliverPolicy

        config = ConsumerConfig(
            name=self._consumer,
            durable_name=self._consumer,
            deliver_policy=DeliverPolicy.ALL,
            ack_policy=AckPolicy.EXPLICIT,
            ack_wait=self._ack_wait_s,
            inactive_threshold=self._forget_after_s,
        )
        await self._js.add_consumer(self._stream, config)
        self._subscription = await self._js.pull_subscribe_bind(consumer=self._consumer, stream=self._stream)

    async def _fetch(self, timeout_s: float) -> Msg | None:
        """Requests one message; None if none arrives in time, or NATS is away."""
        from nats.errors import TimeoutError as NatsTimeoutError

        try:
            messages: list[Msg] = await self._subscription.fetch(1, timeout=timeout_s)
            return messages[0]
        except (NatsTimeoutError, asyncio.TimeoutError):
            return None
        except Exception:
            # NATS is away, or has lost its data, so that the consumer is missing.
            await self._recover()
            return None

    def _check_connection(self) -> None:
        """Raises FeedError if the connection does not open again."""
        reason = self._client.reason_of_end(MISSING_S)
        if reason is not None:
            raise FeedError(f"the feed of the run {self._run} ended: {reason}")

    async def _recover(self) -> None:
        """Subscribes again after a failure of NATS.

        Raises:
            FeedError: The stream does not exist any more, or NATS has ended the connection for good.
        """
        from nats.js.errors import NotFoundError

        loop = asyncio.get_running_loop()
        missing_since: float | None = None
        while True:
            await asyncio.sleep(RETRY_S)
            self._check_connection()
            try:
                return await self._subscribe()
            except NotFoundError as error:
                missing_since = loop.time() if missing_since is None else missing_since
                if loop.time() - missing_since > MISSING_S:
                    raise FeedError(f"the run {self._run} has no feed on NATS any more") from error
            except Exception:
                missing_since = None  # the client connects again by itself

    async def _accept(self, message: Msg) -> DeliveredGroup | None:
        """Reads the group of a message and holds it; None if this process has acknowledged it, or if it is gone."""
        headers = message.headers or {}
        id = int(headers.get("Nats-Msg-Id", 0))
        if id in self._acknowledged:
            await _confirm(message)
            return None
        self._held, self._held_id = message, id
        self._keeper = asyncio.create_task(self._keep(message))
        data = message.data
        if OBJECT_HEADER in headers:
            try:
                bucket = await self._js.object_store(self._stream)
                found = await asyncio.wait_for(bucket.get(headers[OBJECT_HEADER]), 6 * TIMEOUT_S)
            except Exception:
                # Other trainers have acknowledged the group meanwhile, or NATS is away.
                self._held = None
                self._stop_keeping()
                with contextlib.suppress(Exception):
                    await message.nak(delay=1)
                return None
            data = found.data or b""
        group: DeliveredGroup = json.loads(data)
        group["deliveries"] = message.metadata.num_delivered
        return group

    async def _keep(self, message: Msg) -> None:
        """Tells NATS that the trainer works on a group, so that no other trainer gets it."""
        while True:
            await asyncio.sleep(self._ack_wait_s / 3)
            with contextlib.suppress(Exception):
                await message.in_progress()

    def _stop_keeping(self) -> None:
        if self._keeper is not None:
            self._keeper.cancel()
            self._keeper = None


class NatsFeed:
    """Feed that blocks, as `nats` opens it: an iterator of groups. It acknowledges a group when the next one is requested."""

    def __init__(self, feed: AsyncNatsFeed) -> None:
        self._feed = feed
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="sparring-feed", daemon=True)
        self._thread.start()
        try:
            self._call(feed.open())
        except BaseException:
            self._stop()
            raise

    def __iter__(self) -> NatsFeed:
        return self

    def __next__(self) -> DeliveredGroup:
        try:
            return self._call(self._feed.__anext__())
        except StopAsyncIteration:
            raise StopIteration from None

    def receive(self, timeout_s: float | None = None) -> DeliveredGroup | None:
        """Acknowledges the group before, and waits for the next one; returns None after `timeout_s` seconds."""
        return self._call(self._feed.receive(timeout_s))

    def acknowledge(self) -> bool:
        """Acknowledges the current group before the next one is requested. Returns False if NATS did not confirm it in time."""
        return self._call(self._feed.acknowledge())

    def release(self) -> None:
        """Returns the current group unused: NATS delivers it again, without waiting for `ack_wait_s`; others may come before."""
        self._call(self._feed.release())

    def state(self) -> dict[str, Any] | None:
        """Reads the state of the run: `state`, `policy_version`, `policy` and `version`. None if the run was deleted."""
        return self._call(self._feed.state())

    def close(self) -> None:
        """Returns the group that is not acknowledged to the other trainers of the consumer, and disconnects."""
        if self._thread.is_alive():
            self._call(self._feed.close())
            self._stop()

    def __enter__(self) -> NatsFeed:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _call(self, call: Coroutine[Any, Any, _Result]) -> _Result:
        if not self._thread.is_alive():
            call.close()
            raise FeedError("the feed is closed")
        future = asyncio.run_coroutine_threadsafe(call, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def _stop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _confirm(message: Msg) -> bool:
    """Acknowledges a message, and waits for the confirmation of NATS. Returns False if there is none."""
    try:
        await message.ack_sync(timeout=TIMEOUT_S)
    except Exception:
        return False
    return True
