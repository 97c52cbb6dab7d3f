"""Taskset: its configuration, the rows, and the scoring of a rollout by the server's replay."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Self

import verifiers.v1 as vf
from pydantic import Field, model_validator

from sparring.client import ApiError, Client
from sparring.curriculum import DEFAULT_URL
from sparring.errors import invalid, one_of
from sparring.tasks import task as find_task
from sparring.text_episode import Reward
from sparring.tool_episode import PROMPT

from .rollouts import RunningEpisode, episode_source
from .rows import LeasedRows

#: Seconds for which the server is tried when the rows are read.
LOAD_TIMEOUT_S = 5.0
#: Maximum number of episodes of a scenario in a group or an evaluation.
MAX_GROUP_SIZE = 1024
#: Maximum number of groups of a lease.
MAX_LEASE_GROUPS = 1024
#: Task of a new run, and world of the tasks that the tools support.
DEFAULT_TASK, WORLD = "kessler/survival", "kessler/"
#: Results of an episode that are metrics.
METRICS = ("score", "skill", "success", "steps", "fuel_used", "lost", "invalid_calls")

#: Threads that begin episodes. They may wait until the server has a free session, so other calls have threads of their own.
_begin_threads = ThreadPoolExecutor(256, "sparring-begin")
#: Threads that step and end episodes.
step_threads = ThreadPoolExecutor(64, "sparring-step")
#: Running episodes by the id of their trace.
running: dict[str, RunningEpisode] = {}


class SparringConfig(vf.TasksetConfig):
    """Configuration of the taskset: training on a run, or an evaluation on a suite."""

    url: str = DEFAULT_URL
    """Address of the server. Its token is read from `SPARRING_TOKEN`."""
    run: str | None = None
    """Id of the run to train on; without it a run is created. Not with `suite`."""
    suite: str | None = None
    """Name of the suite to evaluate on. The evaluation belongs to a new run."""
    tasks: list[str] = Field(default_factory=list)
    """Tasks of the new run (`kessler/survival`), or of the suite (all of kessler). Not with `run`."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Other settings of the new run, as for `POST /v1/runs`. Not with `run`."""
    group_size: int | None = Field(None, ge=1, le=MAX_GROUP_SIZE)
    """Rollouts of a row that share a scenario, for training (the run's `group_size`)."""
    lease_groups: int = Field(1, ge=1, le=MAX_LEASE_GROUPS)
    """Groups of a lease, for training. A smaller number follows the curriculum more closely."""
    rollouts: int = Field(1, ge=1, le=MAX_GROUP_SIZE)
    """Rollouts of a row, for an evaluation."""
    policy: str = "verifiers"
    """Name of the policy in the evaluation."""
    policy_version: int | None = Field(None, ge=0)
    """Policy version of the episodes (the newest of the run)."""
    reward: Reward = "score"
    """Reward of a rollout. `skill` is 0 for the best plan without observations, 1 for a planner that knows the scenario."""
    prompt: str = PROMPT
    """User message before the first observation."""
    max_debris: int = Field(2, ge=0)
    """Pieces of debris per satellite that are described after an action."""
    max_wait_s: float = Field(600.0, ge=0.0)
    """Seconds for which an unreachable server, or one without a free session, is tried again."""

    @model_validator(mode="after")
    def check_choices(self) -> Self:
        """Checks that the fields agree with each other.

        Raises:
            ValueError: They do not; the message names the field.
        """
        if self.run is not None and self.suite is not None:
            got = f"got {self.run!r} and {self.suite!r}"
            raise ValueError(f"`run` must be omitted with `suite`, {got}: pass `run` to train, or `suite` to evaluate")
        for name in ("tasks", "settings"):
            if self.run is not None and getattr(self, name):
                reason = f"a run keeps its tasks and settings; omit `run` to create one, got {self.run!r}"
                raise ValueError(f"`{name}` must be omitted with `run`: {reason}")
        self.tasks = [find_task(name).id for name in self.tasks]
        others = [task for task in self.tasks if not task.startswith(WORLD)]
        if others:
            raise ValueError(f"`tasks` must be tasks of kessler, got {', '.join(others)}")
        return self


