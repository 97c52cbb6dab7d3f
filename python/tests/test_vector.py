"""The vector environment against Gymnasium's own SyncVectorEnv of the single ones, bit by bit."""

import gc
import os

import gymnasium
import numpy as np
import pytest
from conftest import equal, short
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import sparring

MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED]


def peers(task, mode, envs, **settings):
    """Ours, and Gymnasium's of the same environments."""
    settings = {"params": short(task), **settings}
    ours = sparring.make_vec(task, envs, autoreset_mode=mode, episode_statistics=False, **settings)
    theirs = SyncVectorEnv([lambda: sparring.Environment(task, **settings) for _ in range(envs)], autoreset_mode=mode)
    return ours, theirs


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("settings", [{}, {"observation": "telemetry"}, {"actions": "discrete"}], ids=str)
def test_as_gymnasium_steps_them(task, mode, settings):
    ours, theirs = peers(task, mode, 5, **settings)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.single_action_space == theirs.single_action_space
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"] == mode
    seen, told = ours.reset(seed=17)[0], theirs.reset(seed=17)[0]
    assert equal(seen, told)
    ours.action_space.seed(1)
    ends = 0
    for _ in range(130):
        actions = ours.action_space.sample()
        here, there = ours.step(actions), theirs.step(actions)
        assert all(equal(a, b) for a, b in zip(here[:4], there[:4], strict=True))
        done = here[2] | here[3]
        ends += done.sum()
        if mode == AutoresetMode.SAME_STEP and done.any():
            assert equal(here[4]["final_obs"], there[4]["final_obs"])
            assert equal(here[4]["_final_obs"], there[4]["_final_obs"])
        if mode == AutoresetMode.DISABLED and done.any():
            assert equal(
                ours.reset(options={"reset_mask": done.copy()})[0],
                theirs.reset(options={"reset_mask": done.copy()})[0],
            )
    assert ends > 5


@pytest.mark.parametrize("mode", MODES[:2])
def test_episode_statistics_are_gymnasiums(task, mode):
    settings = {"params": short(task), "autoreset_mode": mode}
    ours = sparring.make_vec(task, 4, **settings)
    theirs = gymnasium.wrappers.vector.RecordEpisodeStatistics(sparring.make_vec(task, 4, episode_statistics=False, **settings))
    ours.reset(seed=3), theirs.reset(seed=3)
    ours.action_space.seed(2)
    ends = 0
    for _ in range(130):
        actions = ours.action_space.sample()
        *_, here = ours.step(actions)
        *_, there = theirs.step(actions)
        assert ("episode" in here) == ("episode" in there)
        if "episode" in here:
            ends += 1
            assert equal(here["_episode"], there["_episode"])
            np.testing.assert_array_equal(here["episode"]["l"], there["episode"]["l"])
            np.testing.assert_allclose(here["episode"]["r"], there["episode"]["r"], rtol=1e-12)
            assert (here["episode"]["t"][here["_episode"]] > 0).all()
    assert ends > 1


def test_the_same_at_any_number_of_environments_and_threads(task):
    def rollout(envs, threads):
        made = sparring.make_vec(task, envs, params=short(task), threads=threads)
        made.reset(seed=23)
        rng = np.random.default_rng(9)
        rows = []
        for _ in range(120):
            actions = rng.uniform(-0.3, 0.3, (256, *made.single_action_space.shape)).astype(np.float32)[:envs]
            seen, rewards, terminations, truncations, _ = made.step(actions)
            rows.append((seen[:7], rewards[:7], terminations[:7], truncations[:7]))
        return rows, [made.state_hash(env) for env in range(7)]

    first, hashes = rollout(7, 1)
    for envs, threads in [(256, 1), (256, 2), (256, 5), (70, None)]:
        again, others = rollout(envs, threads)
        assert hashes == others
        assert all(equal(a, b) for x, y in zip(first, again, strict=True) for a, b in zip(x, y, strict=True))


def test_nothing_is_copied():
    envs = sparring.make_vec("kessler/survival", 64, threads=2)
    out = (envs.empty(), np.zeros(64), np.zeros(64, bool), np.zeros(64, bool))
    seen, _ = envs.reset(seed=1, out=out[0])
    assert seen.ctypes.data == out[0].ctypes.data
    actions = np.zeros(envs.action_space.shape, np.float32)
    for given, got in zip(out, envs.step(actions, out=out)[:4], strict=True):
        assert given.ctypes.data == got.ctypes.data and given.shape == got.shape
    assert out[1].any()
    # Without arrays of the caller's: the same memory again once nobody has it, and never while somebody does.
    places = {envs.step(actions)[0].ctypes.data for _ in range(50)}
    assert len(places) <= 2
    kept = [envs.step(actions)[0] for _ in range(10)]
    assert len({one.ctypes.data for one in kept}) == 10


