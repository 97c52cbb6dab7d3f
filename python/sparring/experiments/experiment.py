"""Definition of an experiment: arms, trainings, and the files that record them."""

from __future__ import annotations

import json
import platform
import re
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import sparring

#: Strategies of a server.
STRATEGIES = (
    "auto", "staircase", "controller", "bandit", "ladder", "uniform", "fixed", "adr", "learnability", "plr", "plr_robust",
    "accel", "alp_gmm",
)  # fmt: skip
#: Arm that trains at a single level.
TARGET = "target"
#: Suffix of a strategy with designed layouts.
DESIGNS_SUFFIX = "+designs"
#: Arm with which the others are compared.
BASELINE = "uniform"
#: Packages whose versions affect the results.
PACKAGES = ("numpy", "gymnasium", "torch", "stable-baselines3", "rliable")
#: File with the definition of the experiment.
EXPERIMENT_FILE = "experiment.json"
#: File with the server's comparisons of each arm with the baseline.
COMPARISON_FILE = "compared.json"
#: File that a training writes last; its presence means that the training is complete.
DONE_FILE = "done.json"


class ExperimentError(Exception):
    """The experiment cannot be run; the message names the option at fault."""


@dataclass(frozen=True)
class Experiment:
    """Definition of an experiment. Results of equal experiments differ only by chance and by the speed of the machine."""

    arms: tuple[str, ...] = ("ladder", "uniform", "fixed", "target")
    seeds: tuple[int, ...] = (1, 2, 3)
    #: Environment steps of a training.
    budget: int = 300_000
    tasks: tuple[str, ...] = ("kessler/survival",)
    #: Episodes per scenario: some strategies use the differences between them.
    group_size: int = 4
    #: Level of the arm `target`.
    target_level: int = 5
    suite: str | None = None
    #: Evaluations on the held-out suite during a training, evenly spaced.
    evaluations: int = 6
    #: Episodes per held-out scenario at the end; fewer than 8 do not measure the worst tenth.
    rollouts: int = 8
    #: Held-out skill; the report has the steps at which each training reaches it.
    threshold: float = 0.2
    num_envs: int = 128

    def __post_init__(self) -> None:
        for arm in self.arms:
            strategy = arm.removesuffix(DESIGNS_SUFFIX)
            if strategy not in STRATEGIES and arm != TARGET:
                known = f"{', '.join(STRATEGIES)} (each also with {DESIGNS_SUFFIX}) and {TARGET}"
                raise ExperimentError(f"--strategies must be among {known}, got {arm!r}")
        for name in ("arms", "seeds", "tasks"):
            values = getattr(self, name)
            if not values or len(set(values)) != len(values):
                raise ExperimentError(
                    f"{_option(name)} must have at least one value and no value twice, got {','.join(map(str, values))!r}"
                )
        for name in ("budget", "group_size", "evaluations", "rollouts", "num_envs", "target_level"):
            minimum = 0 if name == "target_level" else 1
            if getattr(self, name) < minimum:
                raise ExperimentError(f"{_option(name)} must be >= {minimum}, got {getattr(self, name)}")
        for task in self.tasks:
            levels = len(sparring.levels(task))
            if self.target_level >= levels:
                raise ExperimentError(f"--target-level must be from 0 to {levels - 1} for {task}, got {self.target_level}")

    def trainings(self) -> list[Training]:
        """Returns all trainings, seed by seed, so that an experiment that is stopped early has compared all arms."""
        return [Training(arm, seed) for seed in self.seeds for arm in self.arms]

    def run_settings(self, arm: str, seed: int) -> dict[str, Any]:
        """Returns the settings of the run of a training, for `POST /v1/runs`."""
        strategy, designs = arm.removesuffix(DESIGNS_SUFFIX), arm.endswith(DESIGNS_SUFFIX)
        settings: dict[str, Any] = {
            "name": f"{arm}, seed {seed}",
            "seed": seed,
            "tasks": list(self.tasks),
            "group_size": self.group_size,
            "strategy": "uniform" if arm == TARGET else strategy,
            "design": {} if designs else {"share": 0},
        }
        if arm == TARGET:
            settings["task_settings"] = {task: {"levels": self._single_level(task)} for task in self.tasks}
        return settings

    def _single_level(self, task: str) -> dict[str, Any]:
        row = sparring.levels(task)[self.target_level]
        return {"columns": list(row), "rows": [list(row.values())]}


@dataclass(frozen=True)
class ServerAddress:
    """Server that runs an experiment."""

    url: str
    #: Token, as for `sparring.Curriculum`; empty for a server that the experiment starts, which has no tokens.
    token: str | None = None


@dataclass(frozen=True)
class Training:
    """Training of one arm with one seed."""

    arm: str
    seed: int

    @property
    def folder(self) -> str:
        """Name of the folder with the training's files."""
        return f"{self.arm.replace('+', '-')}-{self.seed}"


def record(folder: Path, experiment: Experiment) -> Experiment:
    """Writes the definition of an experiment, with the arms and seeds that the folder already has.

    Raises:
        ExperimentError: The folder has another experiment.
    """
    file = folder / EXPERIMENT_FILE
    # Without a complete training there is nothing to continue.
    if file.exists() and any(folder.glob(f"*/{DONE_FILE}")):
        previous = json.loads(file.read_text())["experiment"]
        current = json.loads(json.dumps(asdict(experiment)))
        changed = [name for name, value in current.items() if name not in ("arms", "seeds") and previous.get(name) != value]
        if changed:
            listed = ", ".join(f"{_option(name)} {previous.get(name)}" for name in changed)
            raise ExperimentError(f"--out {folder} has an experiment with {listed}: use these settings or another folder")
        experiment = Experiment(
            **{
                **asdict(experiment),
                "arms": tuple(dict.fromkeys((*previous["arms"], *experiment.arms))),
                "seeds": tuple(dict.fromkeys((*previous["seeds"], *experiment.seeds))),
            }
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_json(file, {"experiment": asdict(experiment)})
    return experiment


def _option(field: str) -> str:
    """Returns the command line option of a field of `Experiment`."""
    return "--strategies" if field == "arms" else f"--{field.replace('_', '-')}"


def package_versions() -> dict[str, str]:
    """Returns the versions of everything that affects the results, except the server."""
    versions = {"sparring": sparring.__version__, "python": platform.python_version(), "machine": platform.machine()}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "none"
    return versions


def write_json(file: Path, value: Any) -> None:
    """Writes a JSON file atomically."""
    part = file.with_suffix(".part")
    part.write_text(json.dumps(value, indent=2) + "\n")
    part.replace(file)


def split_list(text: str) -> tuple[str, ...]:
    """Splits a list with commas or spaces."""
    return tuple(part for part in re.split(r"[,\s]+", text) if part)
