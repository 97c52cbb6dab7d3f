"""Runs the trainings of the protocol that are not complete, some of them in parallel."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from . import held_out, learners, training
from .protocol import PROBLEMS, SEEDS, find_problem
from .training import Training


def planned(problems: Sequence[str] = (), arms: Sequence[str] = (), seeds: Sequence[int] = ()) -> list[Training]:
    """Returns the trainings of the protocol, or those of some problems, arms and seeds, the claims first."""
    listed = [
        Training(problem.name, arm, seed)
        for is_claimed in (True, False)
        for seed in SEEDS
        for problem in PROBLEMS
        for arm in problem.arms
        if (arm in problem.claimed) == is_claimed and seed in problem.seeds(arm)
    ]
    return [
        each
        for each in listed
        if each.problem in (problems or [each.problem])
        and each.arm in (arms or [each.arm])
        and each.seed in (seeds or [each.seed])
    ]


def missing(folder: Path, trainings: Sequence[Training]) -> list[Training]:
    """Returns the trainings without results."""
    return [each for each in trainings if not each.file(folder).exists()]


def run(
    folder: Path,
    trainings: Sequence[Training],
    jobs: int,
    done: Callable[[Training], None],
    binary: str | None = None,
    budget: int | None = None,
) -> None:
    """Runs trainings, each in a process and on a core of its own; `budget` replaces that of the protocol for a trial.

    A training that was interrupted begins anew; its seed decides its scenarios and weights.

    Raises:
        CurriculumError: A server fails.
        ExperimentError: A package of a learner is missing.
    """
    learners.check(find_problem(each.problem) for each in trainings)
    # Parallel trainings would draw the same scenarios at the same time.
    for task in dict.fromkeys(find_problem(each.problem).task for each in trainings):
        held_out.load(folder / "held-out", task)
    if jobs == 1:
        for each in trainings:
            training.run(folder, each, binary, budget)
            done(each)
        return
    context = multiprocessing.get_context("spawn")  # a learner's threads do not survive a fork
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_use_one_core) as pool:
        futures = {pool.submit(training.run, folder, each, binary, budget): each for each in trainings}
        try:
            for future in as_completed(futures):
                future.result()
                done(futures[future])
        finally:
            pool.shutdown(cancel_futures=True)


def _use_one_core() -> None:
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
