"""Programs return what they return on bsk_rl: each communication, rewarder, observation, action and hook."""

import contextlib
import gzip
import io
import json
from pathlib import Path

import pytest
from log_programs import LOG_PROGRAMS, log_lines
from plain import differences, plain
from programs import PROGRAMS, SEED
from utilities import utilities

FOLDER = Path(__file__).parent / "fixtures"


def read(name):
    return json.loads(gzip.decompress((FOLDER / name).read_bytes()))


@pytest.fixture(scope="module")
def expected():
    return {name: read(f"{name}.json.gz") for name in ("programs", "utilities", "logs")}


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.__name__)
def test_program_returns_what_it_returns_on_the_peer(program, expected):
    with contextlib.redirect_stderr(io.StringIO()):
        got = plain(program(SEED))
    assert differences(expected["programs"][program.__name__], got)[:3] == []


def test_utilities_draw_and_compute_what_the_peer_does(expected):
    got = plain(utilities(SEED))
    assert differences(expected["utilities"], got) == []


@pytest.mark.parametrize("program", LOG_PROGRAMS, ids=lambda program: program.__name__)
def test_log_lines_are_those_of_the_peer(program, expected):
    assert log_lines(program) == expected["logs"][program.__name__]
