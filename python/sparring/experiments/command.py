"""`python -m sparring.experiments curriculum`: the same learner under several curricula, compared on held-out scenarios.

    python -m sparring.experiments curriculum --out mine
    python -m sparring.experiments curriculum --out mine --strategies ladder,plr,uniform --seeds 1,2,3,4 --budget 500000

Each strategy trains the learner of `sparring.experiments.ppo` once for each seed through a server's curriculum, with designed
layouts off unless `+designs` is said behind it, and the policy is flown on a frozen suite whose seeds no training ever has.
Baselines are `uniform` over the levels, `fixed`, `target` (one level alone), and plans that look at nothing. Started again with
the same folder it goes on where it was; trainings that were cut off begin anew, and arms and seeds may be added.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..curriculum import CurriculumError
from .plan import DESIGNS, STRATEGIES, TARGET, Experiment, Training, Wrong, names, record


def _options() -> argparse.ArgumentParser:
    usual: dict[str, Any] = {field.name: field.default for field in fields(Experiment)}
    parser = argparse.ArgumentParser(
        prog="python -m sparring.experiments curriculum",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )

    def listed(name: str) -> str:
        return ",".join(str(value) for value in usual[name])

    parser.add_argument("--out", type=Path, required=True, help="folder of the experiment: made, or gone on with")
    parser.add_argument(
        "--strategies",
        default=listed("arms"),
        help=f"of {', '.join(STRATEGIES)} and {TARGET}, or all; {DESIGNS} behind one designs layouts, too (default: %(default)s)",
    )
    parser.add_argument("--seeds", default=listed("seeds"), help="of trainings; four or more to trim any (%(default)s)")
    parser.add_argument("--tasks", default=listed("tasks"), help="trained together, and told of (%(default)s)")
    parser.add_argument("--suite", help="held-out suite that the server knows (the newest of the tasks' world)")
    for name, text in (
        ("budget", "environment steps of each training"),
        ("group_size", "episodes of one scenario"),
        ("target_level", f"the level of {TARGET}"),
        ("looks", "looks at the suite during a training"),
        ("rollouts", "episodes of each held-out scenario at the end; 8 for the worst tenth"),
        ("threshold", "held-out skill that counts as having got there"),
        ("num_envs", "environments that train"),
    ):
        kind = type(usual[name])
        parser.add_argument(f"--{name.replace('_', '-')}", type=kind, default=usual[name], help=f"{text} (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="trainings at once, each on a core of its own (%(default)s)")
    parser.add_argument("--url", help="a server that is there; one is started otherwise (pip install sparring-server)")
    parser.add_argument("--report", action="store_true", help="only write the report of what is done")
    return parser


def _asked(args: argparse.Namespace) -> Experiment:
    told = {field.name: getattr(args, field.name) for field in fields(Experiment) if hasattr(args, field.name)}
    arms = (*STRATEGIES, TARGET) if args.strategies == "all" else names(args.strategies)
    try:
        seeds = tuple(int(seed) for seed in names(args.seeds))
    except ValueError as error:
        raise Wrong(f"seeds: {args.seeds!r} are not whole numbers with commas between") from error
    if args.jobs < 1:
        raise Wrong("jobs: at least one")
    import sparring

    try:
        tasks = tuple(sparring.task(task).id for task in names(args.tasks))
    except ValueError as error:
        raise Wrong(f"tasks: {error}") from error
    if len(tasks) > 1 and any(task.startswith("docking/") for task in tasks):
        raise Wrong("tasks: one policy flies those of kessler, or one of docking")
    return Experiment(**{**told, "arms": arms, "seeds": seeds, "tasks": tasks})


def main(arguments: list[str] | None = None) -> int:
    """The command line.

    Returns:
        2 where what was asked for cannot be done, 130 where it was stopped by Ctrl-C.
    """
    args = _options().parse_args(arguments)
    try:
        _run(args)
    except (Wrong, CurriculumError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nstopped; the same command goes on from here", file=sys.stderr)
        return 130
    return 0


def _run(args: argparse.Namespace) -> None:
    from tqdm import tqdm

    from . import findings, harness, report

    findings.needs()  # before hours of training, not behind them
    if not args.report:
        experiment = record(args.out, _asked(args))
        waiting = harness.missing(args.out, experiment)
        every = len(experiment.trainings())
        print(f"{every - len(waiting)} of {every} trainings are done; {len(waiting) * experiment.budget:,} steps to fly")
        with tqdm(total=len(waiting) * experiment.budget, unit=" steps", unit_scale=True, dynamic_ncols=True) as bar:

            def told(one: Training, steps: int) -> None:
                bar.set_description(one.folder)
                bar.update(steps)

            harness.fly(args.out, experiment, url=args.url, binary=None, jobs=args.jobs, told=told)
    for file in report.write(findings.read(args.out), args.out):
        print(file)
    print((args.out / report.REPORT).read_text())


if __name__ == "__main__":
    sys.exit(main())
