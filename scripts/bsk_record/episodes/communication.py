"""Episodes of satellites that communicate: lines of sight, ranges, periods and broadcasts."""

from __future__ import annotations

import numpy as np
from bsk_rl.utils.orbital import random_orbit, walker_delta_args

from bsk_record.episodes.common import ORBIT_S, UNIQUE_IMAGES, imager, targets_observed
from bsk_record.policies import RandomPolicy
from bsk_record.specs import CommunicatorSpec, Episode, component


def neighbouring_orbit():
    """Draws an orbit near those of the other satellites, so that links come and go."""
    return random_orbit(
        i=np.random.uniform(40.0, 80.0),
        a=6371 + 500,
        Omega=np.random.uniform(0.0, 100.0),
        omega=0.0,
        f=np.random.uniform(0.0, 100.0),
    )


def neighbours(count: int, **args):
    """Returns imagers on neighbouring orbits."""
    return tuple(imager(f"EO_{number}", args={"oe": neighbouring_orbit} | args) for number in range(1, count + 1))


def train(spacing: float):
    """Returns the randomizer of satellites in one plane, `spacing` degrees apart."""
    return walker_delta_args(altitude=800.0, inc=60.0, n_planes=1, clustersize=3, clusterspacing=spacing)


BROADCASTER = {
    "actions": (component("Image", n_ahead_image=5), component("Broadcast", duration=30.0)),
    "observations": (targets_observed(3),),
}

EPISODES = (
    Episode(
        name="los_breaks",
        seed=23,
        cls="ConstellationTasking",
        satellites=neighbours(4),
        scenario=component("UniformTargets", n_targets=500),
        rewarders=UNIQUE_IMAGES,
        communicator=CommunicatorSpec(("LOSCommunication",)),
        policy=RandomPolicy(),
        max_steps=70,
        env={"time_limit": ORBIT_S},
    ),
    Episode(
        name="los_multi",
        seed=11,
        cls="ConstellationTasking",
        satellites=neighbours(4, losMaximumRange=2.5e6),
        scenario=component("UniformTargets", n_targets=400),
        rewarders=UNIQUE_IMAGES,
        communicator=CommunicatorSpec(("LOSMultiCommunication",)),
        policy=RandomPolicy(),
        max_steps=60,
        env={"time_limit": ORBIT_S},
    ),
    Episode(
        name="free_period",
        seed=3,
        cls="GeneralSatelliteTasking",
        satellites=tuple(imager(f"EO_{number}") for number in (1, 2, 3)),
        scenario=component("UniformTargets", n_targets=(400, 500)),
        rewarders=UNIQUE_IMAGES,
        communicator=CommunicatorSpec(("FreeCommunication",), min_period=600.0),
        orbits=train(15.0),
        policy=RandomPolicy(busy=0.1),
        max_steps=60,
        env={"time_limit": ORBIT_S, "generate_obs_retasking_only": True},
    ),
    Episode(
        name="broadcast",
        seed=4,
        cls="ConstellationTasking",
        satellites=tuple(imager(f"EO_{number}", **BROADCASTER) for number in (1, 2, 3)),
        scenario=component("UniformTargets", n_targets=400),
        rewarders=UNIQUE_IMAGES,
        communicator=CommunicatorSpec(("BroadcastCommunication", "LOSCommunication")),
        orbits=train(25.0),
        policy=RandomPolicy(weights={"Image": 3.0, "Broadcast": 1.0}, busy=0.05),
        max_steps=60,
        env={"time_limit": ORBIT_S},
    ),
)
