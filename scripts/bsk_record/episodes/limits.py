"""Episodes at the limits of values: what is full, empty or at the same place from the start."""

from __future__ import annotations

from typing import Any

from bsk_rl.utils.orbital import random_orbit

from bsk_record.episodes.common import NADIR, SCANNING_TIME, imager, radians, scanner
from bsk_record.policies import ScriptPolicy
from bsk_record.specs import CommunicatorSpec, Episode, SatelliteSpec, component

CHARGE, DESAT = 1, 3


def orbit() -> Any:
    """Returns a circular orbit at 500 km, the same for all satellites."""
    return random_orbit(a=6878.1366, e=0.0, i=60.0, Omega=0.0, omega=0.0, f=0.0)


def scan_episode(name: str, args: dict[str, Any], *script: int) -> Episode:
    """Returns an episode of a scanning satellite at rest, with some other arguments."""
    rest = {
        "disturbance_vector": [0.0, 0.0, 0.0],
        "wheelSpeeds": [0.0, 0.0, 0.0],
        "storageInit": 0,
        "storedCharge_Init": 200 * 3600.0,
        "omega_init": [0.0, 0.0, 0.0],
        "sigma_init": [0.0, 0.0, 0.0],
        "oe": orbit(),
    }
    return Episode(
        name=name,
        seed=1,
        cls="SatelliteTasking",
        satellites=(scanner(args=rest | args),),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=ScriptPolicy(script),
        max_steps=len(script),
        env={"time_limit": 5700.0},
    )


def idle_imager(name: str, **args: Any) -> SatelliteSpec:
    """Returns an imager that charges second by second, on the common orbit."""
    return imager(
        name,
        args={"oe": orbit(), "wheelSpeeds": [0.0, 0.0, 0.0], "sigma_init": [0.0, 0.0, 0.0]} | args,
        actions=(component("Charge", duration=1.0),),
        observations=(component("Time"),),
    )


def pair_episode(name: str, max_steps: int, communicator: str = "NoCommunication", **first: Any) -> Episode:
    """Returns an episode of two satellites at the same place; `first` are arguments of the first."""
    return Episode(
        name=name,
        seed=1,
        cls="ConstellationTasking",
        satellites=(idle_imager("EO_1", **first), idle_imager("EO_2")),
        scenario=component("UniformTargets", n_targets=1),
        rewarders=(component("UniqueImageReward"),),
        communicator=CommunicatorSpec((communicator,)),
        policy=ScriptPolicy((0,)),
        max_steps=max_steps,
        env={"time_limit": 5700.0},
    )


# Stations on a grid, so that passes are short and frequent.
GRID = [
    {"name": f"{latitude}_{longitude}", "lat": float(latitude), "long": float(longitude)}
    for latitude in (-60, -30, 0, 30, 60)
    for longitude in range(0, 360, 30)
]

# Downlinks of 5 s among long pauses: some end without access, which the transmitter must not count as a pause.
PAUSED_DOWNLINKS = Episode(
    name="paused_downlinks",
    seed=168,
    cls="SatelliteTasking",
    satellites=(
        imager(
            "EO",
            args={
                "oe": orbit(),
                "instrumentBaudRate": 3e6,
                "transmitterBaudRate": -1e6,
                "storageInit": 7_000_000,
                "wheelSpeeds": [0.0, 0.0, 0.0],
                "sigma_init": [0.0, 0.0, 0.0],
            },
            actions=(component("Charge", duration=5.0), component("Downlink", duration=5.0)),
            observations=(component("Time"),),
        ),
    ),
    scenario=component("UniformTargets", n_targets=1),
    rewarders=(component("UniqueImageReward"),),
    policy=ScriptPolicy((0,) * 250 + (1,) + (0,) * 29 + (1,) + (0,) * 18 + (1,)),
    max_steps=300,
    env={"time_limit": 1500.0},
    world_args={
        "groundStationsData": GRID,
        "gsMinimumElevation": radians(45.0),
        "utc_init": "2000 JAN 01 12:00:00.000 (UTC)",
    },
)

EPISODES = (
    scan_episode("capacity_fraction", {"dataStorageCapacity": 100.9, "storageInit": 50}, CHARGE),
    scan_episode("battery_overfull", {"storedCharge_Init": 800_000.0, "batteryStorageCapacity": 720_000.0}, CHARGE),
    scan_episode("wheel_at_limit", {"wheelSpeeds": [6000.0, 0.0, 0.0], "maxWheelSpeed": 6000.0}, DESAT),
    pair_episode("same_place", 2, "LOSCommunication"),
    pair_episode("dead_start", 3, storedCharge_Init=0.0),
    PAUSED_DOWNLINKS,
)
