"""Episodes in which satellites die at different times."""

from __future__ import annotations

from typing import Any

from bsk_rl.utils.orbital import walker_delta_args

from bsk_record.episodes.common import UNIQUE_IMAGES, imager, resources_observed, targets_observed
from bsk_record.policies import RandomPolicy
from bsk_record.specs import CommunicatorSpec, Episode, component

# Charge in W s; the fourth satellite dies of its wheels.
CHARGES = (6e4, 1.2e5, 2.2e5, 3e6)


def mortals() -> tuple[Any, ...]:
    """Returns four imagers whose batteries or wheels fail."""
    specs = []
    for number, charge in enumerate(CHARGES, 1):
        args: dict[str, Any] = {
            "batteryStorageCapacity": 1.5 * charge,
            "storedCharge_Init": charge,
            "basePowerDraw": -60.0,
            "panelArea": 0.2,
        }
        if number == len(CHARGES):
            args |= {"maxWheelSpeed": 1900.0, "disturbance_vector": [6e-3, 0.0, -2e-3]}
        specs.append(
            imager(
                f"EO_{number}",
                args=args,
                actions=(component("Image", n_ahead_image=4), component("Charge", duration=80.0)),
                observations=(targets_observed(2), resources_observed()),
            )
        )
    return tuple(specs)


def deaths(name: str, cls: str, seed: int, **changes: Any) -> Episode:
    """Returns an episode of the four satellites in an environment class."""
    return Episode(
        name=name,
        seed=seed,
        cls=cls,
        satellites=mortals(),
        scenario=component("UniformTargets", n_targets=500),
        rewarders=UNIQUE_IMAGES,
        communicator=CommunicatorSpec(("FreeCommunication",)),
        orbits=walker_delta_args(altitude=600.0, inc=60.0, n_planes=2),
        max_steps=70,
        env={"time_limit": 5000.0, "failure_penalty": -2.0},
        **changes,
    )


EPISODES = (
    deaths("deaths_constellation", "ConstellationTasking", 1, policy=RandomPolicy(weights={"Image": 2.0})),
    deaths(
        "deaths_general",
        "GeneralSatelliteTasking",
        2,
        policy=RandomPolicy(weights={"Image": 2.0}, dead=0.3, busy=0.05),
        continues_after_death=True,
    ),
)
