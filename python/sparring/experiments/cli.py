"""Compare curricula: train the same learner under each, and evaluate its policy on held-out scenarios.

    python -m sparring.experiments curriculum --out mine
    python -m sparring.experiments curriculum --out mine --strategies ladder,plr,uniform --seeds 1,2,3,4 --budget 500000

Each strategy trains the learner of `sparring.experiments.ppo` once per seed through a server's curriculum. Designed layouts are
off, except for a strategy with the suffix `+designs`. The policy is evaluated on a frozen suite whose seeds no training has.
Baselines are `uniform` over the levels, `fixed`, `target` (a single level), and blind plans. The same command with the same
folder continues an experiment: interrupted trainings start again, and strategies and seeds may be added.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..tasks import have_equal_agents
from .command_line import run_command
from .experiment import DESIGNS_SUFFIX, STRATEGIES, TARGET, Experiment, ExperimentError, Training, record, split_list


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line.

    Returns:
        Exit status: 2 after an error, 130 after Ctrl-C.
    """
    return run_command(_parser(), _run, arguments)


def _parser() -> argparse.ArgumentParser:
    defaults: dict[str, Any] = {field.name: field.default for field in fields(Experiment)}
    parser = argparse.ArgumentParser(
        prog="python -m sparring.experiments curriculum",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )

    def listed(name: str) -> str:
        return ",".join(str(value) for value in defaults[name])

    parser.add_argument("--out", type=Path, required=True, help="folder of the experiment; an existing experiment is continued")
    parser.add_argument(
        "--strategies",
        default=listed("arms"),
        help=f"strategies to compare: {', '.join(STRATEGIES)} or {TARGET}; `all` selects all, the suffix {DESIGNS_SUFFIX} adds "
        "designed layouts (%(default)s)",
    )
    parser.add_argument(
        "--seeds", default=listed("seeds"), help="seeds of trainings; the mean is trimmed from four seeds on (%(default)s)"
    )
    parser.add_argument("--tasks", default=listed("tasks"), help="tasks of each training, separated by commas (%(default)s)")
    parser.add_argument("--suite", help="held-out suite of the server (default: the newest with one of the tasks)")
    for name, text in (
        ("budget", "env-steps of each training"),
        ("group_size", "episodes per scenario"),
        ("target_level", f"level of {TARGET}"),
        ("evaluations", "evaluations on the suite during a training"),
        ("rollouts", "episodes per held-out scenario at the end; the worst tenth needs 8 or more"),
        ("threshold", "held-out skill, from -1 to 1, of the column `steps to`"),
        ("num_envs", "environments of a training"),
    ):
        kind = type(defaults[name])
        parser.add_argument(f"--{name.replace('_', '-')}", type=kind, default=defaults[name], help=f"{text} (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="parallel trainings, one core each (%(default)s)")
    parser.add_argument("--url", help="address of a running server (default: start one, which needs the package sparring-server)")
    parser.add_argument("--report", action="store_true", help="only write the report of the completed trainings")
    return parser


def _read_experiment(args: argparse.Namespace) -> Experiment:
    settings = {field.name: getattr(args, field.name) for field in fields(Experiment) if hasattr(args, field.name)}
    arms = (*STRATEGIES, TARGET) if args.strategies == "all" else split_list(args.strategies)
    try:
        seeds = tuple(int(seed) for seed in split_list(args.seeds))
    except ValueError as error:
        raise ExperimentError(f"--seeds must be integers separated by commas, got {args.seeds!r}") from error
    if args.jobs < 1:
        raise ExperimentError(f"--jobs must be >= 1, got {args.jobs}")
    import sparring

    try:
        tasks = tuple(sparring.task(task).id for task in split_list(args.tasks))
    except ValueError as error:
        raise ExperimentError(f"--tasks: {error}") from error
    if not have_equal_agents(tasks):
        raise ExperimentError(f"--tasks must be tasks of kessler, or one task of another world, got {', '.join(tasks)}")
    return Experiment(**{**settings, "arms": arms, "seeds": seeds, "tasks": tasks})


def _run(args: argparse.Namespace) -> None:
    from tqdm import tqdm

    from . import report, results, runner

    results.check_dependencies()  # reports a missing package before hours of training
    if not args.report:
        experiment = record(args.out, _read_experiment(args))
        missing = runner.missing_trainings(args.out, experiment)
        total = len(experiment.trainings())
        steps = len(missing) * experiment.budget
        print(f"{total - len(missing)} of {total} trainings are complete; {steps:,} steps to run")
        with tqdm(total=steps, unit=" steps", unit_scale=True, dynamic_ncols=True) as bar:

            def progress(training: Training, steps: int) -> None:
                bar.set_description(training.folder)
                bar.update(steps)

            runner.run(args.out, experiment, url=args.url, binary=None, jobs=args.jobs, progress=progress)
    for file in report.write(results.read(args.out), args.out):
        print(file)
    print((args.out / report.REPORT_FILE).read_text())


if __name__ == "__main__":
    sys.exit(main())
