"""Ray Tune: each trial has one run, also after its process or the whole experiment was killed. Run by hand: make test-heavy"""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("ray.rllib")
import ray
from conftest import needs_server
from ray import tune
from ray.rllib.algorithms.ppo import PPO
from test_rllib import active_leases, finished_by_version, local_curriculum, team_config

import sparring
import sparring.rllib
import sparring.tune
from sparring.tune import TuneTrial, open_run

EXAMPLE = Path(__file__).parents[3] / "examples" / "ray_tune.py"
TASK = "kessler/survival"
TRIAL = TuneTrial("LR search", "ab12c_00001", "CurriculumPPO_sparring_team_ab12c_00001", ("lr:5e-05",))


@pytest.fixture(scope="module")
def server():
    """Curriculum that owns a server; tests create the runs of their trials there."""
    with local_curriculum([TASK]) as curriculum:
        yield curriculum


def runs_of(server, experiment):
    """Returns the runs of an experiment by their ids."""
    runs = server.request("GET", f"/v1/runs?limit=500&tag={experiment}")["runs"]
    return {run["id"]: run for run in runs}


def episodes_of(server, run):
    """Returns the number of episodes of a run, which are the same by run and by policy version."""
    with sparring.Curriculum(server.url, run, token="") as curriculum:
        assert not active_leases(curriculum)
        count = curriculum.request("GET", f"/v1/runs/{run}")["episodes"]
        assert sum(finished_by_version(curriculum).values()) == count
    return count


def example_command(server, storage, iterations, *more):
    """Returns the command of the example with two tiny trials, which have a core each."""
    small = ["--env-runners", "0", "--envs", "4", "--steps", "60", "--checkpoint", "1", "--cpus", "2", "--verbose", "0"]
    words = ["--url", server.url, "--storage", os.fspath(storage), "--iterations", str(iterations), *small, *more]
    return [sys.executable, os.fspath(EXAMPLE), *words]


def run_example(command):
    """Runs the example to its end; returns the columns of its lines by run."""
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, env={**os.environ, "SPARRING_TOKEN": ""})
    assert ended.returncode == 0, ended.stderr[-3000:]
    lines = re.findall(r"^(\S+-\w+)  (strategy .*)$", ended.stdout, re.M)
    return {run: dict(re.findall(r"(\w+) (\S+)", rest)) for run, rest in lines}


@needs_server
def test_each_trial_has_its_run(server, tmp_path):
    strategies = ["auto", "ladder", "uniform"]
    rows = run_example(example_command(server, tmp_path, 2, "--experiment", "three", "--strategies", *strategies))
    runs = runs_of(server, "three")
    assert rows.keys() == runs.keys() and len(rows) == 3
    assert sorted(row["strategy"] for row in rows.values()) == strategies
    for run, row in rows.items():
        trial = run.removeprefix("three-")
        assert runs[run]["name"] == f"CurriculumPPO_sparring_team_{trial}"
        assert runs[run]["tags"] == sorted(["three", f"trial:{trial}", "lr:0.0005"])
        assert runs[run]["settings"]["curriculum"]["strategy"] == row["strategy"]
        assert row["iterations"] == "2" and int(row["episodes"]) == episodes_of(server, run) >= 4
        assert all(row[name] != "nan" for name in ("return", "skill", "rung"))
    # The numbers that Tune stored are those of the server.
    for file in tmp_path.glob("three/*/result.json"):
        last = json.loads(file.read_text().splitlines()[-1])
        assert last["curriculum"]["episodes/finished"] == runs[last["curriculum_run"]]["episodes"]
        assert last["config"]["env_config"]["curriculum"]["run"] == last["curriculum_run"]


