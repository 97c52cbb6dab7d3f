"""Vector environments equal Gymnasium's SyncVectorEnv of single environments, to the bit."""

import gc
import os

import gymnasium
import numpy as np
import pytest
from conftest import bitwise_equal, random_actions, short_episode_params
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sparring

MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED]


def make_both(task, mode, envs, **settings):
    """Returns the vector environment, and Gymnasium's of the same single environments."""
    settings = {"params": short_episode_params(task), **settings}
    ours = sparring.make_vec(task, envs, autoreset_mode=mode, episode_statistics=False, **settings)
    theirs = SyncVectorEnv([lambda: sparring.Environment(task, **settings) for _ in range(envs)], autoreset_mode=mode)
    return ours, theirs


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("settings", [{}, {"observation": "telemetry"}, {"actions": "discrete"}, {"actions": "few"}], ids=str)
def test_steps_equal_those_of_sync_vector_env(task, mode, settings):
    ours, theirs = make_both(task, mode, 5, **settings)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.single_action_space == theirs.single_action_space
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"] == mode
    assert bitwise_equal(ours.reset(seed=17)[0], theirs.reset(seed=17)[0])
    ours.action_space.seed(1)
    ends = 0
    for _ in range(130):
        actions = ours.action_space.sample()
        step, expected = ours.step(actions), theirs.step(actions)
        assert all(bitwise_equal(a, b) for a, b in zip(step[:4], expected[:4], strict=True))
        done = step[2] | step[3]
        ends += done.sum()
        if mode == AutoresetMode.SAME_STEP and done.any():
            assert bitwise_equal(step[4]["final_obs"], expected[4]["final_obs"])
            assert bitwise_equal(step[4]["_final_obs"], expected[4]["_final_obs"])
        if mode == AutoresetMode.DISABLED and done.any():
            assert bitwise_equal(
                ours.reset(options={"reset_mask": done.copy()})[0],
                theirs.reset(options={"reset_mask": done.copy()})[0],
            )
    assert ends > 5


@pytest.mark.parametrize("mode", MODES[:2])
def test_episode_statistics_equal_gymnasiums(task, mode):
    settings = {"params": short_episode_params(task), "autoreset_mode": mode}
    ours = sparring.make_vec(task, 4, **settings)
    theirs = gymnasium.wrappers.vector.RecordEpisodeStatistics(sparring.make_vec(task, 4, episode_statistics=False, **settings))
    ours.reset(seed=3), theirs.reset(seed=3)
    ours.action_space.seed(2)
    ends = 0
    for _ in range(130):
        actions = ours.action_space.sample()
        *_, infos = ours.step(actions)
        *_, expected = theirs.step(actions)
        assert ("episode" in infos) == ("episode" in expected)
        if "episode" in infos:
            ends += 1
            assert bitwise_equal(infos["_episode"], expected["_episode"])
            np.testing.assert_array_equal(infos["episode"]["l"], expected["episode"]["l"])
            np.testing.assert_allclose(infos["episode"]["r"], expected["episode"]["r"], rtol=1e-12)
            assert (infos["episode"]["t"][infos["_episode"]] > 0).all()
    assert ends > 1


