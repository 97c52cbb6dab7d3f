"""The notebook runs with a tiny model and no model hub. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_notebook.py
"""

import os
from pathlib import Path

import pytest
from conftest import BINARY, needs_server

pytest.importorskip("trl")
pytest.importorskip("nbclient")
import nbclient
import nbformat
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import sparring

NOTEBOOK = Path(__file__).parents[3] / "examples" / "grpo_websocket.ipynb"


def test_notebook_has_no_outputs():
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert "parameters" in code[0].metadata.tags
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


def execute():
    """Executes the notebook; returns its output."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    resources = {"metadata": {"path": NOTEBOOK.parent}}
    nbclient.NotebookClient(notebook, timeout=500, kernel_name="python3", resources=resources).execute()
    return "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", []))


@needs_server
def test_notebook_runs_and_resumes(tmp_path, monkeypatch):
    # During placement there would be no mastery to check.
    settings = {"tasks": ["kessler/survival"], "group_size": 4, "judge": "deterministic"}
    settings |= {"strategy": "ladder", "placement": False, "design": {"designer": "off"}}
    with sparring.Curriculum.local(binary=BINARY, settings=settings) as curriculum:
        parameters = {"URL": curriculum.url, "RUN": curriculum.run, "TINY": "1", "STEPS": "2"}
        parameters |= {
            "GROUPS": "1",
            "GROUP_SIZE": "4",
            "TOKENS": "512",
            "OUTPUT": os.fspath(tmp_path),
            "OMP_NUM_THREADS": "1",
            "HUB_REPO": "",
        }
        for name, value in parameters.items():
            monkeypatch.setenv(name, value)
        path = os.pathsep.join(os.path.abspath(part) for part in os.environ.get("PYTHONPATH", "").split(os.pathsep) if part)
        monkeypatch.setenv("PYTHONPATH", path)
        print(execute())
        url = f"/v1/runs/{curriculum.run}/episodes"
        episodes = curriculum.request("GET", f"{url}?limit=100")["episodes"]
        assert curriculum.mastery()[0]["results"]["episodes"] == len(episodes) == 8
        assert all(episode["score"] is not None for episode in episodes)
        scenarios = [curriculum.request("GET", f"{url}/{episode['episode']}")["scenario_id"] for episode in episodes]
        assert sorted(scenarios.count(scenario) for scenario in set(scenarios)) == [4, 4]
        assert {episode["policy_version"] for episode in episodes} == {0, 1}
        assert (tmp_path / "checkpoint-2" / "adapter_model.safetensors").exists()
        # A second execution with one more step resumes from the checkpoint.
        monkeypatch.setenv("STEPS", "3")
        print(execute())
        episodes = curriculum.request("GET", f"{url}?limit=100")["episodes"]
        assert [episode["policy_version"] for episode in episodes].count(2) == 4
        assert len(episodes) == 12
        versions = curriculum.request("GET", f"/v1/runs/{curriculum.run}/policy_versions")["versions"]
        checkpoints = {row["version"]: row["checkpoint"] for row in versions if row["checkpoint"]}
        assert checkpoints == {2: os.fspath(tmp_path), 3: os.fspath(tmp_path)}
    assert (tmp_path / "adapter_model.safetensors").exists()
    events = EventAccumulator(os.fspath(tmp_path / "runs" / "curriculum"))
    events.Reload()
    points = events.Scalars("curriculum/kessler/survival/mastery")
    assert {point.step for point in points} == {1, 2, 3}
