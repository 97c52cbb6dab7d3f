"""PPO in one file, with the curriculum of a real server."""

import numpy as np
import pytest
from conftest import BINARY, needs_server
from documents import printed_command, run_command

pytest.importorskip("torch")
import torch

import sparring
from sparring.experiments import ppo, ppo_cli


def test_advantages_equal_their_definition():
    envs = sparring.make_vec("kessler/survival", 2, autoreset_mode="same_step")
    rollout = ppo.Rollout(envs, ppo.Config(rollout=6))
    rng = np.random.default_rng(1)
    rollout.rewards[:] = rng.normal(size=rollout.rewards.shape)
    rollout.values[:] = rng.normal(size=rollout.values.shape)
    rollout.dones[3, 0] = True
    gamma, gae_lambda = 0.9, 0.8
    advantages = rollout.advantages(gamma, gae_lambda)
    for env in range(2):
        for step in range(6):
            # Schulman et al. 2016, equation 16.
            expected, weight = 0.0, 1.0
            for at in range(step, 6):
                done = rollout.dones[at, env, 0]
                after = 0.0 if done else rollout.values[at + 1, env, 0]
                expected += weight * (rollout.rewards[at, env, 0] + gamma * after - rollout.values[at, env, 0])
                weight *= gamma * gae_lambda
                if done:
                    break
            assert advantages[step, env, 0] == pytest.approx(expected, abs=1e-5)
    envs.close()


def test_rollout_has_the_environments_observations():
    config = ppo.Config(task="kessler/survival", level=9, num_envs=4, rollout=60)
    envs = ppo.make_envs(config, None)
    rollout = ppo.Rollout(envs, config)
    torch.manual_seed(1)
    policy = ppo.Policy(rollout.observations.shape[-1], 5, config)
    envs.reset(seed=1, out=rollout.observations[0])
    absent = envs.absent_agents()
    rollout.collect(envs, policy, absent)
    assert rollout.observations.any(axis=(1, 2, 3)).all()
    replayed = sparring.make_vec("kessler/survival", 4, level=9, actions="few", autoreset_mode="same_step")
    observations, _ = replayed.reset(seed=1)
    absent = replayed.absent_agents()
    for step in range(60):
        assert (rollout.observations[step] == observations).all()
        assert (rollout.active[step] == ~absent).all()
        observations, *_, infos = replayed.step(rollout.actions[step])
        results = replayed.agent_results()
        absent = results.terminations | results.truncations
        if "_episode" in infos:
            absent[infos["_episode"]] = replayed.absent_agents()[infos["_episode"]]
    assert not rollout.active.all(), "no agent left before the others"
    envs.close()
    replayed.close()


def test_repeated_actions_collect_rewards_until_an_episode_ends():
    config = ppo.Config.tuned("docking/single", num_envs=8, rollout=40, level=3)
    envs = ppo.make_envs(config, None)
    rollout = ppo.Rollout(envs, config)
    torch.manual_seed(3)
    policy = ppo.Policy(rollout.observations.shape[-1], 13, config)
    envs.reset(seed=2, options={"params": {"start_scale": 0.01}}, out=rollout.out[0])
    rollout.collect(envs, policy, envs.absent_agents())
    replayed = ppo.make_envs(config, None)
    replayed.reset(seed=2, options={"params": {"start_scale": 0.01}})
    for step in range(40):
        observations, rewards, terminations, truncations, _ = replayed.step(rollout.actions[step], repeat=5)
        assert np.allclose(rollout.rewards[step, :, 0], rewards, atol=1e-5)
        assert (rollout.dones[step, :, 0] == terminations | truncations).all()
        assert (rollout.observations[step + 1] == observations).all()
    assert rollout.dones.any()
    envs.close()
    replayed.close()


