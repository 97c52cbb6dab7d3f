"""Single environments pass Gymnasium's checker and follow its API."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from conftest import IDS_AND_ACTIONS, bitwise_equal, random_actions, short_episode_params
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import sparring


@pytest.mark.parametrize(("id", "actions"), IDS_AND_ACTIONS)
@pytest.mark.parametrize("observation", [None, "telemetry"])
@pytest.mark.filterwarnings(
    "ignore:.*(A Box observation space|not within the range|minimum value is -infinity|maximum value is infinity).*"
)
def test_environment_passes_gymnasiums_checker(id, observation, actions):
    env = gymnasium.make(id, observation=observation, actions=actions, disable_env_checker=True)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.filterwarnings("ignore:.*(minimum value is -infinity|maximum value is infinity).*")
def test_rendering_passes_gymnasiums_checker(id):
    env = gymnasium.make(id, render_mode="rgb_array", disable_env_checker=True)
    check_env(env.unwrapped)
    env.close()


def run_episode(env, seed, actions):
    """Returns the observations of an episode, and its rewards, flags and scores."""
    observations = [env.reset(seed=seed)[0]]
    results = []
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        results.append((reward, terminated, truncated, info["score"]))
        if terminated or truncated:
            break
    return observations, results


def test_episodes_are_deterministic(task):
    env = sparring.Environment(task, params=short_episode_params(task))
    rng = np.random.default_rng(3)
    actions = [random_actions(env.action_space, rng, 1, scale=0.2)[0] for _ in range(60)]
    first = run_episode(env, 11, actions)
    run_episode(env, 12, actions)
    same_environment = run_episode(env, 11, actions)
    new_environment = run_episode(sparring.Environment(task, params=short_episode_params(task)), 11, actions)
    for repeated in (same_environment, new_environment):
        assert all(bitwise_equal(a, b) for a, b in zip(first[0], repeated[0], strict=True))
        assert first[1] == repeated[1]


def test_flags_are_bools_and_rewards_floats(task):
    env = sparring.Environment(task)
    env.reset(seed=1)
    _, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert isinstance(info["score"], float) and isinstance(info["alerts"], list)


def test_kept_observations_do_not_change():
    env = sparring.Environment("kessler/survival", level=0)
    env.action_space.seed(5)
    kept = [env.reset(seed=5)[0]]
    copies = [kept[0].copy()]
    for _ in range(20):
        kept.append(env.step(env.action_space.sample())[0])
        copies.append(kept[-1].copy())
    assert all(bitwise_equal(a, b) for a, b in zip(kept, copies, strict=True))
    row = env.step(env.action_space.sample())[0][1]  # a view keeps its array, too
    copy = row.copy()
    for _ in range(5):
        env.step(env.action_space.sample())
    assert bitwise_equal(row, copy)


def test_step_after_the_end_needs_a_reset(task):
    env = sparring.Environment(task, params=short_episode_params(task))
    with pytest.raises(ResetNeeded):
        env.step(env.action_space.sample())
    env.reset(seed=2)
    for _ in range(3000):
        *_, terminated, truncated, _ = env.step(None)
        if terminated or truncated:
            break
    else:
        pytest.fail("the episode does not end")
    with pytest.raises(ResetNeeded):
        env.step(env.action_space.sample())
    env.reset()
    env.step(env.action_space.sample())


def test_agent_axes_are_rotated_world_axes():
    own = sparring.Environment("kessler/survival", observation="telemetry", axes="agent")
    world = sparring.Environment("kessler/survival", observation="telemetry")
    observation, _ = own.reset(seed=4)
    world.reset(seed=4)
    rng = np.random.default_rng(1)
    for _ in range(30):
        action = rng.uniform(-0.05, 0.05, (3, 2)).astype(np.float32)
        x, y = observation["satellites"][:, 0].astype(float), observation["satellites"][:, 1].astype(float)
        radial = np.stack([x, y], 1) / np.hypot(x, y)[:, None]
        in_track = np.stack([-radial[:, 1], radial[:, 0]], 1)
        rotated = action[:, :1] * radial + action[:, 1:] * in_track
        observation, *_, own_info = own.step(action)
        expected, *_, world_info = world.step(rotated.astype(np.float32))
        # Observations have single precision, so directions differ by about 1e-7, and the difference grows.
        np.testing.assert_allclose(observation["satellites"], expected["satellites"], rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(own.history, world.history, atol=1e-5)
    assert own_info["score"] == pytest.approx(world_info["score"], abs=1e-9)


def test_discrete_actions_are_the_tasks_choices():
    env = sparring.Environment("kessler/survival", actions="discrete", observation="telemetry")
    observation, _ = env.reset(seed=4)
    env.step([0, 3, 4])
    burns = env.history[0]
    position = observation["satellites"][:, :2]
    radial = position / np.linalg.norm(position, axis=1, keepdims=True)
    in_track = np.stack([-radial[:, 1], radial[:, 0]], 1)
    np.testing.assert_allclose(burns, [[0, 0], -0.05 * in_track[1], -0.05 * radial[2]], atol=1e-6)


def test_few_actions_begin_with_hold():
    for task, count in (("kessler/survival", 5), ("docking/multiagent", 13)):
        env = sparring.Environment(task, actions="few")
        assert env.action_space.nvec.tolist() == [count] * len(env.action_space.nvec)
        assert not any(sparring.task(task).few_choices[0])
        env.reset(seed=4)
        env.step(env.action_space.nvec - 1)
        with pytest.raises(ValueError, match=f"from 0 to {count - 1}"):
            env.step(env.action_space.nvec)
        env.close()


def test_extended_state_is_docking_only():
    env = sparring.Environment("docking/single", observation="extended_state")
    observation, _ = env.reset(seed=4)
    assert observation.shape == env.observation_space.shape == (1, 20)
    assert [name.removeprefix("deputy_0_") for name in env.columns()][8:12] == [
        "time_left",
        "time_left_share",
        "log_thrust_bound",
        "log_distance",
    ]
    with pytest.raises(ValueError, match="`observation` must be tracks or telemetry in kessler@1"):
        sparring.Environment("kessler/survival", observation="extended_state")


def test_reset_options_choose_the_scenario():
    env = sparring.Environment("kessler/survival")
    scenario = sparring.Scenario("survival", params={"debris": 60}, seed=99)
    env.reset(seed=1, options={"scenario": scenario})
    assert env.scenario == scenario
    env.reset(options={"scenario": scenario.to_dict()})
    assert env.scenario == scenario
    env.reset(seed=5, options={"params": {"debris": 10}})
    assert (env.scenario.seed, env.scenario.params["debris"]) == (5, 10.0)
    env.reset(options={"level": 9})
    assert env.scenario.params["debris"] == 200.0
    for options, field in [
        ({"scenario": 7}, "options.scenario"),
        ({"no": 7}, "options.no"),
        ({"params": {"debris": -1}}, "params.debris"),
        ({"params": {"debris": float("nan")}}, "params.debris"),
        ({"level": 10}, "level"),
        ({"scenario": sparring.Scenario("formation")}, "scenario"),
    ]:
        with pytest.raises(ValueError, match=field):
            env.reset(options=options)


UNFAIR = {"mode": "replace", "bodies": {
    "satellites": [[60, 0, 0, 4], [0, 60, -4, 0], [-60, 0, 0, -4]], "debris": [[60, 0.5, 0, 4]],
}}  # fmt: skip


def test_scenario_option_runs_once_and_sequence_continues():
    plain, env = sparring.Environment("survival"), sparring.Environment("survival")
    once = sparring.Scenario("survival", params={"debris": 1}, physics={"gravity": "j2"}, seed=99)
    scenarios = []
    for tested, options in ((plain, None), (env, {"scenario": once})):
        scenarios.append([tested.reset(seed=7)[1]["scenario"], tested.reset(options=options)[1]["scenario"]])
        scenarios[-1] += [tested.reset()[1]["scenario"] for _ in range(2)]
    assert scenarios[1] == [scenarios[0][0], once, *scenarios[0][1:3]]
    assert env.reset(seed=5, options={"scenario": once, "level": 2})[1]["scenario"] == once
    assert env.reset()[1]["scenario"] == sparring.Scenario("survival", level=2, seed=5)


def test_rejected_reset_changes_nothing():
    docking = sparring.Environment("docking/multiagent")
    kessler = sparring.Environment("survival")
    unfair = sparring.Scenario("survival", params={"debris": 1}, seed=1, layout=UNFAIR)
    for env, rejected in (
        (docking, [{"options": {"level": 9}}, {"options": {"params": {"deputies": 4}}, "seed": 3}]),
        (kessler, [{"options": {"scenario": unfair}}, {"options": {"level": 9}, "seed": 2**51}, {"seed": -1}]),
    ):
        first = env.reset(seed=1)[1]["scenario"]
        env.step(env.action_space.sample())
        for arguments in rejected:
            before = env._native.state_hash(0)
            with pytest.raises(ValueError, match=r"options|seed"):
                env.reset(**arguments)
            assert env._native.state_hash(0) == before
            assert env.scenario == first
            env.step(env.action_space.sample())
        assert env.reset(seed=1)[1]["scenario"] == first
    with pytest.raises(ValueError, match=r"`options`: params\.deputies .*; choose .* at most the agents"):
        docking.reset(options={"level": 9})


def test_history_has_only_agents_that_take_part():
    env = sparring.Environment("docking/multiagent")
    env.reset(seed=0, options={"params": {"deputies": 1}})
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, _ = env.step(np.ones((3, 3), np.float32))
        total, over = total + reward, terminated or truncated
    assert env.history.shape[1:] == (1, 3)
    # Each reward has single precision.
    assert sparring.replay(env.scenario, env.history).total_reward == pytest.approx(total, abs=1e-4)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copied", "pickled"])
def test_copy_has_the_same_settings(copied):
    settings = {"level": 3, "actions": "discrete", "render_mode": "rgb_array", "render_size": (96, 64)}
    env = gymnasium.make("sparring/Survival-v0", **settings).unwrapped
    copied_env = copied(env)
    assert bitwise_equal(env.reset(seed=3)[0], copied_env.reset(seed=3)[0])
    assert copied_env.action_space == env.action_space
    assert copied_env.render().shape == (64, 96, 3)
    envs = copied(sparring.make_vec("docking/single", 3, autoreset_mode="same_step", threads=1))
    assert (envs.num_envs, envs.threads, envs.autoreset_mode) == (3, 1, gymnasium.vector.AutoresetMode.SAME_STEP)
    assert bitwise_equal(envs.reset(seed=1)[0], sparring.make_vec("docking/single", 3).reset(seed=1)[0])


def test_training_and_evaluation_seeds_are_rejected():
    env = sparring.Environment("kessler/survival")
    for space in (1, 2):
        seed = space << 51
        with pytest.raises(ValueError, match="seed"):
            env.reset(seed=seed)
        fields = {**sparring.Scenario("survival").to_dict(), "seed": seed}
        with pytest.raises(ValueError, match="seed"):
            env.reset(options={"scenario": sparring.Scenario.from_dict(fields)})
        with pytest.raises(ValueError, match="seed"):
            sparring.Scenario("survival", seed=seed)
