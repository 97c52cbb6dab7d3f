"""RLlib's counts and returns of episodes are those of the server. Run by hand: make test-heavy"""

import pytest

pytest.importorskip("ray.rllib")
from conftest import needs_server
from test_rllib import active_leases, agents_config, cluster, local_curriculum, team_config  # noqa: F401

pytestmark = needs_server


def train_here(config, envs, steps):
    """Trains on one fragment in this process; returns its metrics of episodes.

    RLlib's mean of several fragments is the mean of their means.
    """
    config = config.training(train_batch_size_per_learner=envs * steps, minibatch_size=envs * steps)
    algorithm = config.env_runners(num_env_runners=0, rollout_fragment_length=steps).build_algo()
    try:
        return algorithm.train()["env_runners"]
    finally:
        algorithm.stop()


def replayed_scores(curriculum):
    """Returns the scores of the episodes that the server replayed."""
    listed = curriculum.request("GET", f"/v1/runs/{curriculum.run}/episodes?limit=500")["episodes"]
    return [episode["score"] for episode in listed if episode["score"] is not None]


def test_returns_of_the_team_equal_the_scores(cluster):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        metrics = train_here(team_config(curriculum), 8, 240)
        scores = replayed_scores(curriculum)
    assert metrics["num_episodes"] == len(scores) > 12
    returns = [metrics[f"episode_return_{name}"] for name in ("mean", "min", "max")]
    assert returns == pytest.approx([sum(scores) / len(scores), min(scores), max(scores)], abs=1e-6)
    assert metrics["episode_len_min"] > 1


def test_returns_of_agents_are_those_of_the_team(cluster):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        metrics = train_here(agents_config(curriculum, 2, 240, "kessler/survival", lease_groups=2), 2, 240)
        scores = replayed_scores(curriculum)
    assert metrics["num_episodes"] == len(scores) > 4
    assert metrics["episode_len_min"] > 1
    # A satellite has the team's reward while it is active.
    of_agents = metrics["agent_episode_returns_mean"].values()
    assert max(of_agents) <= sum(scores) / len(scores) + 1e-6
    assert min(of_agents) > 0.0


def evaluating_config(curriculum, **evaluation):
    config = team_config(curriculum, envs=2, steps=51).env_runners(num_env_runners=0)
    return config.evaluation(evaluation_duration=4, **evaluation)


@pytest.mark.parametrize(
    "evaluation",
    [
        {"evaluation_interval": 1},
        {"evaluation_num_env_runners": 1},
        {"evaluation_interval": 1, "evaluation_config": {"explore": False, "env_config": {"threads": 1}}},
    ],
)
def test_evaluation_with_the_curriculum_is_rejected(cluster, evaluation):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        with pytest.raises(ValueError, match=r"`evaluation_config` must .*'curriculum': None.*sparring\.evaluate"):
            evaluating_config(curriculum, **evaluation).build_algo()
        # The env runners have returned their episodes.
        assert not active_leases(curriculum)


def test_evaluation_on_environments_of_the_training_is_rejected(cluster):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        algorithm = evaluating_config(curriculum).build_algo()
        try:
            with pytest.raises(ValueError, match="`evaluation_config` must"):
                algorithm.evaluate()
        finally:
            algorithm.stop()
        assert not replayed_scores(curriculum)


def test_evaluation_without_the_curriculum_does_not_count(cluster):  # noqa: F811
    with local_curriculum(["kessler/survival"]) as curriculum:
        other = {"env_config": {"curriculum": None, "level": 9}}
        config = evaluating_config(curriculum, evaluation_interval=1, evaluation_config=other)
        algorithm = config.build_algo()
        try:
            result = algorithm.train()
        finally:
            algorithm.stop()
        scores = replayed_scores(curriculum)
    assert result["evaluation"]["env_runners"]["num_episodes"] == 4
    assert result["env_runners"]["num_episodes"] == len(scores) > 0
