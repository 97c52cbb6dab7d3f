"""Loggers with the packages of W&B, MLflow and Trackio, without a network: each test reads the stored numbers. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_loggers_heavy.py
"""

import json
import os
import struct
import threading

import pytest
from conftest import needs_server
from curriculum_servers import RecordedMetrics, local_curriculum, step_randomly
from documents import URL, code_blocks

pytest.importorskip("mlflow")
pytest.importorskip("trackio")
pytest.importorskip("wandb")
import mlflow
import trackio
import wandb
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from trackio.sqlite_storage import SQLiteStorage
from wandb.proto.wandb_internal_pb2 import Record

import sparring
from sparring.loggers import MlflowLogger, TrackioLogger, WandbLogger

pytestmark = needs_server
#: Size of a block of a file of W&B, which has the format of LevelDB's log, after a header of 7 bytes.
WANDB_BLOCK = 32_768


@pytest.fixture(scope="module")
def curriculum():
    with local_curriculum() as opened:
        yield opened


@pytest.fixture(scope="module")
def envs(curriculum):
    envs = sparring.make_vec(num_envs=2, curriculum=curriculum)
    envs.reset()
    yield envs
    envs.close()


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Makes all trackers write to a temporary folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("trackio.sqlite_storage.TRACKIO_DIR", tmp_path)
    monkeypatch.setenv("WANDB_SILENT", "true")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    monkeypatch.setattr(wandb, "run", None)  # a disabled run stays there after its end
    yield tmp_path
    wandb.teardown()  # otherwise later runs of W&B use this folder


def log_training(make_logger, curriculum, envs):
    """Logs after some episodes at each of three steps; returns the curriculum's and other numbers of each step."""
    recorded = RecordedMetrics(curriculum)
    logger, expected = make_logger(recorded), {}
    for step in (100, 200, 300):
        step_randomly(envs, 60)
        logger.log(step, {"train/loss": 1 / step})
        expected[step] = {f"curriculum/{name}": value for name, value in recorded.last.items()} | {"train/loss": 1 / step}
    assert expected[100]["curriculum/episodes/finished"] < expected[300]["curriculum/episodes/finished"]
    return expected


def read_wandb(folder):
    """Returns the numbers of each row of the only run in a folder of W&B, by the row's number."""
    wandb.teardown()  # the process that writes the file can still be busy after the end of the run
    (file,) = (folder / "wandb").glob("offline-run-*/run-*.wandb")
    data, rows, offset, part = file.read_bytes(), {}, 7, b""
    while offset < len(data):
        left = WANDB_BLOCK - offset % WANDB_BLOCK
        if left < 7:
            offset += left
            continue
        _, size, kind = struct.unpack_from("<IHB", data, offset)
        part += data[offset + 7 : offset + 7 + size]
        offset += 7 + size
        if kind in (1, 4):  # a whole record, or its last part
            record, part = Record.FromString(part), b""
            if record.WhichOneof("record_type") == "history":
                items = {"/".join(item.nested_key) or item.key: json.loads(item.value_json) for item in record.history.item}
                rows[items["_step"]] = {name: value for name, value in items.items() if not name.startswith("_")}
    return rows


def test_wandb_stores_the_numbers_of_each_step(curriculum, envs, folder):
    with wandb.init(project="satellites"):
        sent = log_training(WandbLogger, curriculum, envs)
    rows = read_wandb(folder)
    assert rows == {step: {**numbers, "curriculum/step": step} for step, numbers in sent.items()}


def test_wandb_keeps_numbers_of_steps_below_the_newest(curriculum, envs, folder):
    with wandb.init(project="satellites") as run:
        run.log({"train/entropy": 1.0}, step=250)
        sent = log_training(WandbLogger, curriculum, envs)
        run.log({"train/entropy": 0.5}, step=300)
    rows = read_wandb(folder)
    assert {row: numbers["curriculum/step"] for row, numbers in rows.items()} == {250: 100, 251: 200, 300: 300}
    assert [rows[row]["train/entropy"] for row in (250, 300)] == [1.0, 0.5]
    for numbers in rows.values():
        assert sent[numbers["curriculum/step"]].items() <= numbers.items()


