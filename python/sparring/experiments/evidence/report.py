"""Tables and figures of the evidence runs, and CSV files with every seed."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..report import format_table, save_figure
from ..results import Interval
from .protocol import ARMS, BASELINE_ARM, CONTROL_ARM, DESIGNS_ARM, PROBLEMS, Problem
from .statistics import (
    CURVES_FILE,
    TRAININGS_FILE,
    Outcome,
    aimed_failure_difference,
    aimed_mode,
    difference,
    mean,
    pairs,
    ratio_of_steps,
    read,
    relative_area,
)

#: Name of the report's file.
REPORT_FILE = "report.md"
#: Columns of the table of a problem.
COLUMNS = (
    "arm", "seeds", "thousand steps to {0}", "mean", "ratio", "to {1}", "ratio", "area", "against uniform levels", "final",
    "worst tenth", "zero variance",
)  # fmt: skip
#: Largest number of arms of a figure in which each has the range of its seeds.
FEW_ARMS = 5

#: Columns of the table of designed layouts.
DESIGN_COLUMNS = ("problem", "pairs", "worst tenth", "mean", "aimed failure", "aimed mode (pairs)")


def write(folder: Path) -> list[Path]:
    """Writes the report of the complete trainings, its figures and its CSV files; returns their paths."""
    outcomes = read(folder)
    files = [folder / TRAININGS_FILE, folder / CURVES_FILE]
    _write_trainings(outcomes, files[0])
    _write_curves(outcomes, files[1])
    parts = ["# Evidence\n"]
    for problem in PROBLEMS:
        of_problem = [outcome for outcome in outcomes if outcome.problem.name == problem.name]
        if of_problem:
            figure = folder / f"{problem.name.replace('/', '-')}.svg"
            _draw(of_problem[0].problem, of_problem, figure)
            files.append(figure)
            parts.append(
                f"## {problem.name}\n\n{_table(of_problem[0].problem, of_problem)}\n![Curves of {problem.name}]({figure.name})\n"
            )
    parts.extend(_designs(outcomes))
    files.append(folder / REPORT_FILE)
    files[-1].write_text("\n".join(parts))
    return files


def of_arm(outcomes: Sequence[Outcome], arm: str) -> list[Outcome]:
    """Returns the trainings of an arm."""
    return [outcome for outcome in outcomes if outcome.training.arm == arm]


def _table(problem: Problem, outcomes: Sequence[Outcome]) -> str:
    head = [column.format(*problem.thresholds) for column in COLUMNS]
    rows = [
        _row(problem, of_arm(outcomes, arm.name), of_arm(outcomes, BASELINE_ARM)) for arm in ARMS if of_arm(outcomes, arm.name)
    ]
    return format_table(head, rows)


def _designs(outcomes: Sequence[Outcome]) -> list[str]:
    """Compares the final policies of the arm with designed layouts with those of its control."""
    rows = []
    for problem in PROBLEMS:
        of_problem = [outcome for outcome in outcomes if outcome.problem.name == problem.name]
        designs, control = pairs(of_arm(of_problem, DESIGNS_ARM), of_arm(of_problem, CONTROL_ARM))
        if designs:
            changes = [difference(designs, control, measure) for measure in ("worst_tenth", problem.measure)]
            changes.append(aimed_failure_difference(designs, control))
            modes = Counter(mode for mode in map(aimed_mode, designs) if mode is not None)
            aims = ", ".join(f"{mode} ({pairs})" for mode, pairs in modes.most_common()) or "–"
            rows.append([problem.name, str(len(designs)), *(_format(change, "+.3f") for change in changes), aims])
    if not rows:
        return []
    caption = f"Final policies of `{DESIGNS_ARM}`, compared with those of `{CONTROL_ARM}` in pairs with the same seed."
    return [f"## Designed layouts\n\n{caption}\n", format_table(list(DESIGN_COLUMNS), rows)]


def _row(problem: Problem, arm: Sequence[Outcome], baseline: Sequence[Outcome]) -> list[str]:
    first, second = problem.thresholds
    zero_variance = [outcome.zero_variance for outcome in arm if outcome.zero_variance is not None]
    return [
        arm[0].training.arm,
        str(len(arm)),
        " ".join(_thousands(outcome.steps_to(first)) for outcome in arm),
        _thousands(float(np.mean([outcome.steps_or_budget(first) for outcome in arm]))),
        _format(ratio_of_steps(arm, baseline, first)),
        _thousands(float(np.mean([outcome.steps_or_budget(second) for outcome in arm]))),
        _format(ratio_of_steps(arm, baseline, second)),
        f"{mean([outcome.area() for outcome in arm]).mean:.3f}",
        _format(relative_area(arm, baseline), "+.1%"),
        _format(mean([outcome.final[problem.measure] for outcome in arm]), ".3f"),
        f"{mean([outcome.final['worst_tenth'] for outcome in arm]).mean:.3f}",
        f"{float(np.mean(zero_variance)):.2f}" if zero_variance else "–",
    ]


def _thousands(steps: float | None) -> str:
    return "–" if steps is None else f"{steps / 1000:.0f}"


def _format(interval: Interval | None, form: str = ".2f") -> str:
    return "–" if interval is None else f"{interval.mean:{form}} [{interval.low:{form}}, {interval.high:{form}}]"


def _write_csv(file: Path, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(rows)


def _write_trainings(outcomes: Sequence[Outcome], file: Path) -> None:
    head = [
        "problem",
        "arm",
        "seed",
        "steps_to_first",
        "steps_to_second",
        "area",
        "success",
        "skill",
        "worst_tenth",
        "zero_variance",
    ]

    def row(outcome: Outcome) -> list[Any]:
        training, final = outcome.training, outcome.final
        reached = [outcome.steps_to(threshold) for threshold in outcome.problem.thresholds]
        measures = [outcome.area(), final["success"], final["skill"], final["worst_tenth"], outcome.zero_variance]
        return [
            training.problem, training.arm, training.seed,
            *("" if steps is None else int(steps) for steps in reached),
            *("" if value is None else f"{value:.4f}" for value in measures),
        ]  # fmt: skip

    _write_csv(file, head, map(row, outcomes))


def _write_curves(outcomes: Sequence[Outcome], file: Path) -> None:
    rows = (
        [outcome.training.problem, outcome.training.arm, outcome.training.seed, int(steps), f"{value:.4f}"]
        for outcome in outcomes
        for steps, value in zip(outcome.steps, outcome.values, strict=True)
    )
    _write_csv(file, ["problem", "arm", "seed", "steps", "value"], rows)


def _draw(problem: Problem, outcomes: Sequence[Outcome], file: Path) -> None:
    """Draws the mean curves with the range of the seeds, and the share of trainings below the first threshold.

    Among many arms, only the baseline and `auto` have the range, so that the curves stay readable.
    """
    drawn = [arm for arm in ARMS if of_arm(outcomes, arm.name)]

    def draw(axes: Any) -> None:
        for arm in drawn:
            trainings = of_arm(outcomes, arm.name)
            is_main = len(drawn) <= FEW_ARMS or arm.name in (BASELINE_ARM, CONTROL_ARM)
            color = f"C{ARMS.index(arm) % 10}"
            line = {"linestyle": "-" if ARMS.index(arm) < 10 else "--", "linewidth": 1.5 if is_main else 0.8}
            grid = trainings[0].steps  # trainings end rollouts, and so evaluate, at different steps
            values = np.array([np.interp(grid, outcome.steps, outcome.values) for outcome in trainings])
            steps = grid / 1e6
            axes[0].plot(steps, values.mean(axis=0), color=color, label=arm.name, **line)
            if is_main:
                axes[0].fill_between(steps, values.min(axis=0), values.max(axis=0), color=color, alpha=0.12, linewidth=0)
            _draw_survival(axes[1], problem, trainings, color=color, label=arm.name, **line)
        axes[0].set_ylabel(f"held-out {problem.measure}")
        axes[0].axhline(problem.thresholds[0], color="black", linewidth=0.8, linestyle=":")
        axes[1].set_ylabel(f"trainings below {problem.thresholds[0]}")
        axes[1 if len(drawn) > FEW_ARMS else 0].legend(frameon=False, fontsize=7)
        for axis in axes:
            axis.set_xlabel("environment steps, millions")

    save_figure(file, 2, draw)


def _draw_survival(axis: Any, problem: Problem, trainings: Sequence[Outcome], **line: Any) -> None:
    """Draws the estimate of Kaplan and Meier (1958) of the share of trainings that have not reached the threshold."""
    from scipy import stats

    reached = [outcome.steps_to(problem.thresholds[0]) for outcome in trainings]
    times = stats.CensoredData(
        uncensored=[steps / 1e6 for steps in reached if steps is not None],
        right=[problem.budget / 1e6 for steps in reached if steps is None],
    )
    survival = stats.ecdf(times).sf
    axis.step([0.0, *survival.quantiles, problem.budget / 1e6], [1.0, *survival.probabilities, survival.probabilities[-1]],
              where="post", **line)  # fmt: skip
