"""RLlib's names of the environments in several sessions of Ray in one process. Run by hand: make test-heavy"""

import pytest

pytest.importorskip("ray.rllib")
import ray
from conftest import needs_server
from ray.rllib.algorithms.ppo import PPOConfig
from test_rllib import agents_config, local_curriculum, team_config

import sparring.rllib


def train_in_session(make_config):
    """Trains for an iteration in a session of its own; returns the number of its env-steps."""
    ray.init("local", num_cpus=3, include_dashboard=False, object_store_memory=100 * 2**20, log_to_driver=False)
    try:
        algorithm = make_config().build_algo()
        try:
            return algorithm.train()["env_runners"]["num_env_steps_sampled"]
        finally:
            algorithm.stop()
    finally:
        ray.shutdown()


def test_names_are_strings():
    from sparring.rllib import AGENTS, TEAM

    assert (TEAM, AGENTS) == ("sparring/team", "sparring/agents") and type(TEAM) is str
    with pytest.raises(AttributeError, match="TEAMS"):
        sparring.rllib.TEAMS  # noqa: B018


@needs_server
def test_names_work_in_every_session():
    with local_curriculum(["kessler/survival"]) as curriculum:
        config = team_config(curriculum, envs=2, steps=51)
        for make_config in (
            lambda: config,
            # RLlib does not change a config that was built, and this one has read its name in the first session.
            config.copy,
            lambda: agents_config(curriculum, 2, 51, "kessler/survival", lease_groups=2),
        ):
            # Two env runners with two environments each; a beginning is no step.
            assert train_in_session(make_config) >= 2 * 2 * 50


def test_names_work_in_every_session_without_the_callback():
    def make_config():
        config = PPOConfig().environment(sparring.rllib.TEAM, env_config={"task": "kessler/survival"})
        config.env_runners(num_env_runners=1, rollout_fragment_length=20, gym_env_vectorize_mode="vector_entry_point")
        config.training(train_batch_size_per_learner=20, minibatch_size=20)
        return config.rl_module(rl_module_spec=sparring.rllib.module_spec("kessler/survival"))

    assert [train_in_session(make_config) >= 19 for _ in range(2)] == [True, True]
