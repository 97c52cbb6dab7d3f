"""Learners of the evidence runs, with settings that were tuned with the arm `uniform-levels`."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import sparring

from .. import grpo, ppo
from ..experiment import ExperimentError
from .held_out import SampledPolicy
from .protocol import Problem

#: Called after each update with the number of steps, the policy and metrics.
Report = Callable[[int, SampledPolicy, dict[str, float]], None]


def check(problems: Iterable[Problem]) -> None:
    """Checks that the packages of the learners are installed.

    Raises:
        ExperimentError: One is missing.
    """
    for problem in problems:
        if problem.learner == "sb3":
            try:
                from .. import sb3_ppo  # noqa: F401
            except ImportError as error:
                raise ExperimentError(f"--problems {problem.name}: {error}") from error


def train(problem: Problem, seed: int, curriculum: sparring.Curriculum, report: Report) -> SampledPolicy:
    """Trains the learner of a problem; returns its policy."""
    changes = {"steps": problem.budget, "seed": seed, **problem.hyperparameters}
    if problem.learner == "grpo":
        return grpo.train(grpo.Config.tuned(problem.task, **changes), curriculum, report, report_metrics=False)
    config = ppo.Config.tuned(problem.task, **changes)
    if problem.learner == "sb3":
        from .. import sb3_ppo

        return sb3_ppo.train(config, curriculum, report, report_metrics=False)
    return ppo.train(config, curriculum, report, report_metrics=False)
