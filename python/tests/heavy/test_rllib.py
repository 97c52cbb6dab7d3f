"""RLlib on the curriculum of a real server: two env runners take part in one run. Run by hand:

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
from conftest import BINARY, served
from flights import serve_again

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
    # Tune wants a core for the algorithm, too.
    ray.init("local", num_cpus=3, include_dashboard=False, object_store_memory=100 * 2**20, log_to_driver=False)
    yield
    ray.shutdown()


def local(tasks, db=None, **settings):
    settings = {"tasks": tasks, "placement": False, "design": {"designer": "off"}, "group_size": 4, **settings}
    return sparring.Curriculum.local(db, binary=BINARY, settings=settings)


def config_of(curriculum, name, envs, steps, task, mode, lease=8, **more):
    wish = {"url": curriculum.url, "run": curriculum.run, "lease": lease, "form": "groups"}
    batch = 2 * envs * steps
    return (
        PPOConfig()
        .environment(name, env_config={"task": task, "curriculum": wish, **more})
        .env_runners(num_env_runners=2, num_envs_per_env_runner=envs, rollout_fragment_length=steps, gym_env_vectorize_mode=mode)
        .training(train_batch_size_per_learner=batch, minibatch_size=batch // 2, num_epochs=2, lr=5e-4)
        .callbacks(sparring.rllib.CurriculumCallback)
    )


def team(curriculum, envs=8, steps=60, task="kessler/survival", **more):
    config = config_of(curriculum, sparring.rllib.TEAM, envs, steps, task, "vector_entry_point", **more)
    return config.rl_module(rl_module_spec=sparring.rllib.module(task))


def agents(curriculum, envs, steps, task, **more):
    config = config_of(curriculum, sparring.rllib.AGENTS, envs, steps, task, "sync", **more)
    spec = MultiRLModuleSpec(rl_module_specs={"shared": sparring.rllib.module(task)})
    return config.multi_agent(policies={"shared"}, policy_mapping_fn=lambda *_, **__: "shared").rl_module(rl_module_spec=spec)


def runners(algorithm):
    """What each env runner's own curriculum says, by process."""

    def told(runner):
        whole = runner.env.unwrapped
        own = whole if hasattr(whole, "curriculum") else whole.envs[0].unwrapped
        return os.getpid(), own.curriculum.run, own.curriculum.policy_version, own.curriculum.stats()

    return algorithm.env_runner_group.foreach_env_runner(told, local_env_runner=False)


def finished(curriculum):
    """Episodes the server counts, by version of the policy."""
    told = curriculum.ask("GET", f"/v1/runs/{curriculum.run}/versions")["versions"]
    return {row["version"]: sum(task["episodes"] for task in row["tasks"]) for row in told}


def open_leases(curriculum):
    leases = curriculum.ask("GET", f"/v1/runs/{curriculum.run}/leases?limit=500")["leases"]
    assert leases
    return [lease for lease in leases if lease["status"] == "active"]


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_a_team_is_the_environments_laid_flat(actions):
    envs = sparring.rllib.team_env({"task": "kessler/survival", "num_envs": 3, "level": 9, "actions": actions})
    same = sparring.make_vec("kessler/survival", 3, level=9, actions=actions, episode_statistics=False)
    assert envs.single_observation_space.shape == (216,)
    assert envs.single_action_space.shape == ((6,) if actions == "continuous" else (3,))
    seen, _ = envs.reset(seed=5)
    assert (seen.reshape(3, 3, 72) == same.reset(seed=5)[0]).all()
    envs.action_space.seed(1)
    ended = 0
    for _ in range(120):
        joint = envs.action_space.sample()
        seen, rewards, terminated, truncated, infos = envs.step(joint)
        assert seen in envs.observation_space
        other = same.step(joint.reshape(same.action_space.shape))
        assert (seen.reshape(3, 3, 72) == other[0]).all() and (rewards == other[1]).all()
        assert (terminated == other[2]).all() and (truncated == other[3]).all() and infos == {}
        ended += (terminated | truncated).sum()
    assert ended > 3
    envs.close()
    same.close()


def test_wrong_settings_are_named():
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
        sparring.rllib.module("none")


