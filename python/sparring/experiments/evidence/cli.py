"""Run the trainings of the evidence protocol, and write tables and figures.

    python -m sparring.experiments evidence --out evidence --jobs 2
    python -m sparring.experiments evidence --out evidence --problems docking/single --arms uniform-levels,auto
    python -m sparring.experiments evidence --out evidence --report

Each training starts a server of its own. The same command continues after a stop: complete trainings are kept, and an interrupted
one begins anew. `docs/reference/evidence-protocol.md` says what is run and measured.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command_line import run_command
from ..experiment import ExperimentError, split_list
from .protocol import ARMS, PROBLEMS, SEEDS, find_arm, find_problem


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line.

    Returns:
        Exit status: 2 after an error, 130 after Ctrl-C.
    """
    return run_command(_parser(), _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sparring.experiments evidence",
        description=__doc__,
        epilog="arms:\n" + "\n".join(f"  {arm.name:22}{arm.description}" for arm in ARMS),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the results; existing results are kept")
    parser.add_argument("--problems", default="", help=f"problems (default: {', '.join(each.name for each in PROBLEMS)})")
    parser.add_argument("--arms", default="", help=f"arms (default: {', '.join(each.name for each in ARMS)})")
    parser.add_argument("--seeds", default="", help=f"seeds (default: {SEEDS[0]} to {SEEDS[-1]}, of most arms the first five)")
    parser.add_argument("--jobs", type=int, default=1, help="parallel trainings, one core each (%(default)s)")
    parser.add_argument("--budget", type=int, help="env-steps of each training, for a trial (default: those of the protocol)")
    parser.add_argument("--binary", help="program of the server (default: SPARRING_BIN, or that of the package sparring-server)")
    parser.add_argument("--report", action="store_true", help="only write the tables and figures of the complete trainings")
    return parser


def _run(args: argparse.Namespace) -> None:
    from tqdm import tqdm

    from . import report, runner
    from .training import Training

    problems = [find_problem(name).name for name in split_list(args.problems)]
    arms = [find_arm(name).name for name in split_list(args.arms)]
    trainings = runner.planned(problems, arms, _read_seeds(args.seeds))
    if not trainings:
        known = "; ".join(f"{problem.name}: {', '.join(problem.arms)}" for problem in PROBLEMS if problem.name in problems)
        raise ExperimentError(
            f"--arms and --seeds must be of a training of the protocol ({known}), got {args.arms} and {args.seeds}"
        )
    for name, value in (("jobs", args.jobs), ("budget", args.budget)):
        if value is not None and value < 1:
            raise ExperimentError(f"--{name} must be >= 1, got {value}")
    if not args.report:
        missing = runner.missing(args.out, trainings)
        print(f"{len(trainings) - len(missing)} of {len(trainings)} trainings are complete")
        with tqdm(total=len(missing), unit=" trainings", dynamic_ncols=True) as bar:

            def done(training: Training) -> None:
                bar.set_description(f"{training.problem} {training.arm} {training.seed}")
                bar.update()

            runner.run(args.out, missing, args.jobs, done, args.binary, args.budget)
    for file in report.write(args.out):
        print(file)


def _read_seeds(text: str) -> list[int]:
    try:
        seeds = [int(seed) for seed in split_list(text)]
    except ValueError as error:
        raise ExperimentError(f"--seeds must be integers separated by commas, got {text!r}") from error
    unknown = sorted(set(seeds) - set(SEEDS))
    if unknown:
        raise ExperimentError(f"--seeds must be from {SEEDS[0]} to {SEEDS[-1]}, got {unknown[0]}")
    return seeds
