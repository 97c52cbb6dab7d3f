"""The notebook, executed with a tiny model and no hub. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_notebook.py
"""

import os
from pathlib import Path

import pytest
from conftest import BINARY, served

pytest.importorskip("trl")
pytest.importorskip("nbclient")
import nbclient
import nbformat
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import sparring

NOTEBOOK = Path(__file__).parents[3] / "examples" / "grpo_kessler.ipynb"


def test_it_is_clean():
    book = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(book)
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    assert "parameters" in code[0].metadata.tags
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


def execute():
    """Executes it from its beginning to its end; what it printed."""
    book = nbformat.read(NOTEBOOK, as_version=4)
    where = {"metadata": {"path": NOTEBOOK.parent}}
    nbclient.NotebookClient(book, timeout=500, kernel_name="python3", resources=where).execute()
    return "".join(output.get("text", "") for cell in book.cells for output in cell.get("outputs", []))


@served
def test_it_runs_to_its_end(tmp_path, monkeypatch):
    # Without placement: where it looks for a level there is no mastery yet.
    settings = {"tasks": ["kessler/survival"], "group_size": 4, "judge": "deterministic"}
    settings |= {"placement": False, "design": {"designer": "off"}}
    with sparring.Curriculum.local(binary=BINARY, settings=settings) as curriculum:
        wish = {"URL": curriculum.url, "RUN": curriculum.run, "TINY": "1", "STEPS": "2", "GROUPS": "1", "SIBLINGS": "4"}
        wish |= {"TOKENS": "512", "OUTPUT": os.fspath(tmp_path), "OMP_NUM_THREADS": "1", "HUB_REPO": ""}
        for name, value in wish.items():
            monkeypatch.setenv(name, value)
        path = os.pathsep.join(os.path.abspath(part) for part in os.environ.get("PYTHONPATH", "").split(os.pathsep) if part)
        monkeypatch.setenv("PYTHONPATH", path)
        print(execute())
        at = f"/v1/runs/{curriculum.run}/episodes"
        episodes = curriculum.ask("GET", f"{at}?limit=100")["episodes"]
        assert curriculum.mastery()[0]["plain"]["episodes"] == len(episodes) == 8
        assert all(episode["score"] is not None for episode in episodes)
        scenarios = [curriculum.ask("GET", f"{at}/{episode['episode']}")["scenario_id"] for episode in episodes]
        assert sorted(scenarios.count(one) for one in set(scenarios)) == [4, 4]
        assert {episode["policy_version"] for episode in episodes} == {0, 1}
        assert (tmp_path / "checkpoint-2" / "adapter_model.safetensors").exists()
        # Run again for a step more it goes on where it was.
        monkeypatch.setenv("STEPS", "3")
        print(execute())
        episodes = curriculum.ask("GET", f"{at}?limit=100")["episodes"]
        assert [episode["policy_version"] for episode in episodes].count(2) == 4
        assert len(episodes) == 12
        versions = curriculum.ask("GET", f"/v1/runs/{curriculum.run}/versions")["versions"]
        told = {row["version"]: row["checkpoint"] for row in versions if row["checkpoint"]}
        assert told == {2: os.fspath(tmp_path), 3: os.fspath(tmp_path)}
    assert (tmp_path / "adapter_model.safetensors").exists()
    events = EventAccumulator(os.fspath(tmp_path / "runs" / "curriculum"))
    events.Reload()
    points = events.Scalars("curriculum/kessler/survival/mastery")
    assert {point.step for point in points} == {1, 2, 3}
