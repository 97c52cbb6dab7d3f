"""Vector environments of composed satellites return what single ones return."""

import logging

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from parts import IMAGER_ARGS, SCANNER_ARGS, Imager, Scanner, imagers
from peer import GeneralSatelliteTasking, SatelliteTasking, Target, aliveness_checker, comm, data, obs, scene

import sparring
from sparring.tasking.vector import GO_ON, TaskingVectorEnv

QUIET = {"log_level": "ERROR"}
ENVS = 3


def scanning(limit=2000.0):
    """Returns a satellite and the other arguments of a scanning environment."""
    return Scanner("S", SCANNER_ARGS), {
        "scenario": scene.UniformNadirScanning(1 / 2000.0),
        "rewarder": data.ScanningTimeReward(),
        "time_limit": limit,
        **QUIET,
    }


def imaging(limit=900.0):
    """Returns satellites that share data, and the other arguments of their environment."""
    return imagers(2), {
        "scenario": scene.UniformTargets(700),
        "rewarder": (data.UniqueImageReward(), data.NoReward()),
        "communicator": comm.LOSCommunication(),
        "time_limit": limit,
        **QUIET,
    }


def equal(first, second):
    """Returns whether two observations or spaces of arrays are equal to the bit."""
    if isinstance(first, tuple):
        return all(equal(a, b) for a, b in zip(first, second, strict=True))
    return np.array_equal(first, second)


@pytest.mark.parametrize("make", [scanning, imaging])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_first_episodes_are_those_of_single_environments(make, mode):
    satellites, arguments = make()
    envs = sparring.make_vec(satellites=satellites, num_envs=ENVS, autoreset_mode=mode, threads=1, **arguments)
    kind = SatelliteTasking if make is scanning else GeneralSatelliteTasking
    singles = SyncVectorEnv([lambda: kind(satellites, **arguments)] * ENVS, autoreset_mode=mode)
    assert isinstance(envs, TaskingVectorEnv)
    assert envs.observation_space == singles.observation_space and envs.action_space == singles.action_space
    observations, infos = envs.reset(seed=21)
    assert equal(observations, singles.reset(seed=21)[0])
    assert infos["requires_retasking"].all() and not infos["d_ts"].any()
    envs.action_space.seed(1)
    for _ in range(300):
        actions = envs.action_space.sample()
        got, expected = envs.step(actions), singles.step(actions)
        ended = got[2] | got[3]
        assert all(np.array_equal(got[part], expected[part]) for part in (1, 2, 3))
        assert np.array_equal(got[4]["d_ts"], expected[4]["d_ts"]) or ended.any()
        if ended.any():
            break
        assert equal(got[0], expected[0])
    assert ended.any()
    if mode == AutoresetMode.SAME_STEP:
        env = int(np.argmax(ended))
        assert equal(got[4]["final_obs"][env], expected[4]["final_obs"][env])


def run(seed, steps, **arguments):
    """Returns the results of some steps with the first action, through the ends of episodes."""
    satellite, others = scanning(600.0)
    envs = sparring.make_vec(satellites=satellite, num_envs=ENVS, **others, **arguments)
    envs.reset(seed=seed)
    return [envs.step(np.zeros(ENVS, int))[:4] for _ in range(steps)]


def test_later_episodes_follow_from_the_seed():
    first, second, other = run(3, 12), run(3, 12), run(4, 12)
    assert all(equal(a, b) for a, b in zip(first, second, strict=True))
    assert not all(equal(a, b) for a, b in zip(first[-3:], other[-3:], strict=True))
    truncations = [step[3].all() for step in first]
    assert truncations[3] and not truncations[4], "the step after the last one begins an episode"


def test_disabled_autoreset_waits_for_a_reset():
    satellite, arguments = scanning(300.0)
    envs = sparring.make_vec(satellites=satellite, num_envs=ENVS, autoreset_mode="disabled", **arguments)
    with pytest.raises(ResetNeeded, match="environment 0"):
        envs.step(np.zeros(ENVS, int))
    envs.reset(seed=1)
    envs.step(np.zeros(ENVS, int))
    assert envs.step(np.zeros(ENVS, int))[3].all()
    with pytest.raises(ResetNeeded):
        envs.step(np.zeros(ENVS, int))
    envs.reset(options={"reset_mask": np.array([True, True, False])})
    with pytest.raises(ResetNeeded, match="environment 2"):
        envs.step(np.zeros(ENVS, int))


def test_satellites_go_on_without_an_action():
    satellites, arguments = imaging()
    envs = sparring.make_vec(satellites=satellites, num_envs=1, **arguments)
    envs.reset(seed=2)
    _, _, _, _, infos = envs.step((np.array([0]), np.array([1])))
    busy = ~infos["requires_retasking"][0]
    assert busy.sum() == 1
    actions = tuple(np.array([GO_ON if is_busy else 2]) for is_busy in busy)
    assert envs.step(actions)[4]["d_ts"][0] > 0.0


