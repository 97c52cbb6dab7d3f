"""Stable-Baselines3: the rows of its environments, and a training with the curriculum of a real server."""

import json
import os
import zipfile

import gymnasium
import numpy as np
import pytest
from conftest import BINARY, needs_server
from documents import printed_command, run_command

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.save_util import json_to_data
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import sparring
import sparring.sb3

PPO_SETTINGS = {
    "n_steps": 50,
    "batch_size": 2400,
    "n_epochs": 8,
    "gamma": 0.97,
    "gae_lambda": 0.9,
    "learning_rate": 5e-4,
    "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -1.5},
    "device": "cpu",
    "seed": 1,
}


def test_only_active_rows_are_learned_from():
    envs = sparring.sb3.vec_env(8, "kessler/survival", level=9)
    model = PPO("MlpPolicy", envs, n_steps=50, batch_size=64, n_epochs=1, device="cpu", **sparring.sb3.active_only(envs))
    model.learn(1)
    buffer, envs = model.rollout_buffer, envs.envs
    active = buffer.active
    assert 0.3 < active.mean() < 1.0, "some agents left, but not all at once"
    sampled = sum(len(batch.observations) for batch in buffer.get(64))
    assert sampled == active.sum()
    inactive = np.flatnonzero(buffer.swap_and_flatten(active[..., None]).reshape(-1) == 0)
    inactive_rows = {row.tobytes() for row in buffer.observations[inactive]}
    assert not any(row.numpy().tobytes() in inactive_rows for batch in buffer.get(64) for row in batch.observations)


@pytest.mark.parametrize("steps_after", [0, 20], ids=["last step", "earlier step"])
def test_advantages_end_where_an_agent_leaves(steps_after):
    envs = sparring.sb3.vec_env(4, "kessler/survival", level=9)
    hold = np.zeros((envs.num_envs, 2), np.float32)
    envs.seed(2)
    envs.reset()
    steps = 0
    while envs.next_active.all():
        envs.step(hold)
        steps += 1
    steps += steps_after
    envs.seed(2)
    envs.reset()
    settings = {"gamma": 0.9, "gae_lambda": 0.8, **sparring.sb3.active_only(envs)["rollout_buffer_kwargs"]}
    buffer = sparring.sb3.ActiveRolloutBuffer(
        steps, envs.observation_space, envs.action_space, "cpu", n_envs=envs.num_envs, **settings
    )
    buffer.reset()
    values = np.random.default_rng(1).normal(size=(steps + 1, envs.num_envs)).astype(np.float32)
    dones, ends = np.ones(envs.num_envs, bool), np.zeros((steps, envs.num_envs), bool)
    for step in range(steps):
        starts = dones
        rows, rewards, dones, _ = envs.step(hold)
        buffer.add(rows, hold, rewards, starts, torch.from_numpy(values[step]), torch.zeros(envs.num_envs))
        results = envs.envs.agent_results()
        ends[step] = dones | (results.terminations | results.truncations).reshape(-1)
    buffer.compute_returns_and_advantage(torch.from_numpy(values[-1]), dones)
    assert (ends[steps - 1 - steps_after] & ~dones).any(), "no agent left before its episode ended"
    for step, row in np.argwhere(buffer.active):
        advantage, factor = 0.0, 1.0
        for later in range(step, steps):
            next_value = 0.0 if ends[later, row] else values[later + 1, row]
            advantage += factor * (buffer.rewards[later, row] + 0.9 * next_value - values[later, row])
            factor *= 0.9 * 0.8
            if ends[later, row]:
                break
        assert buffer.advantages[step, row] == pytest.approx(advantage, abs=1e-5)
        assert buffer.returns[step, row] == pytest.approx(advantage + values[step, row], abs=1e-5)


def test_rollout_without_active_rows_changes_no_weight():
    envs = sparring.sb3.vec_env(4, "kessler/survival")
    optimizer = {"optimizer_class": torch.optim.SGD, "optimizer_kwargs": {}}
    settings = {"n_steps": 50, "batch_size": 16, "n_epochs": 2, "device": "cpu", "policy_kwargs": optimizer}
    model = PPO("MlpPolicy", envs, **settings, **sparring.sb3.active_only(envs))
    buffer = model.rollout_buffer

    class Deactivate(BaseCallback):
        def _on_step(self):
            return True

        def _on_rollout_end(self):
            buffer.active[:] = False

    before = [weights.clone() for weights in model.policy.parameters()]
    model.learn(1, callback=Deactivate())
    after = list(model.policy.parameters())
    assert all(torch.allclose(a, b, atol=1e-7) for a, b in zip(before, after, strict=True))
    # With a single active row there is a single minibatch.
    buffer.active[7, 3] = True
    assert [len(batch.observations) for batch in buffer.get(16)] == [1]


