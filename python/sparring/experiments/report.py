"""Report of an experiment: tables in Markdown, pictures, and a CSV file for other programs."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..evaluation import BLIND_PANEL
from .experiment import BASELINE, TARGET
from .results import METRICS, PART, ExperimentResults, read_comparison

#: Name of the report's file.
REPORT_FILE = "report.md"
#: Columns of the training curves, and their axis labels.
CURVES = (("heldout_skill", "held-out skill (contested)"), ("learner_level", "level in training"))


def write(results: ExperimentResults, folder: Path) -> list[Path]:
    """Writes the report, the table and the pictures; returns their files."""
    files = [folder / "trainings.csv", folder / REPORT_FILE, folder / "skill.svg", folder / "curves.svg"]
    _write_trainings(results, files[0])
    files[1].write_text(_format_report(results, folder))
    _draw_skill(results, files[2])
    _draw_curves(results, files[3])
    return files


def _write_trainings(results: ExperimentResults, file: Path) -> None:
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened)
        writer.writerow(
            ["arm", "seed", "task", *METRICS, "zero_variance_share", "steps_to_threshold", "steps", "training_s", "run"]
        )
        for training, done in results.done.items():
            arm, index = training.arm, results.trainings_of(training.arm).index(training)
            for number, task in enumerate(results.experiment.tasks):
                values = [results.values(arm, metric)[index, number] for metric in METRICS]
                zero_variance = next(row["group_counts"]["zero_variance_share"] for row in done["tasks"] if row["task"] == task)
                writer.writerow([
                    arm, training.seed, task, *(f"{value:.6f}" for value in values), zero_variance,
                    results.steps_to_threshold(training), done["steps"], round(done["training_s"], 1), done["run"],
                ])  # fmt: skip


TRAININGS_SECTION = """## Across trainings

Interquartile means across training seeds with 95 % stratified bootstrap intervals (rliable). One half of the episodes ranks the
scenarios, the other half measures the worst tenth. *Zero variance*: share of groups whose episodes all have the same score.
*Steps*: steps of each training at its first evaluation with a mean held-out skill of {threshold} or more.
"""
COMPARISON_SECTION = """## Against {baseline}, on the same scenarios

Differences with 95 % bootstrap intervals over scenarios, with the trainings of an arm pooled. *Improvement*: probability that
an episode of the arm has a higher score on the same scenario.
"""
PICTURES_SECTION = """![Held-out skill of each training](skill.svg)

![Training curves](curves.svg)
"""


def _format_report(results: ExperimentResults, folder: Path) -> str:
    experiment = results.experiment
    head = ["arm", "trainings", *METRICS, "zero variance", f"steps to {experiment.threshold}"]
    parts = [
        "# Curricula compared\n",
        _format_summary(results),
        TRAININGS_SECTION.format(threshold=experiment.threshold),
        format_table(head, [*(_arm_row(results, arm) for arm in results.arms()), _blind_row(results)]),
        COMPARISON_SECTION.format(baseline=BASELINE),
        _format_comparison(results, folder),
        PICTURES_SECTION,
    ]
    return "\n".join(parts)


def _format_summary(results: ExperimentResults) -> str:
    experiment = results.experiment
    seeds = ", ".join(map(str, experiment.seeds))
    servers = ", ".join(sorted({done["server"] for done in results.done.values()}))
    versions = ", ".join(f"{name} {version}" for name, version in results.versions().items())
    return (
        f"{len(results.done)} of {len(experiment.trainings())} trainings: {', '.join(experiment.arms)}, seeds {seeds}; "
        f"{experiment.budget:,} environment steps each on {', '.join(experiment.tasks)}, groups of {experiment.group_size}.\n"
        f"Held-out suite: {experiment.suite or 'the default'}, its {PART} scenarios, {experiment.rollouts} episodes each, with "
        f"the actions sampled.\n\nVersions: {versions}; server {servers}.\n"
    )


def format_table(head: list[str], rows: list[list[str]]) -> str:
    """Returns a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _arm_row(results: ExperimentResults, arm: str) -> list[str]:
    trainings = results.trainings_of(arm)
    steps = [results.steps_to_threshold(training) for training in trainings]
    zero_variance = results.zero_variance_share(arm)
    intervals = [results.across(arm, metric) for metric in METRICS]
    return [
        arm,
        str(len(trainings)),
        *("–" if interval is None else str(interval) for interval in intervals),
        "–" if zero_variance is None else f"{zero_variance:.2f}",
        ", ".join("never" if reached is None else f"{reached:,}" for reached in steps),
    ]