def test_rollout_without_rows_leaves_the_policy_as_it_is():
    config = ppo.Config(task="kessler/survival", num_envs=2, rollout=4)
    envs = ppo.make_envs(config, None)
    rollout = ppo.Rollout(envs, config)
    policy = ppo.Policy(rollout.observations.shape[-1], 5, config)
    before = [parameter.clone() for parameter in policy.parameters()]
    optimizer = torch.optim.Adam(policy.parameters())
    for learned in (0, 1):
        rollout.active.reshape(-1)[:learned] = True
        assert ppo.learn(policy, optimizer, rollout, config) == {}
    assert all((old == new).all() for old, new in zip(before, policy.parameters(), strict=True))
    rollout.active[:] = True
    assert {"policy_loss", "value_loss", "hold"} == ppo.learn(policy, optimizer, rollout, config).keys()
    assert all(parameter.isfinite().all() for parameter in policy.parameters())
    envs.close()


def test_tuned_settings_belong_to_the_task():
    assert ppo.Config.tuned("docking/multiagent").decision_steps == 5
    assert ppo.Config.tuned("kessler/rendezvous", seed=4) == ppo.Config(task="kessler/rendezvous", reward_weight=4.0, seed=4)
    for task in sparring.tasks():
        ppo.make_envs(ppo.Config.tuned(task, num_envs=2), None).close()


@needs_server
def test_training_with_a_curriculum_improves_skill(tmp_path):
    settings = {"tasks": ["kessler/survival"], "design": {"designer": "off"}}
    reports = []
    with sparring.Curriculum.local(binary=BINARY, settings=settings, form="groups") as curriculum:
        policy = ppo.train(ppo.Config(steps=80_000), curriculum, lambda steps, _, metrics: reports.append((steps, metrics)))
        curriculum.flush()
        result = sparring.evaluate(curriculum, policy.sample, policy="ppo", stochastic=True, rollouts=2, actions="few")
        skill = result.mean("kessler/survival")
        versions = curriculum.request("GET", f"/v1/runs/{curriculum.run}")["policy_version"]
    assert reports[-1][0] >= 80_000
    assert versions >= 10
    # Trainings by hand reached 0.2 to 0.4; an agent that holds has 0.0, a random agent less.
    assert skill > 0.1


@pytest.mark.parametrize(
    ("line", "field"),
    [("--steps -5", "steps"), ("--minibatch 0", "minibatch"), ("--run run-x", "--run"), ("--task moon", "task")],
)
def test_invalid_option_is_reported(line, field, capsys):
    with pytest.raises(SystemExit) as ended:
        ppo_cli.main(line.split())
    assert ended.value.code == 2
    assert field in capsys.readouterr().err.splitlines()[-1]


def test_saved_policy_acts_as_before(tmp_path, capsys):
    file = tmp_path / "policy.pt"
    ppo_cli.main(["--steps", "600", "--num-envs", "4", "--save", str(file), "--level", "3"])
    assert "600 steps" in capsys.readouterr().out, "the last rollout is printed"
    policy = ppo.Policy.load(str(file))
    observations = np.random.default_rng(1).normal(size=(2, 3, policy.sizes[0])).astype(np.float32)
    assert policy.act(observations).shape == (2, 3)
    assert (policy.act(observations) == ppo.Policy.load(str(file)).act(observations)).all()


@needs_server
@pytest.mark.parametrize(
    ("start", "shorter", "more"),
    [
        ("--local", {"--steps 1000000": "--steps 6400"}, ()),
        ("--task", {}, ("--steps", "6400")),
    ],
)
def test_printed_commands_train(start, shorter, more, tmp_path):
    page = "docs/guides/train-own-loop.md"
    command = printed_command(page, f"python -m sparring.experiments ppo {start}", shorter)
    output = run_command(command, tmp_path, *more)
    assert "6,400 steps" in output
    assert ("skill on held-out contested scenarios" in output) == (tmp_path / "runs").exists() == (start == "--local")


@pytest.mark.parametrize("task", ["docking/single", "docking/multiagent"])
def test_docking_can_be_trained(task):
    reports = []
    policy = ppo.train(ppo.Config(task=task, steps=80, num_envs=2, rollout=20), None, lambda *report: reports.append(report))
    assert [steps for steps, *_ in reports] == [40, 80]
    assert policy.sizes == (8, 13)
