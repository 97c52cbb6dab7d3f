"""What an experiment compares: arms, trainings, and what is recorded of both."""

from __future__ import annotations

import json
import platform
import re
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import sparring

#: Strategies of a server, and the baseline that is none of its: one level alone.
STRATEGIES = ("ladder", "uniform", "fixed", "adr", "learnability", "plr", "plr_robust", "accel", "alp_gmm")
TARGET = "target"
#: Behind a strategy: with layouts that are designed for what the agent fails at, which everything else here does without.
DESIGNS = "+designs"
#: What the others are compared with.
BASELINE = "uniform"
#: Packages whose versions decide what comes out.
PACKAGES = ("numpy", "gymnasium", "torch", "rliable")
FILE = "experiment.json"
#: Each arm against the baseline, as the server compares them.
COMPARED = "compared.json"
#: Written last: a training whose folder has it is done.
DONE = "done.json"


class Wrong(Exception):
    """What was asked for cannot be done; one sentence."""


@dataclass(frozen=True)
class Experiment:
    """What is asked for. Two of the same differ only in what chance and a machine's speed make of them."""

    arms: tuple[str, ...] = ("ladder", "uniform", "fixed", "target")
    seeds: tuple[int, ...] = (1, 2, 3)
    #: Environment steps of a training.
    budget: int = 300_000
    tasks: tuple[str, ...] = ("kessler/survival",)
    #: Episodes of a scenario: some strategies learn from how they differ.
    group_size: int = 4
    #: The level that the arm `target` trains at.
    target_level: int = 5
    suite: str | None = None
    #: Looks at the held-out suite during a training, evenly spaced.
    looks: int = 6
    #: Episodes of each held-out scenario at the end: 8, or the worst tenth cannot be told.
    rollouts: int = 8
    #: The held-out skill whose first look counts as having got there.
    threshold: float = 0.2
    num_envs: int = 64

    def __post_init__(self) -> None:
        for arm in self.arms:
            strategy = arm.removesuffix(DESIGNS)
            if strategy not in STRATEGIES and arm != TARGET:
                raise Wrong(f"strategies: {arm!r} is none of {', '.join(STRATEGIES)} (each also with {DESIGNS}) and {TARGET}")
        for name in ("arms", "seeds", "tasks"):
            given = getattr(self, name)
            if not given or len(set(given)) != len(given):
                raise Wrong(f"{name}: none, or one of them twice")
        for name in ("budget", "group_size", "looks", "rollouts", "num_envs", "target_level"):
            least = 0 if name == "target_level" else 1
            if getattr(self, name) < least:
                raise Wrong(f"{name}: {getattr(self, name)} is below {least}")
        for task in self.tasks:
            levels = len(sparring.levels(task))
            if self.target_level >= levels:
                raise Wrong(f"target_level: {task} has levels 0 to {levels - 1}")

    def trainings(self) -> list[Training]:
        """All of them, seed by seed, so that an experiment that is stopped early has compared all arms."""
        return [Training(arm, seed) for seed in self.seeds for arm in self.arms]

    def run_settings(self, arm: str, seed: int) -> dict[str, Any]:
        """The run of an arm, as a server is asked for it."""
        strategy, designs = arm.removesuffix(DESIGNS), arm.endswith(DESIGNS)
        settings: dict[str, Any] = {
            "name": f"{arm}, seed {seed}",
            "seed": seed,
            "tasks": list(self.tasks),
            "group_size": self.group_size,
            "strategy": "uniform" if arm == TARGET else strategy,
            "design": {} if designs else {"share": 0},
        }
        if arm == TARGET:
            settings["task_settings"] = {task: {"levels": self._level_alone(task)} for task in self.tasks}
        return settings

    def _level_alone(self, task: str) -> dict[str, Any]:
        row = sparring.levels(task)[self.target_level]
        return {"columns": list(row), "rows": [list(row.values())]}


@dataclass(frozen=True)
class Where:
    """The server that an experiment is flown at."""

    url: str
    #: As `sparring.Curriculum` takes it: empty for a server of the experiment's own, which knows none.
    token: str | None = None


@dataclass(frozen=True)
class Training:
    """One training: an arm with a seed."""

    arm: str
    seed: int

    @property
    def folder(self) -> str:
        """Where what came of it is kept."""
        return f"{self.arm.replace('+', '-')}-{self.seed}"


def versions() -> dict[str, str]:
    """Of everything that decides what comes out, but for the server."""
    found = {"sparring": sparring.__version__, "python": platform.python_version(), "machine": platform.machine()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "none"
    return found


def record(folder: Path, experiment: Experiment) -> Experiment:
    """Writes down what an experiment is, or says that the folder's is another; more seeds, arms and trainings may be added.

    Raises:
        Wrong: The folder has an experiment that cannot go on as this one.
    """
    file = folder / FILE
    # Of what has come to nothing yet there is nothing to go on with.
    if file.exists() and any(folder.glob(f"*/{DONE}")):
        before = json.loads(file.read_text())["experiment"]
        now = json.loads(json.dumps(asdict(experiment)))
        differing = [name for name, value in now.items() if name not in ("arms", "seeds") and before.get(name) != value]
        if differing:
            named = ", ".join(f"{name} {before.get(name)}" for name in differing)
            raise Wrong(f"out: {folder} has an experiment with {named}; go on with that, or name another folder")
        experiment = Experiment(
            **{
                **asdict(experiment),
                "arms": tuple(dict.fromkeys((*before["arms"], *experiment.arms))),
                "seeds": tuple(dict.fromkeys((*before["seeds"], *experiment.seeds))),
            }
        )
    folder.mkdir(parents=True, exist_ok=True)
    write(file, {"experiment": asdict(experiment)})
    return experiment


def write(file: Path, told: Any) -> None:
    """Writes JSON, whole or not at all."""
    half = file.with_suffix(".part")
    half.write_text(json.dumps(told, indent=2) + "\n")
    half.replace(file)


def names(text: str) -> tuple[str, ...]:
    """What is written with commas between."""
    return tuple(part for part in re.split(r"[,\s]+", text) if part)