@needs_server
def test_interrupted_experiment_continues_its_runs(server, tmp_path):
    compared = ["--strategies", "ladder", "--lrs", "5e-4", "1e-3"]
    command = example_command(server, tmp_path, 3, "--experiment", "interrupted", *compared)
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        deadline = time.monotonic() + 120
        while len(list(tmp_path.glob("interrupted/*/checkpoint_*"))) < 2:
            assert first.poll() is None and time.monotonic() < deadline
            time.sleep(0.1)
    finally:
        first.send_signal(signal.SIGKILL)
        first.wait()
    before = runs_of(server, "interrupted")
    rows = run_example(command)
    after = runs_of(server, "interrupted")
    assert rows.keys() == before.keys() == after.keys() and len(rows) == 2
    assert {row["iterations"] for row in rows.values()} == {"3"}
    assert {row["lr"] for row in rows.values()} == {"0.0005", "0.001"}
    assert all(after[run]["episodes"] > before[run]["episodes"] for run in rows)


class KillOnce(tune.Callback):
    """Callback that kills the process of a trial after its first iteration."""

    def __init__(self):
        self.killed = None

    def on_trial_result(self, iteration, trials, trial, result, **_):
        if self.killed is None:
            self.killed = (result["pid"], result["curriculum_run"])
            os.kill(result["pid"], signal.SIGKILL)


@needs_server
def test_killed_trial_starts_again_in_its_run(server, tmp_path):
    ray.init("local", num_cpus=1, include_dashboard=False, object_store_memory=100 * 2**20, log_to_driver=False)
    kill = KillOnce()
    try:
        config = team_config(server, envs=4, steps=60).env_runners(num_env_runners=0)
        settings = {"tasks": [TASK], "strategy": "ladder", "design": {"share": 0}}
        config.env_config = {"task": TASK, "curriculum": {"url": server.url, "settings": settings, "token": "", "ttl_s": 5}}
        result = tune.Tuner(
            sparring.tune.run_per_trial(PPO, tags=["lr"]),
            param_space=config.to_dict(),
            run_config=tune.RunConfig(
                name="killed",
                storage_path=os.fspath(tmp_path),
                stop={"training_iteration": 3},
                failure_config=tune.FailureConfig(max_failures=1),
                checkpoint_config=tune.CheckpointConfig(checkpoint_frequency=1),
                callbacks=[kill],
                verbose=0,
            ),
        ).fit()[0]
    finally:
        ray.shutdown()
    assert result.error is None and result.metrics["training_iteration"] == 3
    assert result.metrics["pid"] != kill.killed[0] and result.metrics["curriculum_run"] == kill.killed[1]
    ((run, row),) = runs_of(server, "killed").items()
    assert run == kill.killed[1] and row["tags"][:2] == ["killed", "lr:0.0005"]
    assert row["episodes"] > result.metrics["curriculum"]["episodes/finished"] > 0


@needs_server
def test_run_is_created_once(server):
    settings = {"tasks": [TASK], "strategy": "ladder", "tags": ["mine"]}
    run = open_run(TRIAL, settings, server.url, "")
    assert run == "lr-search-ab12c_00001" == open_run(TRIAL, settings, server.url, "")
    stored = server.request("GET", f"/v1/runs/{run}")
    assert stored["name"] == TRIAL.name and stored["tags"] == ["lr-search", "lr:5e-05", "mine", "trial:ab12c_00001"]
    with pytest.raises(sparring.CurriculumError, match=r"exists with strategy 'ladder', but its trial has 'auto'"):
        open_run(TRIAL, {**settings, "strategy": "auto"}, server.url, "")
    with pytest.raises(ValueError, match=r"`curriculum\.settings\.id` must be omitted"):
        open_run(TRIAL, {"id": "mine"}, server.url, "")
    with pytest.raises(sparring.CurriculumError, match="strategy"):
        open_run(TuneTrial("new", "1", "new"), {"strategy": "none"}, server.url, "")


def test_names_become_valid_ids_and_tags():
    trial = TuneTrial("/Über: All_" + "x" * 80, "A.1", "name", ("lr:[[0, 0.1]]", "lr:[[0, 0.1]]", ":"))
    assert re.fullmatch(r"[a-z0-9][a-z0-9_-]{0,63}", trial.run) and trial.run.endswith("-a-1")
    assert all(re.fullmatch(r"[a-z0-9][a-z0-9_.:-]{0,63}", tag) for tag in trial.run_tags())
    assert len(trial.run_tags()) == len(set(trial.run_tags()))
