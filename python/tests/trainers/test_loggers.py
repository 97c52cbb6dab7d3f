"""Loggers of a curriculum's metrics: their common interface, and TensorBoard's event files."""

import math
import sys

import numpy as np
import pytest
from conftest import needs_server
from curriculum_servers import RecordedMetrics, kill_server, remote_curriculum, step_randomly

import sparring
from sparring import loggers

#: Class of each tracker, the module that it imports, and the package to install.
TRACKERS = [
    (loggers.WandbLogger, "wandb", "wandb"),
    (loggers.MlflowLogger, "mlflow", "mlflow"),
    (loggers.TrackioLogger, "trackio", "trackio"),
    (loggers.TensorBoardLogger, "tensorboard.summary.writer.event_file_writer", "tensorboard"),
]


class Metrics:
    """Source of metrics without a server."""

    reads = 0
    reachable = True

    def metrics(self):
        self.reads += 1
        if not self.reachable:
            raise sparring.CurriculumError("no server answers")
        return {"kessler/survival/level": 3.0, "kessler/survival/skill": 0.25}


class Writer:
    """Writer that records its calls."""

    def __init__(self):
        self.rows, self.is_closed = [], False

    def add_scalar(self, name, value, step):
        self.rows.append((name, value, step))

    def flush(self):
        pass

    def close(self):
        self.is_closed = True


class WandbRun:
    """Run of W&B with its rule: numbers of a step below the newest are dropped."""

    def __init__(self, mode="offline"):
        self.step, self.rows = 0, {}
        self.settings = type("Settings", (), {"mode": mode})

    def define_metric(self, *_, **__):
        pass

    def log(self, numbers, step=None):
        assert self.settings.mode != "shared" or step is None
        row = self.step if step is None else step
        assert row >= self.step, "W&B drops these numbers"
        self.rows.setdefault(row, {}).update(numbers)
        self.step = row + (step is None)


def wandb_logger(monkeypatch, run):
    module = type(sys)("wandb")
    module.__file__, module.run = "wandb.py", run
    monkeypatch.setitem(sys.modules, "wandb", module)
    return loggers.WandbLogger(Metrics())


@pytest.mark.parametrize(("logger", "module", "package"), TRACKERS)
def test_missing_package_is_named_when_a_logger_is_made(logger, module, package, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=f"needs {package}: pip install {package}"):
        logger(Metrics(), tmp_path)


def test_folder_named_as_a_package_is_no_package(monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "wandb", raising=False)
    (tmp_path / "wandb").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    with pytest.raises(ImportError, match="pip install wandb"):
        loggers.WandbLogger(Metrics())
    monkeypatch.delitem(sys.modules, "wandb", raising=False)


def test_log_reads_once_and_returns_what_it_sent():
    source, writer = Metrics(), Writer()
    sent = loggers.TensorBoardLogger(source, writer).log(7, {"train/loss": np.float32(0.5)})
    assert source.reads == 1
    assert sent == {"curriculum/kessler/survival/level": 3.0, "curriculum/kessler/survival/skill": 0.25, "train/loss": 0.5}
    assert writer.rows == [(name, value, 7) for name, value in sent.items()]


def test_step_none_follows_the_last_step():
    writer = Writer()
    logger = loggers.TensorBoardLogger(Metrics(), writer)
    for step in (None, None, np.int64(10), None):
        logger.log(step)
    assert [step for name, _, step in writer.rows if name.endswith("level")] == [0, 1, 10, 11]
    assert all(type(step) is int for _, _, step in writer.rows)


@pytest.mark.parametrize("step", [-1, 1.5, True, "1"])
def test_invalid_step_is_rejected_before_a_request(step):
    source = Metrics()
    with pytest.raises(ValueError, match="`step` must be an integer >= 0"):
        loggers.TensorBoardLogger(source, Writer()).log(step)
    assert source.reads == 0


