"""Environments with the curriculum of a real server: which episodes they run and how these are reported."""

import gymnasium
import numpy as np
import pytest
from conftest import needs_server
from curriculum_servers import SETTINGS, hold_to_end, local_curriculum, step_randomly, wait_until

import sparring

pytestmark = needs_server


def count_reported(stats):
    return stats["counted"] + stats["stored"]


@pytest.mark.parametrize("form", ["groups", "columns"])
@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_finished_episodes_are_counted(form, mode):
    with local_curriculum(form=form, lease_groups=32) as curriculum:
        envs = sparring.make_vec(num_envs=16, curriculum=curriculum, autoreset_mode=mode)
        envs.reset()
        curriculum.policy_version = 3
        ended = step_randomly(envs, 230, 0.02)
        assert (envs.levels >= 0).all(), "a fast server may have moved the level"
        assert envs.train.all()
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
        assert stats["finished"] == ended > 60
        assert stats["refused"] == stats["late"] == stats["duplicate"] == 0
        if form == "columns":
            assert stats["accepted"] + stats["unsent"] <= ended
            assert stats["accepted"] >= 32
        else:
            assert count_reported(stats) == ended
        curriculum.close()
        assert curriculum.stats()["unsent"] == 0


def test_one_batch_runs_all_tasks_of_a_run():
    settings = {**SETTINGS, "tasks": ["kessler/survival", "kessler/rendezvous", "kessler/formation"]}
    with local_curriculum(settings=settings, form="groups", lease_groups=16) as curriculum:
        envs = sparring.make_vec(num_envs=8, curriculum=curriculum)
        envs.reset()
        tasks = set()
        for _ in range(120):
            envs.step(np.zeros(envs.action_space.shape, np.float32))
            tasks |= {envs.scenario(env).task for env in range(8)}
        envs.close()
        assert tasks == set(settings["tasks"])
        curriculum.flush()
        assert count_reported(curriculum.stats()) == curriculum.stats()["finished"] > 10


def test_docking_episodes_are_counted():
    settings = {**SETTINGS, "tasks": ["docking/multiagent"]}
    with local_curriculum(settings=settings, form="groups", lease_groups=4) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        observations, _ = envs.reset()
        assert observations.shape == (4, 5, 8)
        ended = step_randomly(envs, 1600, 1.0)
        envs.close()
        curriculum.flush()
        assert curriculum.stats()["finished"] == ended > 2


@pytest.mark.parametrize("form", ["groups", "columns"])
def test_largest_group_size_is_leased(form):
    with local_curriculum(settings={**SETTINGS, "group_size": 1024}, form=form) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        assert curriculum.stats()["ready"] >= 1020, "the first group, of which four episodes run"
        envs.close()


def test_metrics_have_no_level_during_placement():
    settings = {**SETTINGS, "placement": True}
    with local_curriculum(settings=settings, form="groups") as curriculum:
        names = set(curriculum.metrics())
    assert "kessler/survival/success" not in names, "no episode was run"
    assert "kessler/survival/params/debris" in names
    assert not {name for name in names if "level" in name or "mastery" in name}


def test_truncated_episode_warns():
    with local_curriculum() as curriculum:
        env = gymnasium.make("sparring/Survival-v0", curriculum=curriculum, max_episode_steps=3)
        env.reset()
        for _ in range(3):
            env.step(np.zeros(env.action_space.shape, np.float32))
        with pytest.warns(UserWarning, match="reset after 3 steps, before its end"):
            env.reset()
        env.close()


def test_truncated_parallel_episode_warns():
    with local_curriculum(form="groups") as curriculum:
        env = sparring.parallel_env(curriculum=curriculum)
        env.reset()
        env.step({})
        with pytest.warns(UserWarning, match="reset after 1 steps, before its end"):
            env.reset()
        env.close()


def test_closed_batch_returns_episodes_to_others():
    with local_curriculum(form="groups", lease_groups=8, ahead=8) as curriculum:
        closed, other = (sparring.make_vec(num_envs=4, curriculum=curriculum) for _ in range(2))
        closed.reset()
        other.reset()
        returned = {closed.scenario(env).seed for env in range(4)}
        closed.close()
        with pytest.raises(sparring.CurriculumError, match="closed"):
            closed.step(np.zeros(closed.action_space.shape, np.float32))
        new = sparring.make_vec(num_envs=4, curriculum=curriculum)
        new.reset()
        assert {new.scenario(env).seed for env in range(4)} == returned
        new.close()
        other.close()


