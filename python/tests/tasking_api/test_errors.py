"""Errors of arguments are those of bsk_rl, and parts that are left out say what to use instead."""

import gymnasium
import numpy as np
import pytest
from parts import IMAGER_ARGS, Imager, imagers
from peer import (
    ConstellationTasking,
    GeneralSatelliteTasking,
    SatelliteTasking,
    act,
    comm,
    data,
    dyn,
    fsw,
    messaging,
    obs,
    orbital,
    sats,
    scene,
)

QUIET = {"log_level": "ERROR"}


@pytest.fixture
def env():
    env = SatelliteTasking(Imager("a", IMAGER_ARGS), scene.UniformTargets(800), data.UniqueImageReward(), **QUIET)
    env.reset(seed=1)
    return env


def test_unknown_arguments_are_key_errors():
    with pytest.raises(KeyError, match="foo not a valid key for sat_args"):
        Imager("a", {"foo": 1})
    with pytest.raises(KeyError, match="foo not a valid key for world_args"):
        GeneralSatelliteTasking(Imager("a"), world_args={"foo": 1})
    randomized = SatelliteTasking(Imager("a"), sat_arg_randomizer=lambda items: {items[0]: {"foo": 1}}, **QUIET)
    with pytest.raises(KeyError, match="foo not a valid key for sat_args"):
        randomized.reset(seed=1)


@pytest.mark.parametrize("n_targets", [-4, (3, 3), (-1, 4)])
def test_numbers_of_targets_are_checked(n_targets):
    with pytest.raises(ValueError, match="`n_targets` must be"):
        scene.UniformTargets(n_targets)
    with pytest.raises(ValueError, match="`n_targets` must be"):
        scene.CityTargets(n_targets)


def test_seeds_of_numpys_generator_are_accepted(env):
    with pytest.raises(ValueError, match=r"from 0 to 2\*\*32 - 1, got"):
        env.reset(seed=2**32)
    for seed in (-1, 1.5):
        with pytest.raises(gymnasium.error.Error, match="Seed must be"):
            env.reset(seed=seed)
    assert len(env.reset(seed=2**32 - 1)[0]) == 6


def test_properties_are_checked():
    with pytest.raises(ValueError, match="Invalid property key: x"):
        obs.SatProperties(dict(prop="a", x=1))
    with pytest.raises(ValueError, match="prop=zz is not predefined"):
        obs.OpportunityProperties(dict(prop="zz"), n_ahead_observe=1)

    class Observer(sats.ImagingSatellite):
        observation_spec = [obs.SatProperties(dict(prop="nothing"))]
        action_spec = [act.Drift()]

    with pytest.raises(AttributeError, match="Property nothing not found"):
        SatelliteTasking(Observer("a"), scene.UniformTargets(5), **QUIET).reset(seed=1)


def test_actions_are_checked(env):
    with pytest.raises(ValueError, match="out of range"):
        env.step(77)
    with pytest.raises(ValueError, match="not a known target"):
        env.step("nothing")
    with pytest.raises(ValueError, match="no compatible set_action_override"):
        env.step(2.5)
    with pytest.raises(TypeError, match="Invalid target_query"):
        env.satellite.parse_target_selection(2.5)
    env.step(1)


def test_orbits_are_given_once():
    for args in ({"oe": None}, {"rN": [7e6, 0, 0], "vN": [0, 7500, 0]}):
        with pytest.raises(ValueError, match="over or underspecified"):
            SatelliteTasking(Imager("a", args), **QUIET).reset(seed=1)


def test_models_must_fit_together():
    class Wrong(sats.Satellite):
        observation_spec = [obs.Time()]
        action_spec = [act.Drift(duration=1.0)]
        dyn_type = dyn.BasicDynamicsModel
        fsw_type = fsw.ImagingFSWModel

    with pytest.raises(TypeError, match="must be a subclass of"):
        SatelliteTasking(Wrong("a"), **QUIET).reset(seed=1)

    class Blind(sats.ImagingSatellite):
        observation_spec = [obs.Time()]
        action_spec = [act.Drift(duration=1.0)]

    with pytest.raises(TypeError, match="LOSCommDynModel"):
        GeneralSatelliteTasking([Blind("a"), Blind("b")], communicator=comm.LOSCommunication())
    with pytest.raises(TypeError, match="abstract"):
        sats.Satellite("a")
    with pytest.raises(ValueError, match="single satellite"):
        SatelliteTasking(imagers(2))


