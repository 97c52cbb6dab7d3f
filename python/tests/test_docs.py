"""Code blocks of the documentation run as they are."""

import pathlib
import re
import subprocess

import numpy as np
import pytest
from conftest import BINARY, needs_server
from curriculum_servers import local_curriculum

ROOT = pathlib.Path(__file__).parents[2]
URL = "http://127.0.0.1:8700"


def code_blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@needs_server
def test_python_page_runs_from_top_to_bottom(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    pytest.importorskip("moviepy")
    pytest.importorskip("httpx")
    monkeypatch.chdir(tmp_path)
    blocks = code_blocks("docs/reference/python.md")
    assert len(blocks) == 6
    with local_curriculum() as curriculum:
        names = {"actions": np.zeros((1024, 3, 2), np.float32)}
        for code in blocks:
            # The server, the run and the first event are those of this test.
            code = code.replace(URL, curriculum.url).replace('run="mine"', f'run="{curriculum.run}"')
            code = code.replace(', token="…"', "").replace("after=0): ...", "after=0): break")
            if "out = " in code:
                names["envs"].reset(seed=1)
            exec(code, names)
    assert names["bracket"].skill(names["outcome"].score) > 0.0
    assert names["version"] == 999 and names["curriculum"].policy_version == 999
    assert names["event"]


@needs_server
def test_readme_trainer_learns(tmp_path):
    """The commands of the README: an environment by scripts/venv, and the trainer beside a server."""
    program = code_blocks("README.md")[0]
    assert program == (ROOT / "examples/first_trainer.py").read_text(encoding="utf-8")
    assert sum(bool(line.strip()) for line in program.splitlines()) <= 20
    venv = tmp_path / "venv"
    subprocess.run([ROOT / "scripts/venv", venv], check=True)
    assert (venv / "bin/sparring").resolve() == (ROOT / "target/debug/sparring").resolve()
    with local_curriculum() as curriculum:
        command = [venv / "bin/python", "-c", program.replace(URL, curriculum.url)]
        trainer = subprocess.run(command, check=True, capture_output=True, text=True)
    levels = [int(level) for level in re.findall(r"^update \d+: level (\d), skill", trainer.stdout, re.MULTILINE)]
    assert len(levels) == 8 and levels[0] <= 1 and levels[-1] >= 2, trainer.stdout


@needs_server
def test_readme_environments_run(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARRING_BIN", BINARY)
    _, environments, curriculum = code_blocks("README.md")
    exec(environments, {})
    exec(curriculum, {})
    assert (tmp_path / "mine.sqlite3").stat().st_size > 0
