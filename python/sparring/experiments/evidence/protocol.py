"""The protocol in code: tasks, budgets, thresholds, arms and seeds. They were fixed before the first run of each learner."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import sparring

from ..experiment import ExperimentError

#: Seeds of the claims, which no tuning used: the first are those of all arms, all of them those of the arms of the claims.
SEEDS = tuple(range(101, 111))
#: Number of seeds of an arm that no claim is about.
FEW_SEEDS = 5
#: Arm with which all others are compared.
BASELINE_ARM = "uniform-levels"
#: Arm with designed layouts, and the arm without them with which it is compared.
DESIGNS_ARM, CONTROL_ARM = "auto-designs", "auto"
#: Arms of the claims, with all seeds.
CLAIMED = (BASELINE_ARM, "uniform-rungs", CONTROL_ARM)
#: Algorithm that trains the policy of a problem.
Learner = Literal["ppo", "grpo", "sb3"]
#: Held-out scenarios of a task. They have user seeds, which no curriculum proposes.
HELD_OUT_SCENARIOS = 200
#: Seed of the first held-out scenario that is tried. Tuning used other scenarios.
HELD_OUT_SEED = 40_000_000
#: Evaluations on the held-out scenarios during a training, evenly spaced.
LOOKS = 40
#: Episodes of each held-out scenario at the end: one half ranks the scenarios, the other half measures the worst tenth.
FINAL_EPISODES = 8


@dataclass(frozen=True)
class Arm:
    """A way to choose the scenarios of a training."""

    name: str
    strategy: str
    description: str
    #: Hyperparameters of the strategy that differ from the defaults.
    hyperparameters: dict[str, Any] = field(default_factory=dict)
    #: Episodes for each scenario, unless the problem sets them.
    group_size: int = 1
    #: Designer of layouts for the agent's failures.
    designer: str = "off"
    #: Rule of the level moves (default: that of the run, `half` for groups of several episodes).
    target: str | None = None
    #: Returns the level table for a share of the budget that is used up, 0 to 1; None if the table does not change.
    levels: Callable[[str, float], dict[str, Any]] | None = None

    def run_settings(self, task: str, seed: int, group_size: int | None = None) -> dict[str, Any]:
        """Returns the settings of a run, for `POST /v1/runs`; `group_size` replaces that of the arm."""
        settings: dict[str, Any] = {
            "name": f"{self.name}, seed {seed}",
            "seed": seed,
            "tasks": [task],
            "group_size": group_size or self.group_size,
            "strategy": self.strategy,
            "strategy_settings": self.hyperparameters,
            "design": {"designer": self.designer},
        }
        if self.target is not None:
            settings["target"] = self.target
        if self.levels is not None:
            settings["task_settings"] = {task: {"levels": self.levels(task, 0.0)}}
        return settings


def level_table(task: str, start_scale: float = 1.0) -> dict[str, Any]:
    """Returns the level table of a task with a start scale, so that its levels are the rungs, and not its starts."""
    rows = [{**row, **_scaled(task, start_scale)} for row in sparring.levels(task)]
    return {"columns": list(rows[0]), "rows": [list(row.values()) for row in rows]}


def ramp(task: str, share: float) -> dict[str, Any]:
    """Returns the level table of a ramp that climbs all rungs at a constant rate until three quarters of the budget.

    It knows the budget, which no strategy does.
    """
    starts, rows = sparring.task(task).start_rungs, sparring.levels(task)
    rungs = len(starts) or len(rows)
    rung = min(rungs - 1, int(share / 0.75 * rungs))
    if share >= 0.75:
        return level_table(task)
    if starts:
        return level_table(task, starts[rung])
    return {"columns": list(rows[rung]), "rows": [list(rows[rung].values())]}


def _scaled(task: str, start_scale: float) -> dict[str, float]:
    return {"start_scale": start_scale} if sparring.task(task).start_rungs else {}


#: All arms.
ARMS = (
    Arm(BASELINE_ARM, "uniform", "all levels are equally likely"),
    Arm("uniform-rungs", "bandit", "all rungs are equally likely", {"uniform": 1.0}),
    Arm("fixed", "fixed", "the default params of the task"),
    Arm("ramp", "uniform", "the rungs one after the other, at a rate that knows the budget", levels=ramp),
    Arm(
        "contested", "bandit", "all levels are equally likely, only contested scenarios", {"uniform": 1.0},
        levels=lambda task, _: level_table(task),
    ),
    Arm("staircase", "staircase", "the sampler staircase"),
    Arm("controller", "controller", "the sampler controller"),
    Arm("bandit", "bandit", "the sampler bandit"),
    Arm(CONTROL_ARM, "auto", "the sampler that the table of the strategy auto names"),
    Arm(DESIGNS_ARM, "auto", "auto, with layouts of the procedural designer", designer="procedural"),
    Arm("learnability", "learnability", "levels and scenarios by p(1 − p) of a model of success"),
    Arm(
        "learnability-rollouts", "learnability", "sampling for learnability, with scoring rollouts counted",
        {"rank": "rollouts"}, group_size=8,
    ),
    Arm("plr", "plr", "prioritised level replay by learnability", group_size=4),
    Arm("ladder", "ladder", "level moves on evidence, towards a success of one half", target="half"),
)  # fmt: skip
#: Arms of the problems of the first learner.
FIRST_ARMS = tuple(arm.name for arm in ARMS if arm.name != "ladder")


@dataclass(frozen=True)
class Problem:
    """A task with a reward, a budget and the thresholds of a held-out measure."""

    name: str
    task: str
    #: Environment steps of a training, which include probes and scoring rollouts.
    budget: int
    #: Held-out measure, averaged over the scenarios: `success`, or `skill`.
    measure: str
    #: Values of the measure of which the steps are counted. Claims are about the first.
    thresholds: tuple[float, float]
    #: Settings of the learner that differ from those tuned for the task.
    hyperparameters: dict[str, Any] = field(default_factory=dict)
    #: Its algorithm.
    learner: Learner = "ppo"
    #: Episodes for each scenario, of a learner that needs groups; None for those of the arm.
    group_size: int | None = None
    #: Names of its arms.
    arms: tuple[str, ...] = FIRST_ARMS
    #: Arms with all seeds; the others have the first few.
    claimed: tuple[str, ...] = CLAIMED

    def seeds(self, arm: str) -> tuple[int, ...]:
        """Returns the seeds of an arm."""
        return SEEDS if arm in self.claimed else SEEDS[:FEW_SEEDS]

    def run_settings(self, arm: Arm, seed: int) -> dict[str, Any]:
        """Returns the settings of the run of a training, for `POST /v1/runs`."""
        return arm.run_settings(self.task, seed, self.group_size)


#: Success of a deputy is all that is rewarded.
SUCCESS_ONLY = {"reward_weight": 0.0, "success_reward": 1.0}
PROBLEMS = (
    Problem("docking/single", "docking/single", 4_000_000, "success", (0.7, 0.5)),
    Problem("docking/single-success", "docking/single", 12_000_000, "success", (0.7, 0.5), SUCCESS_ONLY),
    Problem("docking/multiagent", "docking/multiagent", 4_000_000, "success", (0.7, 0.5)),
    Problem("kessler/survival", "kessler/survival", 400_000, "skill", (0.5, 0.4)),
    Problem("kessler/rendezvous", "kessler/rendezvous", 400_000, "skill", (0.25, 0.15)),
    Problem("kessler/eco_station", "kessler/eco_station", 300_000, "skill", (0.5, 0.3)),
    Problem("kessler/formation", "kessler/formation", 300_000, "skill", (0.08, 0.05)),
    Problem("tasking/scanning", "tasking/scanning", 300_000, "skill", (0.1, 0.0)),
    Problem(
        "kessler/survival-groups", "kessler/survival", 400_000, "skill", (0.5, 0.4), learner="grpo", group_size=8,
        arms=(BASELINE_ARM, "contested", CONTROL_ARM, "ladder"), claimed=(),
    ),
    Problem(
        "docking/single-sb3", "docking/single", 4_000_000, "success", (0.7, 0.5), learner="sb3",
        arms=(BASELINE_ARM, CONTROL_ARM), claimed=(),
    ),
    Problem(
        "kessler/survival-sb3", "kessler/survival", 400_000, "skill", (0.5, 0.4), learner="sb3",
        arms=(BASELINE_ARM, CONTROL_ARM), claimed=(),
    ),
)  # fmt: skip

Named = TypeVar("Named", Problem, Arm)


def find_problem(name: str) -> Problem:
    """Returns a problem by its name.

    Raises:
        ExperimentError: There is none.
    """
    return _find(PROBLEMS, name, "--problems")


def find_arm(name: str) -> Arm:
    """Returns an arm by its name.

    Raises:
        ExperimentError: There is none.
    """
    return _find(ARMS, name, "--arms")


def _find(known: Sequence[Named], name: str, option: str) -> Named:
    for each in known:
        if each.name == name:
            return each
    raise not_among(option, (each.name for each in known), name)


def not_among(option: str, known: Iterable[object], value: str, note: str = "") -> ExperimentError:
    """Returns the error of an option whose value is unknown; the message lists the known values, then a note about them."""
    return ExperimentError(f"{option} must be among {', '.join(map(str, known))}{note}, got {value!r}")
