"""GRPO in one file: advantages in closed form, groups of a real server, and a small training."""

import numpy as np
import pytest
from conftest import BINARY, needs_server

pytest.importorskip("torch")
import torch

import sparring
from sparring.experiments import grpo, ppo

SETTINGS = {"tasks": ["kessler/survival"], "strategy": "uniform", "group_size": 8, "design": {"designer": "off"}}


def test_group_advantages_equal_their_definition():
    returns = np.array([[0.0, -1.0, 0.3], [-1.0, -1.0, 0.3], [-1.0, -1.0, 0.3], [-1.0, -1.0, 0.3]])
    # Of four returns 0, −1, −1, −1 the mean is −3/4 and the standard deviation √3/4.
    plain = grpo.advantages(returns, scale_by_std=False)
    assert plain[:, 0] == pytest.approx([0.75, -0.25, -0.25, -0.25])
    scaled = grpo.advantages(returns, scale_by_std=True)
    assert scaled[:, 0] == pytest.approx(np.array([3.0, -1.0, -1.0, -1.0]) / 3.0**0.5, rel=1e-5)
    assert (scaled[:, 1:] == 0.0).all(), "equal returns have no advantage"
    thirds = np.full((3, 1), 0.1)
    assert thirds.mean(axis=0)[0] != 0.1, "the mean of equal numbers may be rounded"
    assert (grpo.advantages(thirds, scale_by_std=True) == 0.0).all()


def episode(policy, returns, rng, steps=4):
    """Makes an episode of one agent, in which it took action 1 if its return is 0, else action 2."""
    observations = rng.normal(size=(steps, 1, policy.sizes[0])).astype(np.float32)
    actions = np.full((steps, 1), 1 if returns == 0.0 else 2)
    with torch.no_grad():
        log_probs = policy.actor(torch.from_numpy(observations)).log_softmax(-1).numpy()
    rewards = np.zeros((steps, 1), np.float32)
    rewards[-1] = returns
    taken = np.take_along_axis(log_probs, actions[..., None], -1)[..., 0]
    return grpo.Episode(observations, actions, taken, rewards, np.ones((steps, 1), np.bool_))


def test_groups_raise_the_probability_of_better_actions():
    config = grpo.Config(hold_logit=0.0, epochs=20)
    torch.manual_seed(1)
    policy, rng = grpo.Actor(3, 5, config), np.random.default_rng(1)
    optimizer = torch.optim.Adam(policy.parameters(), 1e-2)
    before = [parameter.clone() for parameter in policy.parameters()]
    equal = [[episode(policy, -1.0, rng) for _ in range(4)] for _ in range(3)]
    assert grpo.learn(policy, optimizer, equal, config) == {"zero_variance": 1.0}
    assert grpo.learn(policy, optimizer, [], config) == {}
    assert all((old == new).all() for old, new in zip(before, policy.parameters(), strict=True))
    mixed = [episode(policy, result, rng) for result in (0.0, -1.0, -1.0, 0.0)]
    metrics = grpo.learn(policy, optimizer, [mixed, *equal], config)
    assert metrics["zero_variance"] == 0.75
    assert metrics["rows"] == 16.0
    observations = torch.from_numpy(np.concatenate([each.observations for each in mixed]))
    with torch.no_grad():
        probabilities = policy.actor(observations).softmax(-1).mean((0, 1))
    assert probabilities[1] > 0.24 > 0.18 > probabilities[2], "both are a fifth at first"


@needs_server
def test_collected_groups_have_the_episodes_of_one_scenario():
    config = grpo.Config(task="kessler/survival", num_envs=20, seed=3)
    with sparring.Curriculum.local(binary=BINARY, settings={**SETTINGS, "seed": 1}, form="groups") as curriculum:
        assert curriculum.group_size == 8
        envs = sparring.make_vec(
            "kessler/survival", 20, curriculum=curriculum, autoreset_mode="same_step", **ppo.environment_settings(config)
        )
        collector = grpo.GroupCollector(envs, curriculum.group_size, config)
        torch.manual_seed(1)
        policy = grpo.Actor(envs.single_observation_space.shape[-1], 5, config)
        groups = collector.collect(policy, 6, 100_000)
        envs.close()
        curriculum.flush()
        counts = curriculum.mastery()[0]["group_counts"]
    assert len(groups) >= 6
    assert counts["complete"] >= len(groups)
    for number, group in enumerate(groups):
        assert len(group) == 8
        first = group[0].observations[0]
        assert all((each.observations[0] == first).all() for each in group), "all begin in the same scenario"
        assert all((other[0].observations[0] != first).any() for other in groups[:number])
        for each in group:
            for agent in range(3):
                steps = int(each.active[:, agent].sum())
                assert each.active[:steps, agent].all(), "an agent that left takes no part"
                assert each.rewards[: steps - 1, agent].sum() == 0.0
                assert each.returns()[agent] == (-1.0 if steps < 50 else each.rewards[49, agent])
                assert (each.actions[:, agent] < 5).all()


@needs_server
def test_training_by_groups_alone_improves_skill():
    def skill(policy, name):
        settings = {"rollouts": 2, "stochastic": True, **ppo.environment_settings(policy.config)}
        return sparring.evaluate(curriculum, policy.sample, policy=name, **settings).mean("kessler/survival")

    reports = []
    with sparring.Curriculum.local(binary=BINARY, settings={**SETTINGS, "seed": 2}, form="groups") as curriculum:
        config = grpo.Config.tuned("kessler/survival", steps=80_000, seed=2)
        torch.manual_seed(2)
        start = skill(grpo.Actor(72, 5, config), "start")
        policy = grpo.train(config, curriculum, lambda steps, _, metrics: reports.append((steps, metrics)))
        curriculum.flush()
        trained = skill(policy, "trained")
        counts = curriculum.mastery()[0]["group_counts"]
    assert reports[-1][0] >= 80_000
    assert all(0.0 <= metrics["zero_variance"] <= 1.0 for _, metrics in reports)
    assert counts["complete"] > 100 and 0.0 < counts["zero_variance_share"] < 0.5
    assert not any(isinstance(module, torch.nn.Linear) and module.out_features == 1 for module in policy.modules()), "a critic"
    # A training by hand gained 0.3 on other scenarios; a policy that does not learn stays within 0.05.
    assert trained - start > 0.12


@needs_server
def test_groups_of_one_episode_are_refused():
    with sparring.Curriculum.local(binary=BINARY, settings={**SETTINGS, "group_size": 1}) as curriculum:
        with pytest.raises(ValueError, match=r"`curriculum.group_size` must be >= 2: .* got 1"):
            grpo.train(grpo.Config(steps=100), curriculum)
        with curriculum.reopen(group_size=4) as groups:
            assert groups.group_size == 4


def test_invalid_hyperparameter_is_named():
    for name, value in (("groups", 0), ("steps", 0), ("clip", 0.0)):
        with pytest.raises(ValueError, match=f"`{name}` must be"):
            grpo.Config(**{name: value})


def test_learning_rate_falls_linearly_to_a_tenth():
    config = grpo.Config(learning_rate=0.01, steps=200)
    assert [config.learning_rate_at(steps) for steps in (0, 100, 200, 300)] == pytest.approx([0.01, 0.0055, 0.001, 0.001])
    assert ppo.Config(learning_rate=0.01, steps=200).learning_rate_at(100) == config.learning_rate_at(100)


def test_tuned_settings_have_the_rewards_of_ppo():
    assert grpo.Config.tuned("kessler/rendezvous", seed=4).reward_weight == 4.0
    assert grpo.Config.tuned("docking/single").decision_steps == 5