def test_results_do_not_depend_on_batch_size_and_threads(task):
    # A step of tasking takes a hundred times longer than one of the other worlds, and its episodes have fewer steps.
    many, steps = (40, 40) if task.startswith("tasking/") else (256, 120)

    def rollout(envs, threads):
        batch = sparring.make_vec(task, envs, params=short_episode_params(task), threads=threads)
        batch.reset(seed=23)
        rng = np.random.default_rng(9)
        rows = []
        for _ in range(steps):
            actions = random_actions(batch.single_action_space, rng, 256)[:envs]
            observations, rewards, terminations, truncations, _ = batch.step(actions)
            rows.append((observations[:7], rewards[:7], terminations[:7], truncations[:7]))
        return rows, [batch.state_hash(env) for env in range(7)]

    first, hashes = rollout(7, 1)
    assert sum((terminations | truncations).sum() for *_, terminations, truncations in first) >= 7, "environments are reset"
    for envs, threads in [(many, 1), (many, 2), (many, 5), (many // 3, None)]:
        rows, other_hashes = rollout(envs, threads)
        assert other_hashes == hashes
        assert all(bitwise_equal(a, b) for x, y in zip(first, rows, strict=True) for a, b in zip(x, y, strict=True))


def test_out_arrays_are_written_in_place():
    envs = sparring.make_vec("kessler/survival", 64, threads=2)
    out = (envs.empty_observations(), np.zeros(64), np.zeros(64, bool), np.zeros(64, bool))
    observations, _ = envs.reset(seed=1, out=out[0])
    assert observations.ctypes.data == out[0].ctypes.data
    actions = np.zeros(envs.action_space.shape, np.float32)
    for array, returned in zip(out, envs.step(actions, out=out)[:4], strict=True):
        assert array.ctypes.data == returned.ctypes.data and array.shape == returned.shape
    assert out[1].any()
    # Without `out`, memory is reused once no caller holds it, and not before.
    addresses = {envs.step(actions)[0].ctypes.data for _ in range(50)}
    assert len(addresses) <= 2
    kept = [envs.step(actions)[0] for _ in range(10)]
    assert len({array.ctypes.data for array in kept}) == 10


def test_telemetry_parts_are_views_of_one_array():
    envs = sparring.make_vec("kessler/survival", 8, observation="telemetry")
    observations, _ = envs.reset(seed=1)
    bases = set()
    for part in observations.values():
        while part.base is not None and isinstance(part.base, np.ndarray):
            part = part.base
        bases.add(id(part))
    assert len(bases) == 1


def test_reset_mask_leaves_other_environments_alone():
    envs = sparring.make_vec("kessler/survival", 6, autoreset_mode="disabled")
    envs.reset(seed=1)
    actions = np.zeros(envs.action_space.shape, np.float32)
    before = envs.step(actions)[0].copy()
    mask = np.array([True, False, True, False, False, False])
    after, _ = envs.reset(seed=50, options={"reset_mask": mask})
    assert bitwise_equal(before[~mask], after[~mask])
    fresh, _ = envs.reset(seed=50)
    assert bitwise_equal(after[mask], fresh[mask])


def test_gymnasium_makes_vector_environments():
    envs = gymnasium.make_vec("sparring/Rendezvous-v0", 3, vectorization_mode="vector_entry_point", level=2)
    assert isinstance(envs.unwrapped, sparring.VectorEnvironment)
    gymnasium.wrappers.vector.RecordEpisodeStatistics(envs).reset(seed=1)
    envs.close()


def test_each_environment_gets_its_own_scenario():
    envs = sparring.make_vec("kessler/survival", 2)
    scenarios = [sparring.Scenario("survival", params={"debris": n}, seed=n) for n in (10, 20)]
    envs.reset(options={"scenario": scenarios})
    assert [envs.scenario(0), envs.scenario(1)] == scenarios
    with pytest.raises(ValueError, match="scenario"):
        envs.reset(options={"scenario": scenarios[:1]})


def test_sequences_continue_after_a_common_scenario():
    envs, plain = (sparring.make_vec("survival", 4, autoreset_mode="disabled") for _ in range(2))
    envs.reset(seed=0)
    plain.reset(seed=0)
    scenario = sparring.Scenario("survival", seed=5)
    envs.reset(options={"scenario": scenario})
    assert [envs.scenario(env) for env in range(4)] == [scenario] * 4
    for _ in range(2):
        envs.reset()
        plain.reset()
        assert [envs.scenario(env) for env in range(4)] == [plain.scenario(env) for env in range(4)]


def test_one_rejected_request_resets_no_environment():
    envs = sparring.make_vec("docking/multiagent", 3)
    envs.reset(seed=0)
    before = [envs.state_hash(env) for env in range(3)]
    valid = sparring.Scenario("docking/multiagent", seed=1)
    mask = np.array([False, True, False])
    for options in (
        {"params": {"deputies": 4}, "reset_mask": mask},
        {"scenario": [valid, valid, "bad"]},
        {"scenario": [valid, valid, sparring.Scenario("docking/multiagent", params={"deputies": 5})]},
        {"scenario": "x"},
    ):
        with pytest.raises(ValueError, match="options"):
            envs.reset(options=options)
        assert [envs.state_hash(env) for env in range(3)] == before
    envs.reset(options={"reset_mask": mask})
    assert [envs.state_hash(env) == old for env, old in enumerate(before)] == [True, False, True]
    assert envs.scenario(1) != valid
    envs.step(np.zeros(envs.action_space.shape, np.float32))


def test_forked_process_raises_without_threads():
    envs = sparring.make_vec("kessler/survival", 128, threads=2)
    envs.reset(seed=1)
    child = os.fork()
    if child == 0:
        try:
            envs.step(np.zeros(envs.action_space.shape, np.float32))
        except RuntimeError as error:
            os._exit(7 if "another process" in str(error) else 8)
        os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    envs.step(np.zeros(envs.action_space.shape, np.float32))
    envs.close()


def test_failed_constructor_leaves_nothing_to_close(recwarn):
    for invalid in ({"num_envs": 0}, {"task": ""}, {"curriculum": "http://127.0.0.1:8700"}):
        with pytest.raises(ValueError, match=next(iter(invalid))):
            sparring.make_vec(**{"num_envs": 2, **invalid})
    gc.collect()
    assert not [warning for warning in recwarn if "_native" in str(warning.message)]


def test_array_changed_in_place_is_not_reused():
    envs = sparring.make_vec("survival", 4, threads=1)
    observations, _ = envs.reset(seed=1)
    shape, actions = observations.shape, np.zeros(envs.action_space.shape, np.float32)
    for change in (
        lambda array: setattr(array, "shape", (4, -1)),
        lambda array: array.setflags(write=False),
        lambda array: setattr(array, "dtype", np.int32),
    ):
        change(observations)
        for _ in range(6):
            del observations
            observations, *_ = envs.step(actions)
            assert observations.shape == shape
            assert observations.dtype == np.float32
            assert observations.flags.writeable
            assert observations.flags.c_contiguous


def test_reset_mask_may_be_a_view():
    envs = sparring.make_vec("survival", 4)
    envs.reset(seed=1)
    flags = np.zeros((4, 3), np.bool_)
    flags[2, 1] = True
    before = [envs.scenario(env) for env in range(4)]
    envs.reset(options={"reset_mask": flags[:, 1]})
    after = [envs.scenario(env) for env in range(4)]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, True, False, True]


@pytest.mark.parametrize("mode", MODES)
def test_repeated_actions_equal_single_steps_until_the_end(task, mode):
    settings = {"params": short_episode_params(task), "autoreset_mode": mode, "actions": "few"}
    together = sparring.make_vec(task, 4, **settings)
    alone = [sparring.make_vec(task, 1, **settings) for _ in range(4)]
    together.reset(seed=5)
    for env, single in enumerate(alone):
        single.reset(seed=5 + env)
    together.action_space.seed(4)
    begins, ends, steps = np.zeros(4, np.bool_), 0, 0
    for _ in range(60):
        actions = together.action_space.sample()
        step = together.step(actions, repeat=3)
        by_agent, over = together.agent_results().rewards, step[2] | step[3]
        for env, single in enumerate(alone):
            total, agents = 0.0, np.zeros_like(by_agent[env])
            for _ in range(3):
                observations, rewards, terminations, truncations, infos = single.step(actions[env : env + 1])
                total, agents = total + rewards[0], agents + single.agent_results().rewards[0]
                done = bool(terminations[0] or truncations[0])
                # A step that only begins an episode ignores its actions.
                is_reset = bool(begins[env]) and mode == AutoresetMode.NEXT_STEP
                steps += not is_reset
                begins[env] = done
                if done or is_reset:
                    break
            assert (bool(over[env]), step[1][env]) == (done, total)
            assert bitwise_equal(by_agent[env], agents)
            assert bitwise_equal(np.asarray(step[0][env]), np.asarray(observations[0]))
            if done:
                assert step[4]["episode"]["l"][env] == infos["episode"]["l"][0]
        ends += int(over.sum())
        if mode == AutoresetMode.DISABLED and over.any():
            together.reset(options={"reset_mask": over.copy()})
            for single in (alone[env] for env in np.flatnonzero(over)):
                single.reset()
            begins[:] = False
    assert ends > 3
    assert together.total_steps == steps == sum(single.total_steps for single in alone)
    with pytest.raises(ValueError, match="`repeat` must be an integer >= 1, got 0"):
        together.step(together.action_space.sample(), repeat=0)
