"""Shared code of the command lines of experiments: errors, and a stop by Ctrl-C."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from ..curriculum import CurriculumError
from .experiment import ExperimentError


def run_command(parser: argparse.ArgumentParser, run: Callable[[argparse.Namespace], None], arguments: list[str] | None) -> int:
    """Parses arguments and runs an experiment that a later call continues.

    Returns:
        Exit status: 2 after an error, 130 after Ctrl-C.
    """
    args = parser.parse_args(arguments)
    try:
        run(args)
    except (ExperimentError, CurriculumError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nStopped. The same command continues the experiment.", file=sys.stderr)
        return 130
    return 0