def test_unreachable_server_sends_only_extra_numbers(caplog):
    source, writer = Metrics(), Writer()
    logger = loggers.TensorBoardLogger(source, writer)
    source.reachable = False
    assert logger.log(1) == {}
    assert logger.log(2, {"train/loss": 0.5}) == {"train/loss": 0.5}
    assert writer.rows == [("train/loss", 0.5, 2)]
    assert "no server answers" in caplog.text
    source.reachable = True
    assert len(logger.log()) == 2
    assert writer.rows[-1][2] == 3


def test_writer_of_the_caller_stays_open():
    writer = Writer()
    with loggers.TensorBoardLogger(Metrics(), writer) as logger:
        logger.log()
    assert not writer.is_closed


def test_wandb_logger_never_writes_below_the_newest_row(monkeypatch):
    run = WandbRun()
    logger = wandb_logger(monkeypatch, run)
    for step in range(20):
        run.log({"train/loss": step})
    for step in (5, 6, 6, None, 100, None):
        logger.log(step)
    rows = {row: numbers["curriculum/step"] for row, numbers in run.rows.items() if "curriculum/step" in numbers}
    assert rows == {20: 5, 21: 6, 22: 22, 100: 100, 101: 101}


def test_wandb_logger_shares_the_row_of_a_step(monkeypatch):
    run = WandbRun()
    logger = wandb_logger(monkeypatch, run)
    for step in (10, 20):
        logger.log(step)
        run.log({"train/loss": 0.5}, step=step)
    assert sorted(run.rows) == [10, 20]
    assert all(numbers["train/loss"] == 0.5 and numbers["curriculum/step"] == row for row, numbers in run.rows.items())


def test_wandb_logger_omits_the_row_in_shared_mode(monkeypatch):
    run = WandbRun("shared")
    logger = wandb_logger(monkeypatch, run)
    logger.log(10)
    logger.log()
    assert [numbers["curriculum/step"] for numbers in run.rows.values()] == [10, 11]


@pytest.fixture
def read_scalars():
    accumulators = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")

    def read(folder):
        events = accumulators.EventAccumulator(str(folder))
        events.Reload()
        return {name: [(event.step, event.value) for event in events.Scalars(name)] for name in events.Tags()["scalars"]}

    return read


def assert_series(scalars, expected):
    """Compares scalars with the numbers of each step, in single precision."""
    assert scalars.keys() == {name for numbers in expected.values() for name in numbers}
    for name, points in scalars.items():
        assert dict(points) == pytest.approx({step: numbers[name] for step, numbers in expected.items() if name in numbers})


@needs_server
def test_event_file_of_a_folder_has_the_metrics(read_scalars, tmp_path):
    owner, curriculum = remote_curriculum()
    envs = sparring.make_vec(num_envs=2, curriculum=curriculum)
    envs.reset()
    recorded, expected = RecordedMetrics(curriculum), {}
    with owner, loggers.TensorBoardLogger(recorded, tmp_path) as logger:
        for step in (100, 200):
            step_randomly(envs, 60)
            logger.log(step, {"train/loss": 1 / step})
            expected[step] = {f"curriculum/{name}": value for name, value in recorded.last.items()} | {"train/loss": 1 / step}
        assert expected[100]["curriculum/episodes/finished"] < expected[200]["curriculum/episodes/finished"]
        envs.close()
        curriculum.close()
        kill_server(owner)
        expected[300] = logger.log(300, {"train/loss": math.pi})
        assert list(expected[300]) == ["train/loss"]
    assert_series(read_scalars(tmp_path), expected)


@needs_server
def test_summary_writer_of_torch_gets_the_metrics(read_scalars, tmp_path):
    tensorboard = pytest.importorskip("torch.utils.tensorboard")
    owner, curriculum = remote_curriculum()
    with owner, tensorboard.SummaryWriter(tmp_path) as writer:
        logger = loggers.TensorBoardLogger(curriculum, writer)
        expected = {0: logger.log(), 1: logger.log()}
    assert expected[0]["curriculum/kessler/survival/level"] == 0.0
    assert_series(read_scalars(tmp_path), expected)
