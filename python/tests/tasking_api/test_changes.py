"""Changes that the compiled simulation would not see are errors, and wrong arguments raise the peer's errors."""

import gc
import weakref

import numpy as np
import pytest
from parts import IMAGER_ARGS, Imager, constellation, imagers
from peer import (
    ConstellationTasking,
    Data,
    DataStore,
    GeneralSatelliteTasking,
    GlobalReward,
    SatelliteTasking,
    Target,
    act,
    comm,
    data,
    dyn,
    fsw,
    obs,
    sats,
    scene,
)

QUIET = {"log_level": "CRITICAL"}


@pytest.fixture
def env():
    env = constellation(GeneralSatelliteTasking, imagers(1), max_step_duration=50.0)
    env.reset(seed=1)
    return env


def observer(*items):
    """Returns a class of imagers with observations."""
    return type("Observer", (Imager,), {"observation_spec": list(items)})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("simulator.max_step_duration", 10.0),
        ("simulator.time_limit", 10.0),
        ("satellites[0].dynamics.maxWheelSpeed", 10.0),
        ("satellites[0].dynamics.min_orbital_radius", 7e6),
        ("satellites[0].dynamics.storageUnitValidCheck", True),
        ("satellites[0].dynamics.basePowerSink.nodePowerOut", -1.0),
        ("satellites[0].dynamics.powerMonitor.storageCapacity", 1.0),
        ("satellites[0].dynamics.scObject.hub.mHub", 1.0),
        ("satellites[0].fsw.locPoint.pHat_B", [1, 0, 0]),
    ],
)
def test_parameters_of_a_started_simulation_are_fixed(env, path, value):
    owner, _, name = path.rpartition(".")
    with pytest.raises(NotImplementedError, match=f"A change of {name} in an episode is not supported"):
        setattr(eval(f"env.{owner}", {"env": env}), name, value)


def test_wheels_and_stations_are_fixed(env):
    dynamics = env.satellites[0].dynamics
    for item, name in ((dynamics.rwFactory.rwList["RW1"], "u_max"), (dynamics.world.groundStations[0], "height_m")):
        with pytest.raises(AttributeError, match="cannot assign"):
            setattr(item, name, 0.0)
    assert dynamics.rwFactory.rwList["RW2"].u_max == IMAGER_ARGS["u_max"]


def test_durations_of_actions_are_those_of_the_start():
    class Busy(Imager):
        action_spec = [act.Charge(duration=20.0), act.Image(2, max_duration=20.0), act.Broadcast(duration=20.0)]

    env = SatelliteTasking(Busy("a", IMAGER_ARGS), scene.UniformTargets(800), data.UniqueImageReward(), **QUIET)
    env.reset(seed=1)
    charge, image, broadcast = env.satellite.action_builder.action_spec
    charge.duration, image.max_duration, broadcast.duration = 30.0, 30.0, 30.0
    for action in (0, 1, 3):
        with pytest.raises(NotImplementedError, match="A duration that changes in an episode"):
            env.step(action)
    env.reset(seed=1)
    assert env.step(0)[4]["d_ts"] == pytest.approx(30.0)


class Placed(scene.UniformTargets):
    """Targets that are added to the access checks with settings of their own."""

    def __init__(self, **settings):
        super().__init__(300)
        self.settings = settings

    def reset_pre_sim_init(self):
        self.n_targets = 300
        self.regenerate_targets()
        for target in self.targets:
            settings = {"object": target, "r_LP_P": target.r_LP_P, "min_elev": np.radians(45.0), "type": "target"}
            self.satellites[0].add_location_for_access_checking(**(settings | self.settings))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"object": "one"}, "at several places"),
        ({"object": "one", "r_LP_P": np.ones(3)}, "A target that is added twice"),
        ({"min_elev": 0.5}, "A minimum elevation of a target other than"),
        ({"start_time": 60.0}, "start_time of a target"),
        ({"type": "ship"}, "Opportunities of type 'ship'"),
    ],
)
def test_targets_with_settings_of_their_own_are_left_out(settings, message):
    env = constellation(GeneralSatelliteTasking, imagers(1), scenario=Placed(**settings))
    with pytest.raises(NotImplementedError, match=message):
        env.reset(seed=1)


def test_targets_stay_where_they_are(env):
    satellite = env.satellites[0]
    with pytest.raises(NotImplementedError, match="A location that is added after the start"):
        satellite.add_location_for_access_checking(object="x", r_LP_P=np.ones(3), min_elev=0.8, type="target")
    target = satellite.find_next_opportunities(1, types="target")[0]["object"]
    target.r_LP_P = target.r_LP_P + 1.0
    with pytest.raises(NotImplementedError, match="A target that moves in an episode"):
        env.step([target])
    with pytest.raises(ValueError, match="not a target of the satellite"):
        env.step([Target("x", [1, 2, 3], 1.0)])


