"""Programs that observe and act."""

from __future__ import annotations

import numpy as np
from parts import IMAGER_ARGS, ORBIT_S, Imager, constellation, fly, imagers, images
from peer import (
    GeneralSatelliteTasking,
    SatelliteTasking,
    act,
    data,
    dyn,
    fsw,
    obs,
    orbital,
    sats,
    scene,
)

STATE = ["sigma_BN", "BN", "omega_BN_B", "BP", "HN", "r_BN_N", "r_BN_P", "v_BN_N", "v_BN_P", "omega_BP_P", "omega_BH_H"]
ORBIT = [
    "semi_major_axis",
    "eccentricity",
    "inclination",
    "ascending_node",
    "argument_of_periapsis",
    "true_anomaly",
]
RESOURCES = ["battery_charge", "battery_charge_fraction", "wheel_speeds", "wheel_speeds_fraction", "storage_level"]
OTHERS = ["beta_angle", "storage_level_fraction", "c_hat_P", "c_hat_H", "panel_angle", "messages"]
PROPERTIES = STATE + ORBIT + RESOURCES + OTHERS
WINDOW = ["opportunity_open", "opportunity_mid", "opportunity_close"]
PRESETS = ["priority", "r_LP_P", "r_LB_H", *WINDOW, "target_angle", "target_angle_rate"]


class ReadingDynamics(dyn.FullFeaturedDynModel):
    @property
    def panel_angle(self):
        spice = self.world.gravFactory.spiceObject
        sun = np.array(spice.planetStateOutMsgs[self.world.sun_index].read().PositionVector)
        normal = np.transpose(self.BN) @ self.satellite.sat_args["nHat_B"]
        return np.arccos(np.dot(normal, sun / np.linalg.norm(sun)))

    @property
    def messages(self):
        earth = self.world.gravFactory.spiceObject.planetStateOutMsgs[self.world.body_index].read()
        storage = self.storageUnit.storageUnitDataOutMsg.read()
        return [
            *np.ravel(earth.J20002Pfix),
            *(np.ravel(earth.J20002Pfix_dot) * 1e4),
            *(np.array(self.world.omega_PN_N) * 1e4),
            *self.scObject.scStateOutMsg.read().v_BN_N,
            self.powerMonitor.batPowerOutMsg.read().storageLevel,
            storage.storageLevel + storage.storedData[0],
            self.rwStateEffector.rwSpeedOutMsg.read().wheelSpeeds[1],
            self.simulator.sim_time,
        ]


def all_observations(seed):
    class Observer(sats.ImagingSatellite):
        observation_spec = [
            obs.SatProperties(*[dict(prop=name) for name in PROPERTIES]),
            obs.SatProperties(dict(prop="known", fn=lambda item: len(item.known_targets), norm=10.0)),
            obs.Time(norm=100.0),
            obs.Time(observe_time_remaining=True, name="left"),
            obs.OpportunityProperties(
                *[dict(prop=name) for name in PRESETS],
                dict(name="twice", fn=lambda item, opportunity: opportunity["object"].priority * 2.0),
                n_ahead_observe=2,
            ),
            obs.OpportunityProperties(dict(prop="r_LP_P", norm=1e6), type="ground_station", n_ahead_observe=2),
            obs.OpportunityProperties(
                dict(prop="opportunity_open", norm=ORBIT_S), type=["target", "ground_station"], n_ahead_observe=2, name="both"
            ),
            obs.Eclipse(norm=ORBIT_S),
            obs.Time(),
        ]
        action_spec = [act.Image(n_ahead_image=2), act.Charge(duration=60.0), act.Downlink(duration=60.0)]
        dyn_type = ReadingDynamics
        fsw_type = fsw.SteeringImagerFSWModel

    args = IMAGER_ARGS | {"oe": lambda: orbital.random_orbit(i=50.0, e=0.01)}
    env = SatelliteTasking(
        Observer("A", args),
        scenario=scene.UniformTargets(1500),
        rewarder=data.UniqueImageReward(),
        time_limit=6000.0,
        log_level="CRITICAL",
    )
    records = fly(env, seed, 6)
    return [*records, [str(name) for name in env.satellite.observation_description], env.satellite.action_description]


class Clock(obs.Observation):
    def get_obs(self):
        return np.array([self.simulator.sim_time, self.satellite.dynamics.beta_angle])


class Doubled(obs.SatProperties):
    def get_obs(self):
        return {name: 2.0 * value for name, value in super().get_obs().items()}


def own_observations(seed):
    class Observer(sats.ImagingSatellite):
        observation_spec = [
            Clock("clock"),
            Doubled(dict(prop="battery_charge_fraction"), dict(prop="c_hat_P", module="fsw")),
            obs.SatProperties(dict(prop="r_BN_P", norm=np.array([1e6, 2e6, 3e6]), name="place")),
            obs.OpportunityProperties(dict(fn=lambda item, opportunity: opportunity["window"][1] / ORBIT_S), n_ahead_observe=2),
        ]
        action_spec = Imager.action_spec
        dyn_type = dyn.FullFeaturedDynModel
        fsw_type = fsw.SteeringImagerFSWModel

    env = constellation(GeneralSatelliteTasking, imagers(1, Observer), dtype=np.float32)
    records = fly(env, seed, 4)
    return [*records, [str(name) for name in env.satellites[0].observation_description], str(env.observation_space)]


def all_actions(seed):
    class Busy(sats.ImagingSatellite):
        observation_spec = [obs.SatProperties(dict(prop="battery_charge_fraction"), dict(prop="sigma_BN"))]
        action_spec = [
            act.Image(n_ahead_image=2, max_duration=100.0),
            act.Charge(duration=60.0),
            act.Downlink(duration=70.0),
            act.Desat(duration=60.0),
            act.NadirPoint(duration=50.0),
            act.Drift(duration=20.0),
            act.DiscreteFSWAction("action_charge", name="sun", duration=30.0, reset_task=True),
        ]
        dyn_type = (dyn.GroundStationDynModel, dyn.LOSCommDynModel)
        fsw_type = (fsw.SteeringFSWModel, fsw.ImagingFSWModel)

    env = SatelliteTasking(
        Busy("busy", IMAGER_ARGS, obs_type=list),
        scenario=scene.UniformTargets(1500),
        rewarder=data.UniqueImageReward(),
        max_step_duration=65.0,
        log_level="CRITICAL",
    )
    return [*fly(env, seed, 25, images), env.satellite.action_description]


def targets_by_object_and_id(seed):
    env = constellation(GeneralSatelliteTasking, imagers(2))
    rng = np.random.default_rng(seed)
    records = [env.reset(seed=seed)[0]]
    for step in range(8):
        actions = []
        for satellite in env.satellites:
            found = satellite.find_next_opportunities(6, types="target")
            target = found[int(rng.integers(6))]["object"]
            actions.append((target if step % 2 else target.id) if satellite.requires_retasking else None)
        records.append([*env.step(actions), images(env)])
    return records


PROGRAMS = [all_observations, own_observations, all_actions, targets_by_object_and_id]
