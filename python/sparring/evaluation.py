"""Evaluation of policies on held-out scenarios."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from .curriculum import Curriculum, CurriculumError
from .curriculum_arguments import MAX_GROUP_EPISODES
from .errors import invalid
from .vector import VectorEnvironment, make_vec

#: Name of the blind panel in the rows of an evaluation.
BLIND_PANEL = "blind_panel"
#: Timeout for the server to complete an evaluation after its last episode, seconds.
COMPLETION_TIMEOUT_S = 120.0
#: Maximum number of groups of a lease of evaluation episodes.
MAX_EVALUATION_LEASE_GROUPS = 64


@dataclass(frozen=True)
class EvaluationResult:
    """Result of an evaluation on a suite."""

    #: Id of the evaluation, for `sparring eval`, the dashboard and `GET /v1/evaluations/compare`.
    id: str
    #: For each task, part of the suite and policy: means with 95 % bootstrap intervals of score, success, skill, lost,
    #: fuel_used and cvar10. The policies are the evaluated one and the blind panel.
    rows: list[dict[str, Any]]

    def mean(self, task: str, metric: str = "skill", part: str = "contested") -> float | None:
        """Returns the mean of a metric of the evaluated policy; None if it is undefined.

        Args:
            task: Id of the task, or `all` for the mean over all tasks.
            metric: `score`, `success`, `skill`, `lost`, `fuel_used` or `cvar10`.
            part: Part of the suite, such as `contested`, or `all`.
        """
        for row in self.rows:
            if (row["task"], row["part"]) == (task, part) and row["policy"] != BLIND_PANEL and row.get(metric):
                mean: float | None = row[metric]["mean"]
                return mean
        return None


def evaluate(
    curriculum: Curriculum,
    act: Callable[[Any], Any],
    *,
    suite: str | None = None,
    tasks: Sequence[str] | None = None,
    policy: str = "policy",
    rollouts: int | None = None,
    stochastic: bool | None = None,
    training: str | None = None,
    training_seed: int | None = None,
    num_envs: int = 64,
    decision_steps: int = 1,
    progress: Callable[[int, int], None] | None = None,
    **environment: Any,
) -> EvaluationResult:
    """Evaluates a policy on a held-out suite, without effect on the run's curriculum.

    An interrupted evaluation is cancelled.

    Args:
        curriculum: Curriculum of the run; its `policy_version` is evaluated.
        act: Function from the observations of all environments to their actions.
        suite: Name of a suite of the server (default: the newest with a task of the run; `GET /v1/suites` lists all).
        tasks: Tasks of the suite to evaluate (default: those of the run). They must have equal agents, as those of kessler have.
        policy: Name of the policy; not `blind_panel`.
        rollouts: Episodes per scenario (1; 8 if `stochastic`).
        stochastic: True if the policy samples its actions.
        training: Name that all trainings with the same settings share, to pool their evaluations.
        training_seed: Seed of this training.
        num_envs: Number of environments.
        decision_steps: Steps for which an action is repeated, or until its episode ends.
        progress: Called with the number of finished episodes and their total.
        environment: Arguments of `sparring.make_vec` for observations and actions.

    Raises:
        CurriculumError: The suite is unknown, or the server fails.
        ValueError: The suite has no task of the run, or a value is invalid; the message names the field.
    """
    _check_arguments(curriculum, policy, decision_steps, environment)
    curriculum.wait_for_server()
    optional = {
        **_choose_suite(curriculum, suite, tasks),
        "rollouts": rollouts,
        "stochastic": stochastic,
        "training": training,
        "training_seed": training_seed,
    }
    settings = {name: value for name, value in optional.items() if value is not None}
    settings |= {"run": curriculum.run, "policy": policy, "policy_version": curriculum.policy_version}
    evaluation = curriculum.request("POST", "/v1/evaluations", settings)
    try:
        _run_evaluation(curriculum, evaluation, act, decision_steps, num_envs, progress, environment)
    except BaseException:
        # The remaining episodes will not be run, and the server limits the number of open evaluations.
        with contextlib.suppress(CurriculumError):
            curriculum.request("POST", f"/v1/evaluations/{evaluation['id']}/cancel")
        raise
    return _wait_for_result(curriculum, evaluation["id"])


def _check_arguments(curriculum: Any, policy: str, decision_steps: Any, environment: dict[str, Any]) -> None:
    if not isinstance(curriculum, Curriculum):
        raise invalid("curriculum", "a sparring.Curriculum", curriculum)
    if policy == BLIND_PANEL:
        raise ValueError(f"`policy` must not be {policy!r}, the name of the baseline of all suites; choose another name")
    if isinstance(decision_steps, bool) or not isinstance(decision_steps, int) or decision_steps < 1:
        raise invalid("decision_steps", "an integer >= 1", decision_steps)
    if "autoreset_mode" in environment:
        raise ValueError("`autoreset_mode` must be omitted: an evaluation runs each scenario once and resets by itself")


def _choose_suite(curriculum: Curriculum, name: str | None, tasks: Sequence[str] | None) -> dict[str, Any]:
    """Returns the suite and its tasks to evaluate."""
    requested = tasks or curriculum.tasks
    for suite in curriculum.request("GET", "/v1/suites")["suites"]:
        common = [task for task in suite["tasks"] if task in requested]
        if name not in (None, suite["name"]) or (name is None and not common):
            continue
        if not common and not tasks:
            listed = f"{suite['name']} has {', '.join(suite['tasks'])}, the run has {', '.join(curriculum.tasks)}"
            raise ValueError(f"`suite` must have a task of the run, but {listed}; choose another suite, or pass `tasks`")
        return {"suite": suite["name"], "tasks": list(tasks or common)}
    # The server rejects an unknown suite.
    return {field: value for field, value in (("suite", name), ("tasks", tasks)) if value}


def _run_evaluation(
    curriculum: Curriculum,
    evaluation: dict[str, Any],
    act: Callable[[Any], Any],
    decision_steps: int,
    num_envs: int,
    progress: Callable[[int, int], None] | None,
    environment: dict[str, Any],
) -> None:
    total = evaluation["scenarios"] * evaluation["rollouts"]
    groups = max(1, min(MAX_EVALUATION_LEASE_GROUPS, MAX_GROUP_EPISODES // evaluation["rollouts"]))
    with curriculum.reopen(purpose="eval", evaluation=evaluation["id"], lease_groups=groups) as held_out:
        envs = make_vec(num_envs=min(num_envs, total), curriculum=held_out, **environment)
        try:
            for finished in _run_episodes(envs, act, decision_steps):
                if progress is not None:
                    progress(finished, total)
        finally:
            envs.close()


def _run_episodes(envs: VectorEnvironment, act: Callable[[Any], Any], decision_steps: int) -> Iterator[int]:
    """Runs all episodes; yields the number of finished ones whenever it changes."""
    observations, _ = envs.reset()
    finished = 0
    while not envs.idle.all():
        observations, _, _, _, infos = envs.step(act(observations), repeat=decision_steps)
        if "_episode" in infos:
            finished += int(infos["_episode"].sum())
            yield finished


def _wait_for_result(curriculum: Curriculum, id: str) -> EvaluationResult:
    deadline = time.monotonic() + COMPLETION_TIMEOUT_S
    while True:
        evaluation = curriculum.request("GET", f"/v1/evaluations/{id}")
        if evaluation["state"] == "complete":
            return EvaluationResult(id, evaluation["rows"])
        if evaluation["state"] == "failed" or time.monotonic() > deadline:
            reason = evaluation.get("error") or f"it did not complete within {COMPLETION_TIMEOUT_S:.0f} s of its last episode"
            raise CurriculumError(f"the evaluation {id} is {evaluation['state']}: {reason}")
        time.sleep(0.1)