def test_loaded_model_continues_to_learn(tmp_path):
    envs = sparring.sb3.vec_env(4, "kessler/survival", level=9)
    model = PPO("MlpPolicy", envs, n_steps=50, batch_size=200, device="cpu", **sparring.sb3.active_only(envs))
    model.learn(600)
    model.save(tmp_path / "model")
    with zipfile.ZipFile(tmp_path / "model.zip") as archive:
        data = json_to_data(archive.read("data").decode())
    # A loaded buffer has no environments and uses all rows, unless it gets the arguments again.
    loaded = {name: data[name] for name in ("rollout_buffer_class", "rollout_buffer_kwargs")}
    for arguments in (loaded, sparring.sb3.active_only(envs)):
        continued = PPO("MlpPolicy", envs, n_steps=50, batch_size=200, device="cpu", **arguments)
        continued.learn(600)
        assert continued.rollout_buffer.active.all() == (arguments is loaded)
    if int(torch.__version__.split(".")[0]) >= 2:  # Stable-Baselines3 cannot load files with an older version
        loaded_model = PPO.load(tmp_path / "model", env=envs, device="cpu", **sparring.sb3.active_only(envs))
        rows = envs.reset()
        assert (loaded_model.predict(rows, deterministic=True)[0] == model.predict(rows, deterministic=True)[0]).all()
        loaded_model.learn(600)
    with pytest.raises(ValueError, match="envs"):
        sparring.sb3.active_only(DummyVecEnv([lambda: gymnasium.make("sparring/Survival-v0")]))


@pytest.mark.parametrize("actions", ["continuous", "discrete"])
def test_rows_equal_those_of_the_environments(actions):
    envs = sparring.sb3.vec_env(3, "kessler/survival", level=9, actions=actions)
    single = sparring.make_vec("kessler/survival", 3, level=9, actions=actions, autoreset_mode="same_step")
    assert envs.num_envs == 9
    envs.seed(5)
    rows = envs.reset()
    observations, _ = single.reset(seed=5)
    assert (rows.reshape(observations.shape) == observations).all()
    ended = lost = 0
    for step in range(120):
        rng = np.random.default_rng(step)
        continuous = actions == "continuous"
        joint = rng.uniform(-1, 1, (9, 2)).astype(np.float32) if continuous else rng.integers(0, 17, (9,))
        rows, rewards, dones, infos = envs.step(joint)
        observations, team_rewards, *_, env_infos = single.step(joint.reshape(single.action_space.shape))
        _, terminated, truncated = single.agent_results()
        assert (rows.reshape(observations.shape) == observations).all()
        # A lost satellite's row has the team's reward, and is done with the others.
        assert (rewards.reshape(3, 3) == team_rewards[:, None]).all()
        over = env_infos.get("_episode", np.zeros(3, bool))
        assert (dones.reshape(3, 3) == over[:, None]).all()
        for env in np.flatnonzero(over):
            ended += 1
            for agent in range(3):
                info = infos[3 * env + agent]
                assert info["episode"]["r"] == env_infos["episode"]["r"][env]
                assert info["episode"]["l"] == env_infos["episode"]["l"][env]
                assert (info["terminal_observation"] == env_infos["final_obs"][env][agent]).all()
                assert info["TimeLimit.truncated"] == bool(truncated[env, agent] and not terminated[env, agent])
        lost += int(terminated[~over].sum())
    assert ended > 3
    assert lost > 0, "no satellite was lost before its episode ended"
    envs.close()
    single.close()


def test_decisions_and_rewards_are_those_of_the_arguments():
    def own_loss(results):
        return -1.0 * (results.terminations & ~results.truncations)

    envs = sparring.sb3.vec_env(8, "kessler/survival", level=9, reward=own_loss)
    envs.seed(2)
    envs.reset()
    totals, episodes, ended_early = np.zeros(24), np.zeros(24), np.zeros(24, bool)
    for _ in range(120):
        _, rewards, dones, _ = envs.step(np.zeros((24, 2), np.float32))
        totals += rewards
        episodes += dones
        assert rewards.dtype == np.float32, "the function returns float64"
        lost = rewards < 0.0
        assert envs.active[lost].all()
        ended_early |= lost & ~dones
        assert not envs.next_active[lost & ~dones].any()
    assert ended_early.any(), "no satellite was lost before its episode ended"
    assert (totals < 0.0).any() and (-totals <= episodes + 1).all(), "a lost satellite costs 1 once in an episode"
    docking = sparring.sb3.vec_env(2, "docking/single", actions="few", decision_steps=5)
    single = sparring.make_vec("docking/single", 2, actions="few", autoreset_mode="same_step")
    docking.seed(3)
    assert (docking.reset() == single.reset(seed=3)[0].reshape(2, -1)).all()
    actions = np.array([[1], [4]])
    rows, rewards, *_ = docking.step(actions[:, 0])
    returns = np.zeros(2)
    for _ in range(5):
        observations, step_rewards, *_ = single.step(actions)
        returns += step_rewards
    assert (rows == observations.reshape(2, -1)).all()
    assert rewards == pytest.approx(returns, abs=1e-5)
    with pytest.raises(ValueError, match="`decision_steps` must be an integer >= 1, got 0"):
        sparring.sb3.vec_env(2, decision_steps=0)


