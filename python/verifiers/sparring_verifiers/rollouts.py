"""Episodes of rollouts: beginning, finishing and failing them on the server."""

from __future__ import annotations

import atexit
import functools
import itertools
import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sparring.client import ApiError, Client, ServerUnreachableError

from .session import SessionError
from .session_episode import SessionEpisode

#: Code of the error of a lease whose episodes all have results.
LEASE_CLOSED = "lease_closed"

_logger = logging.getLogger(__name__)


class EpisodeSource:
    """Runs the episodes of rows on one server. Its methods are thread-safe, and block until the server answers.

    Args:
        url: Address of the server.
        max_wait_s: Seconds for which an unreachable server, or one without a free session, is tried again.
    """

    def __init__(self, url: str, max_wait_s: float) -> None:
        self._url = url
        self._max_wait_s = max_wait_s
        self._client = Client(url, retry_timeout_s=max_wait_s)
        atexit.register(self._client.close)

    def begin(self, row: Mapping[str, Any], max_debris: int) -> RunningEpisode:
        """Begins an episode of a row that no other rollout has. The server decides which, so any process can ask.

        Raises:
            ApiError: The server rejects a request.
            ServerUnreachableError: The server does not answer in time.
            SessionError: All episodes of the scenario have a result or are running, or the server cannot be reached in time.
        """
        episode = self._open(row, max_debris)
        begun = RunningEpisode(self, row, episode, {})
        try:
            begun.info.update(self._describe(row, episode))
        except BaseException as error:
            begun.fail(str(error))
            raise
        return begun

    def finish(self, episode: SessionEpisode, run: str) -> dict[str, Any]:
        """Ends an episode; returns its receipt and its outcome, both from the server's replay.

        Raises:
            ApiError: The server rejects a request.
            ServerUnreachableError: The server does not answer in time.
            SessionError: The server has no score of the episode.
        """
        receipt = episode.finish()
        stored = self._client.episodes.get(run, episode.episode)
        return {**(stored.get("outcome") or {}), **receipt, "invalid_calls": episode.invalid_calls}

    def fail(self, episode: SessionEpisode, row: Mapping[str, Any], reason: str) -> None:
        """Ends an episode that the infrastructure lost, which is never a low score.

        An episode of a run is reported as failed. One of an evaluation returns to its row, so that a later rollout runs it.
        """
        episode.abandon()
        if "evaluation" in row or episode.lease != row["lease"]:
            return
        result: Any = {"episode": episode.episode, "status": "failed", "reason": reason}
        try:
            self._client.results.report(row["run"], results=[result])
        except (ApiError, ServerUnreachableError) as error:
            _logger.warning("episode %s cannot be reported as failed; its lease expires: %s", episode.episode, error)

    def _open(self, row: Mapping[str, Any], max_debris: int) -> SessionEpisode:
        requests = _evaluation_requests(row) if "evaluation" in row else _training_requests(row)
        for request in requests:
            try:
                return SessionEpisode(self._url, {"run": row["run"], **request}, max_debris, self._max_wait_s)
            except SessionError as error:
                if error.field not in ("episode_id", "group_id") and error.code != LEASE_CLOSED:
                    raise
        wanted = f"`rollouts` must be the number of rollouts of a row, but {len(row.get('episodes', ()))} are already run"
        raise SessionError("no_episode_left", f"{wanted}; for another evaluation, load the environment again")

    def _describe(self, row: Mapping[str, Any], episode: SessionEpisode) -> dict[str, Any]:
        """Returns the ids, task and level of an episode, and whether the trainer should learn from it."""
        ids = {"run": row["run"], "lease": episode.lease, "episode": episode.episode, "scenario": episode.scenario}
        about = {**ids, "task": episode.task}
        if "evaluation" in row:
            return {**about, **{name: row[name] for name in ("evaluation", "part", "index")}}
        try:
            groups = self._client.leases.get(row["run"], episode.lease)["groups"]
        except ApiError:
            if episode.lease == row["lease"]:
                raise
            # With tokens, a lease that the server took for a named group belongs to the server.
            return about
        group = next(group for group in groups if group["scenario"] == episode.scenario)
        return {**about, "level": group.get("level"), "train": group["train"]}


@dataclass(frozen=True)
class RunningEpisode:
    """Episode of a rollout that has no result yet."""

    source: EpisodeSource
    row: Mapping[str, Any]
    episode: SessionEpisode
    #: Ids, task and level of the episode.
    info: dict[str, Any]

    def finish(self) -> dict[str, Any]:
        """Ends the episode; see `EpisodeSource.finish`."""
        return self.source.finish(self.episode, self.row["run"])

    def fail(self, reason: str) -> None:
        """Ends an episode that the infrastructure lost; see `EpisodeSource.fail`."""
        self.source.fail(self.episode, self.row, reason)


@functools.cache
def episode_source(url: str, max_wait_s: float) -> EpisodeSource:
    """Returns the source of a server, one for all rollouts of this process."""
    return EpisodeSource(url, max_wait_s)


def _evaluation_requests(row: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    return ({"lease_id": row["lease"], "episode_id": episode} for episode in row["episodes"])


def _training_requests(row: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yields the group of the row, then further groups by names that all processes share."""
    yield {"lease_id": row["lease"], "group_id": row["group"]}
    shared = {name: row[name] for name in ("group_size", "policy_version")}
    for number in itertools.count(2):
        yield {"group_id": f"{row['lease']}-{row['group']}-{number}", **shared}
