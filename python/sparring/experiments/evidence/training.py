"""One training of an arm: the learner, its evaluations, and the file with its results."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import sparring

from ..experiment import package_versions, write_json
from . import held_out as held_out_scenarios
from . import learners
from .failures import aimed_episodes, failure_shares
from .held_out import HeldOut, SampledPolicy, measure
from .protocol import FINAL_EPISODES, LOOKS, Arm, Problem, find_arm, find_problem

#: Seed of the actions of all evaluations.
EVALUATION_SEED = 7


@dataclass(frozen=True)
class Training:
    """Training of an arm on a problem with a seed."""

    problem: str
    arm: str
    seed: int

    def file(self, folder: Path) -> Path:
        """Returns the file of its results."""
        return results_folder(folder, self.problem) / f"{self.arm}-{self.seed}.json"


def results_folder(folder: Path, problem: str) -> Path:
    """Returns the folder with the results of a problem's trainings."""
    return folder / "trainings" / problem.replace("/", "-")


def stored_budget(results: Mapping[str, Any]) -> int:
    """Returns the budget of a training from its results, env-steps; that of the protocol if they do not have it."""
    return int(results.get("budget", find_problem(results["problem"]).budget))


def run(folder: Path, training: Training, binary: str | None = None, budget: int | None = None) -> None:
    """Runs a training from its beginning, on a server of its own.

    Args:
        folder: Folder of the results.
        training: The training.
        binary: Program of the server.
        budget: Budget of a trial, in place of the protocol's.

    Raises:
        CurriculumError: The server fails.
    """
    problem, arm = find_problem(training.problem), find_arm(training.arm)
    problem = replace(problem, budget=budget or problem.budget)
    scenarios = held_out_scenarios.load(folder / "held-out", problem.task)
    started = time.monotonic()
    settings = problem.run_settings(arm, training.seed)
    with sparring.Curriculum.local(binary=binary, settings=settings, form="groups") as curriculum:
        monitor = _Monitor(problem, arm, curriculum, scenarios)
        policy = learners.train(problem, training.seed, curriculum, monitor.after_rollout)
        final = measure(policy, scenarios, FINAL_EPISODES, EVALUATION_SEED, record=True)
        mastery = curriculum.mastery()[0]
        aimed = aimed_episodes(curriculum)
    results = {
        "problem": training.problem,
        "arm": training.arm,
        "seed": training.seed,
        "budget": problem.budget,
        "curve": monitor.curve,
        "final": {
            "success": final.mean("success"),
            "skill": final.mean("skill"),
            "worst_tenth": final.worst_tenth(problem.measure),
        },
        "failures": failure_shares(final.recorded),
        "aimed": aimed,
        "complete_groups": mastery["group_counts"]["complete"],
        "zero_variance": mastery["group_counts"]["zero_variance_share"],
        "seconds": round(time.monotonic() - started, 1),
        "versions": package_versions(),
    }
    file = training.file(folder)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_json(file, results)


class _Monitor:
    """Evaluates the policy at intervals, and changes the level table of an arm that has several."""

    def __init__(self, problem: Problem, arm: Arm, curriculum: sparring.Curriculum, held_out: HeldOut) -> None:
        self.problem, self.arm, self.curriculum, self.held_out = problem, arm, curriculum, held_out
        self.curve: list[dict[str, Any]] = []
        self._next = 0
        self._levels = arm.levels and arm.levels(problem.task, 0.0)

    def after_rollout(self, steps: int, policy: SampledPolicy, _: dict[str, float]) -> None:
        """Evaluates the policy if an evaluation is due; the last rollout always is."""
        self._change_levels(steps)
        if steps < self._next and steps < self.problem.budget:
            return
        while self._next <= steps:
            self._next += max(1, self.problem.budget // LOOKS)
        measured = measure(policy, self.held_out, 1, EVALUATION_SEED)
        self.curve.append({"steps": steps, "success": measured.mean("success"), "skill": measured.mean("skill")})

    def _change_levels(self, steps: int) -> None:
        if self.arm.levels is None:
            return
        levels = self.arm.levels(self.problem.task, steps / self.problem.budget)
        if levels != self._levels:
            self._levels = levels
            change = {"task_settings": {self.problem.task: {"levels": levels}}}
            self.curriculum.request("PATCH", f"/v1/runs/{self.curriculum.run}", change)
