"""Failure modes of held-out episodes, and those at which designed layouts aim."""

import time

import numpy as np
import pytest
from conftest import needs_server
from curriculum_servers import local_curriculum

pytest.importorskip("torch")
import torch

import sparring
from sparring.experiments import ppo
from sparring.experiments.evidence import failures, held_out


@pytest.mark.parametrize("task", ["docking/multiagent", "kessler/survival", "tasking/scanning"])
def test_recorded_episodes_replay_with_the_measured_score(task, tmp_path):
    scenarios = held_out.load(tmp_path, task, 10, 1)
    config = ppo.Config.tuned(task)
    envs = sparring.make_vec(task, 1, **ppo.environment_settings(config))
    torch.manual_seed(3)
    policy = ppo.Policy(envs.single_observation_space.shape[-1], int(envs.single_action_space.nvec[0]), config)
    measured = held_out.measure(policy, scenarios, 2, 1, record=True)
    assert [episode.scenario for episode in measured.recorded] == scenarios.scenarios * 2
    gaps = scenarios.references - scenarios.floors
    scores = np.array([sparring.replay(*episode).score for episode in measured.recorded]).reshape(2, 10)
    assert np.clip((scores - scenarios.floors) / gaps, -1.0, 1.0) == pytest.approx(measured.skill, abs=1e-6)
    assert held_out.measure(policy, scenarios, 1, 1).recorded == []


def test_shares_count_each_mode_once_an_episode():
    scenarios = [sparring.Scenario("kessler/survival", level=9, seed=seed) for seed in range(20)]
    flown = [(scenario, *sparring.rollout(scenario, "hold", 0)) for scenario in scenarios]
    # Doing nothing loses a satellite or several by a collision.
    lost = sum(not outcome.success for _, outcome, _ in flown)
    shares = failures.failure_shares([held_out.RecordedEpisode(scenario, actions) for scenario, _, actions in flown])
    assert 0.2 < shares["collision"] == lost / 20 <= 1.0


@needs_server
def test_episodes_on_layouts_are_counted_by_their_aim():
    settings = {"tasks": ["kessler/survival"], "strategy": "ladder", "placement": False, "group_size": 2}
    settings["design"] = {"share": 1.0, "fixed_share": True}
    with local_curriculum(settings=settings, form="groups") as curriculum:
        assert failures.aimed_episodes(curriculum) == {}
        envs = sparring.make_vec("kessler/survival", 16, curriculum=curriculum)
        envs.reset()
        hold = np.zeros(envs.action_space.shape, np.float32)
        designed, deadline = 0, time.monotonic() + 60.0
        while designed < 8 and time.monotonic() < deadline:
            for _ in range(200):
                envs.step(hold)
            curriculum.flush()
            (row,) = curriculum.mastery()
            designed = row["designed_results"]["episodes"]
        envs.close()
        curriculum.flush()
        aimed, (row,) = failures.aimed_episodes(curriculum), curriculum.mastery()
    assert sum(aimed.values()) == row["designed_results"]["episodes"] >= 8
    assert set(aimed) <= {"collision", "fuel_starvation", "decay", "wasted_fuel"}
