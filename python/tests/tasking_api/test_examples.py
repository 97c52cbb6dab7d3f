"""The two example programs print the lines that they print on bsk_rl."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent


@pytest.mark.parametrize("name", ["scanning", "multiagent"])
def test_example_prints_the_lines_of_the_peer(name):
    program = FOLDER / f"example_{name}.py"
    path = os.pathsep.join(filter(None, [str(FOLDER.parents[1]), os.environ.get("PYTHONPATH")]))
    printed = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": path}
    ).stdout
    assert printed.splitlines() == (FOLDER / "fixtures" / f"{name}.expected.txt").read_text().splitlines()
