"""What a policy is worth on scenarios that are held out."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from .curriculum import EPISODES, Curriculum, CurriculumError
from .vector import VectorEnvironment, make_vec


@dataclass(frozen=True)
class Evaluated:
    """How a policy fared on a suite."""

    #: The evaluation's id: `sparring eval`, the dashboard and `GET /v1/evaluations/compare` know it by this.
    id: str
    #: For each task, part of the suite and policy: means with 95 % bootstrap intervals of score, success, skill, lost,
    #: fuel_used and cvar10. Policies are this one and the plans that look at nothing.
    rows: list[dict[str, Any]]

    def of(self, task: str, number: str = "skill", part: str = "contested") -> float | None:
        """The mean of one number of the policy itself; none where it has none."""
        for row in self.rows:
            if (row["task"], row["part"]) == (task, part) and row["policy"] != BLIND and row.get(number):
                mean: float | None = row[number]["mean"]
                return mean
        return None


#: What policies of a suite's rows are compared with: plans that look at nothing.
BLIND = "blind_panel"


def evaluate(
    curriculum: Curriculum,
    act: Callable[[Any], Any],
    *,
    suite: str | None = None,
    tasks: Sequence[str] | None = None,
    policy: str = "policy",
    rollouts: int | None = None,
    chance: bool | None = None,
    training: str | None = None,
    training_seed: int | None = None,
    num_envs: int = 64,
    progress: Callable[[int, int], None] | None = None,
    **environment: Any,
) -> Evaluated:
    """Flies a held-out suite with a policy, for the run of a curriculum; moves nothing of it. What is interrupted is cancelled.

    Args:
        curriculum: Whose run it is of; its `policy_version` is what is evaluated.
        act: Actions of all environments from their observations.
        suite: A suite that the server knows (the newest that has one of the tasks; `GET /v1/suites` lists them).
        tasks: Its tasks that are flown (those of the run); all that one policy flies have agents alike, as all of kessler's have.
        policy: What the policy is called; not `blind_panel`, which is what it is compared with.
        rollouts: Episodes of each scenario (1; 8 of a policy that `chance` is in).
        chance: Whether the policy draws its actions.
        training, training_seed: What trainings of one kind are called together, and which of them this is.
        num_envs: Environments that fly it.
        progress: Is told how many episodes are flown, and of how many.
        environment: What `sparring.make_vec` takes: how it is observed, and what actions are.

    Raises:
        CurriculumError: No such suite, or the server fails.
        ValueError: A suite without any task of the run's, or what is unknown or out of range, with the field.
    """
    if not isinstance(curriculum, Curriculum):
        raise ValueError(f"curriculum: {curriculum!r} is no sparring.Curriculum")
    if policy == BLIND:
        raise ValueError(f"policy: {policy} is what policies are compared with; call it something else")
    if "autoreset_mode" in environment:
        raise ValueError("autoreset_mode: an evaluation flies each scenario once, and resets by itself")
    curriculum.reach()
    known = _suite(curriculum, suite, tasks)
    wish = {**known, "rollouts": rollouts, "chance": chance, "training": training, "training_seed": training_seed}
    begun = curriculum.ask(
        "POST",
        "/v1/evaluations",
        {
            "run": curriculum.run,
            "policy": policy,
            "version": curriculum.policy_version,
            **{name: value for name, value in wish.items() if value is not None},
        },
    )
    most = begun["scenarios"] * begun["rollouts"]
    try:
        lease = max(1, min(64, EPISODES // begun["rollouts"]))
        with curriculum.beside(purpose="eval", evaluation=begun["id"], lease=lease) as exam:
            envs = make_vec(num_envs=min(num_envs, most), curriculum=exam, **environment)
            try:
                for flown in _fly(envs, act):
                    if progress is not None:
                        progress(flown, most)
            finally:
                envs.close()
    except BaseException:
        # Nobody will fly the rest, and of evaluations under way a server has only so many.
        with contextlib.suppress(CurriculumError):
            curriculum.ask("POST", f"/v1/evaluations/{begun['id']}/cancel")
        raise
    return _told(curriculum, begun["id"])


def _suite(curriculum: Curriculum, wanted: str | None, tasks: Sequence[str] | None) -> dict[str, Any]:
    """The suite, and which of its tasks are flown."""
    mine = tasks or curriculum.tasks
    for known in curriculum.ask("GET", "/v1/suites")["suites"]:
        of_it = [task for task in known["tasks"] if task in mine]
        if wanted not in (None, known["name"]) or (wanted is None and not of_it):
            continue
        if not of_it and not tasks:
            over = f"{known['name']} is of {', '.join(known['tasks'])}, and the run of {', '.join(curriculum.tasks)}"
            raise ValueError(f"suite: {over}")
        return {"suite": known["name"], "tasks": list(tasks or of_it)}
    # One that there is not is the server's to refuse.
    return {name: value for name, value in (("suite", wanted), ("tasks", tasks)) if value}


def _fly(envs: VectorEnvironment, act: Callable[[Any], Any]) -> Iterator[int]:
    seen, _ = envs.reset()
    flown = 0
    while not envs.rests.all():
        seen, _, _, _, infos = envs.step(act(seen))
        if "_episode" in infos:
            flown += int(infos["_episode"].sum())
            yield flown


def _told(curriculum: Curriculum, evaluation: str, most_s: float = 120.0) -> Evaluated:
    until = time.monotonic() + most_s
    while True:
        told = curriculum.ask("GET", f"/v1/evaluations/{evaluation}")
        if told["state"] == "complete":
            return Evaluated(evaluation, told["rows"])
        if told["state"] == "failed" or time.monotonic() > until:
            raise CurriculumError(f"the evaluation {evaluation} is {told['state']}: {told.get('trouble') or 'it takes too long'}")
        time.sleep(0.1)