def test_wandb_rows_without_steps_are_those_of_the_run(curriculum, folder):
    with wandb.init(project="satellites") as run:
        logger = WandbLogger(curriculum, run)
        for loss in (3.0, 2.0, 1.0):
            logger.log()
            run.log({"train/loss": loss})
    rows = read_wandb(folder)
    assert [rows[row]["train/loss"] for row in range(3)] == [3.0, 2.0, 1.0]
    assert [rows[row]["curriculum/step"] for row in range(3)] == [0, 1, 2]


def test_disabled_wandb_run_accepts_the_numbers(curriculum):
    with wandb.init(mode="disabled") as run:
        logger = WandbLogger(curriculum, run)
        assert logger.log(1) and logger.log(2)


def read_mlflow(run_id):
    """Returns the numbers of each step of a run of MLflow."""
    client = mlflow.MlflowClient()
    steps = {}
    for name in client.get_run(run_id).data.metrics:
        for metric in client.get_metric_history(run_id, name):
            steps.setdefault(metric.step, {})[name] = metric.value
    return steps


@pytest.mark.parametrize("uri", ["file:{}/mlruns", "sqlite:///{}/mlflow.db"], ids=["files", "sqlite"])
def test_mlflow_stores_the_numbers_of_each_step(uri, curriculum, envs, folder):
    mlflow.set_tracking_uri(uri.format(folder))
    with mlflow.start_run() as run:
        sent = log_training(MlflowLogger, curriculum, envs)
    assert read_mlflow(run.info.run_id) == sent


def test_mlflow_accepts_the_names_of_the_logger(curriculum, folder):
    mlflow.set_tracking_uri(f"file:{folder}/mlruns")
    run = mlflow.MlflowClient().create_run("0")
    names = {"fuel [kg]": "fuel _kg_", "//a/./b/": "a/b", "../up": "up", "Δv, m/s": "Δv_ m/s", "a:b-c.d": "a:b-c.d"}
    sent = MlflowLogger(curriculum, run.info.run_id).log(None, dict.fromkeys(names, 1.5))
    assert set(names.values()) <= sent.keys()
    assert read_mlflow(run.info.run_id) == {0: sent}


def read_trackio(run):
    """Returns the numbers of each step of a run of Trackio."""
    rows = SQLiteStorage.get_logs("satellites", run.name)
    return {row["step"]: {name: value for name, value in row.items() if name not in ("step", "timestamp")} for row in rows}


def test_trackio_stores_the_numbers_of_each_step(curriculum, envs):
    run = trackio.init(project="satellites", embed=False, auto_log_cpu=False, auto_log_gpu=False)
    sent = log_training(TrackioLogger, curriculum, envs)
    logger = TrackioLogger(curriculum)
    sent[301] = logger.log()
    thread = threading.Thread(target=lambda: sent.update({50: logger.log(50)}))
    thread.start()
    thread.join()
    trackio.finish()
    assert read_trackio(run) == sent


@pytest.mark.parametrize("logger", [WandbLogger, MlflowLogger, TrackioLogger])
def test_logger_needs_an_active_run(logger, curriculum):
    with pytest.raises(ValueError, match=r"no run is active: call \w+\.\w+\(\) first"):
        logger(curriculum)


def test_printed_loggers_store_the_numbers(curriculum, folder):
    names = {}
    exec("\n".join(code_blocks("docs/guides/log-metrics.md")).replace(URL, curriculum.url), names)
    rows = read_wandb(folder)
    assert sorted(rows) == [0, 1, 2]
    events = EventAccumulator(os.fspath(folder / "runs"))
    events.Reload()
    assert "curriculum/kessler/survival/level" not in rows[0], "the run places the agent first"
    for name in ("curriculum/kessler/survival/params/debris", "train/loss"):
        values = [rows[step][name] for step in range(3)]
        assert [event.value for event in events.Scalars(name)] == pytest.approx(values)
        (run,) = mlflow.search_runs(output_format="list")
        assert [metric.value for metric in mlflow.MlflowClient().get_metric_history(run.info.run_id, name)] == values
        assert [numbers[name] for _, numbers in sorted(read_trackio(names["run"]).items())] == values
