"""Run the trainings of the evidence protocol, and write tables and figures.

    python -m sparring.experiments evidence --out evidence --jobs 2
    python -m sparring.experiments evidence --out evidence --problems docking/single --arms uniform-levels,auto
    python -m sparring.experiments evidence --out evidence --report

Each training starts a server of its own. The same command continues after a stop: complete trainings are kept, and an interrupted
one begins anew. `docs/reference/evidence-protocol.md` says what is run and measured.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ..command_line import run_command
from ..experiment import ExperimentError, split_list
from .protocol import ARMS, PROBLEMS, SEEDS, not_among

if TYPE_CHECKING:
    from .training import Training


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
    parser.add_argument("--problems", help=f"problems (default: {', '.join(each.name for each in PROBLEMS)})")
    parser.add_argument("--arms", help=f"arms (default: {', '.join(each.name for each in ARMS)})")
    parser.add_argument("--seeds", help=f"seeds (default: {SEEDS[0]} to {SEEDS[-1]}, of most arms the first five)")
    parser.add_argument("--jobs", type=int, default=1, help="parallel trainings, one core each (%(default)s)")
    parser.add_argument(
        "--budget",
        type=int,
        help="env-steps of each training, for a trial in a folder of its own (default: those of the protocol)",
    )
    parser.add_argument("--binary", help="program of the server (default: SPARRING_BIN, or that of the package sparring-server)")
    parser.add_argument("--report", action="store_true", help="only write the tables and figures of the complete trainings")
    return parser


def _run(args: argparse.Namespace) -> None:
    from tqdm import tqdm

    from . import report, runner

    trainings = _selected(args)
    for name, value in (("jobs", args.jobs), ("budget", args.budget)):
        if value is not None and value < 1:
            raise ExperimentError(f"--{name} must be >= 1, got {value}")
    if not args.report:
        missing = runner.missing(args.out, trainings, args.budget)
        print(f"{len(trainings) - len(missing)} of {len(trainings)} trainings are complete")
        with tqdm(total=len(missing), unit=" trainings", dynamic_ncols=True) as bar:

            def done(training: Training) -> None:
                bar.set_description(f"{training.problem} {training.arm} {training.seed}")
                bar.update()

            runner.run(args.out, missing, args.jobs, done, args.binary, args.budget)
    for file in report.write(args.out):
        print(file)


def _selected(args: argparse.Namespace) -> list[Training]:
    """Returns the trainings of the options `--problems`, `--arms` and `--seeds`.

    Raises:
        ExperimentError: An option is empty, has an unknown value, or has none of the trainings that the others select.
    """
    from .runner import planned

    problems = _read_list("--problems", args.problems, [problem.name for problem in PROBLEMS])
    arms = _read_list("--arms", args.arms, [arm.name for arm in ARMS])
    seeds = _read_list("--seeds", args.seeds, [str(seed) for seed in SEEDS], ", which no tuning used")
    trainings = planned(problems, arms, [int(seed) for seed in seeds])
    if trainings:
        return trainings
    of_problems = f" for {args.problems or 'all problems'}"
    of_any_seed = planned(problems, arms)
    if not of_any_seed:
        raise not_among("--arms", _unique(each.arm for each in planned(problems)), args.arms, of_problems)
    raise not_among(
        "--seeds", _unique(each.seed for each in of_any_seed), args.seeds, f" with {args.arms or 'all arms'}{of_problems}"
    )


def _read_list(option: str, text: str | None, known: list[str], note: str = "") -> list[str]:
    """Returns the values of an option, each of which must be known; none if the option is omitted."""
    if text is None:
        return []
    values = list(split_list(text))
    for value in values or [text]:
        if value not in known:
            raise not_among(option, known, value, note)
    return values


def _unique(values: Iterable[object]) -> list[object]:
    return list(dict.fromkeys(values))
