"""The `environment_factory` for TRL's `GRPOTrainer`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsFloat, get_args

try:
    from datasets import Dataset
except ImportError as error:
    raise ImportError("sparring.trl needs TRL: pip install 'sparring[trl]'") from error

from ..connection import read_token
from ..curriculum import Curriculum
from ..errors import invalid, one_of
from ..text_episode import Reward
from .group_episodes import GroupEpisodes
from .shared_version import SharedPolicyVersion
from .tool_environment import PROMPTS, GroupEnvironment, make_environment, tools_of
from .worker import WorkerFactory, WorkerSettings


class EnvironmentFactory:
    """Makes environments for `GRPOTrainer(environment_factory=…)`; all members of a group run one scenario.

    `AsyncGRPOTrainer` accepts it, too: it can be pickled, and in the process that this trainer spawns it is a `WorkerFactory`.

    The first member that is reset with a `group_id` begins a group of the run. Up to `group_size` members with this
    `group_id` run its scenario. Environments run in this process; the actions of each episode are submitted when it ends, and
    the server computes its score. Groups are leased ahead; `close` releases them.

    Args:
        curriculum: Curriculum of a run with tasks of kessler, or with one task of docking or tasking.
        group_size: `num_generations` of the trainer.
        reward: Result of `get_reward`: the `score` or the `skill` of the episode. Skill is 0 for the best plan without
            observations and 1 for a planner that knows the scenario. It is 0 if the two have almost equal scores. Both rewards
            order the members of a group in the same way.
        max_debris: Pieces of debris per satellite of kessler that are described after an action. A piece takes about 35
            tokens of `max_completion_length`.
        lease_groups: Groups of a lease. A smaller number follows the curriculum more closely.
        ttl_s: Seconds until a lease expires; it is renewed after half of them.
        max_wait_s: Seconds that a reset waits for an episode while the server is unreachable.

    Raises:
        ValueError: The run has tasks that need different tools, or a value is out of range.
        CurriculumError: The server rejects the request.
    """

    def __init__(
        self,
        curriculum: Curriculum,
        group_size: int,
        *,
        reward: Reward = "score",
        max_debris: int = 2,
        lease_groups: int = 1,
        ttl_s: int = 600,
        max_wait_s: float = 600.0,
    ) -> None:
        #: Kind of the tools: `kessler`, `docking`, `scanning` or `imaging`.
        self.tools = tools_of(curriculum.tasks)
        if reward not in get_args(Reward):
            raise one_of("reward", get_args(Reward), reward)
        if group_size < 1:
            raise invalid("group_size", ">= 1", group_size)
        self.curriculum = curriculum
        self.group_size = group_size
        self.reward: Reward = reward
        self.max_debris = max_debris
        # A separate queue of episodes: other environments of the curriculum would take episodes of incomplete groups.
        self._lease_settings: dict[str, Any] = {
            "group_size": group_size,
            "lease_groups": lease_groups,
            "ttl_s": ttl_s,
            "max_wait_s": max_wait_s,
        }
        self._group_curriculum = curriculum.reopen(form="groups", **self._lease_settings)
        self._episodes = GroupEpisodes(self._group_curriculum, group_size)
        self._shared_version: SharedPolicyVersion | None = None

    def __call__(self) -> GroupEnvironment:
        """Makes one environment for the trainer."""
        return make_environment(self.tools, self._episodes, self.reward, self.max_debris)

    def __reduce__(self) -> tuple[Any, ...]:
        if self._shared_version is None:
            self._shared_version = SharedPolicyVersion(self.policy_version)
        token = self._group_curriculum.token or ""
        settings = WorkerSettings(
            url=self._group_curriculum.url,
            run=self._group_curriculum.run,
            # A spawned process has the environment variables of its parent.
            token=None if token == (read_token(None) or "") else token,
            tools=self.tools,
            reward=self.reward,
            max_debris=self.max_debris,
            version_file=self._shared_version.path,
            **self._lease_settings,
        )
        return WorkerFactory, (settings,)

    def dataset(self, groups: int, prompt: str | None = None) -> Dataset:
        """Makes a dataset with one prompt and one `group_id` per group.

        Args:
            groups: Number of groups. Scenarios are chosen when they are run, so a second epoch runs other scenarios.
            prompt: Prompt before the first observation (default: that of the world, as `sparring.trl.PROMPT` of kessler).
        """
        return Dataset.from_list(self.rows(groups, prompt))

    def rows(self, groups: int, prompt: str | None = None) -> list[dict[str, Any]]:
        """Returns the rows of `dataset`."""
        content = (PROMPTS[self.tools] if prompt is None else prompt) + "\n\n"
        messages = [{"role": "user", "content": content}]
        return [{"prompt": messages, "group_id": f"group-{number}"} for number in range(groups)]

    @property
    def policy_version(self) -> int:
        """Policy version of the episodes that begin from now on; `CurriculumCallback` sets it."""
        return self._group_curriculum.policy_version

    @policy_version.setter
    def policy_version(self, version: int) -> None:
        self._group_curriculum.policy_version = version
        self.curriculum.policy_version = version
        if self._shared_version is not None:
            self._shared_version.write(version)

    def metrics(self) -> dict[str, float]:
        """Returns `Curriculum.metrics` of the run, with the episodes of these environments.

        Raises:
            CurriculumError: The server is unreachable.
        """
        return self._group_curriculum.metrics()

    def log_metrics(self, step: int, metrics: Mapping[str, SupportsFloat | None]) -> None:
        """Logs metrics of the trainer, as `Curriculum.log_metrics`.

        Raises:
            ValueError: The step or a metric is invalid, or there are more than 100 metrics.
        """
        self._group_curriculum.log_metrics(step, metrics)

    def stats(self) -> dict[str, Any]:
        """Returns `Curriculum.stats` of these environments."""
        return self._group_curriculum.stats()

    def flush(self, timeout_s: float = 60.0) -> None:
        """Waits until all results are submitted.

        Raises:
            CurriculumError: The results are not submitted in time, or the server refused some.
        """
        self._group_curriculum.flush(timeout_s)

    def close(self, timeout_s: float = 60.0) -> None:
        """Submits results and releases unfinished episodes; does not close the curriculum that was passed in.

        Raises:
            CurriculumError: Results could not be submitted, or were refused.
        """
        if self._shared_version is not None:
            self._shared_version.delete()
        self._group_curriculum.close(timeout_s)

    def __enter__(self) -> EnvironmentFactory:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
