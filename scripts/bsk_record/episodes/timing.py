"""Episodes with other step lengths and tick lengths than the usual ones."""

from __future__ import annotations

from typing import Any

from bsk_rl.utils.orbital import walker_delta_args

from bsk_record.episodes.common import NADIR, ORBIT_S, SCANNING_TIME, UNIQUE_IMAGES, imager, scanner, targets_observed
from bsk_record.policies import RandomPolicy
from bsk_record.specs import CommunicatorSpec, Episode, component

SCANNING = RandomPolicy(weights={"Scan": 4.0, "Charge": 4.0, "Downlink": 1.0, "Desat": 2.0})

# Speeds in rpm at which the wheels' momentum does not make a loop of 5 s ticks unstable.
SLOW_WHEELS = [150.0, -100.0, 60.0]

# Gains that keep the control loop stable at the tick length in seconds: feedback K and P, servo P and Ki, and steering.
GAINS: dict[str, tuple[float, dict[str, Any], dict[str, Any]]] = {
    "rate_half": (0.5, {}, {}),
    "rate_two": (2.0, {"K": 2.0, "P": 15.0}, {"servo_P": 15.0, "servo_Ki": 1.0, "K1": 0.15, "K3": 1.0}),
    "rate_five": (
        5.0,
        {"K": 0.2, "P": 5.0, "wheelSpeeds": SLOW_WHEELS},
        {"servo_P": 5.0, "servo_Ki": 0.1, "K1": 0.05, "K3": 0.3, "omega_max": 0.03, "wheelSpeeds": SLOW_WHEELS},
    ),
}

IMAGE_OR_CHARGE = (component("Image", n_ahead_image=5), component("Charge", duration=60.0))


def rate_scan(name: str) -> Episode:
    """Returns a scanning episode at a tick length."""
    rate, feedback, _ = GAINS[name]
    return Episode(
        name=f"{name}_scan",
        seed=5,
        cls="SatelliteTasking",
        satellites=(scanner(args=feedback),),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=SCANNING,
        max_steps=60,
        env={"time_limit": ORBIT_S - 1.0, "sim_rate": rate},
    )


def rate_image(name: str) -> Episode:
    """Returns an imaging episode with steering at a tick length."""
    rate, _, steering = GAINS[name]
    return Episode(
        name=f"{name}_image",
        seed=6,
        cls="SatelliteTasking",
        satellites=(imager("EO", actions=IMAGE_OR_CHARGE, args=steering),),
        scenario=component("UniformTargets", n_targets=900),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(weights={"Image": 5.0, "Charge": 1.0}),
        max_steps=60,
        env={"time_limit": ORBIT_S - 1.0, "sim_rate": rate},
    )


def two_imagers(**changes: Any) -> dict[str, Any]:
    """Returns the settings of two imagers in one plane that communicate freely."""
    return {
        "cls": "ConstellationTasking",
        "satellites": tuple(imager(name, **changes) for name in ("EO_1", "EO_2")),
        "scenario": component("UniformTargets", n_targets=500),
        "rewarders": UNIQUE_IMAGES,
        "communicator": CommunicatorSpec(("FreeCommunication",)),
        "orbits": walker_delta_args(altitude=600.0, inc=70.0, n_planes=1, clustersize=2, clusterspacing=10.0),
    }


EPISODES = (
    Episode(
        name="fixed_interval",
        seed=3,
        policy=RandomPolicy(busy=0.2),
        max_steps=60,
        env={"time_limit": 5400.0, "max_step_duration": 90.0},
        **two_imagers(options={"variable_interval": False}),
    ),
    Episode(
        name="max_step",
        seed=10,
        policy=RandomPolicy(weights={"Image": 5.0, "Charge": 1.0}, busy=0.1),
        max_steps=80,
        env={"time_limit": 3000.0, "max_step_duration": 45.0},
        **two_imagers(actions=IMAGE_OR_CHARGE, observations=(targets_observed(2),)),
    ),
    *(build(name) for name in GAINS for build in (rate_scan, rate_image)),
)
