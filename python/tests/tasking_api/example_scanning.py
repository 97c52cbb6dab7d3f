"""Prints a line a step of the scanning environment of Stephenson and Schaub (2024): action, reward, ends, storage, battery."""

import numpy as np

from sparring.tasking import SatelliteTasking, act, data, obs, sats, scene
from sparring.tasking.sim import dyn, fsw


class ScanningDownlinkDynModel(dyn.ContinuousImagingDynModel, dyn.GroundStationDynModel):
    @property
    def instrument_pointing_error(self) -> float:
        down = -self.r_BN_P / np.linalg.norm(self.r_BN_P)
        return np.arccos(np.dot(down, self.satellite.fsw.c_hat_P))

    @property
    def solar_pointing_error(self) -> float:
        sun = self.world.gravFactory.spiceObject.planetStateOutMsgs[self.world.sun_index].read().PositionVector
        normal = np.transpose(self.BN) @ self.satellite.sat_args["nHat_B"]
        return np.arccos(np.dot(normal, sun / np.linalg.norm(sun)))


class ScanningSatellite(sats.AccessSatellite):
    observation_spec = [
        obs.SatProperties(
            dict(prop="storage_level_fraction"),
            dict(prop="battery_charge_fraction"),
            dict(prop="wheel_speeds_fraction"),
            dict(prop="instrument_pointing_error", norm=np.pi),
            dict(prop="solar_pointing_error", norm=np.pi),
        ),
        obs.OpportunityProperties(
            dict(prop="opportunity_open", norm=5700.0),
            dict(prop="opportunity_close", norm=5700.0),
            type="ground_station",
            n_ahead_observe=1,
        ),
        obs.Eclipse(norm=5700.0),
        obs.Time(),
    ]
    action_spec = [act.Scan(duration=180.0), act.Charge(duration=120.0), act.Downlink(duration=60.0), act.Desat(duration=60.0)]
    dyn_type = ScanningDownlinkDynModel
    fsw_type = fsw.ContinuousImagingFSWModel


sat_args = dict(
    dataStorageCapacity=5000 * 8e6,
    storageInit=lambda: int(np.random.uniform(0.0, 0.8) * 5000 * 8e6),
    instrumentBaudRate=0.5 * 8e6,
    transmitterBaudRate=-50 * 8e6,
    batteryStorageCapacity=200 * 3600,
    storedCharge_Init=lambda: np.random.uniform(0.3, 1.0) * 200 * 3600,
    basePowerDraw=-10.0,
    instrumentPowerDraw=-30.0,
    transmitterPowerDraw=-25.0,
    thrusterPowerDraw=-80.0,
    panelArea=0.25,
    imageAttErrorRequirement=0.1,
    imageRateErrorRequirement=0.1,
    disturbance_vector=lambda: np.random.normal(scale=0.0001, size=3),
    maxWheelSpeed=6000.0,
    wheelSpeeds=lambda: np.random.uniform(-3000, 3000, 3),
    desatAttitude="nadir",
)

env = SatelliteTasking(
    satellite=ScanningSatellite("Scanner_1", sat_args=sat_args),
    scenario=scene.UniformNadirScanning(value_per_second=1 / (5 * 5700.0)),
    rewarder=data.ScanningTimeReward(),
    time_limit=5 * 5700.0,
    failure_penalty=-1.0,
    terminate_on_time_limit=True,
    log_level="WARNING",
)
observation, info = env.reset(seed=42)
print("start", np.round(observation, 4).tolist())
choose = np.random.default_rng(7)
for step in range(60):
    action = int(choose.choice(4, p=[0.4, 0.4, 0.15, 0.05]))
    observation, reward, terminated, truncated, info = env.step(action)
    print(
        step,
        action,
        round(float(reward), 9),
        terminated,
        truncated,
        round(float(observation[0]), 6),
        round(float(observation[1]), 5),
        info["d_ts"],
    )
    if terminated or truncated:
        break
