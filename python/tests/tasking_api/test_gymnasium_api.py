"""The environments work with Gymnasium and PettingZoo, and their objects can be copied."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from parts import IMAGER_ARGS, SCANNER_ARGS, Imager, Scanner, constellation, imagers
from peer import ConstellationTasking, GeneralSatelliteTasking, SatelliteTasking, comm, data, scene
from pettingzoo.test import parallel_api_test

SCENE = {"scenario": scene.UniformTargets(1500), "rewarder": data.UniqueImageReward(), "log_level": "ERROR"}


def test_environments_are_registered_as_the_peer_does():
    single = gymnasium.make("SatelliteTasking-v1", satellite=Imager("a", IMAGER_ARGS), **SCENE)
    observation, info = single.reset(seed=1)
    assert single.observation_space.contains(observation) and info == {"d_ts": 0.0, "requires_retasking": True}
    assert single.action_space == gymnasium.spaces.Discrete(4)
    assert list(single.step(2)[4]) == ["d_ts", "requires_retasking"]
    several = gymnasium.make("GeneralSatelliteTasking-v1", satellites=imagers(2), **SCENE)
    assert len(several.reset(seed=1)[0]) == 2
    assert several.unwrapped.simulator.sim_time == 0.0
    agents = gymnasium.make("ConstellationTasking-v1", satellites=imagers(2), disable_env_checker=True, **SCENE)
    assert agents.unwrapped.possible_agents == ["EO_1", "EO_2"]


def test_checker_of_gymnasium_passes():
    env = SatelliteTasking(Scanner("S", SCANNER_ARGS), scene.UniformNadirScanning(), data.ScanningTimeReward(), time_limit=3000.0)
    check_env(env, skip_render_check=True)
    assert env.observation_space.shape == (7,)


@pytest.mark.filterwarnings("ignore:Agent was given info but was dead last turn")
def test_checker_of_pettingzoo_passes():
    env = constellation(ConstellationTasking, imagers(3), comm.LOSCommunication(), time_limit=2000.0)
    parallel_api_test(env, num_cycles=100)
    assert env.max_num_agents == 3 and env.num_agents == len(env.agents)


def test_environments_work_in_a_vector():
    envs = gymnasium.vector.SyncVectorEnv(
        [lambda: SatelliteTasking(Imager("a", IMAGER_ARGS), time_limit=900.0, **SCENE) for _ in range(2)]
    )
    observations, _ = envs.reset(seed=4)
    alone = SatelliteTasking(Imager("a", IMAGER_ARGS), time_limit=900.0, **SCENE)
    assert np.array_equal(observations[1], alone.reset(seed=5)[0])
    assert envs.step(np.array([0, 1]))[0].shape == (2, 6)


def test_spaces_reset_an_environment_that_was_never_reset():
    env = GeneralSatelliteTasking(imagers(2), **SCENE)
    assert len(env.observation_space) == 2 and env.seed is not None
    agents = ConstellationTasking(imagers(1), **SCENE)
    assert agents.agents == []
    assert agents.observation_space("EO_1").shape == (6,) and agents.agents == ["EO_1"]
    assert agents.action_space("EO_1") is agents.action_space("EO_1")


def test_no_action_lets_a_satellite_go_on():
    env = constellation(GeneralSatelliteTasking, imagers(2), max_step_duration=30.0)
    env.reset(seed=2)
    env.step([0, 1])
    keys = [item.action_builder.prev_action_key for item in env.satellites]
    env.step([None, 2**31 - 1])
    assert [item.action_builder.prev_action_key for item in env.satellites] == keys
    with pytest.raises(ValueError, match="same number of actions"):
        env.step([0])


def test_environments_can_be_copied_before_a_reset():
    env = constellation(ConstellationTasking, imagers(2))
    other = copy.deepcopy(env)
    first, second = env.reset(seed=6)[0], other.reset(seed=6)[0]
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert env.satellites[0] is not other.satellites[0]
    satellite = pickle.loads(pickle.dumps(Imager("a", IMAGER_ARGS)))
    assert satellite.dyn_type is Imager("b").dyn_type and satellite.observation_builder.satellite is satellite
    parts = (scene.UniformTargets(3), data.ResourceReward(2.0), comm.LOSMultiCommunication(10.0))
    assert pickle.loads(pickle.dumps(parts))[2].min_period == 10.0


def test_environment_copies_its_parts():
    satellite, scenario = Imager("a", IMAGER_ARGS), scene.UniformTargets(300)
    env = SatelliteTasking(satellite, scenario, data.UniqueImageReward(), log_level="ERROR")
    env.reset(seed=1)
    assert env.satellite is not satellite and not hasattr(satellite, "simulator")
    assert scenario.targets == [] and len(env.scenario.targets) == 300


def test_same_seed_gives_the_same_episode_again():
    env = constellation(GeneralSatelliteTasking, imagers(2), comm.FreeCommunication())
    runs = []
    for _ in range(2):
        records = [env.reset(seed=8)[0]]
        records += [env.step([1, 2])[0] for _ in range(5)]
        runs.append(np.array(records))
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(env.reset(seed=9)[0], runs[0][0])
