"""BSK-RL's Python API on the compiled simulation of the world `tasking`.

Programs that use bsk_rl 1.3.8 change their import lines:

    from sparring.tasking import SatelliteTasking, act, data, obs, sats, scene
    from sparring.tasking.sim import dyn, fsw

Seed s draws BSK-RL's episode s. The environments are also registered with Gymnasium as
`SatelliteTasking-v1`, `GeneralSatelliteTasking-v1` and `ConstellationTasking-v1`.
"""

import gymnasium

from . import act, comm, data, messaging, obs, sats, scene, sim, utils
from .gym import NO_ACTION, ConstellationTasking, GeneralSatelliteTasking, SatelliteTasking

__all__ = [
    "NO_ACTION",
    "ConstellationTasking",
    "GeneralSatelliteTasking",
    "SatelliteTasking",
    "act",
    "comm",
    "data",
    "messaging",
    "obs",
    "sats",
    "scene",
    "sim",
    "utils",
]

for _name in ("ConstellationTasking", "GeneralSatelliteTasking", "SatelliteTasking"):
    if f"{_name}-v1" not in gymnasium.registry:
        gymnasium.register(id=f"{_name}-v1", entry_point=f"sparring.tasking.gym:{_name}")