def test_telemetry_is_views_of_one_array():
    envs = sparring.make_vec("kessler/survival", 8, observation="telemetry")
    seen, _ = envs.reset(seed=1)
    bases = set()
    for part in seen.values():
        while part.base is not None and isinstance(part.base, np.ndarray):
            part = part.base
        bases.add(id(part))
    assert len(bases) == 1


def test_some_are_reset_and_the_others_go_on():
    envs = sparring.make_vec("kessler/survival", 6, autoreset_mode="disabled")
    envs.reset(seed=1)
    actions = np.zeros(envs.action_space.shape, np.float32)
    before = envs.step(actions)[0].copy()
    mask = np.array([True, False, True, False, False, False])
    after, _ = envs.reset(seed=50, options={"reset_mask": mask})
    assert equal(before[~mask], after[~mask])
    fresh, _ = envs.reset(seed=50)
    assert equal(after[mask], fresh[mask])


def test_gymnasium_makes_it():
    envs = gymnasium.make_vec("sparring/Rendezvous-v0", 3, vectorization_mode="vector_entry_point", level=2)
    assert isinstance(envs.unwrapped, sparring.VectorEnvironment)
    gymnasium.wrappers.vector.RecordEpisodeStatistics(envs).reset(seed=1)
    envs.close()


def test_scenarios_one_each():
    envs = sparring.make_vec("kessler/survival", 2)
    scenarios = [sparring.Scenario("survival", params={"debris": n}, seed=n) for n in (10, 20)]
    envs.reset(options={"scenario": scenarios})
    assert [envs.scenario(0), envs.scenario(1)] == scenarios
    with pytest.raises(ValueError, match="scenario"):
        envs.reset(options={"scenario": scenarios[:1]})


def test_rows_go_on_behind_a_scenario_that_all_fly():
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


def test_one_wish_that_is_refused_moves_no_environment():
    envs = sparring.make_vec("docking/multiagent", 3)
    envs.reset(seed=0)
    before = [envs.state_hash(env) for env in range(3)]
    fine = sparring.Scenario("docking/multiagent", seed=1)
    mask = np.array([False, True, False])
    for options in (
        {"params": {"deputies": 4}, "reset_mask": mask},
        {"scenario": [fine, fine, "bad"]},
        {"scenario": [fine, fine, sparring.Scenario("docking/multiagent", params={"deputies": 5})]},
        {"scenario": "x"},
    ):
        with pytest.raises(ValueError, match="options"):
            envs.reset(options=options)
        assert [envs.state_hash(env) for env in range(3)] == before
    envs.reset(options={"reset_mask": mask})
    assert [envs.state_hash(env) == old for env, old in enumerate(before)] == [True, False, True]
    assert envs.scenario(1) != fine
    envs.step(np.zeros(envs.action_space.shape, np.float32))


def test_a_forked_process_is_told_that_it_has_no_threads():
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


def test_what_cannot_be_made_leaves_nothing_to_close(recwarn):
    for wrong in ({"num_envs": 0}, {"task": ""}, {"curriculum": "http://127.0.0.1:8700"}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            sparring.make_vec(**{"num_envs": 2, **wrong})
    gc.collect()
    assert not [one for one in recwarn if "_native" in str(one.message)]


def test_arrays_that_somebody_changed_in_place_are_not_written_again():
    envs = sparring.make_vec("survival", 4, threads=1)
    seen, _ = envs.reset(seed=1)
    shape, actions = seen.shape, np.zeros(envs.action_space.shape, np.float32)
    for change in (
        lambda seen: setattr(seen, "shape", (4, -1)),
        lambda seen: seen.setflags(write=False),
        lambda seen: setattr(seen, "dtype", np.int32),
    ):
        change(seen)
        for _ in range(6):
            del seen
            seen, *_ = envs.step(actions)
            assert seen.shape == shape
            assert seen.dtype == np.float32
            assert seen.flags.writeable
            assert seen.flags.c_contiguous


def test_a_mask_may_be_a_view():
    envs = sparring.make_vec("survival", 4)
    envs.reset(seed=1)
    flags = np.zeros((4, 3), np.bool_)
    flags[2, 1] = True
    before = [envs.scenario(env) for env in range(4)]
    envs.reset(options={"reset_mask": flags[:, 1]})
    after = [envs.scenario(env) for env in range(4)]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, True, False, True]
