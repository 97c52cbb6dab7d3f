"""One training of an experiment, with its evaluations and its files."""

from __future__ import annotations

import csv
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

import sparring

from . import ppo
from .experiment import DONE_FILE, Experiment, ServerAddress, Training, package_versions, write_json

#: Number of environments of an evaluation.
EVALUATION_ENVS = 256

#: Called with the number of new steps.
Progress = Callable[[int], None]


def is_done(folder: Path, training: Training) -> bool:
    """Returns True if a training is complete."""
    return (folder / training.folder / DONE_FILE).exists()


def run(folder: Path, experiment: Experiment, training: Training, address: ServerAddress, progress: Progress) -> None:
    """Runs a training from its beginning; deletes the files of an earlier attempt.

    Raises:
        CurriculumError: The server fails or rejects a request.
    """
    target = folder / training.folder
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    settings = experiment.run_settings(training.arm, training.seed)
    config = learner_config(experiment, training.seed)
    started = time.monotonic()
    with sparring.Curriculum(address.url, token=address.token, settings=settings, form="groups") as curriculum:
        monitor = _TrainingMonitor(experiment, curriculum, progress)
        policy = ppo.train(config, curriculum, monitor.after_rollout)
        training_s = time.monotonic() - started - monitor.evaluation_s
        curriculum.flush()
        result = _evaluate(experiment, curriculum, policy, training, rollouts=experiment.rollouts)
        _write_csv(target / "curve.csv", monitor.curve)
        _write_csv(target / "scenarios.csv", _read_scenarios(curriculum, result.id))
        torch.save(policy.state_dict(), target / "policy.pt")
        done = {
            "arm": training.arm,
            "seed": training.seed,
            "run": curriculum.run,
            "evaluation": result.id,
            "rows": result.rows,
            "tasks": curriculum.mastery(),
            "episodes": curriculum.stats(),
            "steps": monitor.steps,
            "training_s": training_s,
            "total_s": time.monotonic() - started,
            "versions": package_versions(),
            "server": curriculum.request("GET", "/openapi.json")["info"]["version"],
        }
    write_json(target / DONE_FILE, done)


def learner_config(experiment: Experiment, seed: int) -> ppo.Config:
    """Returns the settings of the learner: those that were tuned for the task, or the defaults for several tasks."""
    changes: dict[str, Any] = {"steps": experiment.budget, "num_envs": experiment.num_envs, "seed": seed}
    tasks = experiment.tasks
    return ppo.Config.tuned(tasks[0], **changes) if len(tasks) == 1 else ppo.Config(**changes)


class _TrainingMonitor:
    """Evaluates the policy at intervals during a training."""

    def __init__(self, experiment: Experiment, curriculum: sparring.Curriculum, progress: Progress) -> None:
        self.experiment, self.curriculum, self.progress = experiment, curriculum, progress
        self.curve: list[dict[str, Any]] = []
        #: Seconds that evaluations took.
        self.evaluation_s = 0.0
        self.steps = 0
        self._next = 0

    def after_rollout(self, steps: int, policy: ppo.Policy, metrics: dict[str, float]) -> None:
        """Evaluates the policy if an evaluation is due. The first one follows the first rollout, as a baseline."""
        self.progress(steps - self.steps)
        self.steps = steps
        if steps < self._next and steps < self.experiment.budget:
            return
        while self._next <= steps:
            self._next += max(1, self.experiment.budget // self.experiment.evaluations)
        started = time.monotonic()
        result = _evaluate(self.experiment, self.curriculum, policy, None, rollouts=1)
        curriculum_metrics = self.curriculum.metrics()
        for task in self.experiment.tasks:
            held_out = {name: result.mean(task, name) for name in ("skill", "success", "score")}
            prefix = f"{task}/"
            task_metrics = {
                name.removeprefix(prefix): value for name, value in curriculum_metrics.items() if name.startswith(prefix)
            }
            self.curve.append(
                {
                    "steps": steps,
                    "task": task,
                    **{f"heldout_{name}": value for name, value in held_out.items()},
                    **task_metrics,
                    **{f"learner_{name}": value for name, value in metrics.items()},
                }
            )
        self.evaluation_s += time.monotonic() - started


def _evaluate(
    experiment: Experiment,
    curriculum: sparring.Curriculum,
    policy: ppo.Policy,
    training: Training | None,
    **arguments: Any,
) -> sparring.EvaluationResult:
    # An evaluation does not change the training's random state.
    with torch.random.fork_rng():
        if training is not None:
            arguments |= {"training": training.arm, "training_seed": training.seed}
        return sparring.evaluate(
            curriculum,
            policy.sample,
            suite=experiment.suite,
            policy="checkpoint" if training is None else training.arm,
            stochastic=True,
            num_envs=EVALUATION_ENVS,
            decision_steps=policy.config.decision_steps,
            **ppo.environment_settings(policy.config),
            **arguments,
        )


def _read_scenarios(curriculum: sparring.Curriculum, evaluation: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    cursor = ""
    while True:
        page = curriculum.request("GET", f"/v1/evaluations/{evaluation}/scenarios?limit=500{cursor}")
        rows += page["scenarios"]
        if not page.get("next"):
            return rows
        cursor = f"&cursor={page['next']}"


def _write_csv(file: Path, rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    with file.open("w", newline="") as opened:
        writer = csv.DictWriter(opened, names)
        writer.writeheader()
        writer.writerows(rows)
