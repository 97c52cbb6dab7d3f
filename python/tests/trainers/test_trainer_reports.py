"""Numbers of trainers that reach the run of their curriculum, on a real server."""

import functools
import math
import time

import numpy as np
import pytest
from conftest import needs_server
from curriculum_servers import local_curriculum

pytest.importorskip("stable_baselines3")
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.logger import configure

import sparring
import sparring.sb3
from sparring import loggers
from sparring.experiments import ppo
from sparring.trainer_metrics import TrainerReport

pytestmark = needs_server


@pytest.fixture(scope="module")
def server():
    with local_curriculum() as owner:
        yield owner


@pytest.fixture
def curriculum(server):
    settings = {"tasks": ["kessler/survival"], "placement": False, "design": {"designer": "off"}}
    with sparring.Curriculum(server.url, settings=settings, form="groups") as curriculum:
        yield curriculum


def stored(curriculum):
    """Returns the stored steps and values by name, after all metrics are sent."""
    curriculum.flush()
    curves = curriculum.request("GET", f"/v1/runs/{curriculum.run}/metrics?points=2000")["metrics"]
    return {curve["name"]: dict(zip(curve["step"], curve["value"], strict=True)) for curve in curves}


def drawn_rung(curriculum):
    """Returns the mean rung of the latest proposals, from the view of the sampler."""
    (sampler,) = curriculum.request("GET", f"/v1/runs/{curriculum.run}/sampler")["tasks"]
    return sum(rung["rung"] * rung["share"] for rung in sampler["rungs"])


class Writer:
    """Writer of a logger that does nothing."""

    def add_scalar(self, name, value, step):
        pass

    def flush(self):
        pass


def test_logger_reports_the_numbers_of_the_loop(curriculum):
    curriculum.request("POST", f"/v1/runs/{curriculum.run}/leases", {"groups": 40})
    logger = loggers.TensorBoardLogger(curriculum, Writer())
    sent = logger.log(5, {"train/loss": np.float32(0.5), "grad norm": math.nan})
    logger.log(None, {"train/loss": 0.25})
    assert sent["curriculum/kessler/survival/rung"] == pytest.approx(drawn_rung(curriculum)) and "grad norm" in sent
    assert stored(curriculum) == {"train/loss": {5: 0.5, 6: 0.25}, "grad_norm": {5: None}}


def test_logger_can_leave_the_server_out(curriculum):
    loggers.TensorBoardLogger(curriculum, Writer(), report=False).log(5, {"train/loss": 0.5})
    assert stored(curriculum) == {}


def train_sb3(curriculum, rollouts, **arguments):
    envs = sparring.sb3.vec_env(4, curriculum=curriculum)
    settings = {"n_steps": 50, "batch_size": 300, "n_epochs": 1, "device": "cpu", "seed": 1}
    model = PPO("MlpPolicy", envs, **settings, **sparring.sb3.active_only(envs))
    model.learn(rollouts * 50 * envs.num_envs, callback=sparring.sb3.CurriculumCallback(curriculum, **arguments))
    envs.close()
    return model


def test_sb3_reports_the_numbers_of_its_logger(curriculum, monkeypatch):
    monkeypatch.setattr(sparring.sb3, "TrainerReport", functools.partial(TrainerReport, interval_s=0.0))
    train_sb3(curriculum, 3)
    metrics = stored(curriculum)
    assert {"train/loss", "train/approx_kl", "rollout/ep_rew_mean", "time/fps"} <= metrics.keys()
    assert not any(name.startswith("curriculum") for name in metrics)
    # The logger writes before the update, and the callback adds the last update at the end.
    assert list(metrics["train/loss"]) == [1200, 1800]
    assert list(metrics["time/fps"]) == [600, 1200, 1800]
    assert all(math.isfinite(value) for value in metrics["train/loss"].values())


def test_sb3_reports_at_most_once_a_second(curriculum):
    started = time.monotonic()
    train_sb3(curriculum, 12)
    seconds = time.monotonic() - started
    steps = {step for values in stored(curriculum).values() for step in values}
    # The first report, one each second, and the last one at the end.
    assert 2 <= len(steps) <= seconds + 2
    assert min(steps) == 600 and max(steps) == 7200


def test_sb3_can_leave_the_server_out(curriculum):
    train_sb3(curriculum, 1, report=False)
    assert stored(curriculum) == {}


def test_sb3_logger_of_the_user_keeps_its_outputs(curriculum, tmp_path):
    envs = sparring.sb3.vec_env(2, curriculum=curriculum, actions="discrete")
    model = DQN("MlpPolicy", envs, buffer_size=1000, learning_starts=100, device="cpu")
    model.set_logger(configure(str(tmp_path), ["csv"]))
    for _ in range(2):
        model.learn(1200, callback=sparring.sb3.CurriculumCallback(curriculum), log_interval=1, reset_num_timesteps=False)
    assert len(model.logger.output_formats) == 1
    assert {"rollout/ep_rew_mean", "train/loss"} <= stored(curriculum).keys()
    assert (tmp_path / "progress.csv").read_text().count("\n") > 2
    envs.close()


@pytest.mark.parametrize("report_metrics", [True, False])
def test_ppo_reports_its_metrics(curriculum, report_metrics):
    config = ppo.Config(steps=600, num_envs=4, rollout=50, epochs=1)
    ppo.train(config, curriculum, report_metrics=report_metrics)
    metrics = stored(curriculum)
    if not report_metrics:
        assert metrics == {}
        return
    assert {"policy_loss", "value_loss", "hold", "return", "level", "steps_per_s"} <= metrics.keys()
    assert max(metrics["policy_loss"]) == 600