@pytest.mark.parametrize(
    ("task", "params", "size"),
    [
        ("kessler/survival", {"debris": 60.0}, 0.1),
        ("docking/multiagent", {"deputies": 3.0, "start_radius": 10.0, "time_limit_s": 300.0}, 1.0),
    ],
)
def test_agents_leave_one_by_one_and_an_episode_ends_once(task, params, size):
    env = sparring.rllib.agents_env({"task": task, "params": params})
    rng = np.random.default_rng(1)
    left = mixed = cut = 0
    for seed in range(60):
        seen, infos = env.reset(seed=seed)
        episode = MultiAgentEpisode(agent_to_module_mapping_fn=lambda *_: "shared")
        episode.add_env_reset(observations=seen, infos=infos)
        push = {agent: rng.uniform(-size, size, env.action_spaces[agent].shape).astype(np.float32) for agent in seen}
        over = False
        while not over:
            acting = episode.get_agents_to_act()
            assert acting == set(env.env.agents)
            joint = {agent: push[agent] for agent in acting}
            seen, rewards, terminated, truncated, infos = env.step(joint)
            assert seen.keys() == rewards.keys() == infos.keys() == set(env.agents) == acting
            assert all(row in env.observation_spaces[agent] for agent, row in seen.items())
            over = terminated["__all__"] or truncated["__all__"]
            gone = {agent for agent in acting if terminated[agent]}
            assert over == (not env.env.agents)
            left += bool(gone) and not over
            mixed += bool(gone) and gone != acting and over
            episode.add_env_step(seen, joint, rewards, infos, terminateds=terminated, truncateds=truncated)
            # RLlib sees the end in the same step, and bootstraps for those whom the horizon cut off alone.
            assert episode.is_done == over
            for agent in acting:
                flown = episode.agent_episodes[agent]
                assert flown.is_done == (over or agent in gone)
                assert flown.is_terminated == (agent in gone)
        cut += truncated["__all__"]
    assert left > 3, "nobody left before the others"
    if task.startswith("kessler"):
        assert mixed > 0, "no episode in whose last step some were lost"
        assert cut > 3
    env.close()


def build(task, observation_space, action_space, **wish):
    spec = sparring.rllib.module(task, **wish)
    spec.observation_space, spec.action_space = observation_space, action_space
    return spec.build()


def test_one_policy_flies_all_rows_and_the_same_in_a_team_as_alone():
    row, acts = spaces.Box(-2, 2, (72,)), spaces.Box(-1, 1, (2,))
    whole = build("kessler/survival", spaces.Box(-2, 2, (216,)), spaces.Box(-1, 1, (6,)), hidden=(16,), log_std=-2.0)
    alone = build("kessler/survival", row, acts, hidden=(16,), log_std=-2.0)
    alone.set_state(whole.get_state())
    seen = torch.randn(5, 3, 72)
    told = whole.forward_train({Columns.OBS: seen.reshape(5, 216)})[Columns.ACTION_DIST_INPUTS]
    rows = alone.forward_train({Columns.OBS: seen.reshape(15, 72)})[Columns.ACTION_DIST_INPUTS]
    assert torch.allclose(told[:, :6].reshape(15, 2), rows[:, :2], atol=1e-6)
    assert (told[:, 6:] == -2.0).all() and (rows[:, 2:] == -2.0).all()
    values = whole.compute_values({Columns.OBS: seen.reshape(5, 216)})
    assert torch.allclose(values, alone.compute_values({Columns.OBS: seen.reshape(15, 72)}).reshape(5, 3).mean(1), atol=1e-6)
    # Actions of `sparring.evaluate` are the same by either.
    by = [sparring.rllib.act(module)(seen.numpy()) for module in (whole, alone)]
    assert by[0].shape == (5, 3, 2)
    assert np.allclose(by[0], by[1], atol=1e-6) and np.allclose(by[0].reshape(5, 6), told[:, :6].detach(), atol=1e-6)


def test_discrete_actions():
    whole = build("kessler/survival", spaces.Box(-2, 2, (216,)), spaces.MultiDiscrete([17] * 3))
    seen = torch.randn(5, 3, 72)
    logits = whole.forward_exploration({Columns.OBS: seen.reshape(5, 216)})[Columns.ACTION_DIST_INPUTS]
    assert logits.shape == (5, 51)
    drawn = whole.get_exploration_action_dist_cls().from_logits(logits).sample()
    assert drawn.shape == (5, 3) and drawn.max() < 17
    best = logits.reshape(5, 3, 17).argmax(-1).numpy()
    assert (sparring.rllib.act(whole)(seen.numpy()) == best).all()
    alone = build("kessler/survival", spaces.Box(-2, 2, (72,)), spaces.Discrete(17))
    alone.set_state(whole.get_state())
    assert (sparring.rllib.act(alone)(seen.numpy()) == best).all()