def test_groups_are_begun_as_environments_need_them():
    with local_curriculum(form="groups", lease_groups=32) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        assert step_randomly(envs, 60) >= 4
        first = curriculum.request("GET", f"/v1/runs/{curriculum.run}/leases")["leases"][-1]["lease"]
        lease = curriculum.request("GET", f"/v1/runs/{curriculum.run}/leases/{first}")
        begun = {group["group"] for group in lease["groups"]}
        curriculum.flush()  # the reports of episodes that have ended may be on their way
        episodes = curriculum.request("GET", f"/v1/runs/{curriculum.run}/episodes?limit=100")["episodes"]
        assert 4 <= len(begun) <= len(episodes) + 4 + 3, "those that ran or run, and an episode for every other environment"
        assert len(lease["groups"]) + len(lease["undisclosed"]) == 32
        # A lease that ended without the curriculum is replaced.
        curriculum.request("POST", f"/v1/runs/{curriculum.run}/leases/{first}/release")
        assert step_randomly(envs, 120) >= 8
        envs.close()
        curriculum.flush()
        assert curriculum.stats()["error"] is None


def test_strategy_without_columns_gets_groups():
    with local_curriculum(settings={**SETTINGS, "strategy": "plr"}) as curriculum:
        envs = sparring.make_vec(num_envs=256, curriculum=curriculum)
        envs.reset()
        assert step_randomly(envs, 52) >= 256
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
    assert count_reported(stats) == stats["finished"]


def test_change_of_strategy_falls_back_to_groups():
    with local_curriculum() as curriculum:
        envs = sparring.make_vec(num_envs=256, curriculum=curriculum)
        envs.reset()
        assert curriculum.request("GET", f"/v1/runs/{curriculum.run}/leases")["leases"][0]["form"] == "columns"
        curriculum.request("PATCH", f"/v1/runs/{curriculum.run}", {"strategy": "plr"})
        assert step_randomly(envs, 320, 0.02) > 1000
        envs.close()
        curriculum.flush()
        stats = curriculum.stats()
        assert count_reported(stats) > 0
        assert stats["error"] is None


def test_episode_has_the_version_that_began_it():
    with local_curriculum(form="groups", lease_groups=8) as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        step_randomly(envs, 5)
        curriculum.policy_version = 7
        assert step_randomly(envs, 120) >= 8
        envs.close()
        curriculum.flush()
        page = curriculum.request("GET", f"/v1/runs/{curriculum.run}/episodes?limit=100")
        versions = [episode["policy_version"] for episode in page["episodes"]]
        assert versions.count(0) == 4
        assert set(versions) == {0, 7}
        # A trainer that joins the run later continues from the newest version.
        assert sparring.Curriculum(curriculum.url, curriculum.run).policy_version == 7


def test_buffer_smaller_than_a_lease_does_not_block():
    with local_curriculum(form="columns", lease_groups=64, buffer=16, max_wait_s=20) as curriculum:
        envs = sparring.make_vec(num_envs=32, curriculum=curriculum)
        envs.reset()
        assert step_randomly(envs, 320, 0.02) > 150
        envs.close()
        curriculum.flush()
        assert curriculum.stats()["accepted"] >= 64


def test_abandoned_episode_is_released_with_its_lease():
    settings = {**SETTINGS, "group_size": 2}
    with local_curriculum(form="groups", lease_groups=1, settings=settings) as curriculum:
        env = sparring.Environment(curriculum=curriculum)
        env.reset()
        first = env.scenario
        env.abandon()
        env.reset()
        assert env.scenario == first, "the other episode of the group"
        hold_to_end(env)
        path = f"/v1/runs/{curriculum.run}/leases?limit=100"
        wait_until(lambda: curriculum.request("GET", path)["leases"][0]["status"] == "released")
        assert curriculum.stats()["unfinished"] == 1
        env.close()
