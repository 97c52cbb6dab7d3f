"""Code blocks of the documentation run as they are."""

import pathlib
import re

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
def test_readme_code_runs(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARRING_BIN", BINARY)
    with local_curriculum() as curriculum:
        for code in code_blocks("README.md"):
            exec(code.replace(URL, curriculum.url), {})
        runs = [run["id"] for run in curriculum.request("GET", "/v1/runs")["runs"]]
        versions = [row for run in runs for row in curriculum.request("GET", f"/v1/runs/{run}/policy_versions")["versions"]]
    # The trainer takes 20 leases of 8 groups of 4 episodes.
    assert sum(task["episodes"] for row in versions for task in row["tasks"]) == 640
    assert {row["version"] for row in versions} == set(range(20))
    assert (tmp_path / "mine.sqlite3").stat().st_size > 0
