"""The tasks of tasking in Python: named actions, steps of different durations, and agents that need an action."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

import sparring

SHORT = {"time_limit_s": 1800.0}
TASKS = {"tasking/scanning": 4, "tasking/imaging": 13, "tasking/constellation": 13}


def make_env(task: str, **settings: Any) -> sparring.Environment:
    targets = {} if task == "tasking/scanning" else {"targets": 200.0}
    return sparring.Environment(task, params={**SHORT, **targets}, **settings)


@pytest.mark.parametrize(("task", "count"), TASKS.items())
def test_spaces_are_those_of_named_actions(task: str, count: int) -> None:
    spec = sparring.task(task)
    env = make_env(task)
    agents = 3 if task.endswith("constellation") else 1
    assert env.action_space == gymnasium.spaces.MultiDiscrete([count] * agents)
    assert env.observation_space.shape == (agents, 12 if task.endswith("scanning") else 50)
    assert len(spec.action_names) == count and spec.hold_choice == -1 and spec.time_limit_s is not None
    assert sparring.task("kessler/survival").hold_choice == 0


def test_env_ids_are_registered() -> None:
    env = gymnasium.make("sparring/Scanning-v0", params=SHORT, render_mode="rgb_array")
    env.reset(seed=3)
    _, _, _, _, info = env.step([0])
    assert info["d_ts"] == 180.0
    image = env.render()
    assert isinstance(image, np.ndarray) and image.std() > 5.0
    env.close()


def test_infos_tell_duration_and_who_needs_an_action() -> None:
    env = make_env("tasking/constellation")
    _, info = env.reset(seed=1)
    assert info["d_ts"] == 0.0 and info["requires_retasking"].tolist() == [True] * 3
    total, steps = 0.0, 0
    while True:
        action = np.where(info["requires_retasking"], 10, -1)
        _, _, terminated, truncated, info = env.step(action)
        total, steps = total + info["d_ts"], steps + 1
        if terminated or truncated:
            break
        assert info["requires_retasking"].any()
    assert truncated and not terminated and total == SHORT["time_limit_s"]
    assert steps == 15


def test_none_goes_on_as_minus_one_does() -> None:
    hashes = []
    for rest in ([-1, -1, -1], None, [None, None, -1], (None, -1, None)):
        env = make_env("tasking/constellation")
        env.reset(seed=5)
        env.step([0, 10, 11])
        for _ in range(3):
            env.step(rest)
        hashes.append(env.state_hash())
    assert len(set(hashes)) == 1
    other = make_env("tasking/constellation")
    other.reset(seed=5)
    other.step([0, 10, 11])
    other.step([12, 12, 12])
    assert other.state_hash() != hashes[0]


def test_single_satellite_takes_an_index() -> None:
    hashes = []
    for action, rest in ((0, -1), ([0], None), (np.int64(0), [-1])):
        env = make_env("tasking/scanning")
        env.reset(seed=5)
        env.step(action)
        env.step(rest)
        hashes.append(env.state_hash())
    assert len(set(hashes)) == 1
    env = make_env("tasking/constellation")
    env.reset(seed=5)
    with pytest.raises(ValueError, match="actions"):
        env.step(0)


def test_hold_of_other_worlds_is_none_as_well() -> None:
    hashes = []
    for action in (None, np.zeros((3, 2), np.float32)):
        env = sparring.Environment("kessler/survival", level=2)
        env.reset(seed=5)
        env.step(action)
        hashes.append(env.state_hash())
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize("action", [[4], [-2], [0.5], ["scan"], 4, -2, True, [[0]], [0, 0]])
def test_invalid_actions_change_nothing(action: Any) -> None:
    env = make_env("tasking/scanning")
    env.reset(seed=2)
    before = env.state_hash()
    with pytest.raises(ValueError, match="actions"):
        env.step(action)
    assert env.state_hash() == before


def test_continuous_actions_are_refused() -> None:
    with pytest.raises(ValueError, match="`actions` must be 'discrete' in tasking@1"):
        make_env("tasking/scanning", actions="continuous")
    env = sparring.Environment("kessler/survival", actions="discrete")
    env.reset(seed=1)
    with pytest.raises(ValueError, match="`actions` must be from 0 to 16, got -1"):
        env.step([-1, 0, 0])


@pytest.mark.parametrize("task", TASKS)
def test_vector_environments_equal_single_ones(task: str) -> None:
    targets = {} if task == "tasking/scanning" else {"targets": 200.0}
    envs = sparring.make_vec(task, 3, params={**SHORT, **targets}, autoreset_mode="disabled")
    singles = [make_env(task) for _ in range(3)]
    _, infos = envs.reset(seed=11)
    for k, env in enumerate(singles):
        env.reset(seed=11 + k)
    rng = np.random.default_rng(1)
    agents, count = envs.single_action_space.shape[0], TASKS[task]
    for _ in range(4):
        assert infos["requires_retasking"].shape == (3, agents)
        actions = rng.integers(-1, count, (3, agents))
        observations, rewards, _, _, infos = envs.step(actions)
        for k, env in enumerate(singles):
            observation, reward, _, _, info = env.step(actions[k])
            np.testing.assert_array_equal(observations[k], observation)
            assert (rewards[k], infos["d_ts"][k]) == (reward, info["d_ts"])
            np.testing.assert_array_equal(infos["requires_retasking"][k], info["requires_retasking"])
    times = envs.step_times()
    np.testing.assert_array_equal(times.d_ts, infos["d_ts"])


def test_kessler_infos_have_times_of_equal_steps() -> None:
    env = sparring.Environment("kessler/survival", level=1)
    env.reset(seed=1)
    assert env.step(None)[4]["d_ts"] == 1.0
    envs = sparring.make_vec("kessler/survival", 2, level=1)
    envs.reset(seed=1)
    *_, infos = envs.step(np.zeros(envs.action_space.shape, np.float32))
    assert infos == {} and envs.step_times().d_ts.tolist() == [1.0, 1.0]


def test_parallel_agents_without_action_go_on() -> None:
    hashes = []
    for rest in ({}, {"satellite_1": None}, {"satellite_0": -1}):
        env = sparring.parallel_env("tasking/constellation", params={**SHORT, "targets": 200.0})
        _, infos = env.reset(seed=4)
        assert all(info["requires_retasking"] and info["d_ts"] == 0.0 for info in infos.values())
        env.step({"satellite_0": 10, "satellite_1": 11, "satellite_2": 12})
        *_, infos = env.step(rest)
        hashes.append(env._native.state_hash(0))
        assert {info["d_ts"] for info in infos.values()} and env.agents == env.possible_agents
    assert len(set(hashes)) == 1


def test_parallel_env_has_the_interface_of_pettingzoo() -> None:
    parallel_api_test(sparring.parallel_env("tasking/constellation", params={**SHORT, "targets": 200.0}), num_cycles=60)


def test_dead_satellites_leave() -> None:
    params = {"time_limit_s": 6000.0, "targets": 200.0, "battery_wh": 4.0, "charge_min": 0.3, "charge_max": 1.0}
    env = sparring.parallel_env("tasking/constellation", params=params)
    env.reset(seed=8)
    returns = dict.fromkeys(env.possible_agents, 0.0)
    died: list[str] = []
    while env.agents:
        before = set(env.agents)
        _, rewards, terminations, _, _ = env.step(dict.fromkeys(env.agents, 12))
        assert set(rewards) == before
        died += [agent for agent, flag in terminations.items() if flag]
        for agent, reward in rewards.items():
            returns[agent] += reward
    assert died and all(returns[agent] <= -0.9 for agent in died)


def test_history_replays_and_scores() -> None:
    env = make_env("tasking/constellation")
    _, info = env.reset(seed=6)
    rng = np.random.default_rng(0)
    done = False
    while not done:
        action = np.where(info["requires_retasking"], rng.integers(0, 13, 3), -1)
        *_, terminated, truncated, info = env.step(action)
        done = terminated or truncated
    assert env.scenario is not None
    outcome = sparring.replay(env.scenario, env.history)
    assert outcome.score == pytest.approx(info["score"])


def test_built_in_policies_act() -> None:
    env = make_env("tasking/scanning")
    _, info = env.reset(seed=9)
    assert env.scenario is not None
    policy = sparring.policy("heuristic", env.scenario)
    done = False
    while not done:
        telemetry = env.telemetry()
        assert telemetry is not None
        *_, terminated, truncated, info = env.step(policy.act(telemetry))
        done = terminated or truncated
    assert info["score"] > 0.1
