"""The harness, small: it goes on where it was stopped, and says what was flown."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import BINARY, served

pytest.importorskip("torch")
pytest.importorskip("rliable")

import sparring
from sparring.experiments import findings, plan
from sparring.experiments.command import main
from sparring.server import Server

TASK = "kessler/survival"


def command(*arguments):
    return [sys.executable, "-W", "ignore", "-m", "sparring.experiments", "curriculum", *map(str, arguments)]


def run(*arguments):
    environment = {**os.environ, "SPARRING_BIN": BINARY or ""}
    return subprocess.run(command(*arguments), capture_output=True, text=True, timeout=600, env=environment)


def test_what_cannot_be_done_is_one_sentence(tmp_path, capsys):
    for wrong, field in (
        (("--strategies", "plr,none"), "strategies"),
        (("--strategies", "plr,plr"), "arms"),
        (("--seeds", "1,x"), "seeds"),
        (("--tasks", "none"), "tasks"),
        (("--target-level", "40"), "target_level"),
        (("--budget", "0"), "budget"),
        (("--report",), "out"),
    ):
        assert main(["--out", str(tmp_path / "none"), *wrong]) == 2
        told = capsys.readouterr().err
        assert told.startswith(field)
        assert len(told.splitlines()) == 1
    assert not (tmp_path / "none").exists()


def test_arms_are_runs_of_their_own():
    asked = plan.Experiment(arms=("ladder", "plr+designs", "target"), target_level=3)
    ladder, plr, target = (asked.run_settings(arm, 7) for arm in asked.arms)
    assert (ladder["strategy"], plr["strategy"], target["strategy"]) == ("ladder", "plr", "uniform")
    assert ladder["design"] == target["design"] == {"share": 0}
    assert plr["design"] == {}
    assert len(target["task_settings"][TASK]["levels"]["rows"]) == 1
    assert len({one.folder for one in asked.trainings()}) == 9


def test_nothing_is_trimmed_of_three_and_the_ends_are_of_four():
    three = findings.interquartile(np.array([[0.0], [0.3], [0.9]]))
    assert three.mean == pytest.approx(0.4)
    four = findings.interquartile(np.array([[-9.0], [0.3], [0.5], [9.0]]))
    assert four.mean == pytest.approx(0.4)
    assert four.low <= four.mean <= four.high


@served
def test_it_goes_on_where_it_was_stopped_and_says_what_was_flown(tmp_path):
    out = tmp_path / "mine"
    asked = ("--out", out, "--strategies", "uniform,target", "--seeds", 1, "--budget", 6400, "--looks", 1, "--rollouts", 2)
    environment = {**os.environ, "SPARRING_BIN": BINARY}
    stopped = subprocess.Popen(
        command(*asked), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    first = out / "uniform-1" / "done.json"
    began = time.monotonic()
    while not first.exists():
        assert stopped.poll() is None, stopped.stderr.read()
        assert time.monotonic() - began < 300
        time.sleep(0.05)
    os.killpg(stopped.pid, signal.SIGKILL)
    stopped.communicate()
    before = json.loads(first.read_text())
    assert not (out / "target-1" / "done.json").exists()

    assert run(*asked, "--budget", 9600).returncode == 2, "another experiment goes on as this one"
    told = run(*asked)
    assert told.returncode == 0, told.stderr
    assert json.loads(first.read_text()) == before, "what was done was flown again"
    found = findings.read(out)
    assert found.arms() == ["uniform", "target"]
    for one in found.done:
        assert found.done[one]["steps"] == 6400
        told_of = found.done[one]["episodes"]
        assert told_of["counted"] + told_of["stored"] == told_of["flown"] > 0
        skills = [row["skill"] for row in found.scenarios[one] if row["task"] == TASK and row["part"] == "contested"]
        assert len(skills) > 50
        assert found.values(one.arm, "skill")[0, 0] == pytest.approx(np.nanmean(skills), abs=1e-6)
        assert {row["steps"] for row in found.curves[one]} == {3200, 6400}
    # One level alone: what was faced was drawn from one row.
    server = Server(out / "runs.sqlite3", BINARY)
    try:
        with sparring.Curriculum(server.url, found.done[plan.Training("target", 1)]["run"]) as run_of:
            at = f"/v1/runs/{run_of.run}/episodes"
            some = [episode["episode"] for episode in run_of.ask("GET", f"{at}?limit=20")["episodes"]]
            debris = {run_of.ask("GET", f"{at}/{episode}")["scenario"]["params"]["debris"] for episode in some}
    finally:
        server.stop()
    assert debris == {sparring.levels(TASK)[5]["debris"]} != {sparring.levels(TASK)[0]["debris"]}
    report = (out / "report.md").read_text()
    assert "| uniform | 1 |" in report and "| target | 1 |" in report and "blind_panel" in report
    assert "| target | kessler/survival |" in report, "compared with the baseline"
    with (out / "trainings.csv").open() as file:
        assert [row["arm"] for row in csv.DictReader(file)] == ["uniform", "target"]
    drawn = {name: (out / name).read_text() for name in ("skill.svg", "curves.svg", "report.md", "trainings.csv")}
    assert all(len(text) > 100 for text in drawn.values())
    assert run("--out", os.fspath(out), "--report").returncode == 0
    assert {name: (out / name).read_text() for name in drawn} == drawn, "the same findings are the same files"
    assert found.versions()["numpy"] == np.__version__
    # What was compared before somebody added a training is not told beside it.
    compared = json.loads((out / "compared.json").read_text())
    (out / "compared.json").write_text(json.dumps({**compared, "of": {**compared["of"], "uniform": "eval-0"}}))
    assert findings.compared(out, found) is None
    assert run(*asked).returncode == 0
    assert json.loads((out / "compared.json").read_text()) == compared
