"""Names of satellites, arguments, descriptions and the form of observations."""

import io
from contextlib import redirect_stderr

import numpy as np
import pytest
from parts import IMAGER_ARGS, Imager, constellation, imagers
from peer import ConstellationTasking, GeneralSatelliteTasking, SatelliteTasking, act, data, dyn, fsw, obs, sats, scene

QUIET = {"log_level": "ERROR"}


def test_names_with_a_hyphen_work():
    env = ConstellationTasking([Imager("EO-1", IMAGER_ARGS), Imager("EO-2", IMAGER_ARGS)], scene.UniformTargets(800), **QUIET)
    observation, _ = env.reset(seed=1)
    assert list(observation) == ["EO-1", "EO-2"] == env.agents
    assert env.step({"EO-1": 0, "EO-2": 1})[4]["EO-1"].keys() == {"requires_retasking", "d_ts"}
    with pytest.raises(ValueError, match="nonempty string"):
        Imager("")


def test_equal_names_are_numbered():
    lines = io.StringIO()
    with redirect_stderr(lines):
        env = GeneralSatelliteTasking([Imager("a"), Imager("a"), Imager("b")])
    assert [item.name for item in env.satellites] == ["a_0", "a_1", "b"]
    assert "Renaming satellite a to a_0" in lines.getvalue()
    assert env.get_satellite("a_1") is env.satellites[1]
    with pytest.raises(ValueError, match="'c' not found"):
        env.get_satellite("c")


def test_arguments_are_drawn_at_each_reset():
    env = SatelliteTasking(
        Imager("a", IMAGER_ARGS | {"mass": lambda: np.random.uniform(300, 360)}), **QUIET, scenario=scene.UniformTargets(900)
    )
    masses = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        masses.append(env.satellite.sat_args["mass"])
    assert masses[0] == masses[2] != masses[1]
    assert env.satellite.sat_args["bufferNames"] == ["image_buffer"]


@pytest.mark.parametrize("kind", [np.ndarray, list, dict])
def test_observation_has_the_wanted_form(kind):
    env = SatelliteTasking(Imager("a", IMAGER_ARGS, obs_type=kind), scene.UniformTargets(900), **QUIET)
    observation, _ = env.reset(seed=3)
    assert type(observation) is kind
    if kind is dict:
        assert list(observation["target"]) == ["target_0", "target_1", "target_2"]
        assert env.observation_space["target"]["target_0"]["priority"].shape == (1,)
    else:
        assert len(observation) == 6 and env.observation_space.shape == (6,)


def test_descriptions_name_values_and_actions():
    class Described(sats.ImagingSatellite):
        observation_spec = [obs.Time(), obs.Time(), obs.SatProperties(dict(prop="c_hat_P", norm=2.0))]
        action_spec = [act.Charge(duration=1.0, name="sun"), act.Image(n_ahead_image=2), act.Drift()]

    env = SatelliteTasking(Described("a"), scene.UniformTargets(900), **QUIET)
    env.reset(seed=1)
    values = [f"sat_props.c_hat_P_normd[{axis}]" for axis in range(3)]
    assert env.satellite.observation_description == ["time", "time_2", *values]
    assert env.satellite.action_description == ["sun", "action_image_0", "action_image_1", "action_drift"]


def test_last_property_of_equal_names_is_observed():
    class Observer(sats.ImagingSatellite):
        observation_spec = [
            obs.SatProperties(
                dict(prop="battery_charge_fraction", name="x"), dict(prop="altitude", name="x", fn=lambda item: 2.0)
            )
        ]
        action_spec = [act.Drift()]

    env = SatelliteTasking(Observer("a"), scene.UniformTargets(10), **QUIET)
    assert env.reset(seed=1)[0].tolist() == [2.0]


def test_models_of_a_subclass_replace_those_of_its_base():
    class Slower(Imager):
        fsw_type = fsw.ImagingFSWModel
        dyn_type = dyn.ImagingDynModel

    assert issubclass(Imager("a").fsw_type, fsw.SteeringFSWModel)
    assert not issubclass(Slower("b").fsw_type, fsw.SteeringFSWModel)
    assert "K1" not in Slower.default_sat_args() and "K" in Slower.default_sat_args()


def test_filters_of_one_episode_do_not_stay_for_the_next():
    env = SatelliteTasking(Imager("a", IMAGER_ARGS), scene.UniformTargets(900), data.UniqueImageReward(), **QUIET)
    for seed in (1, 2):
        env.reset(seed=seed)
        env.step(0)
    assert env.satellite.access_filter_functions == []
    imaged = env.satellite.data_store.data.imaged
    hidden = [item["object"] for item in env.satellite.find_next_opportunities(50, types="target")]
    assert not imaged & set(hidden)


def test_is_alive_of_one_satellite_can_be_replaced():
    env = constellation(GeneralSatelliteTasking, imagers(2), failure_penalty=-2.0)
    env.reset(seed=3)
    env.step([0, 1])
    env.satellites[0].is_alive = lambda log_failure=False: False
    _, reward, terminated, truncated, info = env.step([1, 2])
    assert reward <= -1.0 and terminated and not truncated
    assert info["d_ts"] > 0.0
