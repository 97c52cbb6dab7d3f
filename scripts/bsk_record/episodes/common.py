"""Satellites, actions and observations that several episodes share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bsk_record.specs import Component, SatelliteSpec, component

ORBIT_S = 5700.0
BITS_PER_MB = 8e6

# Arguments of BSK-RL's example of agile imagers: steering is fast enough for about one image a minute.
IMAGER_ARGS: dict[str, Any] = {
    "imageAttErrorRequirement": 0.01,
    "imageRateErrorRequirement": 0.01,
    "batteryStorageCapacity": 1e6,
    "storedCharge_Init": 8e5,
    "dataStorageCapacity": 1e12,
    "u_max": 0.4,
    "K1": 0.25,
    "K3": 3.0,
    "omega_max": 0.087,
    "servo_Ki": 5.0,
    "servo_P": 30.0,
}

# Arguments of the scanning satellite of Stephenson and Schaub (2024).
SCANNER_ARGS: dict[str, Any] = {
    "dataStorageCapacity": 5000 * BITS_PER_MB,
    "storageInit": lambda: int(np.random.uniform(0.0, 0.8) * 5000 * BITS_PER_MB),
    "instrumentBaudRate": 0.5 * BITS_PER_MB,
    "transmitterBaudRate": -50 * BITS_PER_MB,
    "batteryStorageCapacity": 200 * 3600,
    "storedCharge_Init": lambda: np.random.uniform(0.4, 1.0) * 200 * 3600,
    "basePowerDraw": -10.0,
    "instrumentPowerDraw": -30.0,
    "transmitterPowerDraw": -25.0,
    "thrusterPowerDraw": -80.0,
    "panelArea": 0.25,
    "imageAttErrorRequirement": 0.1,
    "imageRateErrorRequirement": 0.1,
    "disturbance_vector": lambda: np.random.normal(scale=0.0001, size=3),
    "maxWheelSpeed": 6000.0,
    "wheelSpeeds": lambda: np.random.uniform(-3000, 3000, 3),
    "desatAttitude": "nadir",
}

UNIQUE_IMAGES = (component("UniqueImageReward"),)
SCANNING_TIME = (component("ScanningTimeReward"),)
NADIR = component("UniformNadirScanning", value_per_second=1 / ORBIT_S)


def targets_observed(ahead: int) -> Component:
    """Observes priority and opening of upcoming targets."""
    properties = [{"prop": "priority"}, {"prop": "opportunity_open", "norm": ORBIT_S}]
    return component("OpportunityProperties", properties=properties, n_ahead_observe=ahead)


def stations_observed() -> Component:
    """Observes opening and closing of the next window of a ground station."""
    properties = [{"prop": "opportunity_open", "norm": ORBIT_S}, {"prop": "opportunity_close", "norm": ORBIT_S}]
    return component("OpportunityProperties", properties=properties, type="ground_station", n_ahead_observe=1)


def resources_observed() -> Component:
    """Observes storage, battery and wheels."""
    names = ("storage_level_fraction", "battery_charge_fraction", "wheel_speeds_fraction")
    return component("SatProperties", properties=[{"prop": name} for name in names])


def imager(name: str, *, ahead: int = 5, observed: int = 3, **changes: Any) -> SatelliteSpec:
    """Returns an agile imager; `changes` replaces fields, and `args` adds to its arguments."""
    args = IMAGER_ARGS | changes.pop("args", {})
    fields: dict[str, Any] = {
        "type": "ImagingSatellite",
        "dyn": ("FullFeaturedDynModel",),
        "fsw": ("SteeringImagerFSWModel",),
        "actions": (component("Image", n_ahead_image=ahead),),
        "observations": (targets_observed(observed),),
    }
    return SatelliteSpec(name=name, sat_args=args, **(fields | changes))


def scanner(name: str = "Scanner", **changes: Any) -> SatelliteSpec:
    """Returns a scanning satellite; `changes` replaces fields, and `args` adds to its arguments."""
    args = SCANNER_ARGS | changes.pop("args", {})
    fields: dict[str, Any] = {
        "type": "AccessSatellite",
        "dyn": ("ContinuousImagingDynModel", "GroundStationDynModel"),
        "fsw": ("ContinuousImagingFSWModel",),
        "actions": (
            component("Scan", duration=180.0),
            component("Charge", duration=120.0),
            component("Downlink", duration=60.0),
            component("Desat", duration=60.0),
        ),
        "observations": (
            resources_observed(),
            stations_observed(),
            component("Eclipse", norm=ORBIT_S),
            component("Time"),
        ),
    }
    return SatelliteSpec(name=name, sat_args=args, **(fields | changes))


def radians(degrees: float) -> float:
    """Converts degrees to radians, for arguments of BSK-RL."""
    return math.radians(degrees)
