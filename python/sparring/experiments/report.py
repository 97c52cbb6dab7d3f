"""What came out of an experiment as people read it: tables in Markdown, pictures, and tables for other programs."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..evaluation import BLIND
from .findings import NUMBERS, PART, Findings, compared
from .plan import BASELINE, TARGET

REPORT = "report.md"
#: What a curve is of, and what it is called.
CURVES = (("heldout_skill", "held-out skill (contested)"), ("learner_level", "level that is faced"))


def write(found: Findings, folder: Path) -> list[Path]:
    """Writes everything; the files."""
    files = [folder / "trainings.csv", folder / REPORT, folder / "skill.svg", folder / "curves.svg"]
    _trainings(found, files[0])
    files[1].write_text(_report(found, folder))
    _skill(found, files[2])
    _curves(found, files[3])
    return files


def _trainings(found: Findings, file: Path) -> None:
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened)
        writer.writerow(["arm", "seed", "task", *NUMBERS, "zero_variance_share", "steps_to_threshold", "steps", "flown_s", "run"])
        for one, told in found.done.items():
            for number, task in enumerate(found.experiment.tasks):
                at = found.of(one.arm).index(one)
                of = {name: found.values(one.arm, name)[at, number] for name in NUMBERS}
                zero = next(row["groups"]["zero_variance_share"] for row in told["tasks"] if row["task"] == task)
                writer.writerow([
                    one.arm, one.seed, task, *(f"{of[name]:.6f}" for name in NUMBERS), zero, found.steps_to_threshold(one),
                    told["steps"], round(told["flown_s"], 1), told["run"],
                ])  # fmt: skip


ACROSS = """## Across trainings

Interquartile means across training seeds with 95 % stratified bootstrap intervals (rliable). The worst tenth of scenarios is
ranked by one half of their episodes and told by the other. *Zero variance*: groups whose episodes all scored the same. *Steps*:
of each training, at the first look with a mean held-out skill of {threshold} or more.
"""
AGAINST = """## Against {baseline}, on the same scenarios

Differences with 95 % bootstrap intervals over scenarios, trainings of a side taken together; *improvement*: how likely an
episode of the arm scores higher on the same scenario.
"""
PICTURES = """![Held-out skill of each training](skill.svg)

![Over the training](curves.svg)
"""


def _report(found: Findings, folder: Path) -> str:
    asked = found.experiment
    head = ["arm", "trainings", *NUMBERS, "zero variance", f"steps to {asked.threshold}"]
    parts = [
        "# Curricula compared\n",
        _what(found),
        ACROSS.format(threshold=asked.threshold),
        _table(head, [*(_arm(found, arm) for arm in found.arms()), _blind(found)]),
        AGAINST.format(baseline=BASELINE),
        _compared(found, folder),
        PICTURES,
    ]
    return "\n".join(parts)


def _what(found: Findings) -> str:
    asked = found.experiment
    seeds = ", ".join(map(str, asked.seeds))
    servers = ", ".join(sorted({told["server"] for told in found.done.values()}))
    versions = ", ".join(f"{name} {version}" for name, version in found.versions().items())
    return (
        f"{len(found.done)} of {len(asked.trainings())} trainings: {', '.join(asked.arms)}, seeds {seeds}; {asked.budget:,} "
        f"environment steps each on {', '.join(asked.tasks)}, groups of {asked.group_size}.\n"
        f"Held-out suite: {asked.suite or 'the usual one'}, its {PART} scenarios, {asked.rollouts} episodes each by the policy "
        f"as it explores.\n\nVersions: {versions}; server {servers}.\n"
    )


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _arm(found: Findings, arm: str) -> list[str]:
    trainings = found.of(arm)
    steps = [found.steps_to_threshold(one) for one in trainings]
    zero = found.zero_variance(arm)
    numbers = [found.across(arm, number) for number in NUMBERS]
    return [
        arm,
        str(len(trainings)),
        *("–" if number is None else str(number) for number in numbers),
        "–" if zero is None else f"{zero:.2f}",
        ", ".join("never" if at is None else f"{at:,}" for at in steps),
    ]


def _blind(found: Findings) -> list[str]:
    return [f"*{BLIND}*", "", *(_shown(found.blind(number)) for number in NUMBERS), "", ""]


def _shown(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def _compared(found: Findings, folder: Path) -> str:
    told = compared(folder, found) or {}
    rows = [
        [
            arm,
            row["task"],
            *(_interval(row.get(name), "+") for name in ("skill", "success", "score")),
            _interval(row.get("improvement"), ""),
        ]
        for arm in found.arms()
        for row in told.get(arm, [])
        if row["part"] == PART and row["task"] in found.experiment.tasks
    ]
    if not rows:
        absent = BASELINE not in found.arms()
        return f"{BASELINE} is not among the arms.\n" if absent else "They are compared once all trainings are done.\n"
    return _table(["arm", "task", "skill", "success", "score", "improvement"], rows)


def _interval(of: dict[str, Any] | None, sign: str) -> str:
    return "–" if not of else f"{of['mean']:{sign}.3f} [{of['low']:{sign}.3f}, {of['high']:{sign}.3f}]"


def _drawn(file: Path, width: int, draw: Callable[[Any], None]) -> None:
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5 * width, 3.6), layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.subplots(1, width, squeeze=False)[0]
    draw(axes)
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    # Without a date, and by names that are not drawn: the same findings are the same file.
    with rc_context({"svg.hashsalt": file.name}):
        figure.savefig(file, metadata={"Date": None})


def _skill(found: Findings, file: Path) -> None:
    def draw(axes: Any) -> None:
        arms = found.arms()
        for place, arm in enumerate(reversed(arms)):
            each = found.values(arm, "skill").mean(axis=1)
            axes[0].plot(each, np.full(len(each), place), "o", color="tab:blue", alpha=0.45)
            across = found.across(arm, "skill")
            if across is not None:
                axes[0].plot([across.low, across.high], [place, place], color="black")
                axes[0].plot([across.mean], [place], "|", color="black", markersize=14)
        axes[0].axvline(found.blind("skill"), color="tab:red", linestyle="--", label="blind plans")
        axes[0].set_yticks(range(len(arms)), list(reversed(arms)))
        axes[0].set_xlabel("held-out skill (contested)")
        axes[0].legend(frameon=False)

    _drawn(file, 1, draw)


def _curves(found: Findings, file: Path) -> None:
    def draw(axes: Any) -> None:
        for axis, (name, label) in zip(axes, CURVES, strict=True):
            for arm in found.arms():
                steps, means = _mean_curve(found, arm, name)
                if (arm, name) == (TARGET, "learner_level"):
                    # Its run has one level, whatever that is in the table of the others.
                    means = [float(found.experiment.target_level)] * len(steps)
                axis.plot([at / 1000 for at in steps], means, label=arm)
            axis.set_xlabel("environment steps, thousands")
            axis.set_ylabel(label)
        axes[0].axhline(found.blind("skill"), color="tab:red", linestyle="--", linewidth=1)
        axes[0].legend(frameon=False)

    _drawn(file, len(CURVES), draw)


def _mean_curve(found: Findings, arm: str, name: str) -> tuple[list[int], list[float]]:
    points: dict[int, list[float]] = {}
    for one in found.of(arm):
        for row in found.curves[one]:
            points.setdefault(row["steps"], []).append(row.get(name, float("nan")))
    steps = sorted(points)
    return steps, [float(np.mean(points[at])) for at in steps]
