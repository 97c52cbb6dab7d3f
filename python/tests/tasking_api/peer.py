"""Names of the API that programs use: those of sparring.tasking, or of bsk_rl while numbers are recorded."""

import os

if os.environ.get("TASKING_PEER") == "bsk_rl":
    from Basilisk.architecture import bskLogging, messaging
    from Basilisk.utilities.orbitalMotion import elem2rv, rv2elem
    from bsk_rl import ConstellationTasking, GeneralSatelliteTasking, SatelliteTasking, act, comm, data, obs, sats, scene
    from bsk_rl.data.base import Data, DataStore, GlobalReward
    from bsk_rl.data.unique_image_data import UniqueImageData, UniqueImageReward, UniqueImageStore
    from bsk_rl.scene.targets import Target
    from bsk_rl.sim import dyn, fsw
    from bsk_rl.utils import attitude, functional, orbital
    from bsk_rl.utils.functional import aliveness_checker

    bskLogging.setDefaultLogLevel(bskLogging.BSK_ERROR)
    ROOT_LOGGER = "bsk_rl"
else:
    from sparring.tasking import (
        ConstellationTasking,
        GeneralSatelliteTasking,
        SatelliteTasking,
        act,
        comm,
        data,
        messaging,
        obs,
        sats,
        scene,
    )
    from sparring.tasking.data.base import Data, DataStore, GlobalReward
    from sparring.tasking.data.unique_image_data import UniqueImageData, UniqueImageReward, UniqueImageStore
    from sparring.tasking.scene.targets import Target
    from sparring.tasking.sim import dyn, fsw
    from sparring.tasking.utils import attitude, functional, orbital
    from sparring.tasking.utils.elements import elem2rv, rv2elem
    from sparring.tasking.utils.functional import aliveness_checker

    ROOT_LOGGER = "sparring.tasking"

__all__ = [
    "ROOT_LOGGER",
    "ConstellationTasking",
    "Data",
    "DataStore",
    "GeneralSatelliteTasking",
    "GlobalReward",
    "SatelliteTasking",
    "Target",
    "UniqueImageData",
    "UniqueImageReward",
    "UniqueImageStore",
    "act",
    "aliveness_checker",
    "attitude",
    "comm",
    "data",
    "dyn",
    "elem2rv",
    "fsw",
    "functional",
    "messaging",
    "obs",
    "orbital",
    "rv2elem",
    "sats",
    "scene",
]
