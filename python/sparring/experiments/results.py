"""Results of an experiment, read from its folder, and their statistics.

Means across trainings are interquartile means with stratified bootstrap intervals by rliable (Agarwal et al. 2021, "Deep
reinforcement learning at the edge of the statistical precipice", section 4.3). Scenarios are never trimmed: the value of a
training is its mean over all scenarios of a part of the suite. The server compares two arms on the same scenarios.
"""

from __future__ import annotations

import csv
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..evaluation import BLIND_PANEL
from .experiment import COMPARISON_FILE, DONE_FILE, EXPERIMENT_FILE, Experiment, ExperimentError, Training
from .training import is_done

#: Resamples of a bootstrap.
RESAMPLES = 2000
#: Metrics of an arm in the report.
METRICS = ("skill", "success", "score", "cvar10")
#: Part of the suite in the report.
PART = "contested"


@dataclass(frozen=True)
class Interval:
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        if self.low == self.high:  # a single training
            return f"{self.mean:.3f}"
        return f"{self.mean:.3f} [{self.low:.3f}, {self.high:.3f}]"


@dataclass(frozen=True)
class ExperimentResults:
    """Results of the complete trainings of an experiment."""

    experiment: Experiment
    #: Summary that each training wrote.
    done: dict[Training, dict[str, Any]]
    #: Evaluations during each training.
    curves: dict[Training, list[dict[str, Any]]]
    #: Results on each held-out scenario.
    scenarios: dict[Training, list[dict[str, Any]]]

    def arms(self) -> list[str]:
        """Returns the arms with a complete training."""
        return [arm for arm in self.experiment.arms if self.trainings_of(arm)]

    def trainings_of(self, arm: str) -> list[Training]:
        """Returns the complete trainings of an arm."""
        return [training for training in self.done if training.arm == arm]

    def evaluations(self) -> dict[str, str]:
        """Returns for each arm the ids of its evaluations, separated by commas."""
        return {arm: ",".join(self.done[training]["evaluation"] for training in self.trainings_of(arm)) for arm in self.arms()}

    def versions(self) -> dict[str, str]:
        """Returns for each package all versions that trainings used."""
        versions: dict[str, set[str]] = {}
        for done in self.done.values():
            for name, version in done.get("versions", {}).items():
                versions.setdefault(name, set()).add(version)
        return {name: " and ".join(sorted(found)) for name, found in versions.items()}

    def values(self, arm: str, metric: str) -> npt.NDArray[np.float64]:
        """Returns a metric of an arm, trainings × tasks; NaN if it is undefined."""
        tasks = self.experiment.tasks
        rows = [[_mean(self.done[training]["rows"], task, metric, arm) for task in tasks] for training in self.trainings_of(arm)]
        return np.array(rows, dtype=np.float64).reshape(-1, len(tasks))

    def blind(self, metric: str) -> float:
        """Returns a metric of the blind panel, as the mean over tasks."""
        rows = next(iter(self.done.values()))["rows"]
        return float(np.nanmean([_mean(rows, task, metric, BLIND_PANEL) for task in self.experiment.tasks]))

    def across(self, arm: str, metric: str) -> Interval | None:
        """Returns the interquartile mean across an arm's trainings; None if the metric is undefined."""
        values = self.values(arm, metric)
        return None if np.isnan(values).any() or not values.size else interquartile(values)

    def steps_to_threshold(self, training: Training) -> int | None:
        """Returns the steps at the first evaluation whose mean held-out skill reaches the threshold; None if none does."""
        by_steps: dict[int, list[float]] = {}
        for row in self.curves[training]:
            by_steps.setdefault(row["steps"], []).append(row["heldout_skill"])
        for steps, skills in sorted(by_steps.items()):
            if np.mean(skills) >= self.experiment.threshold:
                return steps
        return None

    def zero_variance_share(self, arm: str) -> float | None:
        """Returns the share of an arm's groups whose episodes all have the same score, over tasks and trainings."""
        rows = [row for training in self.trainings_of(arm) for row in self.done[training]["tasks"]]
        shares = [row["group_counts"]["zero_variance_share"] for row in rows]
        known = [share for share in shares if share is not None]
        return float(np.mean(known)) if known else None


def check_dependencies() -> None:
    """Checks that rliable can be imported.

    Raises:
        ExperimentError: The import fails.
    """
    try:
        from rliable import library  # noqa: F401
    except Exception as error:  # incompatible packages raise errors of many types
        raise ExperimentError(f"cannot import rliable: {error}; pip install 'sparring[experiments]'") from error


def interquartile(values: npt.NDArray[np.float64]) -> Interval:
    """Returns the interquartile mean of an array of trainings × tasks, with its interval.

    With fewer than four trainings no value is trimmed, and the interval is wide or meaningless.
    """
    from rliable import library, metrics

    with warnings.catch_warnings():
        # rliable calls a function that renames its generator argument.
        warnings.simplefilter("ignore", FutureWarning)
        means, intervals = library.get_interval_estimates(
            {"arm": values},
            lambda scores: np.array([metrics.aggregate_iqm(scores)]),
            reps=RESAMPLES,
            random_state=np.random.RandomState(0),  # equal results get equal intervals
        )
    return Interval(float(means["arm"][0]), *(float(edge[0]) for edge in intervals["arm"]))


def read(folder: Path) -> ExperimentResults:
    """Reads the results of an experiment.

    Raises:
        ExperimentError: The folder has no experiment, or no training is complete.
    """
    file = folder / EXPERIMENT_FILE
    if not file.exists():
        raise ExperimentError(f"--out must be the folder of an experiment, got {folder}, which has no {EXPERIMENT_FILE}")
    recorded = json.loads(file.read_text())
    experiment = Experiment(**{name: _to_tuple(value) for name, value in recorded["experiment"].items()})
    done = [training for training in experiment.trainings() if is_done(folder, training)]
    if not done:
        raise ExperimentError(f"--out must have a complete training, got {folder}; run the experiment without --report first")
    return ExperimentResults(
        experiment,
        {training: json.loads((folder / training.folder / DONE_FILE).read_text()) for training in done},
        {training: _read_csv(folder / training.folder / "curve.csv") for training in done},
        {training: _read_csv(folder / training.folder / "scenarios.csv") for training in done},
    )


def read_comparison(folder: Path, results: ExperimentResults) -> dict[str, list[dict[str, Any]]] | None:
    """Returns the server's comparison of each arm with the baseline; None if it is missing or of other trainings."""
    file = folder / COMPARISON_FILE
    comparison = json.loads(file.read_text()) if file.exists() else {}
    return comparison["rows"] if comparison.get("of") == results.evaluations() else None


def _mean(rows: list[dict[str, Any]], task: str, metric: str, policy: str) -> float:
    for row in rows:
        if (row["task"], row["part"], row["policy"]) == (task, PART, policy) and row.get(metric):
            return float(row[metric]["mean"])
    return float("nan")


def _to_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _read_csv(file: Path) -> list[dict[str, Any]]:
    with file.open(newline="") as opened:
        return [{name: _parse(value) for name, value in row.items()} for row in csv.DictReader(opened)]


def _parse(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text if text else float("nan")
