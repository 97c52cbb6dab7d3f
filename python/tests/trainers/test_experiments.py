"""The learner in one file, on the curriculum of a real server."""

import numpy as np
import pytest
from conftest import BINARY, served

pytest.importorskip("torch")
import torch

import sparring
from sparring.experiments import ppo


def test_advantages_are_the_sums_they_stand_for():
    envs = sparring.make_vec("kessler/survival", 2, autoreset_mode="same_step")
    rollout = ppo.Rollout(envs, 6)
    rng = np.random.default_rng(1)
    rollout.rewards[:] = rng.normal(size=rollout.rewards.shape)
    rollout.values[:] = rng.normal(size=rollout.values.shape)
    rollout.over[3, 0] = True
    gamma, gae_lambda = 0.9, 0.8
    told = rollout.advantages(gamma, gae_lambda)
    for env in range(2):
        for step in range(6):
            # Schulman et al. 2016, equation 16, as it is written.
            expected, weight = 0.0, 1.0
            for at in range(step, 6):
                over = rollout.over[at, env, 0]
                after = 0.0 if over else rollout.values[at + 1, env, 0]
                expected += weight * (rollout.rewards[at, env, 0] + gamma * after - rollout.values[at, env, 0])
                weight *= gamma * gae_lambda
                if over:
                    break
            assert told[step, env, 0] == pytest.approx(expected, abs=1e-5)
    envs.close()


def test_observations_are_written_where_they_are_learned_from():
    config = ppo.Config(task="kessler/survival", level=9, num_envs=4)
    envs = ppo.make_envs(config, None)
    rollout = ppo.Rollout(envs, 60)
    torch.manual_seed(1)
    policy = ppo.Policy(rollout.seen.shape[-1], 2, config)
    envs.reset(seed=1, out=rollout.seen[0])
    absent = envs.absent()
    rollout.fill(envs, policy, absent)
    assert rollout.seen.any(axis=(1, 2, 3)).all()
    again = sparring.make_vec("kessler/survival", 4, level=9, autoreset_mode="same_step")
    seen, _ = again.reset(seed=1)
    gone = again.absent()
    for step in range(60):
        assert (rollout.seen[step] == seen).all()
        assert (rollout.counts[step] == ~gone).all()
        seen, *_, infos = again.step(rollout.actions[step])
        _, terminated, truncated = again.agents()
        gone = terminated | truncated
        if "_episode" in infos:
            gone[infos["_episode"]] = again.absent()[infos["_episode"]]
    assert not rollout.counts.all(), "nobody left before the others"
    envs.close()
    again.close()


@served
def test_it_learns_through_the_curriculum(tmp_path):
    settings = {"tasks": ["kessler/survival"], "design": {"designer": "off"}}
    told = []
    with sparring.Curriculum.local(binary=BINARY, settings=settings, form="groups") as curriculum:
        policy = ppo.train(ppo.Config(steps=100_000), curriculum, lambda taken, _, numbers: told.append((taken, numbers)))
        curriculum.flush()
        skill = sparring.evaluate(curriculum, policy.act, policy="ppo", chance=False).of("kessler/survival")
        versions = curriculum.ask("GET", f"/v1/runs/{curriculum.run}")["policy_version"]
    assert told[-1][0] >= 100_000
    assert versions >= 20
    # 0.2 to 0.4 in trainings by hand; an agent that does nothing has 0.0, and one that acts at random less.
    assert skill > 0.1


@pytest.mark.parametrize(
    ("line", "field"),
    [("--steps -5", "steps"), ("--minibatches 0", "minibatches"), ("--run run-x", "--run"), ("--task moon", "task")],
)
def test_what_cannot_be_trained_is_said_in_a_sentence(line, field, capsys):
    with pytest.raises(SystemExit) as ended:
        ppo.main(line.split())
    assert ended.value.code == 2
    assert field in capsys.readouterr().err.splitlines()[-1]


def test_a_policy_that_is_kept_acts_as_it_did(tmp_path, capsys):
    file = tmp_path / "policy.pt"
    ppo.main(["--steps", "600", "--num-envs", "4", "--save", str(file), "--level", "3"])
    assert "600 steps" in capsys.readouterr().out, "the last rollout is told of"
    policy = ppo.Policy.load(str(file))
    seen = np.random.default_rng(1).normal(size=(2, 3, policy.sizes[0])).astype(np.float32)
    assert policy.act(seen).shape == (2, 3, 2)
    assert (policy.act(seen) == ppo.Policy.load(str(file)).act(seen)).all()


@pytest.mark.parametrize("task", ["docking/single", "docking/multiagent"])
def test_docking_is_learned_from(task):
    told = []
    policy = ppo.train(ppo.Config(task=task, steps=80, num_envs=2, rollout=20), None, lambda *now: told.append(now))
    assert [taken for taken, *_ in told] == [40, 80]
    assert policy.sizes == (8, 3)