def _blind_row(results: ExperimentResults) -> list[str]:
    return [f"*{BLIND_PANEL}*", "", *(_format_value(results.blind(metric)) for metric in METRICS), "", ""]


def _format_value(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def _format_comparison(results: ExperimentResults, folder: Path) -> str:
    comparison = read_comparison(folder, results) or {}
    rows = [
        [
            arm,
            row["task"],
            *(_format_interval(row.get(name), "+") for name in ("skill", "success", "score")),
            _format_interval(row.get("improvement"), ""),
        ]
        for arm in results.arms()
        for row in comparison.get(arm, [])
        if row["part"] == PART and row["task"] in results.experiment.tasks
    ]
    if not rows:
        is_missing = BASELINE not in results.arms()
        return f"{BASELINE} is not among the arms.\n" if is_missing else "Compared once all trainings are complete.\n"
    return format_table(["arm", "task", "skill", "success", "score", "improvement"], rows)


def _format_interval(interval: dict[str, Any] | None, sign: str) -> str:
    if not interval:
        return "–"
    return f"{interval['mean']:{sign}.3f} [{interval['low']:{sign}.3f}, {interval['high']:{sign}.3f}]"


def save_figure(file: Path, columns: int, draw: Callable[[Any], None]) -> None:
    """Draws some axes side by side and saves them as SVG."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5 * columns, 3.6), layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    draw(axes)
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    # Without a date and with fixed ids, equal results give equal files.
    with rc_context({"svg.hashsalt": file.name}):
        figure.savefig(file, metadata={"Date": None})


def _draw_skill(results: ExperimentResults, file: Path) -> None:
    def draw(axes: Any) -> None:
        arms = results.arms()
        for row, arm in enumerate(reversed(arms)):
            skills = results.values(arm, "skill").mean(axis=1)
            axes[0].plot(skills, np.full(len(skills), row), "o", color="tab:blue", alpha=0.45)
            across = results.across(arm, "skill")
            if across is not None:
                axes[0].plot([across.low, across.high], [row, row], color="black")
                axes[0].plot([across.mean], [row], "|", color="black", markersize=14)
        axes[0].axvline(results.blind("skill"), color="tab:red", linestyle="--", label="blind plans")
        axes[0].set_yticks(range(len(arms)), list(reversed(arms)))
        axes[0].set_xlabel("held-out skill (contested)")
        axes[0].legend(frameon=False)

    save_figure(file, 1, draw)


def _draw_curves(results: ExperimentResults, file: Path) -> None:
    def draw(axes: Any) -> None:
        for axis, (column, label) in zip(axes, CURVES, strict=True):
            for arm in results.arms():
                steps, means = _mean_curve(results, arm, column)
                if (arm, column) == (TARGET, "learner_level"):
                    # Its run has a single level with index 0, whatever that level is in the task's table.
                    means = [float(results.experiment.target_level)] * len(steps)
                axis.plot([step / 1000 for step in steps], means, label=arm)
            axis.set_xlabel("environment steps, thousands")
            axis.set_ylabel(label)
        axes[0].axhline(results.blind("skill"), color="tab:red", linestyle="--", linewidth=1)
        axes[0].legend(frameon=False)

    save_figure(file, len(CURVES), draw)


def _mean_curve(results: ExperimentResults, arm: str, column: str) -> tuple[list[int], list[float]]:
    points: dict[int, list[float]] = {}
    for training in results.trainings_of(arm):
        for row in results.curves[training]:
            points.setdefault(row["steps"], []).append(row.get(column, float("nan")))
    steps = sorted(points)
    return steps, [float(np.mean(points[step])) for step in steps]
