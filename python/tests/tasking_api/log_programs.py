"""Programs whose log lines are compared."""

from __future__ import annotations

import contextlib
import io
import logging
import re

import numpy as np
from parts import IMAGER_ARGS, SCANNER_ARGS, Imager, Scanner, constellation, fly, imagers, train
from peer import (
    ROOT_LOGGER,
    ConstellationTasking,
    GeneralSatelliteTasking,
    SatelliteTasking,
    act,
    comm,
    data,
    dyn,
    fsw,
    sats,
    scene,
)


def quiet_environment(kind, satellites, *args, **settings):
    """Returns an environment of imagers that logs at the level INFO."""
    env = constellation(kind, satellites, *args, **settings)
    logging.getLogger(ROOT_LOGGER).setLevel("INFO")
    return env


def imaging_log():
    env = quiet_environment(GeneralSatelliteTasking, imagers(3), comm.LOSCommunication(), sat_arg_randomizer=train())
    fly(env, 3, 6)
    target = env.satellites[0].find_next_opportunities(3, types="target")[-1]["object"]
    env.step([None, None, None])
    env.step([target, None, None])


def dying_log():
    class Mortal(sats.ImagingSatellite):
        observation_spec = Imager.observation_spec
        action_spec = [act.Image(n_ahead_image=3, max_duration=50.0), act.Broadcast(duration=30.0), act.Charge(duration=40.0)]
        dyn_type = dyn.FullFeaturedDynModel
        fsw_type = fsw.SteeringImagerFSWModel

    args = {"batteryStorageCapacity": 3e4, "basePowerDraw": -40.0, "storedCharge_Init": lambda: np.random.uniform(1e4, 3e4)}
    time = data.ResourceReward(0.1, lambda item: item.simulator.sim_time)
    env = quiet_environment(
        ConstellationTasking,
        imagers(3, Mortal, **args),
        comm.FreeCommunication(),
        targets=(700, 800),
        rewarder=(data.UniqueImageReward(), time),
        time_limit=900.0,
        max_step_duration=33.0,
    )
    fly(env, 3, 30)


def scanning_log():
    env = SatelliteTasking(
        Scanner("S", SCANNER_ARGS),
        scenario=scene.UniformNadirScanning(),
        rewarder=data.ScanningTimeReward(),
        time_limit=1500.0,
        log_level="INFO",
    )
    fly(env, 3, 12)


def warnings_log():
    args = {"storedCharge_Init": 2e6, "basePowerDraw": 5.0, "transmitterBaudRate": 9.0, "storageInit": 5e12}
    satellites = [Imager("a", IMAGER_ARGS | args | {"maxWheelSpeed": 100.0}) for _ in range(2)]
    env = quiet_environment(GeneralSatelliteTasking, satellites, targets=3000)
    fly(env, 3, 2)


def simultaneous_log():
    """Actions of several satellites end at the same times."""

    class Busy(sats.ImagingSatellite):
        observation_spec = Imager.observation_spec
        action_spec = [
            act.Charge(duration=120.0),
            act.Downlink(duration=80.0),
            act.Desat(duration=40.0),
            act.Image(n_ahead_image=1, max_duration=40.0),
        ]
        dyn_type = dyn.FullFeaturedDynModel
        fsw_type = fsw.SteeringImagerFSWModel

    fly(quiet_environment(ConstellationTasking, imagers(4, Busy), comm.FreeCommunication()), 5, 40)


def windows_log():
    """Windows are computed for a long time at once, and padded."""
    env = quiet_environment(GeneralSatelliteTasking, imagers(1), targets=300)
    env.reset(seed=3)
    env.satellites[0].calculate_additional_windows(2000.0)
    env.satellites[0].find_next_opportunities(20, types="target", max_lookahead=3)


LOG_PROGRAMS = [imaging_log, dying_log, scanning_log, warnings_log, simultaneous_log, windows_log]


def log_lines(program):
    """Returns the log lines that a program prints, without the time of day, ids and names of packages."""
    stream = io.StringIO()
    with contextlib.redirect_stderr(stream):
        program()
    logging.getLogger(ROOT_LOGGER).setLevel("CRITICAL")
    lines = [re.sub(r"\d{4}-\d\d-\d\d [\d:,]+ ", "", line) for line in stream.getvalue().splitlines()]
    lines = [line.replace(ROOT_LOGGER, "PACKAGE") for line in lines]
    return [line for line in lines if "Creating logger" not in line]
