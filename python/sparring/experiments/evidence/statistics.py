"""Statistics of the trainings: steps to a threshold, ratios with intervals, and areas under the curve."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..experiment import ExperimentError
from ..results import Interval
from .protocol import ARMS, PROBLEMS, Problem, find_problem
from .training import Training, results_folder, stored_budget

#: Names of a report's CSV files: the measures of each training, and its curve.
TRAININGS_FILE, CURVES_FILE = "trainings.csv", "curves.csv"
#: Resamples of a bootstrap.
RESAMPLES = 10_000


@dataclass(frozen=True)
class Outcome:
    """Results of a complete training."""

    training: Training
    problem: Problem
    #: Environment steps at each evaluation.
    steps: npt.NDArray[np.float64]
    #: Held-out measure at each evaluation.
    values: npt.NDArray[np.float64]
    #: Measures of the final policy: `success`, `skill` and `worst_tenth`.
    final: dict[str, float]
    #: Share of groups whose episodes all have the same score; None if groups have one episode.
    zero_variance: float | None
    #: Share of final episodes with at least one failure of each mode; None for a training of before this was measured.
    failures: dict[str, float] | None = None
    #: Number of episodes on layouts that aim at each failure mode.
    aimed: dict[str, int] = field(default_factory=dict)

    def steps_to(self, threshold: float) -> float | None:
        """Returns the steps at the first of two evaluations whose mean is the threshold or more; None if there are none.

        One evaluation has a standard error of about 0.03, so a single one would often be above by chance.
        """
        reached = np.flatnonzero((self.values[:-1] + self.values[1:]) / 2 >= threshold)
        return float(self.steps[reached[0]]) if reached.size else None

    def steps_or_budget(self, threshold: float) -> float:
        """Returns the steps to a threshold, or the budget, which is a lower bound of them."""
        reached = self.steps_to(threshold)
        return float(self.problem.budget) if reached is None else reached

    def area(self) -> float:
        """Returns the mean of the measure over the budget, by trapezoids."""
        widths = np.diff(self.steps)
        return float((widths * (self.values[:-1] + self.values[1:]) / 2).sum() / widths.sum())


def read(folder: Path) -> list[Outcome]:
    """Reads the complete trainings, in the order of the protocol.

    A training without a file of results, but with rows in the CSV files of an earlier report, is read from these. The failures of
    its episodes are unknown.

    Raises:
        ExperimentError: There are none, or those of a problem have several budgets, so that they cannot be compared.
    """
    outcomes = [_outcome(json.loads(file.read_text())) for file in sorted((folder / "trainings").glob("*/*.json"))]
    have_files = {outcome.training for outcome in outcomes}
    outcomes += [outcome for outcome in _read_csv(folder) if outcome.training not in have_files]
    if not outcomes:
        raise ExperimentError(f"--out must have a complete training, got {folder}; run it without --report first")
    _check_budgets(folder, outcomes)
    problems, arms = [problem.name for problem in PROBLEMS], [arm.name for arm in ARMS]
    return sorted(
        outcomes, key=lambda each: (problems.index(each.problem.name), arms.index(each.training.arm), each.training.seed)
    )


def reported(folder: Path) -> set[Training]:
    """Returns the trainings in the CSV files of an earlier report, which need not run again."""
    return {outcome.training for outcome in _read_csv(folder)}


def _read_csv(folder: Path) -> list[Outcome]:
    """Reads the trainings of an earlier report from its CSV files."""
    files = [folder / TRAININGS_FILE, folder / CURVES_FILE]
    if not all(file.exists() for file in files):
        return []
    trainings, curves = (list(csv.DictReader(file.read_text().splitlines())) for file in files)
    points: dict[Training, list[tuple[float, float]]] = {}
    for row in curves:
        points.setdefault(_training_of(row), []).append((float(row["steps"]), float(row["value"])))
    outcomes = []
    for row in trainings:
        training = _training_of(row)
        steps, values = np.array(points[training], np.float64).T
        final = {measure: float(row[measure]) for measure in ("success", "skill", "worst_tenth")}
        zero_variance = float(row["zero_variance"]) if row["zero_variance"] else None
        outcomes.append(Outcome(training, find_problem(training.problem), steps, values, final, zero_variance))
    return outcomes


def _training_of(row: dict[str, str]) -> Training:
    return Training(row["problem"], row["arm"], int(row["seed"]))


def _check_budgets(folder: Path, outcomes: Sequence[Outcome]) -> None:
    for name in dict.fromkeys(outcome.problem.name for outcome in outcomes):
        budgets = sorted({outcome.problem.budget for outcome in outcomes if outcome.problem.name == name})
        if len(budgets) > 1:
            raise ExperimentError(
                f"--out must have trainings of {name} with one budget, got {' and '.join(map(str, budgets))} steps in "
                f"{results_folder(folder, name)}; move those of the trials to another folder"
            )


def _outcome(row: dict[str, Any]) -> Outcome:
    problem = find_problem(row["problem"])
    problem = replace(problem, budget=stored_budget(row))
    return Outcome(
        Training(row["problem"], row["arm"], row["seed"]),
        problem,
        np.array([look["steps"] for look in row["curve"]], np.float64),
        np.array([look[problem.measure] for look in row["curve"]], np.float64),
        row["final"],
        row["zero_variance"],
        row.get("failures"),
        row.get("aimed", {}),
    )


def pairs(arm: Sequence[Outcome], baseline: Sequence[Outcome]) -> tuple[list[Outcome], list[Outcome]]:
    """Returns the trainings of both arms that have the same seeds, in the same order."""
    by_seed = {outcome.training.seed: outcome for outcome in baseline}
    shared = [outcome for outcome in arm if outcome.training.seed in by_seed]
    return shared, [by_seed[outcome.training.seed] for outcome in shared]


def ratio_of_steps(arm: Sequence[Outcome], baseline: Sequence[Outcome], threshold: float) -> Interval | None:
    """Returns how many times as many steps the baseline needs as the arm: the ratio of the mean steps over seeds.

    A training that does not reach the threshold counts as its budget. If only the baseline misses it, the ratio is a lower bound.
    None if the arms have no seed in common.
    """
    arm, baseline = pairs(arm, baseline)
    if not arm:
        return None
    slow = np.array([outcome.steps_or_budget(threshold) for outcome in baseline])
    fast = np.array([outcome.steps_or_budget(threshold) for outcome in arm])
    return _bootstrap(lambda slow, fast, axis=-1: slow.mean(axis) / fast.mean(axis), slow, fast)


def relative_area(arm: Sequence[Outcome], baseline: Sequence[Outcome]) -> Interval | None:
    """Returns by which part of the baseline's area the area of the arm is larger; negative for a loss.

    None if the arms have no seed in common, or an area of the baseline is zero: its learner has learned nothing.
    """
    arm, baseline = pairs(arm, baseline)
    own, other = (np.array([outcome.area() for outcome in outcomes]) for outcomes in (arm, baseline))
    if not arm or not other.all():
        return None
    return _bootstrap(lambda own, other, axis=-1: (own - other).mean(axis) / np.abs(other.mean(axis)), own, other)


def difference(arm: Sequence[Outcome], control: Sequence[Outcome], measure: str) -> Interval | None:
    """Returns by how much a measure of the final policies of an arm is larger than that of a control.

    None if the arms have no seed in common.
    """
    arm, control = pairs(arm, control)
    if not arm:
        return None
    return mean([own.final[measure] - other.final[measure] for own, other in zip(arm, control, strict=True)])


def aimed_mode(designs: Outcome) -> str | None:
    """Returns the failure mode at which most designed episodes of a training aim; None without any."""
    return max(designs.aimed, key=lambda mode: designs.aimed[mode], default=None)


def aimed_failure_difference(designs: Sequence[Outcome], control: Sequence[Outcome]) -> Interval | None:
    """Returns by how much the share of episodes with the aimed failure is larger than without designed layouts.

    The mode is that at which most designed episodes of the pair aim. None if no pair has such a mode and both shares.
    """
    designs, control = pairs(designs, control)
    changes = []
    for own, other in zip(designs, control, strict=True):
        mode = aimed_mode(own)
        if mode is not None and own.failures is not None and other.failures is not None:
            changes.append(own.failures.get(mode, 0.0) - other.failures.get(mode, 0.0))
    return mean(changes) if changes else None


def mean(values: Sequence[float]) -> Interval:
    """Returns a mean over seeds."""
    return _bootstrap(lambda values, axis=-1: values.mean(axis), np.array(values))


def _bootstrap(statistic: Any, *samples: npt.NDArray[np.float64]) -> Interval:
    """Returns a statistic with its 95 % interval by percentiles of a bootstrap over seeds, which keeps pairs together."""
    from scipy import stats

    value = float(statistic(*samples))
    if len(samples[0]) < 2:
        return Interval(value, value, value)
    found = stats.bootstrap(
        samples,
        statistic,
        paired=True,
        vectorized=True,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),  # equal results get equal intervals
    )
    return Interval(value, float(found.confidence_interval.low), float(found.confidence_interval.high))
