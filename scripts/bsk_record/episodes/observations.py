"""Episode that observes every property of BSK-RL's ground imaging models."""

from __future__ import annotations

from bsk_rl.utils.orbital import random_orbit

from bsk_record.episodes.common import ORBIT_S, UNIQUE_IMAGES, imager
from bsk_record.policies import RandomPolicy
from bsk_record.specs import Component, Episode, component

RADIUS_M = 6.3781366e6

DYNAMICS = (
    "sigma_BN",
    "BN",
    "omega_BN_B",
    "BP",
    "HN",
    "r_BN_N",
    "r_BN_P",
    "v_BN_N",
    "v_BN_P",
    "omega_BP_P",
    "omega_BH_H",
    "semi_major_axis",
    "eccentricity",
    "inclination",
    "ascending_node",
    "argument_of_periapsis",
    "true_anomaly",
    "beta_angle",
    "battery_charge",
    "battery_charge_fraction",
    "wheel_speeds",
    "wheel_speeds_fraction",
    "storage_level",
    "storage_level_fraction",
)
NORMS = {"r_BN_N": RADIUS_M, "r_BN_P": RADIUS_M, "v_BN_N": 7616.5, "semi_major_axis": RADIUS_M}
STATION_PROPERTIES = ("r_LP_P", "opportunity_open", "opportunity_mid", "opportunity_close", "target_angle")
# The rate and the Hill frame are functions of a target, and raise an error for a ground station.
TARGET_PROPERTIES = ("priority", *STATION_PROPERTIES, "target_angle_rate", "r_LB_H")


def satellite_properties() -> Component:
    """Observes every property, some of them with a norm and a module."""
    dynamics = [{"prop": name} | ({"norm": NORMS[name]} if name in NORMS else {}) for name in DYNAMICS]
    fsw = [{"prop": "c_hat_P"}, {"prop": "c_hat_H", "module": "fsw", "name": "boresight"}]
    return component("SatProperties", properties=dynamics + fsw)


def opportunity_properties(names: tuple[str, ...], kind: str) -> Component:
    """Observes properties of two upcoming windows of a kind."""
    lengths = {"r_LP_P": RADIUS_M, "r_LB_H": 8e5}
    properties = [{"prop": name} | ({"norm": lengths[name]} if name in lengths else {}) for name in names]
    return component("OpportunityProperties", properties=properties, type=kind, n_ahead_observe=2)


EPISODES = (
    Episode(
        name="all_observations",
        seed=3,
        cls="SatelliteTasking",
        satellites=(
            imager(
                "EO",
                args={"oe": lambda: random_orbit(a=6900.0, e=0.004, i=75.0), "maxWheelSpeed": 6000.0, "dataStorageCapacity": 4e8},
                actions=(
                    component("Image", n_ahead_image=5),
                    component("Charge", duration=100.0),
                    component("Downlink", duration=80.0),
                    component("Desat", duration=60.0),
                ),
                observations=(
                    satellite_properties(),
                    opportunity_properties(TARGET_PROPERTIES, "target"),
                    opportunity_properties(STATION_PROPERTIES, "ground_station"),
                    component("Time"),
                    component("Time", norm=100.0, name="remaining", observe_time_remaining=True),
                    component("Eclipse", norm=ORBIT_S),
                ),
            ),
        ),
        scenario=component("UniformTargets", n_targets=400),
        rewarders=UNIQUE_IMAGES,
        policy=RandomPolicy(weights={"Image": 3.0}),
        max_steps=50,
        env={"time_limit": ORBIT_S},
    ),
)