class SparringData(vf.TaskData):
    """Row of the dataset: a group of a run, or a scenario of an evaluation."""

    url: str
    #: Lease and group or episodes, as `LeasedRows` yields them.
    row: dict[str, Any]
    reward: Reward
    max_debris: int
    max_wait_s: float
    #: Id of the harness with the tools.
    harness_id: str


class SparringTask(vf.Task[SparringData]):
    """Rollout of a row: an episode on the server, whose replay gives reward and metrics."""

    @property
    def key(self) -> str:
        """Scenario of an evaluation, which is equal in all evaluations of a suite; else the lease and the group."""
        row = self.data.row
        return str(row["scenario"]) if "evaluation" in row else f"{row['lease']}-{row['group']}"

    async def setup(self, trace: vf.Trace, runtime: vf.Runtime) -> None:
        """Begins an episode of the row.

        Raises:
            SessionError: The server rejects the request or is unreachable.
            ValueError: The agent has another harness, which does not offer the tools.
        """
        harness = trace.agent.config.harness.id
        if harness != self.data.harness_id:
            raise invalid("env.agent.harness.id", f"{self.data.harness_id!r}, which has the tools", harness)
        loop = asyncio.get_running_loop()
        beginning = loop.run_in_executor(_begin_threads, self._begin)
        try:
            # A thread cannot be cancelled: a cancelled rollout still has to end the session that the thread opens.
            begun = await asyncio.shield(beginning)
        except asyncio.CancelledError:
            beginning.add_done_callback(_fail_cancelled)
            raise
        running[trace.id] = begun
        trace.info["sparring"] = dict(begun.info)

    async def finalize(self, trace: vf.Trace, runtime: vf.Runtime) -> None:
        """Holds for the remaining steps, and stores the server's result."""
        result = await asyncio.get_running_loop().run_in_executor(step_threads, running[trace.id].finish)
        del running[trace.id]
        trace.info["sparring"].update(result)

    @vf.reward
    async def reward(self, trace: vf.Trace) -> Mapping[str, float]:
        """Returns the score or the skill; 0 for all members of a group that the curriculum only measures."""
        result = trace.info["sparring"]
        is_measured = not result.get("train", True)
        return {self.data.reward: 0.0 if is_measured else float(result.get(self.data.reward) or 0.0)}

    @vf.metric
    async def metrics(self, trace: vf.Trace) -> Mapping[str, float]:
        """Returns the results of the episode; without skill if the scenario defines none."""
        result = trace.info["sparring"]
        return {name: float(result[name]) for name in METRICS if result.get(name) is not None}

    def _begin(self) -> RunningEpisode:
        return episode_source(self.data.url, self.data.max_wait_s).begin(self.data.row, self.data.max_debris)


