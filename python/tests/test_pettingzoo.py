"""Multi-agent environments pass PettingZoo's own tests."""

import copy

import gymnasium
import numpy as np
import pytest
from conftest import IDS_AND_ACTIONS, bitwise_equal, hold_action, random_actions, short_episode_params

import sparring

pettingzoo = pytest.importorskip("pettingzoo")
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test  # noqa: E402
from pettingzoo.utils import parallel_to_aec  # noqa: E402


@pytest.mark.parametrize(("id", "actions"), IDS_AND_ACTIONS)
def test_environment_passes_parallel_api_test(id, actions):
    task = sparring.ENVIRONMENTS[id]
    parallel_api_test(sparring.parallel_env(task, params=short_episode_params(task), actions=actions), num_cycles=300)


def test_environment_passes_parallel_seed_test(task):
    parallel_seed_test(lambda: sparring.parallel_env(task))


@pytest.mark.filterwarnings("ignore")
def test_converted_environment_passes_api_test(task):
    env = parallel_to_aec(sparring.parallel_env(task, params=short_episode_params(task)))
    assert env.metadata["is_parallelizable"]
    api_test(env, num_cycles=200)


def test_episodes_are_deterministic(task):
    """`parallel_seed_test` checks a single step."""

    def run_episodes():
        env = sparring.parallel_env(task, params=short_episode_params(task))
        rows = []
        for seed in (3, None, None):
            observations, _ = env.reset(seed=seed)
            rng = np.random.default_rng(4)
            rows.append(observations)
            while env.agents:
                actions = {agent: random_actions(env.action_space(agent), rng, 1)[0] for agent in env.agents}
                observations, rewards, terminations, truncations, _ = env.step(actions)
                rows.append((observations, rewards, terminations, truncations))
        return rows

    first, second = run_episodes(), run_episodes()
    assert len(first) > (10 if task.startswith("tasking") else 20)
    for a, b in zip(first, second, strict=True):
        if isinstance(a, dict):
            assert bitwise_equal(a, b)
        else:
            assert bitwise_equal(a[0], b[0]) and a[1:] == b[1:]


def test_agents_leave_one_by_one():
    env = sparring.parallel_env("docking/multiagent", params=short_episode_params("docking"))
    env.reset(seed=1)
    assert env.agents == ["deputy_0", "deputy_1", "deputy_2"]
    has_left = False
    while env.agents:
        before = list(env.agents)
        observations, rewards, terminations, truncations, _ = env.step({})
        assert set(observations) == set(rewards) == set(terminations) == set(truncations) == set(before)
        assert all(type(flag) is bool for flag in [*terminations.values(), *truncations.values()])
        assert env.agents == [a for a in before if not (terminations[a] or truncations[a])]
        has_left |= 0 < len(env.agents) < len(before)


def test_invalid_action_names_the_agent():
    env = sparring.parallel_env("docking/multiagent")
    env.reset(seed=1)
    for actions, field in [
        ({"deputy_9": [0, 0, 0]}, "deputy_9"),
        ({"deputy_1": [0, 0]}, "deputy_1"),
        ({"deputy_1": ["a", "b", "c"]}, "deputy_1"),
        ({"deputy_1": [0, float("nan"), 0]}, "actions"),
    ]:
        with pytest.raises(ValueError, match=field):
            env.step(actions)


def test_copy_has_the_same_settings():
    env = sparring.parallel_env("docking/multiagent", level=9)
    copied = copy.deepcopy(env)
    assert copied.possible_agents == env.possible_agents and len(copied.possible_agents) == 5
    assert bitwise_equal(env.reset(seed=3)[0], copied.reset(seed=3)[0])


def test_infos_have_scenario_and_alerts():
    env = sparring.parallel_env("survival", params={"fuel": 0.1})
    _, infos = env.reset(seed=3)
    assert {info["scenario"] for info in infos.values()} == {env.scenario}
    *_, infos = env.step({"satellite_1": np.array([1.0, 0.0])})
    assert [info["alerts"] for info in infos.values()] == [["Sat 1 failed burn: Insufficient fuel."]] * 3


def test_black_death_ends_with_the_same_return(task):
    supersuit = pytest.importorskip("supersuit")
    plain = sparring.parallel_env(task, params=short_episode_params(task))
    wrapped = supersuit.black_death_v3(sparring.parallel_env(task, params=short_episode_params(task)))
    for seed in range(3):
        returns, lengths = [], []
        for env in (plain, wrapped):
            env.reset(seed=seed)
            total, length = dict.fromkeys(env.possible_agents, 0.0), 0
            while env.agents:
                hold = {agent: hold_action(env.action_space(agent)) for agent in env.agents}
                _, rewards, *_ = env.step(hold)
                for agent, reward in rewards.items():
                    total[agent] += reward
                length += 1
            returns.append(total)
            lengths.append(length)
        assert returns[0] == returns[1]
        assert lengths[1] - lengths[0] in (0, 1)


def test_step_without_episode_is_rejected(task):
    env = sparring.parallel_env(task, params=short_episode_params(task))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step({})
    env.reset(seed=1)
    while env.agents:
        env.step({})
    assert env.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step({env.possible_agents[0]: hold_action(env.action_space(env.possible_agents[0]))})
