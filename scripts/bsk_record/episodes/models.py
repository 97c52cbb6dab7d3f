"""Episodes of satellites with other models: bare ones, and flight software that asks less than its dynamics offer."""

from __future__ import annotations

from typing import Any

from bsk_record.episodes.common import (
    IMAGER_ARGS,
    NADIR,
    ORBIT_S,
    SCANNING_TIME,
    resources_observed,
    stations_observed,
)
from bsk_record.policies import RandomPolicy
from bsk_record.specs import Episode, SatelliteSpec, component

BUS_ACTIONS = (
    component("Charge", duration=120.0),
    component("NadirPoint", duration=90.0),
    component("Drift", duration=40.0),
    component("Desat", duration=60.0),
    component("DiscreteFSWAction", fsw_action="action_charge", name="again", duration=50.0, reset_task=True),
)
BUS_ARGS: dict[str, Any] = {
    "batteryStorageCapacity": 4e5,
    "storedCharge_Init": 2e5,
    "basePowerDraw": -10.0,
    "maxWheelSpeed": 6000.0,
}
STEERING_ARGS = {name: IMAGER_ARGS[name] for name in ("u_max", "K1", "K3", "omega_max", "servo_Ki", "servo_P")}
BUS_PROPERTIES = ("sigma_BN", "omega_BN_B", "battery_charge_fraction", "wheel_speeds_fraction", "beta_angle")
#: Scanner's dynamics: an instrument that adds data continuously, and ground stations.
SCANNER_DYN = ("ContinuousImagingDynModel", "GroundStationDynModel")


def bus(name: str, fsw: str, args: dict[str, Any]) -> SatelliteSpec:
    """Returns a satellite without instrument, storage and transmitter."""
    return SatelliteSpec(
        name=name,
        type="Satellite",
        dyn=("BasicDynamicsModel",),
        fsw=(fsw,),
        actions=BUS_ACTIONS,
        observations=(
            component("SatProperties", properties=[{"prop": name} for name in BUS_PROPERTIES]),
            component("Time"),
        ),
        sat_args=BUS_ARGS | args,
    )


def carrier(dyn: tuple[str, ...], fsw: str, args: dict[str, Any]) -> SatelliteSpec:
    """Returns a satellite with an instrument that its flight software does not know, which is therefore always on."""
    return SatelliteSpec(
        name="Carrier",
        type="AccessSatellite",
        dyn=dyn,
        fsw=(fsw,),
        actions=BUS_ACTIONS,
        observations=(resources_observed(), stations_observed(), component("Time")),
        sat_args=BUS_ARGS | args,
    )


def sender(fsw: str, args: dict[str, Any]) -> SatelliteSpec:
    """Returns a satellite with a scanner's dynamics, whose flight software commands the instrument for targets only: it sends."""
    return SatelliteSpec(
        name="Sender",
        type="AccessSatellite",
        dyn=SCANNER_DYN,
        fsw=(fsw,),
        actions=(
            component("Downlink", duration=60.0),
            component("Charge", duration=90.0),
            component("Desat", duration=45.0),
            component("NadirPoint", duration=30.0),
        ),
        observations=(resources_observed(), stations_observed(), component("Eclipse", norm=ORBIT_S)),
        sat_args=BUS_ARGS | {"dataStorageCapacity": 500e6, "storageInit": 40_000_000, "transmitterBaudRate": -2.1e5} | args,
    )


EPISODES = (
    Episode(
        name="bare_models",
        seed=4,
        cls="GeneralSatelliteTasking",
        satellites=(
            bus("Feedback", "BasicFSWModel", {"thrusterPowerDraw": -80.0, "desatAttitude": "nadir"}),
            bus("Steering", "SteeringFSWModel", STEERING_ARGS),
        ),
        scenario=component("Scenario"),
        rewarders=(component("NoReward"),),
        policy=RandomPolicy(busy=0.1),
        max_steps=40,
        env={"time_limit": 0.5 * ORBIT_S},
    ),
    Episode(
        name="basic_on_scanner",
        seed=4,
        cls="SatelliteTasking",
        satellites=(
            carrier(
                SCANNER_DYN,
                "BasicFSWModel",
                {"dataStorageCapacity": 1_000_000_000, "storageInit": 30_000_000, "instrumentBaudRate": 1.1e6},
            ),
        ),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=RandomPolicy(),
        max_steps=20,
        env={"time_limit": 0.3 * ORBIT_S},
    ),
    Episode(
        name="basic_on_imager",
        seed=4,
        cls="SatelliteTasking",
        satellites=(
            carrier(
                ("FullFeaturedDynModel",),
                "SteeringFSWModel",
                STEERING_ARGS
                | {
                    "dataStorageCapacity": 1_000_000_000,
                    "storageInit": 30_000_000,
                    "instrumentBaudRate": 1.1e6,
                    "bufferNames": ["first"],
                    "transmitterNumBuffers": 1,
                },
            ),
        ),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=RandomPolicy(),
        max_steps=20,
        env={"time_limit": 0.3 * ORBIT_S},
    ),
    Episode(
        name="imager_software_on_scanner",
        seed=3,
        cls="SatelliteTasking",
        satellites=(sender("ImagingFSWModel", {"K": 5.0, "P": 40.0}),),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=RandomPolicy(weights={"Downlink": 2.0}, in_view=0.9),
        max_steps=100,
        env={"time_limit": ORBIT_S},
    ),
    Episode(
        name="steered_software_on_scanner",
        seed=3,
        cls="SatelliteTasking",
        satellites=(sender("SteeringImagerFSWModel", STEERING_ARGS),),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=RandomPolicy(weights={"Downlink": 2.0}, in_view=0.9),
        max_steps=40,
        env={"time_limit": 0.5 * ORBIT_S, "sim_rate": 0.5},
    ),
)
