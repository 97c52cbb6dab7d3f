"""A small comparison of curricula: it continues after a stop, and its report has all trainings."""

import csv
import json
import os
import pathlib
import shlex
import signal
import subprocess
import sys

import numpy as np
import pytest
from conftest import BINARY, needs_server
from curriculum_servers import wait_until
from documents import printed_command

pytest.importorskip("torch")
pytest.importorskip("rliable")

import sparring
from sparring.experiments import experiment, results, runner
from sparring.experiments.cli import main
from sparring.experiments.experiment import ExperimentError
from sparring.server import Server

TASK = "kessler/survival"


def command(*arguments):
    return [sys.executable, "-W", "ignore", "-m", "sparring.experiments", "curriculum", *map(str, arguments)]


def run(*arguments):
    """Runs an experiment in this process, which has imported torch already; returns its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPARRING_BIN", BINARY or "")
        return main([*map(str, arguments)])


def test_invalid_option_is_reported_in_one_line(tmp_path, capsys):
    for options, field in (
        (("--strategies", "plr,none"), "--strategies"),
        (("--strategies", "plr,plr"), "--strategies"),
        (("--seeds", "1,x"), "--seeds"),
        (("--tasks", "none"), "--tasks"),
        (("--target-level", "40"), "--target-level"),
        (("--budget", "0"), "--budget"),
        (("--report",), "--out"),
    ):
        assert main(["--out", str(tmp_path / "none"), *options]) == 2
        error = capsys.readouterr().err
        assert error.startswith(field)
        assert len(error.splitlines()) == 1
    assert not (tmp_path / "none").exists()


def test_printed_commands_define_experiments(tmp_path, monkeypatch):
    defined = []

    def run(folder, definition, **_):
        defined.append((folder, definition))
        raise ExperimentError("nothing is run")

    monkeypatch.setattr(runner, "run", run)
    monkeypatch.chdir(tmp_path)
    for page in ("docs/guides/train-own-loop.md", "docs/reference/strategies-measured.md"):
        _, module, name, experiment_name, *options = shlex.split(
            printed_command(page, "python -m sparring.experiments curriculum")
        )
        assert (module, name, experiment_name) == ("-m", "sparring.experiments", "curriculum")
        assert main(options) == 2
    (guide_folder, guide), (measured_folder, measured) = defined
    assert guide_folder == measured_folder == pathlib.Path("mine")
    assert guide == experiment.Experiment()
    assert (len(measured.trainings()), measured.budget, measured.evaluations) == (28, 200_000, 4)


def test_each_arm_has_its_own_run_settings():
    definition = experiment.Experiment(arms=("ladder", "plr+designs", "target"), target_level=3)
    ladder, plr, target = (definition.run_settings(arm, 7) for arm in definition.arms)
    assert (ladder["strategy"], plr["strategy"], target["strategy"]) == ("ladder", "plr", "uniform")
    assert ladder["design"] == target["design"] == {"share": 0}
    assert plr["design"] == {}
    assert len(target["task_settings"][TASK]["levels"]["rows"]) == 1
    assert len({training.folder for training in definition.trainings()}) == 9


def test_interquartile_mean_trims_four_values_but_not_three():
    three = results.interquartile(np.array([[0.0], [0.3], [0.9]]))
    assert three.mean == pytest.approx(0.4)
    four = results.interquartile(np.array([[-9.0], [0.3], [0.5], [9.0]]))
    assert four.mean == pytest.approx(0.4)
    assert four.low <= four.mean <= four.high


def kill_after_first_training(options, first_done):
    """Starts an experiment and kills all its processes once the first training is complete."""
    environment = {**os.environ, "SPARRING_BIN": BINARY}
    process = subprocess.Popen(
        command(*options), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )

    def is_done():
        assert process.poll() is None, process.stderr.read()
        return first_done.exists()

    wait_until(is_done)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    wait_until(lambda: is_unlocked(first_done.parents[1] / "runs.sqlite3"))


def is_unlocked(database):
    """Returns True once the killed server of a database has ended."""
    try:
        Server(database, BINARY).stop()
    except sparring.CurriculumError as error:
        if "locked by another process" not in str(error):
            raise
        return False
    return True


def debris_of_episodes(database, run_id):
    """Returns the values of the param `debris` in episodes of a run."""
    server = Server(database, BINARY)
    try:
        with sparring.Curriculum(server.url, run_id) as curriculum:
            path = f"/v1/runs/{curriculum.run}/episodes"
            ids = [episode["episode"] for episode in curriculum.request("GET", f"{path}?limit=20")["episodes"]]
            return {curriculum.request("GET", f"{path}/{id}")["scenario"]["params"]["debris"] for id in ids}
    finally:
        server.stop()


@pytest.fixture(scope="module")
def experiment_folder(tmp_path_factory):
    """Folder of an experiment that was killed after its first training and then completed."""
    out = tmp_path_factory.mktemp("experiment")
    first_done = out / "uniform-1" / "done.json"
    kill_after_first_training(options(out), first_done)
    before = json.loads(first_done.read_text())
    assert not (out / "target-1" / "done.json").exists()

    assert run(*options(out), "--budget", 9600) == 2, "a changed experiment must not continue"
    assert run(*options(out)) == 0
    assert json.loads(first_done.read_text()) == before, "a complete training was run again"
    return out


def options(out):
    size = ("--seeds", 1, "--budget", 6400, "--evaluations", 1, "--rollouts", 2, "--num-envs", 64)
    return ("--out", out, "--strategies", "uniform,target", *size)


@needs_server
def test_continued_experiment_has_all_trainings(experiment_folder):
    found = results.read(experiment_folder)
    assert found.arms() == ["uniform", "target"]
    assert found.versions()["numpy"] == np.__version__
    for training in found.done:
        assert found.done[training]["steps"] == 6400
        episodes = found.done[training]["episodes"]
        assert episodes["counted"] + episodes["stored"] == episodes["finished"] > 0
        skills = [row["skill"] for row in found.scenarios[training] if row["task"] == TASK and row["part"] == "contested"]
        assert len(skills) > 50
        assert found.values(training.arm, "skill")[0, 0] == pytest.approx(np.nanmean(skills), abs=1e-6)
        assert {row["steps"] for row in found.curves[training]} == {3200, 6400}


@needs_server
def test_target_arm_has_a_single_level(experiment_folder):
    found = results.read(experiment_folder)
    run_id = found.done[experiment.Training("target", 1)]["run"]
    debris = debris_of_episodes(experiment_folder / "runs.sqlite3", run_id)
    assert debris == {sparring.levels(TASK)[5]["debris"]} != {sparring.levels(TASK)[0]["debris"]}


@needs_server
def test_report_is_complete_and_reproducible(experiment_folder):
    report = (experiment_folder / "report.md").read_text()
    assert "| uniform | 1 |" in report and "| target | 1 |" in report and "blind_panel" in report
    assert "| target | kessler/survival |" in report, "the comparison with the baseline"
    with (experiment_folder / "trainings.csv").open() as file:
        assert [row["arm"] for row in csv.DictReader(file)] == ["uniform", "target"]
    names = ("skill.svg", "curves.svg", "report.md", "trainings.csv")
    written = {name: (experiment_folder / name).read_text() for name in names}
    assert all(len(text) > 100 for text in written.values())
    assert run("--out", experiment_folder, "--report") == 0
    rewritten = {name: (experiment_folder / name).read_text() for name in names}
    assert rewritten == written, "equal results give equal files"


@needs_server
def test_comparison_of_other_trainings_is_replaced(experiment_folder):
    file = experiment_folder / "compared.json"
    comparison = json.loads(file.read_text())
    file.write_text(json.dumps({**comparison, "of": {**comparison["of"], "uniform": "eval-0"}}))
    assert results.read_comparison(experiment_folder, results.read(experiment_folder)) is None
    assert run(*options(experiment_folder)) == 0
    assert json.loads(file.read_text()) == comparison
