"""What came out of an experiment: read from its folder, and what may be said of it.

Means across trainings are interquartile means with stratified bootstrap intervals by rliable (Agarwal et al. 2021, "Deep
reinforcement learning at the edge of the statistical precipice", section 4.3). Scenarios are never trimmed: a training's number
is its mean over all of a part of the suite. What two arms differ by is told on the same scenarios, by the server.
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

from ..evaluation import BLIND
from .plan import COMPARED, DONE, FILE, Experiment, Training, Wrong
from .training import is_done

#: Resamples of a bootstrap.
RESAMPLES = 2000
#: What is told of an arm, and of what part of the suite.
NUMBERS = ("skill", "success", "score", "cvar10")
PART = "contested"


@dataclass(frozen=True)
class Interval:
    """A mean, and where it may lie: 95 %."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        if self.low == self.high:  # one training alone
            return f"{self.mean:.3f}"
        return f"{self.mean:.3f} [{self.low:.3f}, {self.high:.3f}]"


@dataclass(frozen=True)
class Findings:
    """What came out."""

    experiment: Experiment
    #: What each training wrote down, done ones alone.
    done: dict[Training, dict[str, Any]]
    #: The looks at each.
    curves: dict[Training, list[dict[str, Any]]]
    #: How each did on each held-out scenario.
    scenarios: dict[Training, list[dict[str, Any]]]

    def arms(self) -> list[str]:
        """Arms of which a training is done."""
        return [arm for arm in self.experiment.arms if self.of(arm)]

    def of(self, arm: str) -> list[Training]:
        """An arm's trainings that are done."""
        return [one for one in self.done if one.arm == arm]

    def evaluations(self) -> dict[str, str]:
        """Of each arm, what its trainings' evaluations are called, with commas between."""
        return {arm: ",".join(self.done[one]["evaluation"] for one in self.of(arm)) for arm in self.arms()}

    def versions(self) -> dict[str, str]:
        """What the trainings were flown with: of each package all of its versions."""
        told: dict[str, set[str]] = {}
        for done in self.done.values():
            for name, version in done.get("versions", {}).items():
                told.setdefault(name, set()).add(version)
        return {name: " and ".join(sorted(versions)) for name, versions in told.items()}

    def values(self, arm: str, number: str) -> npt.NDArray[np.float64]:
        """Trainings by tasks; those that have no such number are NaN."""
        tasks = self.experiment.tasks
        rows = [[_of(self.done[one]["rows"], task, number, one.arm) for task in tasks] for one in self.of(arm)]
        return np.array(rows, dtype=np.float64).reshape(-1, len(tasks))

    def blind(self, number: str) -> float:
        """What plans reach that look at nothing, over tasks."""
        told = next(iter(self.done.values()))["rows"]
        return float(np.nanmean([_of(told, task, number, BLIND) for task in self.experiment.tasks]))

    def across(self, arm: str, number: str) -> Interval | None:
        """The interquartile mean across an arm's trainings; none where the number is undefined."""
        values = self.values(arm, number)
        return None if np.isnan(values).any() or not values.size else interquartile(values)

    def steps_to_threshold(self, one: Training) -> int | None:
        """Steps at the first look at which mean held-out skill over tasks is at the threshold; none: it never was."""
        by_steps: dict[int, list[float]] = {}
        for row in self.curves[one]:
            by_steps.setdefault(row["steps"], []).append(row["heldout_skill"])
        for steps, skills in sorted(by_steps.items()):
            if np.mean(skills) >= self.experiment.threshold:
                return steps
        return None

    def zero_variance(self, arm: str) -> float | None:
        """The share of an arm's groups whose episodes all had the same score, over tasks and trainings."""
        shares = [
            task["groups"]["zero_variance_share"] for one in self.of(arm) for task in self.done[one]["tasks"]
        ]  # fmt: skip
        known = [share for share in shares if share is not None]
        return float(np.mean(known)) if known else None


def _of(rows: list[dict[str, Any]], task: str, number: str, policy: str) -> float:
    for row in rows:
        if (row["task"], row["part"], row["policy"]) == (task, PART, policy) and row.get(number):
            return float(row[number]["mean"])
    return float("nan")


def needs() -> None:
    """Whether what the report is made with can be used.

    Raises:
        Wrong: It cannot.
    """
    try:
        from rliable import library  # noqa: F401
    except Exception as error:  # libraries that do not go together fail in ways of their own
        raise Wrong(f"rliable cannot be used here ({error}): pip install 'sparring[experiments]'") from error


def interquartile(values: npt.NDArray[np.float64]) -> Interval:
    """The interquartile mean of trainings by tasks, with its interval. With fewer than four trainings of a task nothing is
    trimmed, and the interval says little."""
    from rliable import library, metrics

    with warnings.catch_warnings():
        # What rliable calls is about to take its generator by another name.
        warnings.simplefilter("ignore", FutureWarning)
        means, intervals = library.get_interval_estimates(
            {"arm": values},
            lambda scores: np.array([metrics.aggregate_iqm(scores)]),
            reps=RESAMPLES,
            random_state=np.random.RandomState(0),  # the same findings have the same intervals
        )
    return Interval(float(means["arm"][0]), *(float(edge[0]) for edge in intervals["arm"]))


def read(folder: Path) -> Findings:
    """Reads an experiment.

    Raises:
        Wrong: There is none, or nothing of it is done.
    """
    file = folder / FILE
    if not file.exists():
        raise Wrong(f"out: {folder} has no experiment")
    recorded = json.loads(file.read_text())
    experiment = Experiment(**{name: _tuple(value) for name, value in recorded["experiment"].items()})
    done = [one for one in experiment.trainings() if is_done(folder, one)]
    if not done:
        raise Wrong(f"out: no training in {folder} is done")
    return Findings(
        experiment,
        {one: json.loads((folder / one.folder / DONE).read_text()) for one in done},
        {one: _read(folder / one.folder / "curve.csv") for one in done},
        {one: _read(folder / one.folder / "scenarios.csv") for one in done},
    )


def compared(folder: Path, found: Findings) -> dict[str, list[dict[str, Any]]] | None:
    """Each arm against the baseline on the same scenarios, as the server compares them; none where that was not asked, or of
    other trainings than are done now."""
    file = folder / COMPARED
    told = json.loads(file.read_text()) if file.exists() else {}
    return told["rows"] if told.get("of") == found.evaluations() else None


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _read(file: Path) -> list[dict[str, Any]]:
    with file.open(newline="") as opened:
        return [{name: _number(value) for name, value in row.items()} for row in csv.DictReader(opened)]


def _number(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text if text else float("nan")
