"""RLlib with the curriculum of a real server: two env runners share one run. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_rllib.py
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import BINARY, needs_server
from curriculum_servers import kill_server, restarted_server

pytest.importorskip("ray")
import ray
import torch
from gymnasium import spaces
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.tune import RunConfig, Tuner
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import sparring
import sparring.rllib

EXAMPLE = Path(__file__).parents[3] / "examples" / "rllib_ppo.py"


@pytest.fixture(scope="module")
def cluster():
    # Tune reserves a core for the algorithm.
    ray.init("local", num_cpus=3, include_dashboard=False, object_store_memory=100 * 2**20, log_to_driver=False)
    yield
    ray.shutdown()


def local_curriculum(tasks, db=None, **settings):
    defaults = {"strategy": "ladder", "placement": False, "design": {"designer": "off"}, "group_size": 4}
    settings = {"tasks": tasks, **defaults, **settings}
    return sparring.Curriculum.local(db, binary=BINARY, settings=settings)


def make_config(curriculum, name, envs, steps, task, mode, lease_groups=8, **more):
    arguments = {"url": curriculum.url, "run": curriculum.run, "lease_groups": lease_groups, "form": "groups"}
    batch = 2 * envs * steps
    return (
        PPOConfig()
        .environment(name, env_config={"task": task, "curriculum": arguments, **more})
        .env_runners(num_env_runners=2, num_envs_per_env_runner=envs, rollout_fragment_length=steps, gym_env_vectorize_mode=mode)
        .training(train_batch_size_per_learner=batch, minibatch_size=batch // 2, num_epochs=2, lr=5e-4)
        .callbacks(sparring.rllib.CurriculumCallback)
    )


def team_config(curriculum, envs=8, steps=60, task="kessler/survival", **more):
    config = make_config(curriculum, sparring.rllib.TEAM, envs, steps, task, "vector_entry_point", **more)
    return config.rl_module(rl_module_spec=sparring.rllib.module_spec(task))


def agents_config(curriculum, envs, steps, task, **more):
    config = make_config(curriculum, sparring.rllib.AGENTS, envs, steps, task, "sync", **more)
    spec = MultiRLModuleSpec(rl_module_specs={"shared": sparring.rllib.module_spec(task)})
    return config.multi_agent(policies={"shared"}, policy_mapping_fn=lambda *_, **__: "shared").rl_module(rl_module_spec=spec)


def runner_states(algorithm):
    """Returns process, run, policy version and stats of each env runner."""

    def read_state(runner):
        env = runner.env.unwrapped
        env = env if hasattr(env, "curriculum") else env.envs[0].unwrapped
        return os.getpid(), env.curriculum.run, env.curriculum.policy_version, env.curriculum.stats()

    return algorithm.env_runner_group.foreach_env_runner(read_state, local_env_runner=False)


def finished_by_version(curriculum):
    """Returns the server's number of episodes by policy version."""
    versions = curriculum.request("GET", f"/v1/runs/{curriculum.run}/policy_versions")["versions"]
    return {row["version"]: sum(task["episodes"] for task in row["tasks"]) for row in versions}


def active_leases(curriculum):
    leases = curriculum.request("GET", f"/v1/runs/{curriculum.run}/leases?limit=500")["leases"]
    assert leases
    return [lease for lease in leases if lease["status"] == "active"]


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_team_env_flattens_the_environments(actions):
    envs = sparring.rllib.team_env({"task": "kessler/survival", "num_envs": 3, "level": 9, "actions": actions})
    same = sparring.make_vec("kessler/survival", 3, level=9, actions=actions, episode_statistics=False)
    assert envs.single_observation_space.shape == (216,)
    assert envs.single_action_space.shape == ((6,) if actions == "continuous" else (3,))
    observations, _ = envs.reset(seed=5)
    assert (observations.reshape(3, 3, 72) == same.reset(seed=5)[0]).all()
    envs.action_space.seed(1)
    ended = 0
    for _ in range(120):
        joint = envs.action_space.sample()
        observations, rewards, terminated, truncated, infos = envs.step(joint)
        assert observations in envs.observation_space
        expected = same.step(joint.reshape(same.action_space.shape))
        assert (observations.reshape(3, 3, 72) == expected[0]).all() and (rewards == expected[1]).all()
        assert (terminated == expected[2]).all() and (truncated == expected[3]).all() and infos == {}
        ended += (terminated | truncated).sum()
    assert ended > 3
    envs.close()
    same.close()


