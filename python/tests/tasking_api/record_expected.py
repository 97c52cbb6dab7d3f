"""Writes what the programs return on bsk_rl, and the log lines of two of them, into fixtures.

scripts/bsk-venv installs the peer. Then, in this folder:

    TASKING_PEER=bsk_rl ../../../target/bsk-venv/bin/python record_expected.py
"""

import gzip
import json
import warnings
from pathlib import Path

from log_programs import LOG_PROGRAMS, log_lines
from plain import plain
from programs import PROGRAMS, SEED
from utilities import utilities

FOLDER = Path(__file__).parent / "fixtures"


def write(name, value):
    """Writes compressed JSON; equal values give equal files."""
    text = json.dumps(plain(value), separators=(",", ":"))
    (FOLDER / name).write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    write("programs.json.gz", {program.__name__: program(SEED) for program in PROGRAMS})
    write("utilities.json.gz", utilities(SEED))
    write("logs.json.gz", {program.__name__: log_lines(program) for program in LOG_PROGRAMS})