def test_agents_outside_kessler_have_their_own_rewards():
    envs = sparring.sb3.vec_env(4, "tasking/constellation")
    envs.seed(2)
    envs.reset()
    rng, different = np.random.default_rng(1), 0
    for _ in range(60):
        rows, rewards, *_ = envs.step(rng.integers(0, envs.action_space.n, envs.num_envs))
        assert rows.dtype == rewards.dtype == np.float32
        own = envs.envs.agent_results().rewards
        assert (rewards == own.reshape(-1)).all()
        different += int((own != own[:, :1]).any())
    assert different > 0, "all satellites have the same rewards"
    envs.close()


def test_invalid_setting_is_named():
    with pytest.raises(ValueError, match="autoreset_mode"):
        sparring.sb3.vec_env(2, "survival", autoreset_mode="disabled")
    with pytest.raises(ValueError, match="observation"):
        sparring.sb3.vec_env(2, "survival", observation="telemetry")


def test_docking_trains_with_vec_monitor():
    envs = VecMonitor(sparring.sb3.vec_env(2, "docking/multiagent", params={"time_limit_s": 60.0}))
    model = PPO("MlpPolicy", envs, n_steps=64, device="cpu", **sparring.sb3.active_only(envs))
    model.learn(1000)
    assert model.num_timesteps >= 1000
    envs.close()


@needs_server
def test_training_with_a_curriculum_improves_skill(tmp_path):
    torch.set_num_threads(1)
    # Survival improves first, so it has most of the weight.
    weights = {"kessler/survival": {"weight": 9.0}}
    settings = {
        "tasks": ["kessler/survival", "kessler/eco_station"],
        "task_settings": weights,
        "strategy": "ladder",
        "design": {"designer": "off"},
    }
    with sparring.Curriculum.local(binary=BINARY, settings=settings, form="groups") as curriculum:
        envs = sparring.sb3.vec_env(64, curriculum=curriculum)
        model = PPO("MlpPolicy", envs, tensorboard_log=os.fspath(tmp_path), **PPO_SETTINGS, **sparring.sb3.active_only(envs))
        held_out = {"tasks": ["kessler/survival"], "stochastic": False}
        start = sparring.evaluate(curriculum, sparring.sb3.policy_fn(model), policy="start", **held_out)
        model.learn(350_000, callback=sparring.sb3.CurriculumCallback(curriculum))
        envs.close()
        curriculum.flush()
        trained = sparring.evaluate(curriculum, sparring.sb3.policy_fn(model), policy="trained", **held_out)
        stats = curriculum.stats()
    assert stats["counted"] + stats["stored"] == stats["finished"] > 1000
    # Three trainings by hand gained 0.21 to 0.28; an agent that does not learn stays within 0.05.
    gain = trained.mean("kessler/survival", part="all") - start.mean("kessler/survival", part="all")
    assert gain > 0.08
    events = EventAccumulator(os.fspath(next(tmp_path.iterdir())))
    events.Reload()
    tags = set(events.Tags()["scalars"])
    for task in settings["tasks"]:
        for name in ("level", "mastery", "success", "skill", "params/debris"):
            assert f"curriculum/{task}/{name}" in tags
    assert {"rollout/ep_rew_mean", "curriculum/episodes/finished"} <= tags


@needs_server
def test_printed_command_trains_evaluates_and_saves(tmp_path):
    shorter = {"--steps 1000000": "--steps 9600"}
    command = printed_command("docs/guides/train-sb3.md", "python examples/sb3_ppo.py", shorter)
    output = run_command(command, tmp_path, "--evaluations", "1", "--envs", "16", "--save", "model.zip")
    evaluations = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    assert [row["steps"] for row in evaluations] == [0, 9600]
    assert all(-1 <= skill <= 1 for row in evaluations for skill in row["skill"].values())
    assert "<svg" in (tmp_path / "sb3.svg").read_text()
    assert all((tmp_path / name).exists() for name in ("model.zip", "runs"))


def test_printed_scanning_command_trains_and_plots(tmp_path):
    shorter = {"--steps 2000000": "--steps 4096"}
    command = printed_command("docs/guides/train-sb3.md", "python examples/scanning_sb3.py", shorter)
    output = run_command(command, tmp_path, "--evaluations", "1", "--episodes", "4", "--envs", "16", "--save", "model.zip")
    evaluations = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    assert [row["steps"] for row in evaluations] == [0, 4096]
    assert all(0 <= row["survived"] <= 1 and -1 <= row["return"] <= 1 for row in evaluations)
    assert "<svg" in (tmp_path / "scanning.svg").read_text() and (tmp_path / "model.zip").exists()