def test_invalid_setting_is_named():
    with pytest.raises(ValueError, match="vector_entry_point"):
        sparring.rllib.team_env({"task": "kessler/survival"})
    with pytest.raises(ValueError, match="autoreset_mode"):
        sparring.rllib.team_env({"num_envs": 2, "autoreset_mode": "disabled"})
    for make in (sparring.rllib.team_env, sparring.rllib.agents_env):
        with pytest.raises(ValueError, match="observation"):
            make({"num_envs": 2, "observation": "telemetry"})
        with pytest.raises(ValueError, match="curriculum"):
            make({"num_envs": 2, "curriculum": {"url": "http://127.0.0.1:8700"}})
    with pytest.raises(ValueError, match="task"):
        sparring.rllib.module_spec("none")


@pytest.mark.parametrize(
    ("task", "params", "size"),
    [
        ("kessler/survival", {"debris": 60.0}, 0.1),
        ("docking/multiagent", {"deputies": 3.0, "start_radius": 10.0, "time_limit_s": 300.0}, 1.0),
    ],
)
def test_agents_leave_one_by_one_and_episode_ends_once(task, params, size):
    env = sparring.rllib.agents_env({"task": task, "params": params})
    rng = np.random.default_rng(1)
    left = mixed = cut = 0
    for seed in range(60):
        observations, infos = env.reset(seed=seed)
        episode = MultiAgentEpisode(agent_to_module_mapping_fn=lambda *_: "shared")
        episode.add_env_reset(observations=observations, infos=infos)
        push = {agent: rng.uniform(-size, size, env.action_spaces[agent].shape).astype(np.float32) for agent in observations}
        over = False
        while not over:
            acting = episode.get_agents_to_act()
            assert acting == set(env.env.agents)
            joint = {agent: push[agent] for agent in acting}
            observations, rewards, terminated, truncated, infos = env.step(joint)
            assert observations.keys() == rewards.keys() == infos.keys() == set(env.agents) == acting
            assert all(row in env.observation_spaces[agent] for agent, row in observations.items())
            over = terminated["__all__"] or truncated["__all__"]
            gone = {agent for agent in acting if terminated[agent]}
            assert over == (not env.env.agents)
            left += bool(gone) and not over
            mixed += bool(gone) and gone != acting and over
            episode.add_env_step(observations, joint, rewards, infos, terminateds=terminated, truncateds=truncated)
            # RLlib sees the end in the same step, and bootstraps only for truncated agents.
            assert episode.is_done == over
            for agent in acting:
                agent_episode = episode.agent_episodes[agent]
                assert agent_episode.is_done == (over or agent in gone)
                assert agent_episode.is_terminated == (agent in gone)
        cut += truncated["__all__"]
    assert left > 3, "no agent left before the others"
    if task.startswith("kessler"):
        assert mixed > 0, "no episode ended with lost and truncated agents"
        assert cut > 3
    env.close()


def build_module(task, observation_space, action_space, **settings):
    spec = sparring.rllib.module_spec(task, **settings)
    spec.observation_space, spec.action_space = observation_space, action_space
    return spec.build()


def test_module_acts_alike_in_team_and_alone():
    row, acts = spaces.Box(-2, 2, (72,)), spaces.Box(-1, 1, (2,))
    team = build_module("kessler/survival", spaces.Box(-2, 2, (216,)), spaces.Box(-1, 1, (6,)), hidden=(16,), log_std=-2.0)
    alone = build_module("kessler/survival", row, acts, hidden=(16,), log_std=-2.0)
    alone.set_state(team.get_state())
    observations = torch.randn(5, 3, 72)
    outputs = team.forward_train({Columns.OBS: observations.reshape(5, 216)})[Columns.ACTION_DIST_INPUTS]
    rows = alone.forward_train({Columns.OBS: observations.reshape(15, 72)})[Columns.ACTION_DIST_INPUTS]
    assert torch.allclose(outputs[:, :6].reshape(15, 2), rows[:, :2], atol=1e-6)
    assert (outputs[:, 6:] == -2.0).all() and (rows[:, 2:] == -2.0).all()
    values = team.compute_values({Columns.OBS: observations.reshape(5, 216)})
    assert torch.allclose(
        values, alone.compute_values({Columns.OBS: observations.reshape(15, 72)}).reshape(5, 3).mean(1), atol=1e-6
    )
    # Both give the same actions to `sparring.evaluate`.
    actions = [sparring.rllib.policy_fn(module)(observations.numpy()) for module in (team, alone)]
    assert actions[0].shape == (5, 3, 2)
    assert np.allclose(actions[0], actions[1], atol=1e-6) and np.allclose(
        actions[0].reshape(5, 6), outputs[:, :6].detach(), atol=1e-6
    )


