"""Command line of the recorder: scripts/bsk-record [--check | --list] [NAME ...]."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import Any

from Basilisk.architecture import bskLogging

from bsk_record.compare import compare_with_file
from bsk_record.encode import file_bytes, write_recording
from bsk_record.episodes import EPISODES
from bsk_record.recorder import record

FOLDER = Path("env-core/fixtures/tasking/recorded")


def main() -> int:
    """Records, checks or lists episodes; returns 1 if a file differs by more than rounding."""
    parser = argparse.ArgumentParser(prog="scripts/bsk-record", description="Record episodes of BSK-RL.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="episodes to record (default: all)")
    parser.add_argument("--check", action="store_true", help="record again and compare with the files")
    parser.add_argument("--list", action="store_true", help="list the names of the episodes")
    args = parser.parse_args()
    unknown = sorted(set(args.names) - set(EPISODES))
    if unknown:
        parser.error(f"unknown episode {unknown[0]!r}; --list prints the names")
    warnings.simplefilter("ignore", DeprecationWarning)
    # A trace reads messages before they are first written, and Basilisk warns of it in every tick.
    bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)
    different = 0
    for name in args.names or EPISODES:
        if args.list:
            print(name)
            continue
        recording = record(EPISODES[name])
        path = FOLDER / f"{name}.json.gz"
        if args.check:
            same, sentence = compare_with_file(path, file_bytes(recording))
            different += not same
            print(f"{name}: {sentence}")
        else:
            print(summary(name, recording, write_recording(path, recording)))
    return 1 if different else 0


def summary(name: str, recording: dict[str, Any], size: int) -> str:
    """Returns one line about a recording: its steps, seconds, images, deaths and size."""
    steps = recording["steps"]
    last = steps[-1]
    parts = [f"{len(steps)} steps", f"{last['t_end']:g} s", f"{size / 1000:.1f} kB"]
    if last["imaged"]:
        parts.append(f"{sum(last['imaged'].values())} images")
    dead = [satellite for satellite, alive in last["alive"].items() if not alive]
    if dead:
        parts.append("dead: " + ", ".join(dead))
    return f"{name}: " + ", ".join(parts)


if __name__ == "__main__":
    sys.exit(main())