class SparringTaskset(vf.Taskset[SparringTask, SparringConfig]):
    """Groups of a run without end, or the scenarios of a suite.

    The process that reads the tasks creates the run or the evaluation, and leases the groups.
    """

    def __new__(cls, config: SparringConfig | None = None) -> Self:
        """Makes the taskset of a run, which is infinite, or of a suite, which is finite: prime-rl reads this from the class."""
        if cls is SparringTaskset and config is not None:
            return object.__new__(SuiteTaskset if config.suite else RunTaskset)
        return object.__new__(cls)  # a copy, as the views of a taskset make them

    def __init__(self, config: SparringConfig) -> None:
        super().__init__(config)
        # Views of the taskset are shallow copies, which share this list.
        self._leased: list[LeasedRows] = []

    def load(self) -> Iterator[SparringTask]:
        """Yields the tasks; the first one creates the run or the evaluation.

        Raises:
            ApiError: The server rejects a request.
            ServerUnreachableError: No server answers.
            ValueError: There is no such run or suite, or it has other tasks.
        """
        config = self.config
        with Client(config.url, retry_timeout_s=LOAD_TIMEOUT_S) as client:
            tasks = self._check(client)
            run = config.run or client.runs.create(**self._run_settings(tasks))["id"]
            group_size = config.group_size or client.runs.get(run)["settings"]["group_size"]
        leased = LeasedRows(config.url, config.max_wait_s)
        self._leased.append(leased)
        for row in self._rows(leased, run, tasks, group_size):
            yield self._task(row)

    def close(self) -> None:
        """Releases the leases of all rows, and cancels evaluations that are not complete; the end of the process does so too."""
        while self._leased:
            self._leased.pop().close()

    def _task(self, row: dict[str, Any]) -> SparringTask:
        config = self.config
        name = f"{config.suite}#{row['index']}" if "evaluation" in row else f"{row['lease']}#{row['group']}"
        data = SparringData(
            name=name,
            prompt=config.prompt,
            url=config.url.rstrip("/"),
            row=row,
            reward=config.reward,
            max_debris=config.max_debris,
            max_wait_s=config.max_wait_s,
            harness_id=config.id,
        )
        return SparringTask(data, config.task)

    def _run_settings(self, tasks: list[str]) -> Any:
        """Returns the settings of a new run."""
        config = self.config
        name = f"{config.policy} on {config.suite}" if config.suite else config.policy
        size = {} if config.group_size is None else {"group_size": config.group_size}
        return {"name": name, "tasks": tasks, **size, **config.settings}

    def _check(self, client: Client) -> list[str]:
        """Returns the tasks of the run or of the evaluation, after a check that the server has them."""
        raise NotImplementedError

    def _rows(self, leased: LeasedRows, run: str, tasks: list[str], group_size: int) -> Iterator[dict[str, Any]]:
        """Yields the rows of the dataset."""
        raise NotImplementedError


class RunTaskset(SparringTaskset):
    """Groups of the curriculum of a run."""

    INFINITE = True

    def _check(self, client: Client) -> list[str]:
        run = self.config.run
        if run is None:
            client.tasks.list()
            return self.config.tasks or [DEFAULT_TASK]
        try:
            rows = client.runs.get(run)["settings"]["curriculum"]["tasks"]
        except ApiError as error:
            if error.status != 404:
                raise
            raise invalid("run", "the id of a run of the server; `sparring runs list` prints them", run) from error
        tasks = [row["task"] for row in rows]
        others = [task for task in tasks if not task.startswith(WORLD)]
        if others:
            raise ValueError(f"`run` must be a run with tasks of kessler only, got {run!r} with {', '.join(others)}")
        return tasks

    def _rows(self, leased: LeasedRows, run: str, tasks: list[str], group_size: int) -> Iterator[dict[str, Any]]:
        config = self.config
        yield from leased.train(
            run, group_size=group_size, lease_groups=config.lease_groups, policy_version=config.policy_version
        )


class SuiteTaskset(SparringTaskset):
    """Scenarios of a suite, as an evaluation of the server."""

    def _check(self, client: Client) -> list[str]:
        name, chosen = self.config.suite, self.config.tasks
        suites = {suite["name"]: suite for suite in client.evaluations.list_suites()["suites"]}
        if name not in suites:
            raise one_of("suite", tuple(suites), name)
        available = [task for task in suites[name]["tasks"] if task.startswith(WORLD)]
        if not available:
            raise ValueError(f"`suite` must have tasks of kessler, but {name} has {', '.join(suites[name]['tasks'])}")
        missing = [task for task in chosen if task not in available]
        if missing:
            raise one_of("tasks", tuple(available), ", ".join(missing))
        return chosen or available

    def _rows(self, leased: LeasedRows, run: str, tasks: list[str], group_size: int) -> Iterator[dict[str, Any]]:
        config = self.config
        request = {"suite": config.suite, "tasks": tasks, "rollouts": config.rollouts, "policy": config.policy}
        if config.policy_version is not None:
            request["policy_version"] = config.policy_version
        yield from leased.evaluate(run, request)


def _fail_cancelled(beginning: asyncio.Future[RunningEpisode]) -> None:
    if not beginning.cancelled() and beginning.exception() is None:
        step_threads.submit(beginning.result().fail, "the rollout was cancelled")
