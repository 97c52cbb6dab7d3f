"""What docs show runs as it is shown."""

import pathlib
import re

import numpy as np
import pytest
from conftest import BINARY, served
from flights import local

ROOT = pathlib.Path(__file__).parents[2]
URL = "http://127.0.0.1:8700"


def shown(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


@served
def test_the_page_about_python_runs_from_top_to_bottom(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    pytest.importorskip("moviepy")
    pytest.importorskip("httpx")
    monkeypatch.chdir(tmp_path)
    blocks = shown("docs/python.md")
    assert len(blocks) == 6
    with local() as curriculum:
        names = {"actions": np.zeros((1024, 3, 2), np.float32)}
        for code in blocks:
            # Its server, its run and its first event are of this test.
            code = code.replace(URL, curriculum.url).replace('run="mine"', f'run="{curriculum.run}"')
            code = code.replace(', token="…"', "").replace("after=0): ...", "after=0): break")
            if "out = " in code:
                names["envs"].reset(seed=1)
            exec(code, names)
    assert names["bracket"].skill(names["flown"].score) > 0.0
    assert names["version"] == 999 and names["curriculum"].policy_version == 999
    assert names["event"]


@served
def test_what_the_readme_shows_runs(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARRING_BIN", BINARY)
    with local() as curriculum:
        for code in shown("README.md"):
            exec(code.replace(URL, curriculum.url), {})
        runs = [run["id"] for run in curriculum.ask("GET", "/v1/runs")["runs"]]
        versions = [row for run in runs for row in curriculum.ask("GET", f"/v1/runs/{run}/versions")["versions"]]
    # Twenty leases of eight groups of four.
    assert sum(task["episodes"] for row in versions for task in row["tasks"]) == 640
    assert {row["version"] for row in versions} == set(range(20))
    assert (tmp_path / "mine.sqlite3").stat().st_size > 0