@served
def test_two_env_runners_fly_one_run(cluster):
    with local(["kessler/survival"]) as curriculum:
        algorithm = team(curriculum).build_algo()
        try:
            results = [algorithm.train() for _ in range(3)]
            told = runners(algorithm)
        finally:
            algorithm.stop()
        assert len({pid for pid, *_ in told}) == 2 and os.getpid() not in {pid for pid, *_ in told}
        assert {run for _, run, *_ in told} == {curriculum.run}
        assert [version for *_, version, _ in told] == [3, 3]
        flown = [stats["flown"] for *_, stats in told]
        # 8 environments of each, 180 steps, at most 50 of an episode and one between two.
        assert min(flown) >= 24
        # Stopping handed in everything, and gave back the rest.
        counted = finished(curriculum)
        assert sum(counted.values()) == sum(flown)
        # An episode is its version's that flew when it began: of the third iteration's, few are over.
        assert {0, 1} <= counted.keys() <= {0, 1, 2} and min(counted[0], counted[1]) > 8
        assert curriculum.ask("GET", f"/v1/runs/{curriculum.run}")["policy_version"] >= 1
        assert not open_leases(curriculum)
        numbers = [result["curriculum"] for result in results]
        for name in ("level", "mastery", "success", "skill", "params/debris", "zero_variance_share"):
            assert f"kessler/survival/{name}" in numbers[-1]
        assert numbers[0]["episodes/flown"] < numbers[-1]["episodes/flown"] == sum(flown)
        assert results[-1]["env_runners"]["num_env_steps_sampled_lifetime"] >= 2850
        assert "default_policy" in results[-1]["learners"]


@served
def test_tune_and_tensorboard_show_the_numbers(cluster, tmp_path):
    with local(["kessler/survival"]) as curriculum:
        config = team(curriculum, envs=2, steps=51)
        where = RunConfig(stop={"training_iteration": 2}, storage_path=os.fspath(tmp_path), name="it", verbose=0)
        found = Tuner("PPO", param_space=config, run_config=where).fit()[0]
        assert found.error is None
        assert found.metrics["curriculum"]["kessler/survival/mastery"] > 0.0
        events = EventAccumulator(os.fspath(found.path))
        events.Reload()
        tags = set(events.Tags()["scalars"])
        for name in ("level", "mastery", "skill", "params/debris", "zero_variance_share"):
            assert f"ray/tune/curriculum/kessler/survival/{name}" in tags
        # Tune stops its trial as others stop an algorithm: what was flown is handed in.
        assert sum(finished(curriculum).values()) == found.metrics["curriculum"]["episodes/flown"]
        assert not open_leases(curriculum)


@served
def test_an_agent_for_each_deputy(cluster):
    with local(["docking/multiagent"]) as curriculum:
        algorithm = agents(curriculum, 2, 500, "docking/multiagent", lease=2).build_algo()
        try:
            results = [algorithm.train() for _ in range(2)]
            # An episode takes 2000 steps where nothing ends it before.
            while min(stats["flown"] for *_, stats in runners(algorithm)) == 0 and len(results) < 10:
                results.append(algorithm.train())
            told = runners(algorithm)
        finally:
            algorithm.stop()
        flown = [stats["flown"] for *_, stats in told]
        assert len(told) == 2 and min(flown) > 0
        assert sum(finished(curriculum).values()) == sum(flown)
        assert not open_leases(curriculum)
        assert "shared" in results[-1]["learners"]
        assert "docking/multiagent/mastery" in results[-1]["curriculum"]