def test_module_has_discrete_actions():
    team = build_module("kessler/survival", spaces.Box(-2, 2, (216,)), spaces.MultiDiscrete([17] * 3))
    observations = torch.randn(5, 3, 72)
    logits = team.forward_exploration({Columns.OBS: observations.reshape(5, 216)})[Columns.ACTION_DIST_INPUTS]
    assert logits.shape == (5, 51)
    sampled = team.get_exploration_action_dist_cls().from_logits(logits).sample()
    assert sampled.shape == (5, 3) and sampled.max() < 17
    best = logits.reshape(5, 3, 17).argmax(-1).numpy()
    assert (sparring.rllib.policy_fn(team)(observations.numpy()) == best).all()
    alone = build_module("kessler/survival", spaces.Box(-2, 2, (72,)), spaces.Discrete(17))
    alone.set_state(team.get_state())
    assert (sparring.rllib.policy_fn(alone)(observations.numpy()) == best).all()


@needs_server
def test_two_env_runners_share_one_run(cluster):
    with local_curriculum(["kessler/survival"]) as curriculum:
        algorithm = team_config(curriculum).build_algo()
        try:
            results = [algorithm.train() for _ in range(3)]
            states = runner_states(algorithm)
        finally:
            algorithm.stop()
        assert len({pid for pid, *_ in states}) == 2 and os.getpid() not in {pid for pid, *_ in states}
        assert {run for _, run, *_ in states} == {curriculum.run}
        assert [version for *_, version, _ in states] == [3, 3]
        finished = [stats["finished"] for *_, stats in states]
        # 8 environments per runner, 180 steps, at most 50 steps per episode and one between two.
        assert min(finished) >= 24
        # Stopping submitted all results and released the rest.
        counted = finished_by_version(curriculum)
        assert sum(counted.values()) == sum(finished)
        # An episode has the version that began it; few episodes of the third iteration have ended.
        assert {0, 1} <= counted.keys() <= {0, 1, 2} and min(counted[0], counted[1]) > 8
        assert curriculum.request("GET", f"/v1/runs/{curriculum.run}")["policy_version"] >= 1
        assert not active_leases(curriculum)
        metrics = [result["curriculum"] for result in results]
        for name in ("level", "mastery", "success", "skill", "params/debris", "zero_variance_share"):
            assert f"kessler/survival/{name}" in metrics[-1]
        assert metrics[0]["episodes/finished"] < metrics[-1]["episodes/finished"] == sum(finished)
        assert results[-1]["env_runners"]["num_env_steps_sampled_lifetime"] >= 2850
        assert "default_policy" in results[-1]["learners"]


@needs_server
def test_tune_and_tensorboard_have_the_metrics(cluster, tmp_path):
    with local_curriculum(["kessler/survival"]) as curriculum:
        config = team_config(curriculum, envs=2, steps=51)
        run_config = RunConfig(stop={"training_iteration": 2}, storage_path=os.fspath(tmp_path), name="it", verbose=0)
        result = Tuner("PPO", param_space=config, run_config=run_config).fit()[0]
        assert result.error is None
        assert result.metrics["curriculum"]["kessler/survival/mastery"] > 0.0
        events = EventAccumulator(os.fspath(result.path))
        events.Reload()
        tags = set(events.Tags()["scalars"])
        for name in ("level", "mastery", "skill", "params/debris", "zero_variance_share"):
            assert f"ray/tune/curriculum/kessler/survival/{name}" in tags
        # Tune stops its trial, which submits the results.
        assert sum(finished_by_version(curriculum).values()) == result.metrics["curriculum"]["episodes/finished"]
        assert not active_leases(curriculum)


@needs_server
def test_each_deputy_is_an_agent(cluster):
    with local_curriculum(["docking/multiagent"]) as curriculum:
        algorithm = agents_config(curriculum, 2, 500, "docking/multiagent", lease_groups=2).build_algo()
        try:
            results = [algorithm.train() for _ in range(2)]
            # An episode takes up to 2000 steps.
            while min(stats["finished"] for *_, stats in runner_states(algorithm)) == 0 and len(results) < 10:
                results.append(algorithm.train())
            states = runner_states(algorithm)
        finally:
            algorithm.stop()
        finished = [stats["finished"] for *_, stats in states]
        assert len(states) == 2 and min(finished) > 0
        assert sum(finished_by_version(curriculum).values()) == sum(finished)
        assert not active_leases(curriculum)
        assert "shared" in results[-1]["learners"]
        assert "docking/multiagent/mastery" in results[-1]["curriculum"]


