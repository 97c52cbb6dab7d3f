"""One training of an experiment: flown, looked at on the way, evaluated at its end, and written down."""

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
from .plan import DONE, Experiment, Training, Where, versions, write

#: Environments that fly an evaluation.
EXAMINED = 256

#: Told how many steps more were flown.
Progress = Callable[[int], None]


def is_done(folder: Path, training: Training) -> bool:
    """Whether a training is done."""
    return (folder / training.folder / DONE).exists()


def fly(folder: Path, experiment: Experiment, training: Training, at: Where, progress: Progress) -> None:
    """Flies a training from its beginning: what an earlier try left is removed.

    Raises:
        CurriculumError: The server fails, or refuses something.
    """
    into = folder / training.folder
    shutil.rmtree(into, ignore_errors=True)
    into.mkdir(parents=True)
    settings = experiment.run_settings(training.arm, training.seed)
    config = ppo.Config(steps=experiment.budget, num_envs=experiment.num_envs, seed=training.seed)
    began = time.monotonic()
    with sparring.Curriculum(at.url, token=at.token, settings=settings, form="groups") as curriculum:
        watch = _Watch(experiment, curriculum, progress)
        policy = ppo.train(config, curriculum, watch.after)
        flown_s = time.monotonic() - began - watch.looked_s
        curriculum.flush()
        found = _examine(experiment, curriculum, policy.draw, training, rollouts=experiment.rollouts, chance=True)
        _write(into / "curve.csv", watch.curve)
        _write(into / "scenarios.csv", _scenarios(curriculum, found.id))
        torch.save(policy.state_dict(), into / "policy.pt")
        told = {
            "arm": training.arm,
            "seed": training.seed,
            "run": curriculum.run,
            "evaluation": found.id,
            "rows": found.rows,
            "tasks": curriculum.mastery(),
            "episodes": curriculum.stats(),
            "steps": watch.steps,
            "flown_s": flown_s,
            "all_s": time.monotonic() - began,
            "versions": versions(),
            "server": curriculum.ask("GET", "/openapi.json")["info"]["version"],
        }
    write(into / DONE, told)


class _Watch:
    """Looks at a training now and then."""

    def __init__(self, experiment: Experiment, curriculum: sparring.Curriculum, progress: Progress) -> None:
        self.experiment, self.curriculum, self.progress = experiment, curriculum, progress
        self.curve: list[dict[str, Any]] = []
        self.looked_s = 0.0
        self.steps = 0
        self._next = 0

    def after(self, steps: int, policy: ppo.Policy, told: dict[str, float]) -> None:
        """After each rollout. The first look is at a policy that has learned from one: as good as none."""
        self.progress(steps - self.steps)
        self.steps = steps
        if steps < self._next and steps < self.experiment.budget:
            return
        while self._next <= steps:
            self._next += max(1, self.experiment.budget // self.experiment.looks)
        began = time.monotonic()
        found = _examine(self.experiment, self.curriculum, policy.act, None, rollouts=1, chance=False)
        numbers = self.curriculum.numbers()
        for task in self.experiment.tasks:
            contested = {name: found.of(task, name) for name in ("skill", "success", "score")}
            faced = {name.removeprefix(f"{task}/"): value for name, value in numbers.items() if name.startswith(f"{task}/")}
            self.curve.append(
                {
                    "steps": steps,
                    "task": task,
                    **{f"heldout_{name}": value for name, value in contested.items()},
                    **faced,
                    **{f"learner_{name}": value for name, value in told.items()},
                }
            )
        self.looked_s += time.monotonic() - began


def _examine(
    experiment: Experiment,
    curriculum: sparring.Curriculum,
    act: Callable[[Any], Any],
    training: Training | None,
    **how: Any,
) -> sparring.Evaluated:
    # What is drawn here is none of the training's: it goes on as if nobody had looked.
    with torch.random.fork_rng():
        named: dict[str, Any] = {} if training is None else {"training": training.arm, "training_seed": training.seed}
        policy = "look" if training is None else training.arm
        return sparring.evaluate(curriculum, act, suite=experiment.suite, policy=policy, num_envs=EXAMINED, **named, **how)


def _scenarios(curriculum: sparring.Curriculum, evaluation: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    cursor = ""
    while True:
        page = curriculum.ask("GET", f"/v1/evaluations/{evaluation}/scenarios?limit=500{cursor}")
        rows += page["scenarios"]
        if not page.get("next"):
            return rows
        cursor = f"&cursor={page['next']}"


def _write(file: Path, rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    with file.open("w", newline="") as opened:
        writer = csv.DictWriter(opened, names)
        writer.writeheader()
        writer.writerows(rows)