def test_nothing_in_view_is_the_peers_error():
    args = {"initial_generation_duration": 600.0, "max_generation_duration_beyond_initial": 600.0}
    env = SatelliteTasking(Imager("a", IMAGER_ARGS, **args), scene.UniformTargets(1), **QUIET)
    with pytest.raises(RuntimeError, match="No opportunities found"):
        env.reset(seed=1)


@pytest.mark.parametrize(
    ("module", "name"),
    [
        (act, "ImpulsiveThrust"),
        (act, "ImpulsiveThrustHill"),
        (act, "AttitudeSetpoint"),
        (act, "ImageRSO"),
        (data, "MixedReward"),
        (data, "RSOInspectionReward"),
        (dyn, "ConjunctionDynModel"),
        (dyn, "MaxRangeDynModel"),
        (dyn, "RSODynModel"),
        (fsw, "MagicOrbitalManeuverFSWModel"),
        (fsw, "RSOInspectorFSWModel"),
        (messaging, "CSSArraySensorMsgPayload"),
        (obs, "RelativeProperties"),
        (scene, "MixedScenario"),
        (scene, "SphericalRSO"),
    ],
)
def test_names_that_are_left_out_say_so(module, name):
    with pytest.raises(NotImplementedError, match=r"is not supported; .*\.$"):
        getattr(module, name)
    with pytest.raises(AttributeError):
        _ = module.Nothing


class NewSoftware(fsw.SteeringImagerFSWModel):
    @fsw.action
    def action_new(self):
        """Does what no other action does."""


class NewDynamics(dyn.FullFeaturedDynModel):
    def setup_something(self):
        """Sets up a module of Basilisk."""


class NewAction(act.DiscreteAction):
    def set_action(self, action, prev_action_key=None):
        self.satellite.fsw.action_charge()
        return self.name


@pytest.mark.parametrize("members", [{"fsw_type": NewSoftware}, {"dyn_type": NewDynamics}, {"action_spec": [NewAction()]}])
def test_parts_of_basilisk_cannot_be_added(members):
    with pytest.raises(NotImplementedError, match="is not supported; "):
        type("Changed", (Imager,), members)("a")


def test_own_communication_methods_are_left_out():
    class Own(comm.CommunicationMethod):
        def communication_pairs(self):
            return []

    with pytest.raises(NotImplementedError, match="compose the classes in `comm`"):
        Own()
    with pytest.raises(NotImplementedError, match="meta_agent_groupings"):
        ConstellationTasking(imagers(1), meta_agent_groupings={"a": ["EO_1"]})


def test_objects_of_basilisk_are_left_out(env):
    with pytest.raises(NotImplementedError, match="createNewEvent"):
        env.simulator.createNewEvent("name")
    with pytest.raises(NotImplementedError, match="Recording messages"):
        env.satellite.dynamics.scObject.scStateOutMsg.recorder()
    with pytest.raises(NotImplementedError, match="direct call of action_charge"):
        env.satellite.fsw.action_charge()
    with pytest.raises(NotImplementedError, match="TrajectorySimulator"):
        orbital.TrajectorySimulator("2018 SEP 29 21:00:00.000 (UTC)")
    with pytest.raises(NotImplementedError, match="next_eclipse at another time"):
        env.satellite.trajectory.next_eclipse(1e3)
    with pytest.raises(NotImplementedError, match="Opportunities of type 'ship'"):
        env.satellite.add_location_for_access_checking(object="x", r_LP_P=np.zeros(3), min_elev=0.1, type="ship")


def test_vizard_is_ignored_with_a_warning(capsys):
    SatelliteTasking(Imager("a"), vizard_dir="/nowhere", vizard_settings={"x": 1})
    assert "Vizard is not supported" in capsys.readouterr().err
