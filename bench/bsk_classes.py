"""Measures BSK-RL's classes in `sparring.tasking`, for `bench/bsk_peers.py`.

    bench/bsk_classes.py scanning

The environment is built by the lines that build BSK-RL's environment. In this process the names of BSK-RL's modules stand for
those of `sparring.tasking`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from dataclasses import asdict


def main() -> None:
    """Prints the speed in one turn, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("environment", choices=("scanning", "imaging", "constellation"), help="environment to step")
    parser.add_argument("--seconds", type=float, default=3.0, help="duration of the turn (%(default)s)")
    args = parser.parse_args()
    for part in ("", ".sim", ".utils", ".utils.orbital"):
        sys.modules[f"bsk_rl{part}"] = importlib.import_module(f"sparring.tasking{part}")
    peers = importlib.import_module("bsk_peers")
    environment = peers.BskEnvironment(peers.ENVIRONMENTS[args.environment]())
    print(json.dumps(asdict(environment.turn(args.seconds))))


if __name__ == "__main__":
    main()
