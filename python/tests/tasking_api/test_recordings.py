"""Seeds draw the recorded episodes of bsk_rl, and stepping them returns what was recorded."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from parts import IMAGER_ARGS, SCANNER_ARGS, Imager, Scanner, imagers, train
from peer import ConstellationTasking, GeneralSatelliteTasking, SatelliteTasking, comm, data, orbital, scene
from recorded import names, read, recorder, without_trace

#: Largest difference of drawn numbers, relative to numbers above 1, and of positions of targets in m.
DRAWN, PLACED_M = 1e-12, 1e-6
#: Largest differences of a run: wheels in rad/s, other numbers relative to numbers above 1.
WHEELS_RAD_S, RUN = 0.02, 1e-4
DRAWN_ARGS = ("oe", "sigma_init", "omega_init", "wheelSpeeds", "storedCharge_Init", "storageInit", "disturbance_vector")
#: Recorded episodes that are run to their end.
EPISODES = (
    "los_multi",
    "broadcast",
    "heterogeneous",
    "deaths_constellation",
    "deaths_general",
    "resource_reward",
    "drift",
    "rate_five_scan",
    "bare_models",
    "basic_on_scanner",
    "basic_on_imager",
    "imager_software_on_scanner",
)
REFERENCE_ARGS = {"batteryStorageCapacity": 1e9, "storedCharge_Init": 1e9}


@pytest.fixture(scope="module")
def tools():
    with recorder() as modules:
        yield modules


def close(expected, got, tolerance):
    if isinstance(expected, dict) and isinstance(got, dict):
        return expected.keys() == got.keys() and all(close(expected[key], got[key], tolerance) for key in expected)
    if isinstance(expected, list) and isinstance(got, list):
        return len(expected) == len(got) and all(close(a, b, tolerance) for a, b in zip(expected, got, strict=True))
    is_number = isinstance(expected, (int, float)) and not isinstance(expected, bool)
    if is_number and isinstance(got, (int, float)):
        return math.isclose(expected, got, rel_tol=tolerance, abs_tol=tolerance)
    return expected == got


@pytest.mark.parametrize("name", names("recorded"))
def test_seed_draws_the_recorded_episode(name, tools):
    recording = read("recorded", name)
    env = tools.components.build_environment(without_trace(tools.episodes[name]))
    env.reset(seed=recording["seed"])
    assert close(recording["world_args"], tools.plain(env.world_args), DRAWN)
    for expected, satellite in zip(recording["satellites"], env.satellites, strict=True):
        assert list(expected["sat_args"]) == list(satellite.sat_args)
        assert close(expected["sat_args"], tools.plain(satellite.sat_args), DRAWN)
    targets = getattr(env.scenario, "targets", [])
    assert [item["name"] for item in recording["targets"]] == [target.name for target in targets]
    for expected, target in zip(recording["targets"], targets, strict=True):
        assert np.abs(np.array(expected["r_LP_P_m"]) - target.r_LP_P).max() < PLACED_M
        assert expected["priority"] == pytest.approx(target.priority, abs=DRAWN)


def reference_environment(name):
    """Returns the environment of a reference recording: a for scanning, b for imaging by three satellites."""
    if name.startswith("a_"):
        args = SCANNER_ARGS | {"storageInit": lambda: np.random.uniform(0.0, 0.8) * 5000 * 8e6}
        scanning = {"scenario": scene.UniformNadirScanning(1 / 28500), "rewarder": data.ScanningTimeReward()}
        return SatelliteTasking(Scanner("Scanner_1", args), time_limit=28500.0, log_level="CRITICAL", **scanning)
    kind = ConstellationTasking if "pz" in name else GeneralSatelliteTasking
    return kind(
        imagers(3, **REFERENCE_ARGS),
        scenario=scene.UniformTargets(1000),
        rewarder=data.UniqueImageReward(),
        communicator=comm.LOSCommunication(),
        sat_arg_randomizer=train(20.0 if "los" in name else None),
        log_level="CRITICAL",
    )


@pytest.mark.parametrize("name", names("reference"))
def test_seed_draws_the_reference_episode(name, tools):
    recording = read("reference", name)
    env = reference_environment(name)
    env.reset(seed=recording["seed"])
    assert recording["initial"]["utc_init"] == env.world_args["utc_init"]
    realized = recording["sat_args_realized"]
    for satellite in env.satellites:
        expected = realized.get(satellite.name, realized)
        for key in set(DRAWN_ARGS) & set(satellite.sat_args):
            assert close(expected[key], tools.plain(satellite.sat_args[key]), DRAWN), key
    for expected, target in zip(
        recording.get("targets", []), getattr(env.scenario, "targets", []), strict="targets" in recording
    ):
        assert np.abs(np.array(expected["r_LP_P_m"]) - target.r_LP_P).max() < PLACED_M


@pytest.mark.parametrize("name", EPISODES)
def test_stepping_returns_what_was_recorded(name, tools, monkeypatch):
    recording = read("recorded", name)
    monkeypatch.setattr(tools.run, "version", lambda package: "")
    got = json.loads(json.dumps(tools.plain(tools.run.record(without_trace(tools.episodes[name])))))
    assert got["initial"].keys() == recording["initial"].keys()
    assert len(got["steps"]) == len(recording["steps"])
    for expected, step in zip(recording["steps"], got["steps"], strict=True):
        for state in (expected["states"], step["states"]):
            for values in state.values():
                values["wheel_speeds_rad_s"] = [WHEELS_RAD_S * round(x / WHEELS_RAD_S / 10) for x in values["wheel_speeds_rad_s"]]
        for key in expected:
            assert close(expected[key], step[key], RUN), (expected["t_start"], key)


def test_default_arguments_are_those_of_the_peer(tools):
    recording = read("reference", "b_gym_seed0")
    defaults = {
        key: value
        for key, value in recording["sat_args_defaults"].items()
        if not (isinstance(value, str) and value.startswith("<callable"))
    }
    own = tools.plain({key: value for key, value in Imager.default_sat_args().items() if not callable(value)})
    assert own == defaults
    assert [key for key in Imager.default_sat_args() if callable(Imager.default_sat_args()[key])] == [
        key for key in recording["sat_args_defaults"] if key not in defaults
    ]
    assert Imager.default_sat_args()["oe"] is orbital.random_orbit
    assert Imager("x", IMAGER_ARGS).sat_args_generator["u_max"] == 0.4