@pytest.mark.parametrize("cls", [Data, DataStore, GlobalReward, obs.Observation, act.Action, act.DiscreteAction])
def test_bases_are_abstract(cls):
    with pytest.raises(TypeError, match="abstract"):
        cls()
    with pytest.raises(TypeError, match="abstract"):
        comm.CommunicationMethod()


@pytest.mark.parametrize("action", [-1, -2, -(2**63), np.int64(-5)])
def test_negative_actions_are_index_errors(env, action):
    with pytest.raises(IndexError):
        env.step([action])
    assert env.step([0])[4]["d_ts"] > 0.0


def test_agents_are_checked():
    env = constellation(ConstellationTasking, imagers(1))
    env.reset(seed=1)
    with pytest.raises(AttributeError):
        env.step([0])
    with pytest.raises(KeyError):
        env.step({"unknown": 0})
    for space in (env.observation_space, env.action_space):
        with pytest.raises(KeyError):
            space("unknown")


def test_numbers_of_opportunities_are_checked(env):
    satellite = env.satellites[0]
    assert len(satellite.find_next_opportunities(-1, types="target")) == 1
    assert len(satellite.find_next_opportunities(1.5, types="target")) == 2
    with pytest.raises(TypeError):
        satellite.find_next_opportunities("x", types="target")
    many = observer(obs.OpportunityProperties(dict(prop="priority"), n_ahead_observe=10**20))
    with pytest.raises((OverflowError, MemoryError)):
        constellation(GeneralSatelliteTasking, imagers(1, many), time_limit=900.0).reset(seed=1)


@pytest.mark.parametrize(
    "item",
    [
        obs.Time(norm=0.0),
        obs.OpportunityProperties(dict(prop="priority", norm=0), n_ahead_observe=1),
        obs.SatProperties(dict(prop="battery_charge_fraction", norm=0.0)),
    ],
)
def test_division_by_zero_is_pythons_error(item):
    with pytest.raises(ZeroDivisionError):
        constellation(GeneralSatelliteTasking, imagers(1, observer(item))).reset(seed=1)


def test_arguments_that_are_no_numbers_are_named():
    for args, error in (({"u_max": float("nan")}, ValueError), ({"u_max": object()}, TypeError)):
        with pytest.raises(error, match="`u_max` must be a number"):
            constellation(GeneralSatelliteTasking, imagers(1, **args)).reset(seed=1)
    for name in ("failure_penalty", "max_step_duration"):
        env = constellation(GeneralSatelliteTasking, imagers(1), **{name: float("nan")})
        if name == "failure_penalty":
            assert env.reset(seed=1)
        else:
            with pytest.raises(ValueError, match="`max_step_duration` must be a number"):
                env.reset(seed=1)


def test_no_rewarders_pay_nothing():
    env = constellation(GeneralSatelliteTasking, imagers(1), rewarder=(), max_step_duration=20.0)
    env.reset(seed=1)
    assert env.step([0])[1] == 0 and env.rewarder.rewarders == ()


def test_messages_are_payloads(env):
    with pytest.raises(TypeError, match="A message has a payload"):
        env.satellites[0].dynamics.powerMonitor.batPowerOutMsg.write(5)


def test_environments_can_be_closed_twice_and_used_again(env):
    env.close()
    env.close()
    with pytest.raises(AttributeError):
        env.step([0])
    assert env.reset(seed=2)[0][0].shape == (6,)


def test_simulations_of_earlier_episodes_are_freed(env):
    first = weakref.ref(env.simulator)
    env.reset(seed=2)
    gc.collect()
    assert first() is None


def test_scenario_with_a_platform_needs_no_targets():
    class Platform(sats.Satellite):
        observation_spec = [obs.Time(norm=1.0)]
        action_spec = [act.Charge(duration=20.0)]
        dyn_type = dyn.ImagingDynModel
        fsw_type = fsw.ImagingFSWModel

    env = SatelliteTasking(Platform("a"), scene.UniformTargets(50), **QUIET)
    env.reset(seed=1)
    assert env.step(0)[4]["d_ts"] == 20.0


def test_new_targets_are_no_changes_of_others(env):
    target = env.scenario.targets[0]
    before = Target.changes
    Target("x", [1, 2, 3], 0.5)
    assert Target.changes == before
    target.priority = 0.5
    assert Target.changes == before + 1
