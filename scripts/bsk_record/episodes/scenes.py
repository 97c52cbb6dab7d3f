"""Episodes with other targets, orbits, satellites and forms of actions."""

from __future__ import annotations

from typing import Any

from bsk_rl.utils.orbital import random_orbit

from bsk_record.episodes.common import (
    NADIR,
    ORBIT_S,
    SCANNING_TIME,
    UNIQUE_IMAGES,
    imager,
    radians,
    resources_observed,
    scanner,
    stations_observed,
    targets_observed,
)
from bsk_record.policies import RandomPolicy, TargetPolicy
from bsk_record.specs import CommunicatorSpec, Episode, component

IMAGE = component("Image", n_ahead_image=5)
ALL_MODES = (
    component("Image", n_ahead_image=4, max_duration=60.0),
    component("Charge", duration=33.0),
    component("Downlink", duration=40.0),
    component("Desat", duration=26.0),
    component("Drift", duration=20.0),
)
FEEDBACK: dict[str, Any] = {"K1": None, "K3": None, "omega_max": None, "servo_Ki": None, "servo_P": None}


def feedback_imager(name: str, **changes: Any) -> Any:
    """Returns an imager with MRP feedback, without the arguments of steering."""
    spec = imager(name, fsw=("ImagingFSWModel",), **changes)
    for key in FEEDBACK:
        del spec.sat_args[key]
    return spec


HETEROGENEOUS = (
    feedback_imager(
        "Heavy",
        args={"mass": 450.0, "width": 1.6, "depth": 1.2, "height": 1.9, "u_max": 0.5, "K": 5.0, "P": 40.0},
        actions=(IMAGE, component("Charge", duration=75.0)),
        options={"generation_duration": 300.0},
    ),
    imager(
        "Light",
        args={
            "mass": 120.0,
            "width": 0.9,
            "depth": 0.7,
            "height": 1.1,
            "u_max": 0.15,
            "servo_P": 4.0,
            "servo_Ki": 0.5,
            "wheelSpeeds": [250.0, 100.0, -150.0],
        },
        actions=(component("Image", n_ahead_image=8, max_duration=200.0),),
        options={"generation_duration": 900.0, "initial_generation_duration": 1200.0},
    ),
    imager(
        "Cube",
        args={
            "mass": 250.0,
            "width": 1.0,
            "depth": 1.0,
            "height": 1.0,
            "servo_P": 15.0,
            "wheelSpeeds": [900.0, -700.0, 400.0],
            "inst_pHat_B": [0.0, 0.6, 0.8],
            "nHat_B": [0.0, -1.0, 0.0],
            "disturbance_vector": [2e-4, -1e-4, 3e-4],
        },
        actions=(component("Drift", duration=20.0), component("Image", n_ahead_image=3), component("Desat", duration=40.0)),
        options={"initial_generation_duration": 3600.0, "max_generation_duration_beyond_initial": 1200.0},
    ),
)


def mixed_actions(name: str, seed: int) -> Episode:
    """Returns an episode of all modes; the seeds are such that steps end on the tick that commands an image."""
    return Episode(
        name=name,
        seed=seed,
        cls="SatelliteTasking",
        satellites=(
            imager(
                "EO",
                actions=ALL_MODES,
                observations=(targets_observed(3), resources_observed(), stations_observed()),
                args={"transmitterBaudRate": -1e6, "thrusterPowerDraw": -80.0, "disturbance_vector": [1e-3, -2e-3, 1e-3]},
            ),
        ),
        scenario=component("UniformTargets", n_targets=1500),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(weights={"Image": 4.0}),
        max_steps=100,
    )


EPISODES = (
    Episode(
        name="cities",
        seed=0,
        cls="SatelliteTasking",
        satellites=(imager("EO"),),
        scenario=component("CityTargets", n_targets=400, n_select_from=1000, location_offset=1e4),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(),
        max_steps=60,
        env={"time_limit": 2 * ORBIT_S},
    ),
    Episode(
        name="heterogeneous",
        seed=3,
        cls="ConstellationTasking",
        satellites=HETEROGENEOUS,
        scenario=component("UniformTargets", n_targets=1000),
        rewarders=UNIQUE_IMAGES,
        communicator=CommunicatorSpec(("LOSCommunication",)),
        policy=RandomPolicy(weights={"Image": 4.0}, busy=0.05),
        max_steps=70,
        env={"time_limit": 4500.0},
    ),
    mixed_actions("mixed_actions", 5),
    mixed_actions("mixed_actions_2", 15),
    Episode(
        name="by_target",
        seed=2,
        cls="ConstellationTasking",
        satellites=tuple(imager(name, actions=(component("Charge", duration=60.0), IMAGE)) for name in ("EO_1", "EO_2")),
        scenario=component("UniformTargets", n_targets=800),
        rewarders=UNIQUE_IMAGES,
        policy=TargetPolicy(ahead=6),
        max_steps=60,
        env={"time_limit": ORBIT_S},
    ),
    Episode(
        name="high_orbit",
        seed=1,
        cls="SatelliteTasking",
        satellites=(
            scanner(
                args={"oe": lambda: random_orbit(a=6371 + 800, i=60.0)}, observations=(resources_observed(), stations_observed())
            ),
        ),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        world_args={"gsMinimumElevation": radians(5.0)},
        policy=RandomPolicy(weights={"Scan": 2.0, "Charge": 2.0, "Downlink": 1.0, "Desat": 0.5}, in_view=0.3),
        max_steps=100,
    ),
    Episode(
        name="elliptic",
        seed=3,
        cls="SatelliteTasking",
        satellites=(imager("EO", args={"oe": lambda: random_orbit(a=7000.0, e=0.01, i=98.0)}),),
        scenario=component("UniformTargets", n_targets=1000),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(),
        max_steps=60,
        env={"time_limit": ORBIT_S},
    ),
)
