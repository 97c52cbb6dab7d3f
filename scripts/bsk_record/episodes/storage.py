"""Episodes in which storage overflows, is emptied, or holds less than a packet, and rewards for resources."""

from __future__ import annotations

from bsk_record.episodes.common import (
    BITS_PER_MB,
    NADIR,
    ORBIT_S,
    SCANNING_TIME,
    UNIQUE_IMAGES,
    imager,
    resources_observed,
    scanner,
    stations_observed,
    targets_observed,
)
from bsk_record.policies import RandomPolicy
from bsk_record.specs import CommunicatorSpec, Episode, component

# Images and downlink over the seven ground stations.
DOWNLINKER = {
    "actions": (component("Image", n_ahead_image=5), component("Downlink", duration=60.0)),
    "observations": (targets_observed(2), resources_observed(), stations_observed()),
}

# Stations with a minimum elevation (rad) or a largest range (m) of their own; the world's values hold for the others.
LIMITED_STATIONS = [
    {"name": "elevation_5", "lat": 40.0, "long": -105.3, "gsMinimumElevation": 0.087},
    {"name": "elevation_25", "lat": 28.3, "long": -80.7, "gsMinimumElevation": 0.436},
    {"name": "range_900_km", "lat": 1.4, "long": 103.8, "gsMaximumRange": 0.9e6},
    {"name": "range_1800_km", "lat": 47.9, "long": 11.1, "gsMaximumRange": 1.8e6},
    {"name": "both", "lat": -33.1, "long": -70.7, "gsMinimumElevation": 0.3, "gsMaximumRange": 0.8e6},
    {"name": "world", "lat": -29.0, "long": 115.3},
    {"name": "unlimited", "lat": 19.9, "long": -155.6, "gsMaximumRange": -1.0},
]

EPISODES = (
    Episode(
        name="storage_overflow_scan",
        seed=1,
        cls="SatelliteTasking",
        satellites=(
            scanner(args={"dataStorageCapacity": 801_234_567, "storageInit": 123_456_789, "transmitterBaudRate": -1.1e7}),
        ),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=RandomPolicy(weights={"Scan": 4.0, "Charge": 1.0, "Downlink": 1.0, "Desat": 0.5}, in_view=0.8),
        max_steps=80,
        env={"time_limit": 1.5 * ORBIT_S, "terminate_on_time_limit": True},
    ),
    Episode(
        name="storage_overflow_image",
        seed=1,
        cls="SatelliteTasking",
        satellites=(
            imager(
                "EO",
                **DOWNLINKER,
                args={"dataStorageCapacity": 60_000_001, "storageInit": 17_000_000, "transmitterBaudRate": -1e6},
            ),
        ),
        scenario=component("UniformTargets", n_targets=1000),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(weights={"Image": 4.0, "Downlink": 1.0}, in_view=0.9),
        max_steps=70,
        env={"time_limit": 1.5 * ORBIT_S},
    ),
    Episode(
        name="storage_packet",
        seed=1,
        cls="SatelliteTasking",
        satellites=(imager("EO", **DOWNLINKER, args={"transmitterPacketSize": -3 * BITS_PER_MB, "transmitterBaudRate": -0.7e6}),),
        scenario=component("UniformTargets", n_targets=800),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(weights={"Image": 2.0, "Downlink": 1.0}, in_view=0.6),
        max_steps=80,
        env={"time_limit": 1.5 * ORBIT_S},
    ),
    Episode(
        name="resource_reward",
        seed=2,
        cls="ConstellationTasking",
        satellites=tuple(
            imager(
                name,
                args={"batteryStorageCapacity": 3e5, "storedCharge_Init": 2e5, "basePowerDraw": -20.0},
                actions=(component("Image", n_ahead_image=4), component("Charge", duration=90.0)),
                observations=(
                    targets_observed(2),
                    component("ResourceRewardWeight", norm=0.5),
                    component("SatProperties", properties=[{"prop": "battery_charge_fraction"}]),
                ),
            )
            for name in ("EO_1", "EO_2")
        ),
        scenario=component("UniformTargets", n_targets=500),
        rewarders=(*UNIQUE_IMAGES, component("ResourceReward", reward_weight=2.5, resource="battery_charge_fraction")),
        communicator=CommunicatorSpec(("FreeCommunication",)),
        policy=RandomPolicy(weights={"Image": 2.0, "Charge": 1.0}, busy=0.1),
        max_steps=60,
        env={"time_limit": ORBIT_S},
    ),
    Episode(
        name="station_limits",
        seed=3,
        cls="SatelliteTasking",
        satellites=(
            scanner(
                args={
                    "storageInit": 30_000_000_000,
                    "transmitterBaudRate": -0.4e7,
                    "batteryStorageCapacity": 400 * 3600,
                    "storedCharge_Init": 300 * 3600,
                }
            ),
        ),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=RandomPolicy(weights={"Scan": 1.0, "Charge": 0.5, "Downlink": 4.0}, in_view=0.9),
        max_steps=200,
        env={"time_limit": 2.5 * ORBIT_S},
        world_args={"groundStationsData": LIMITED_STATIONS, "gsMaximumRange": 1.4e6},
    ),
)
