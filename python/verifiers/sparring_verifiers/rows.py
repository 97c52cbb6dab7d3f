"""Rows of the dataset, in the process that reads it: groups of a run's curriculum, or scenarios of an evaluation."""

from __future__ import annotations

import atexit
import logging
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

from sparring.client import ApiError, Client, ServerUnreachableError
from sparring.curriculum_arguments import MAX_GROUP_EPISODES
from sparring.evaluation import MAX_EVALUATION_LEASE_GROUPS

#: Lifetime of the leases, seconds: the maximum. Rows may wait for hours until their rollouts begin.
LEASE_TTL_S = 86_400
#: Seconds for which the server is tried when the rows are closed.
CLOSE_TIMEOUT_S = 5.0
#: Maximum number of active leases of a run.
MAX_ACTIVE_LEASES = 1024
#: Problem type of a lease that has ended.
LEASE_CLOSED = "urn:sparring:problem:lease_closed"

_logger = logging.getLogger(__name__)


class LeasedRows:
    """Leases whose groups are rows of the dataset. They are released by `close`, at the latest when this process ends.

    Args:
        url: Address of the server.
        max_wait_s: Seconds for which an unreachable server is tried again.
    """

    def __init__(self, url: str, max_wait_s: float) -> None:
        self._url = url
        self._client = Client(url, retry_timeout_s=max_wait_s)
        self._run = ""
        # Older leases have ended: a run has no more active ones.
        self._leases: deque[str] = deque(maxlen=MAX_ACTIVE_LEASES)
        self._evaluation: str | None = None
        atexit.register(self.close)

    def train(self, run: str, *, group_size: int, lease_groups: int, policy_version: int | None) -> Iterator[dict[str, Any]]:
        """Yields groups of a run without end. The curriculum chooses their scenarios when they are leased.

        Args:
            run: Id of the run.
            group_size: Number of rollouts of a row.
            lease_groups: Number of groups of a lease.
            policy_version: Policy version of the episodes; None for the newest of the run at that time.

        Raises:
            ApiError: The server rejects a request.
            ServerUnreachableError: The server does not answer.
        """
        while True:
            version = self._client.runs.get(run)["policy_version"] if policy_version is None else policy_version
            # Groups whose rollouts never begin return to the curriculum without loss.
            lease = self._lease(run, groups=lease_groups, group_size=group_size, policy_version=version, disclosure="begin")
            for number in range(lease_groups):
                yield {
                    "run": run,
                    "lease": lease["lease"],
                    "group": f"group-{number}",
                    "group_size": group_size,
                    "policy_version": version,
                }

    def evaluate(self, run: str, request: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        """Creates an evaluation and yields its scenarios, in the order of the suite.

        Args:
            run: Run whose policy is evaluated.
            request: Other fields of `POST /v1/evaluations`.

        Raises:
            ApiError: The server rejects a request.
            ServerUnreachableError: The server does not answer.
        """
        evaluation = self._client.evaluations.create(run=run, **request)
        self._evaluation = evaluation["id"]
        page = self._client.paginate(self._client.evaluations.list_evaluation_scenarios, evaluation["id"], limit=500)
        scenarios = {scenario["scenario_id"]: scenario for scenario in page}
        groups = max(1, min(MAX_EVALUATION_LEASE_GROUPS, MAX_GROUP_EPISODES // evaluation["rollouts"]))
        for start in range(0, evaluation["scenarios"], groups):
            count = min(groups, evaluation["scenarios"] - start)
            lease = self._lease(run, groups=count, purpose="eval", evaluation=evaluation["id"])
            for group in lease["groups"]:
                scenario = scenarios[group["scenario"]]
                yield {
                    "run": run,
                    "lease": lease["lease"],
                    "episodes": group["episodes"],
                    "evaluation": evaluation["id"],
                    "scenario": group["scenario"],
                    "part": scenario["part"],
                    "index": scenario["index"],
                }

    def close(self) -> None:
        """Releases the leases, and cancels the evaluation if a scenario has no result; its results so far are kept."""
        atexit.unregister(self.close)
        leases = [*self._leases]
        self._leases.clear()
        evaluation, self._evaluation = self._evaluation, None
        try:
            with Client(self._url, retry_timeout_s=CLOSE_TIMEOUT_S) as client:
                if evaluation is not None:
                    _cancel_unfinished(client, evaluation)
                for lease in leases:
                    _release(client, self._run, lease)
        except ServerUnreachableError as error:
            _logger.warning("leases that cannot be released, and expire: %d: %s", len(leases), error)
        self._client.close()

    def _lease(self, run: str, **request: Any) -> dict[str, Any]:
        lease = self._client.leases.create(run, ttl_s=LEASE_TTL_S, **request)
        self._run = run
        self._leases.append(lease["lease"])
        return dict(lease)


def _release(client: Client, run: str, lease: str) -> None:
    try:
        client.leases.release(run, lease)
    except ApiError as error:
        # A lease is over once all its episodes have results.
        if error.problem.get("type") != LEASE_CLOSED:
            _logger.warning("lease %s cannot be released: %s", lease, error)


def _cancel_unfinished(client: Client, evaluation: str) -> None:
    try:
        state = client.evaluations.get(evaluation)
        if state["state"] != "open" or state["scenarios_done"] == state["scenarios"]:
            return
        client.evaluations.cancel(evaluation)
        done = f"{state['scenarios_done']} of {state['scenarios']} scenarios have results"
        _logger.warning("evaluation %s is cancelled: %s", evaluation, done)
    except ApiError as error:
        _logger.warning("evaluation %s cannot be cancelled: %s", evaluation, error)