@served
def test_an_agent_for_each_satellite_and_a_shared_curriculum():
    with local(["kessler/survival"]) as curriculum:
        config = {"curriculum": {"url": curriculum.url, "run": curriculum.run, "lease": 4}}
        one, two = (sparring.rllib.agents_env(config) for _ in range(2))
        assert one.curriculum is two.curriculum is not curriculum
        other = sparring.rllib.agents_env({"curriculum": {**config["curriculum"], "purpose": "probe"}})
        assert other.curriculum is not one.curriculum
        other.close()
        for env in (one, two):
            seen, infos = env.reset()
            assert infos["satellite_0"] == {"scenario": env.env.scenario, "level": 0, "train": True}
            while seen and env.env.agents:
                seen, *_ = env.step({})
            env.reset()
        shared = one.curriculum
        one.close()
        assert shared.stats()["flown"] == 2 and open_leases(curriculum)
        two.close()
        assert sum(finished(curriculum).values()) == 2
        assert not open_leases(curriculum)
        again = sparring.rllib.agents_env(config)
        assert again.curriculum is not shared
        again.close()
        again.close()


@served
def test_what_is_only_looked_at_is_not_learned_from(cluster):
    # It learns from scenarios that come again alone, and nothing comes again at first.
    with local(["kessler/survival"], strategy="plr_robust") as curriculum:
        algorithm = team(curriculum, envs=4).build_algo()
        try:
            result = algorithm.train()
            flown = sum(stats["flown"] for *_, stats in runners(algorithm))
        finally:
            algorithm.stop()
        assert flown > 0
        assert not result.get("learners")
        assert result["curriculum"]["episodes/flown"] == flown


def test_episodes_are_left_out_whole():
    callback = sparring.rllib.CurriculumCallback()

    class Runner:
        class config:
            in_evaluation = False

    def begun(train):
        episode = SingleAgentEpisode()
        episode.add_env_reset(observation=0, infos={"level": 0, "train": np.bool_(train)})
        callback.on_episode_start(episode=episode, env_runner=Runner)
        return episode

    learned, looked = begun(True), begun(False)
    for episode in (learned, looked):
        episode.add_env_step(0, 0, 0.0, {})
    samples = [learned, looked]
    callback.on_sample_end(env_runner=Runner, samples=samples)
    assert samples == [learned]
    # What goes on of it is left out too, though nothing is said of it again.
    rest = looked.cut()
    rest.add_env_step(0, 0, 0.0, {}, terminated=True)
    samples = [rest]
    callback.on_sample_end(env_runner=Runner, samples=samples)
    assert samples == [] and not callback._idle


@served
def test_a_server_that_is_away_for_a_while_costs_no_training(cluster, tmp_path):
    db = tmp_path / "run.sqlite3"
    curriculum = local(["kessler/survival"], db)
    algorithm = team(curriculum, envs=2, lease=64).build_algo()
    try:
        algorithm.train()
        curriculum._server._process.kill()
        curriculum._server._process.wait()
        result = algorithm.train()
        assert "default_policy" in result["learners"]
        assert result["curriculum"]["episodes/waiting"] > 0
        assert "kessler/survival/mastery" not in result["curriculum"]
        with serve_again(db, curriculum.url):
            flown = sum(stats["flown"] for *_, stats in runners(algorithm))
            algorithm.stop()
            assert sum(finished(curriculum).values()) == flown
    finally:
        algorithm.stop()
        curriculum.close()


@served
@pytest.mark.parametrize("task", ["kessler/survival", "kessler/eco_station", "docking/multiagent"])
def test_the_example_runs_as_it_says(task, tmp_path):
    line = [sys.executable, os.fspath(EXAMPLE), "--task", task, "--iterations", "2", "--envs", "4"]
    home = {"HOME": os.fspath(tmp_path), "SPARRING_BIN": BINARY}
    ended = subprocess.run(line, capture_output=True, text=True, timeout=600, env={**os.environ, **home})
    assert ended.returncode == 0, ended.stderr[-3000:]
    rows = re.findall(r"^ +(\d+)  return +(\S+)  level (\S+)  mastery (\S+) .* (\S+) env-steps/s$", ended.stdout, re.M)
    assert [row[0] for row in rows] == ["1", "2"], ended.stdout
    # So early nobody is placed yet, and has neither.
    assert all(row[2] == row[3] == "nan" or (float(row[2]) >= 0.0 and 0.0 < float(row[3]) < 1.0) for row in rows), rows
    assert ("skill on held-out" in ended.stdout) == task.startswith("kessler")


def test_the_example_teaches():
    shown = subprocess.run([sys.executable, os.fspath(EXAMPLE), "--help"], capture_output=True, text=True, timeout=120)
    assert shown.returncode == 0
    for word in ("ray start --head", "ray start --address", "SPARRING_TOKEN", "--url http://head:8700", "sparring token create"):
        assert word in shown.stdout