def test_wrong_actions_change_nothing():
    satellite, arguments = scanning()
    envs, control = (sparring.make_vec(satellites=satellite, num_envs=ENVS, **arguments) for _ in range(2))
    for item in (envs, control):
        item.reset(seed=1)
    for actions in (np.array([0, 1, 4]), np.array([0, -2, 1]), np.zeros(2, int), np.zeros(ENVS)):
        with pytest.raises(ValueError, match="`actions` must be"):
            envs.step(actions)
    assert equal(envs.step(np.ones(ENVS, int))[:4], control.step(np.ones(ENVS, int))[:4])


def test_invalid_arguments_name_their_field():
    satellite, arguments = scanning()
    with pytest.raises(ValueError, match="`task` must be None"):
        sparring.make_vec("tasking/scanning", satellites=satellite)
    with pytest.raises(ValueError, match="`num_envs` must be at least 1"):
        sparring.make_vec(satellites=satellite, num_envs=0, **arguments)
    with pytest.raises(TypeError, match="unexpected keyword argument 'scenario'"):
        sparring.make_vec("kessler/survival", scenario=None)
    envs = sparring.make_vec(satellites=satellite, num_envs=ENVS, **arguments)
    with pytest.raises(ValueError, match="`seed` must be"):
        envs.reset(seed=[1, 2])
    with pytest.raises(ValueError, match=r"`options\.reset_mask` must be"):
        envs.reset(options={"reset_mask": [True] * ENVS})


class Watched(Scanner):
    observation_spec = [obs.SatProperties(dict(prop="now", fn=lambda satellite: satellite.simulator.sim_time))]


class Fragile(Scanner):
    class Dynamics(Scanner.dyn_type):
        @aliveness_checker
        def lives(self):
            """Returns that the satellite lives."""
            return True

    dyn_type = Dynamics


class Listening(Scanner):
    def on_timed_end(self, is_missed=False):
        """Passes the end of an action on."""
        super().on_timed_end(is_missed)


@pytest.mark.parametrize(
    ("satellite", "part"),
    [
        (Watched("a", SCANNER_ARGS), "an observation of a"),
        (Fragile("b", SCANNER_ARGS), "an aliveness checker"),
        (Listening("c", SCANNER_ARGS), "Listening.on_timed_end of c"),
        (Scanner("d", SCANNER_ARGS, obs_type=list), "observations that are no arrays"),
    ],
)
def test_parts_in_python_step_one_by_one(satellite, part, caplog):
    _, arguments = scanning()
    arguments["log_level"] = "INFO"
    with caplog.at_level(logging.INFO, logger="sparring.tasking"):
        envs = sparring.make_vec(satellites=satellite, num_envs=2, **arguments)
    assert isinstance(envs, SyncVectorEnv)
    assert part in caplog.text
    envs.reset(seed=1)
    assert envs.step(np.zeros(2, int))[4]["d_ts"].tolist() == [180.0, 180.0]
    envs.close()


def test_own_reward_runs_in_python():
    _, arguments = scanning()
    arguments["rewarder"] = data.ScanningTimeReward(reward_fn=lambda time: -time)
    envs = sparring.make_vec(satellites=Scanner("S", SCANNER_ARGS), num_envs=1, **arguments)
    envs.reset(seed=1)
    assert sum(float(envs.step(np.zeros(1, int))[1][0]) for _ in range(4)) < 0.0


class Divided(scene.UniformTargets):
    """Scenario that adds its targets to the access checks itself."""

    def reset_pre_sim_init(self):
        super().reset_pre_sim_init()


class Ranked(Target):
    """Target whose priority is computed."""

    @property
    def priority(self):
        return 1.0 / (1.0 + self.rank)

    @priority.setter
    def priority(self, value):
        self.rank = value


class Ranking(scene.UniformTargets):
    def regenerate_targets(self):
        super().regenerate_targets()
        self.targets = [Ranked(target.name, target.r_LP_P, target.priority) for target in self.targets]


@pytest.mark.parametrize("changed", [{"scenario": Divided(700)}, {"failure_penalty": float("nan")}])
def test_targets_and_penalties_of_python_step_one_by_one(changed):
    satellites, arguments = imaging()
    assert isinstance(sparring.make_vec(satellites=satellites, num_envs=2, **(arguments | changed)), SyncVectorEnv)


def test_own_classes_of_targets_are_left_out():
    satellites, arguments = imaging()
    with pytest.raises(NotImplementedError, match="SyncVectorEnv"):
        sparring.make_vec(satellites=satellites, num_envs=2, **(arguments | {"scenario": Ranking(700)})).reset(seed=1)


def test_threads_do_not_change_results():
    satellite, arguments = scanning(600.0)
    count = 130
    results = []
    for threads in (1, 2):
        envs = sparring.make_vec(satellites=satellite, num_envs=count, threads=threads, **arguments)
        assert envs.threads == threads
        envs.reset(seed=9)
        results.append([envs.step(np.arange(count) % 4)[:4] for _ in range(4)])
    assert all(equal(a, b) for a, b in zip(*results, strict=True))


def test_imager_alone_has_arrays():
    envs = sparring.make_vec(
        satellites=Imager("a", IMAGER_ARGS),
        num_envs=2,
        scenario=scene.UniformTargets(700),
        rewarder=data.UniqueImageReward(),
        time_limit=600.0,
        **QUIET,
    )
    assert isinstance(envs.action_space, gymnasium.spaces.MultiDiscrete)
    assert envs.reset(seed=1)[0].shape == (2, 6)