@needs_server
def test_agent_envs_share_one_curriculum():
    with local_curriculum(["kessler/survival"]) as curriculum:
        config = {"curriculum": {"url": curriculum.url, "run": curriculum.run, "lease_groups": 4}}
        first, second = (sparring.rllib.agents_env(config) for _ in range(2))
        assert first.curriculum is second.curriculum is not curriculum
        other = sparring.rllib.agents_env({"curriculum": {**config["curriculum"], "purpose": "probe"}})
        assert other.curriculum is not first.curriculum
        other.close()
        for env in (first, second):
            observations, infos = env.reset()
            times = {"d_ts": 0.0, "requires_retasking": True}
            assert infos["satellite_0"] == {"scenario": env.env.scenario, "level": 0, "train": True, **times}
            while observations and env.env.agents:
                observations, *_ = env.step({})
            env.reset()
        shared = first.curriculum
        first.close()
        assert shared.stats()["finished"] == 2 and active_leases(curriculum)
        second.close()
        assert sum(finished_by_version(curriculum).values()) == 2
        assert not active_leases(curriculum)
        reopened = sparring.rllib.agents_env(config)
        assert reopened.curriculum is not shared
        reopened.close()
        reopened.close()


@needs_server
def test_measured_episodes_are_not_learned_from(cluster):
    # This strategy trains only on repeated scenarios, and at first none is repeated.
    with local_curriculum(["kessler/survival"], strategy="plr_robust") as curriculum:
        algorithm = team_config(curriculum, envs=4).build_algo()
        try:
            result = algorithm.train()
            finished = sum(stats["finished"] for *_, stats in runner_states(algorithm))
        finally:
            algorithm.stop()
        assert finished > 0
        assert not result.get("learners")
        assert result["curriculum"]["episodes/finished"] == finished


def test_measured_episodes_are_removed_as_a_whole():
    callback = sparring.rllib.CurriculumCallback()

    class Runner:
        class config:
            in_evaluation = False

    def begin_episode(train):
        episode = SingleAgentEpisode()
        episode.add_env_reset(observation=0, infos={"level": 0, "train": np.bool_(train)})
        callback.on_episode_start(episode=episode, env_runner=Runner)
        return episode

    learned, measured = begin_episode(True), begin_episode(False)
    for episode in (learned, measured):
        episode.add_env_step(0, 0, 0.0, {})
    samples = [learned, measured]
    callback.on_sample_end(env_runner=Runner, samples=samples)
    assert samples == [learned]
    # The rest of the episode is removed, too, although its start is not repeated.
    rest = measured.cut()
    rest.add_env_step(0, 0, 0.0, {}, terminated=True)
    samples = [rest]
    callback.on_sample_end(env_runner=Runner, samples=samples)
    assert samples == [] and not callback._excluded


@needs_server
def test_training_survives_an_outage(cluster, tmp_path):
    db = tmp_path / "run.sqlite3"
    curriculum = local_curriculum(["kessler/survival"], db)
    algorithm = team_config(curriculum, envs=2, lease_groups=64).build_algo()
    try:
        algorithm.train()
        kill_server(curriculum)
        result = algorithm.train()
        assert "default_policy" in result["learners"]
        assert result["curriculum"]["episodes/unsent"] > 0
        assert "kessler/survival/mastery" not in result["curriculum"]
        with restarted_server(db, curriculum.url):
            finished = sum(stats["finished"] for *_, stats in runner_states(algorithm))
            algorithm.stop()
            assert sum(finished_by_version(curriculum).values()) == finished
    finally:
        algorithm.stop()
        curriculum.close()


@needs_server
@pytest.mark.parametrize("task", ["kessler/survival", "kessler/eco_station", "docking/multiagent"])
def test_example_trains(task, tmp_path):
    command = [sys.executable, os.fspath(EXAMPLE), "--task", task, "--iterations", "2", "--envs", "4"]
    home = {"HOME": os.fspath(tmp_path), "SPARRING_BIN": BINARY}
    ended = subprocess.run(command, capture_output=True, text=True, timeout=600, env={**os.environ, **home})
    assert ended.returncode == 0, ended.stderr[-3000:]
    rows = re.findall(r"^ +(\d+)  return +(\S+)  level (\S+)  mastery (\S+) .* (\S+) env-steps/s$", ended.stdout, re.M)
    assert [row[0] for row in rows] == ["1", "2"], ended.stdout
    # Placement may not have ended, and then there is no level.
    assert all(row[2] == row[3] == "nan" or (float(row[2]) >= 0.0 and 0.0 < float(row[3]) < 1.0) for row in rows), rows
    assert ("skill on held-out" in ended.stdout) == task.startswith("kessler")


def test_example_help_explains_several_hosts():
    ended = subprocess.run([sys.executable, os.fspath(EXAMPLE), "--help"], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0
    for word in ("ray start --head", "ray start --address", "SPARRING_TOKEN", "--url http://head:8700", "sparring token create"):
        assert word in ended.stdout
