"""Episodes of single scanning satellites with other modes, desaturation options, gains and wheel limits."""

from __future__ import annotations

from typing import Any

from bsk_record.episodes.common import NADIR, ORBIT_S, SCANNING_TIME, scanner
from bsk_record.policies import RandomPolicy
from bsk_record.specs import Episode, component

FAST_WHEELS = [3200.0, -2800.0, 2500.0]
# A body so heavy that full wheels turn it slowly; with a light one, saturated wheels make the attitude chaotic.
LARGE_BODY = {"mass": 2500.0, "width": 3.0, "depth": 2.5, "height": 3.5, "u_max": 2.0, "K": 50.0, "P": 800.0}
DESAT = RandomPolicy(weights={"Scan": 2.0, "Charge": 2.0, "Downlink": 1.0, "Desat": 4.0})


def scanning(name: str, seed: int, policy: RandomPolicy = DESAT, args: dict[str, Any] | None = None, **changes: Any) -> Episode:
    """Returns an episode of one scanning satellite with changed arguments."""
    return Episode(
        name=name,
        seed=seed,
        cls="SatelliteTasking",
        satellites=(scanner(args=args or {}, **changes),),
        scenario=NADIR,
        rewarders=SCANNING_TIME,
        policy=policy,
        max_steps=60,
        env={"time_limit": ORBIT_S},
    )


EPISODES = (
    scanning(
        "drift",
        1,
        policy=RandomPolicy(),
        actions=(
            component("Drift", duration=50.0),
            component("NadirPoint", duration=110.0),
            component("Scan", duration=120.0),
            component("Charge", duration=90.0),
            component("Downlink", duration=60.0),
            component("Desat", duration=70.0),
            component("DiscreteFSWAction", fsw_action="action_charge", name="sun", duration=45.0, reset_task=True),
        ),
    ),
    scanning("desat_sun", 2, args={"desatAttitude": "sun"}),
    scanning("desat_none", 3, args={"desatAttitude": None}),
    scanning(
        "desat_options",
        4,
        args={"hs_min": 5.0, "maxCounterValue": 2, "thrMinFireTime": 0.05, "wheelSpeeds": FAST_WHEELS},
    ),
    scanning(
        "integral",
        5,
        args={"Ki": 5e-5, "u_max": 0.4, "disturbance_vector": [2e-3, -1e-3, 1.5e-3], "wheelSpeeds": [500.0, -400.0, 300.0]},
    ),
    scanning(
        "wheel_limit",
        6,
        policy=RandomPolicy(weights={"Scan": 4.0, "Charge": 4.0, "Downlink": 1.0, "Desat": 1.0}),
        args=LARGE_BODY
        | {
            "wheelSpeeds": [5950.0, -5900.0, 5700.0],
            "maxWheelSpeed": float("inf"),
            "storedCharge_Init": 7e5,
            "disturbance_vector": [2e-2, -3e-2, 1e-2],
        },
    ),
)
