"""Runs the trainings of the protocol that are not complete, some of them in parallel."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from ..experiment import ExperimentError
from ..processes import open_pool
from . import held_out, learners, statistics, training
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


def missing(folder: Path, trainings: Sequence[Training], budget: int | None = None) -> list[Training]:
    """Returns the trainings without results, which are in files or in the tables of a report.

    Args:
        folder: Folder of the results.
        trainings: The trainings that are asked for.
        budget: Budget of a trial, in place of the protocol's.

    Raises:
        ExperimentError: The folder has a training of the same problems with another budget, which the command would not replace.
    """
    for name in dict.fromkeys(each.problem for each in trainings):
        asked = budget or find_problem(name).budget
        for file in sorted(training.results_folder(folder, name).glob("*.json")):
            stored = training.stored_budget(json.loads(file.read_text()))
            if stored != asked:
                raise ExperimentError(
                    f"--out must have no training of {name} with another budget than {asked} steps, "
                    f"got {file} with {stored}: choose another folder"
                )
    reported = statistics.reported(folder)
    return [each for each in trainings if each not in reported and not each.file(folder).exists()]


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
    with open_pool(jobs) as pool:
        futures = {pool.submit(training.run, folder, each, binary, budget): each for each in trainings}
        try:
            for future in as_completed(futures):
                future.result()
                done(futures[future])
        finally:
            pool.shutdown(cancel_futures=True)
